"""TwinCAT's .tmc, CODESYS's symbol configuration, PLCopen XML. Their variables are symbols; the
layout that these files tell is that of another wire, so the map gives places of its own."""
import re

from ..problems import Place, Refused
from ..types import (Array, ELEMENTARY, MAX_COUNT, Named, Struct, Text, TypeProblem, parse_type)
from .common import Source
from .tia import children, child_text, local

_POINTER = re.compile(r"\b(POINTER|REFERENCE)\s+TO\b|^PVOID$|^ITF", re.I)


def iec_type(text):
    """A type in IEC spelling; None for pointers and references."""
    if _POINTER.search(text):
        return None
    try:
        return parse_type(re.sub(r"\s+", " ", text.strip()))
    except TypeProblem:
        return None


def _array(kind, bounds):
    """An array of at most MAX_COUNT elements, or None."""
    if kind is None or not bounds:
        return kind
    array = Array(bounds + kind.bounds, kind.element) if isinstance(kind, Array) else \
        Array(bounds, kind)
    return array if all(b >= a for a, b in array.bounds) and array.count() <= MAX_COUNT and \
        len(array.bounds) <= 6 else None


# --- TwinCAT -----------------------------------------------------------------------------------

def _bounds(element):
    """[(low, high)] of its ArrayInfo."""
    found = []
    for info in children(element, "ArrayInfo"):
        low, count = child_text(info, "LBound"), child_text(info, "Elements")
        if not re.match(r"^-?\d{1,9}$", low) or not re.match(r"^\d{1,9}$", count):
            return None
        found.append((int(low), int(low) + int(count) - 1))
    return found


def _tmc_type(element, tag):
    """The type of a SubItem or Symbol: its element `Type` or `BaseType`, and ArrayInfo."""
    for e in children(element, tag):
        if e.get("PointerTo") or e.get("ReferenceTo"):
            return None
        kind = iec_type((e.text or "").strip())
        bounds = _bounds(element)
        return None if bounds is None else _array(kind, bounds)
    return None


def read_tmc(root, path, report):
    source = Source("TwinCAT .tmc", family="codesys")
    for types in children(root, "DataTypes"):
        for kind in children(types, "DataType"):
            _tmc_datatype(source, kind, path, report)
    _drop_unknown(source, path, report)
    symbols = [s for s in root.iter() if local(s.tag) == "Symbol"]
    for symbol in symbols:
        name = child_text(symbol, "Name")
        place = Place("%s: symbol %s" % (path, name))
        kind = _tmc_type(symbol, "BaseType")
        if kind is None or not name:
            report.warning(place, None, "a pointer, or no type that is known: left out")
            continue
        source.add(name, name, kind, child_text(symbol, "Comment"), place)
    if not symbols and not source.types:
        raise Refused("neither symbols nor types", Place(path))
    return source


def _drop_unknown(source, path, report):
    """Fields of types that the file does not have: the others can be used without them."""
    known = {name.upper() for name in source.types}
    for name, fields in source.types.items():
        for field in list(fields):
            kind = field[1].element if isinstance(field[1], Array) else field[1]
            if isinstance(kind, Named) and kind.name.upper() not in known and field[0]:
                report.warning(Place("%s: type %s" % (path, name)), None, '%s: unknown type "%s": '
                               "left out" % (field[0], kind.name))
                fields.remove(field)


def _tmc_datatype(source, kind, path, report):
    name = child_text(kind, "Name")
    items = children(kind, "SubItem")
    if not items:
        base = _tmc_type(kind, "BaseType")
        if children(kind, "EnumInfo") and base is None:
            base = ELEMENTARY["INT"]
        if base is not None and name:
            source.types[name] = [("", base, "", None, 0)]
        return
    fields = []
    for item in items:
        field = _tmc_type(item, "Type")
        if field is None:
            report.warning(Place("%s: type %s" % (path, name)), None, "%s: a pointer, or no type "
                           "that is known: left out" % child_text(item, "Name"))
            continue
        fields.append((child_text(item, "Name"), field, child_text(item, "Comment"), None, 0))
    source.types[name] = fields


# --- CODESYS -----------------------------------------------------------------------------------

def read_codesys(root, path, report):
    """TypeList and nested nodes; a type has an own name, iecname is what it is."""
    source = Source("CODESYS symbol configuration", family="codesys")
    kinds = {}
    for types in children(root, "TypeList"):
        for kind in types:
            _codesys_type(source, kinds, kind, path, report)
    for nodes in children(root, "NodeList"):
        for node in children(nodes, "Node"):
            _node(source, kinds, node, "", path, report, 0)
    return source


def _codesys_type(source, kinds, kind, path, report):
    name, iec = kind.get("name", ""), kind.get("iecname", "")
    tag = local(kind.tag)
    place = Place("%s: type %s" % (path, iec or name))
    if tag == "TypeSimple":
        size = kind.get("size", "")
        kinds[name] = Text(int(size) - 1) if iec.upper().startswith("STRING") and \
            size.isdigit() and 2 <= int(size) <= 255 else iec_type(iec)
    elif tag == "TypeArray":
        bounds = []
        for dim in children(kind, "ArrayDim"):
            low, high = dim.get("minrange", ""), dim.get("maxrange", "")
            if not re.match(r"^-?\d{1,9}$", low) or not re.match(r"^-?\d{1,9}$", high):
                report.warning(place, None, "bounds that are no numbers: left out")
                return
            bounds.append((int(low), int(high)))
        base = kinds.get(kind.get("basetype"))
        kinds[name] = _array(base, bounds) if base is not None else None
    elif tag == "TypeUserDef":
        fields = []
        for element in children(kind, "UserDefElement"):
            field = kinds.get(element.get("type"))
            if field is None:
                report.warning(place, None, '%s: type "%s" is not known: left out' % (
                    element.get("iecname"), element.get("type")))
                continue
            fields.append((element.get("iecname", ""), field, child_text(element, "Comment"), None,
                           0))
        if kind.get("typeclass") == "Enum" or not fields:
            kinds[name] = ELEMENTARY["INT"] if kind.get("typeclass") == "Enum" else None
            return
        source.types[iec or name] = fields
        kinds[name] = Named(iec or name)


def _node(source, kinds, node, before, path, report, depth):
    name = before + node.get("name", "")
    if depth > 40:
        raise Refused("more than 40 levels", Place(path))
    if node.get("type"):
        kind = kinds.get(node.get("type"))
        place = Place("%s: node %s" % (path, name))
        if kind is None:
            report.warning(place, None, 'type "%s" is not known: left out' % node.get("type"))
        else:
            source.add(name.split(".", 1)[1] if depth > 1 and "." in name else name,
                       name.split(".", 1)[1] if depth > 1 and "." in name else name,
                       kind, child_text(node, "Comment"), place)
        return
    for inner in children(node, "Node"):
        _node(source, kinds, inner, name + ".", path, report, depth + 1)


# --- PLCopen -----------------------------------------------------------------------------------

def _plcopen_type(element, depth=0):
    """The type inside <type> or <baseType>."""
    if depth > 40:
        return None
    for e in element:
        name = local(e.tag)
        if name == "derived":
            return Named(e.get("name", "?"))
        if name in ("string", "wstring"):
            length = e.get("length", "80")
            ok = length.isdigit() and 1 <= int(length) <= 254
            return Text(int(length), name == "wstring") if ok else None
        if name == "array":
            bounds = []
            for dim in children(e, "dimension"):
                low, high = dim.get("lower", ""), dim.get("upper", "")
                if not re.match(r"^-?\d{1,9}$", low) or not re.match(r"^-?\d{1,9}$", high):
                    return None
                bounds.append((int(low), int(high)))
            inner = next(iter(children(e, "baseType")), None)
            return _array(_plcopen_type(inner, depth + 1), bounds) if inner is not None else None
        if name == "struct":
            fields = []
            for v in children(e, "variable"):
                kind = next((_plcopen_type(t, depth + 1) for t in children(v, "type")), None)
                if kind is not None:
                    fields.append((v.get("name", ""), kind, "", None, 0))
            return Struct(fields)
        if name == "enum":
            return ELEMENTARY["INT"]
        return iec_type(name)
    return None


def read_plcopen(root, path, report):
    source = Source("PLCopen XML", family="codesys")
    for kind in root.iter():
        if local(kind.tag) == "dataType":
            for base in children(kind, "baseType"):
                type_ = _plcopen_type(base)
                if isinstance(type_, Struct):
                    source.types[kind.get("name", "")] = type_.fields
                elif type_ is not None:
                    source.types[kind.get("name", "")] = [("", type_, "", None, 0)]
    for holder in root.iter():
        if local(holder.tag) not in ("globalVars", "localVars"):
            continue
        for v in children(holder, "variable"):
            name = v.get("name", "")
            kind = next((_plcopen_type(t) for t in children(v, "type")), None)
            place = Place("%s: variable %s" % (path, name))
            if kind is None:
                report.warning(place, None, "no type that is known: left out")
                continue
            source.add(name, name, kind, "", place)
    if not source.items and not source.types:
        hidden = any("MWT" in (e.get("id") or "") for e in root.iter())
        raise Refused("no types and no variables%s" % (
            ": a worksheet of PC WORX with its declarations as HTML; export them as .IEC"
            if hidden else ""), Place(path))
    return source
