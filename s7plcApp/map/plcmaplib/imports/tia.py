"""Exports of TIA Portal: tag tables as workbook and XML, Openness XML of tags, data blocks and
types."""
import xml.etree.ElementTree as ET

from ..problems import Place, Refused
from ..sheets import clean
from ..types import Named, Struct, TypeProblem, parse_type
from .common import Source, add_symbol, once, whole_row

TAG_COLUMNS = ("Name", "Data Type", "Logical Address")


def local(tag):
    """An element's name without its namespace."""
    return tag.rsplit("}", 1)[-1] if isinstance(tag, str) else ""


def children(element, name):
    return [e for e in element if local(e.tag) == name]


def child_text(element, name):
    for e in element:
        if local(e.tag) == name:
            return (e.text or "").strip()
    return ""


def find_tags(cells):
    """The sheets of a workbook that are tables of tags: [(tab, header, rows)]."""
    return [(tab, [clean(c) for c in rows[0][1]], rows[1:]) for tab, rows in cells.items()
            if rows and set(TAG_COLUMNS) <= {clean(c) for c in rows[0][1]}]


def read_workbook(cells, path, report):
    """All sheets such as `PLC Tags` of an .xlsx."""
    found = find_tags(cells)
    source = Source("TIA tag table (.xlsx%s)" % (
        ": " + ", ".join(tab for tab, _, _ in found) if len(found) > 1 else ""), family="tia")
    used = TAG_COLUMNS + ("Comment",)
    for tab, header, rows in found:
        once(header, used, Place(path, 1, 1, tab), report)
        columns = {name: number for number, name in enumerate(header, 1)}
        for line, texts in rows:
            row = {n: clean(texts[i - 1]) if i <= len(texts) else "" for n, i in columns.items()}
            place = Place(path, line, columns["Name"], tab)
            if any(row.values()) and whole_row(line, [columns[c] for c in used if c in columns],
                                               cells.lost[tab], place, report):
                comment = row.get("Comment", "")
                add_symbol(source, row["Name"], row["Logical Address"], row["Data Type"],
                           "" if comment == "''" else comment, place, report)
    return source


def read_tagtable(root, path, report):
    """<Tagtable> of <Tag type addr remark ...>name</Tag>"""
    source = Source("TIA tag table (.xml)", family="tia")
    for number, tag in enumerate(root.iter(), 0):
        if local(tag.tag) != "Tag":
            continue
        name = (tag.text or "").strip()
        place = Place("%s: tag %s" % (path, name or number))
        if not name or "addr" not in tag.attrib:
            report.warning(place, None, "a tag without name or addr: left out")
            continue
        add_symbol(source, name, tag.get("addr"), tag.get("type", ""), tag.get("remark", ""),
                   place, report)
    return source


def _texts(element):
    """A comment: English if there is one, else the first that is not empty."""
    found = {}
    for item in element.iter():
        if local(item.tag) == "AttributeList" and children(item, "Text"):
            text = child_text(item, "Text")
            if text:
                found[child_text(item, "Culture")] = text
    for culture in sorted(found):
        if culture.startswith("en"):
            return found[culture]
    return found[sorted(found)[0]] if found else ""


def read_openness(root, path, report):
    """A document with tag tables, data blocks and types."""
    source = Source("TIA Openness", family="tia")
    known = False
    for element in root.iter():
        name = local(element.tag)
        if name == "SW.Tags.PlcTag":
            known = True
            _tag(source, element, path, report)
        elif name in ("SW.Tags.PlcTagTable", "SW.Tags.PlcUserConstant"):
            known = True
        elif name in ("SW.Blocks.GlobalDB", "SW.Types.PlcStruct"):
            known = True
            _block(source, element, name, path, report)
    if not known:
        raise Refused("a document without PLC tags, data blocks and types; allowed: SW.Tags.PlcTag "
                      "SW.Blocks.GlobalDB SW.Types.PlcStruct", Place(path))
    return source


def _attributes(element):
    """{name: text} of its AttributeList."""
    for e in children(element, "AttributeList"):
        return e, {local(a.tag): (a.text or "").strip() for a in e}
    return None, {}


def _tag(source, element, path, report):
    _, attributes = _attributes(element)
    name = attributes.get("Name", "")
    place = Place("%s: tag %s" % (path, name or "?"))
    if not name or "LogicalAddress" not in attributes:
        report.warning(place, None, "a tag without name or address: left out")
        return
    add_symbol(source, name, attributes["LogicalAddress"], attributes.get("DataTypeName", ""),
               _texts(element), place, report)


def _block(source, element, kind, path, report):
    holder, attributes = _attributes(element)
    name = attributes.get("Name", "")
    place = Place("%s: block %s" % (path, name or "?"))
    if attributes.get("MemoryLayout", "Standard") != "Standard":
        report.error(place, None, "it has optimised access and so no offsets: set the block to "
                     "standard access")
        return
    sections = [s for s in holder.iter() if local(s.tag) == "Section"] if holder is not None else []
    fields = []
    for section in sections:
        if section.get("Name") in ("Static", "None", None):
            fields += _members(section, place, report, 0)
    if kind == "SW.Types.PlcStruct":
        source.types[name] = fields
        return
    number = attributes.get("Number", "")
    if number.isdigit():
        source.blocks[name] = int(number)
    source.add(name, "", Struct(fields), "", place)


def _members(element, place, report, depth):
    """[(name, type, comment, at, line)] of nested members."""
    found = []
    if depth > 40:
        raise Refused("more than 40 levels", place)
    for member in children(element, "Member"):
        name, text = member.get("Name", ""), member.get("Datatype", "")
        inner = _members(member, place, report, depth + 1)
        try:
            if text.strip().upper() == "STRUCT":
                kind = Struct(inner)
            else:
                kind = parse_type(text.replace('"', "") if text.startswith('"') else
                                  text.replace("&quot;", "").replace('"', ""))
        except TypeProblem as e:
            report.error(place, None, "%s: %s" % (name, e))
            continue
        if inner and not isinstance(kind, Struct) and getattr(kind, "element", None) is not None \
                and str(kind.element).upper() == "STRUCT":
            kind.element = Struct(inner)
        comment = next((_multi(c) for c in children(member, "Comment")), "")
        found.append((name, kind, comment, None, 0))
    return found


def _multi(element):
    """The text of <MultiLanguageText Lang="en-US">."""
    texts = {e.get("Lang", ""): (e.text or "").strip() for e in element.iter()
             if local(e.tag) == "MultiLanguageText"}
    for lang in sorted(texts):
        if lang.startswith("en") and texts[lang]:
            return texts[lang]
    return next((texts[l] for l in sorted(texts) if texts[l]), "")


def parse_xml(data, path):
    """The root, or Refused with the line. No document type is read: none of these has one."""
    if b"<!DOCTYPE" in data[:4096] or b"<!ENTITY" in data:
        raise Refused("an XML with a document type: none of the forms that are known has one",
                      Place(path))
    try:
        return ET.fromstring(data)
    except ET.ParseError as e:
        line, column = getattr(e, "position", (None, None))
        raise Refused("no well-formed XML: %s" % str(e).split(":")[0],
                      Place(path, line, (column or 0) + 1)) from None
    except (ValueError, LookupError) as e:  # an encoding that is none
        raise Refused("no XML: %s" % e, Place(path)) from None


__all__ = ["read_workbook", "read_tagtable", "read_openness", "parse_xml", "find_tags", "local",
           "children", "child_text", "Named"]
