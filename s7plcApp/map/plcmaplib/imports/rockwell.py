"""Exports of Studio 5000: tag CSV, L5K, L5X. They have no offsets; the tag is the place."""
import re

from ..problems import Place, Refused
from ..sheets import csv_rows
from ..types import Array, ELEMENTARY, Named, Text
from .common import Source
from .tia import children, child_text, local

TYPES = {"BOOL": "BOOL", "BIT": "BOOL", "SINT": "SINT", "INT": "INT", "DINT": "DINT",
         "LINT": "LINT", "USINT": "USINT", "UINT": "UINT", "UDINT": "UDINT", "ULINT": "ULINT",
         "REAL": "REAL", "LREAL": "LREAL"}
KEYS = {"wire": "etherip", "family": "none"}
STRING_LENGTH = 82  # of the predefined STRING


def _members(text):
    """[(field, type, comment, at, line)] of "PRE:DINT ACC:DINT"."""
    return [(n, ELEMENTARY[t], "", None, 0) for n, t in (w.split(":") for w in text.split())]


PREDEFINED = {  # as clients can name their members
    "TIMER": _members("PRE:DINT ACC:DINT EN:BOOL TT:BOOL DN:BOOL"),
    "COUNTER": _members("PRE:DINT ACC:DINT CU:BOOL CD:BOOL DN:BOOL OV:BOOL UN:BOOL"),
    "CONTROL": _members("LEN:DINT POS:DINT EN:BOOL EU:BOOL DN:BOOL EM:BOOL ER:BOOL UL:BOOL IN:BOOL "
                        "FD:BOOL")}


def _with_predefined(source):
    for name, fields in PREDEFINED.items():
        source.types.setdefault(name, list(fields))
    return source


def unescape(text):
    """$-escapes: $N new line, $T, $Q ", $' ', $$ $, $D55C one character."""
    def one(m):
        code = m.group(1)
        simple = {"N": " ", "L": " ", "P": " ", "R": " ", "T": " ", "Q": '"', "'": "'", "$": "$"}
        if code.upper() in simple:
            return simple[code.upper()]
        return chr(int(code, 16)) if len(code) == 4 and not 0xD800 <= int(code, 16) < 0xE000 else "?"
    return re.sub(r"\$([0-9A-Fa-f]{4}|.)", one, text)


def rockwell_type(name, dimensions):
    """A type from its name and [lengths]."""
    upper = name.upper()
    if upper == "STRING":
        kind = Text(STRING_LENGTH)
    elif upper in TYPES:
        kind = ELEMENTARY[TYPES[upper]]
    else:
        kind = Named(name)
    lengths = [int(d) for d in dimensions if d and int(d)]
    return Array([(0, n - 1) for n in lengths], kind) if lengths else kind


def _split_type(text):
    """DINT[3,4] -> (DINT, [3, 4])"""
    m = re.match(r"^\s*([\w:]+)\s*(?:\[\s*([\d,\s]*)\])?\s*$", text)
    if not m:
        return None
    dims = [d.strip() for d in (m.group(2) or "").split(",") if d.strip()]
    if any(len(d) > 6 for d in dims):
        return None
    return m.group(1), dims


def is_csv(text):
    return re.search(r"^TYPE[,\t]SCOPE[,\t]NAME[,\t]DESCRIPTION[,\t]DATATYPE", text[:20000],
                     re.M) is not None


def read_csv(text, path, report):
    """TAG rows; COMMENT rows describe members; ALIAS rows have the target in SPECIFIER."""
    source = Source("Rockwell tag CSV", **KEYS)
    head = re.search(r"^TYPE([,\t])SCOPE", text, re.M)
    columns, aliases = None, 0
    for number, cells in csv_rows(text, head.group(1), path):
        cells = [c.strip() for c in cells]
        if columns is None:
            if cells[:3] == ["TYPE", "SCOPE", "NAME"]:
                columns = {c: i for i, c in enumerate(cells)}
                for name in ("DESCRIPTION", "DATATYPE", "SPECIFIER"):
                    if name not in columns:
                        raise Refused("the column %s is missing" % name, Place(path, number))
            continue
        if not any(cells):
            continue
        row = {c: cells[i] if i < len(cells) else "" for c, i in columns.items()}
        place = Place(path, number)
        if row["TYPE"] == "ALIAS":
            aliases += 1
        elif row["TYPE"].startswith("COMMENT"):
            scope = "Program:%s." % row["SCOPE"] if row["SCOPE"] else ""
            _comment(source, scope + row.get("SPECIFIER", ""), row["DESCRIPTION"])
        elif row["TYPE"] == "TAG":
            _tag(source, row["NAME"], row["SCOPE"], row["DATATYPE"],
                 unescape(row["DESCRIPTION"]), place, report)
        elif not re.match(r"^(R?COMMENT|TEXTBOX|ROUTINE)(:|$)|^remark$", row["TYPE"]):
            report.warning(place, None, 'a row "%s": left out' % row["TYPE"][:30])
    source.left_out += aliases
    return _with_predefined(source)


def _comment(source, operand, text):
    """The description of a member of a tag."""
    source.comments[operand.upper()] = " ".join(unescape(text).split())


def _tag(source, name, scope, text, description, place, report):
    found = _split_type(text)
    if not found or not name:
        report.warning(place, None, '"%s": type "%s" is not known: left out' % (name, text[:40]))
        return
    if ":" in found[0] or ":" in name:  # of a module: I, O and C of its own
        source.left_out += 1
        return
    tag = "Program:%s.%s" % (scope, name) if scope else name
    try:
        kind = rockwell_type(*found)
    except ValueError:
        report.warning(place, None, '"%s": bounds "%s": left out' % (name, text[:40]))
        return
    source.add(tag, tag, kind, description, place)


# --- L5X -------------------------------------------------------------------------------------

def read_l5x(root, path, report):
    source = Source("Rockwell L5X", **KEYS)
    controller = next((e for e in root.iter() if local(e.tag) == "Controller"), None)
    if controller is None:
        raise Refused("an L5X without a controller", Place(path))
    for types in children(controller, "DataTypes"):
        for kind in children(types, "DataType"):
            _l5x_type(source, kind, path, report)
    for definitions in children(controller, "AddOnInstructionDefinitions"):
        for kind in children(definitions, "AddOnInstructionDefinition"):
            _l5x_instruction(source, kind, path, report)
    for tags in children(controller, "Tags"):
        _l5x_tags(source, tags, "", path, report)
    for programs in children(controller, "Programs"):
        for program in children(programs, "Program"):
            for tags in children(program, "Tags"):
                _l5x_tags(source, tags, program.get("Name", ""), path, report)
    return _with_predefined(source)


def _l5x_type(source, kind, path, report):
    """Members; hidden ones hold the bits of others."""
    fields = []
    name = kind.get("Name", "")
    if kind.get("Family") == "StringFamily":
        source.types[name] = [("", Text(STRING_LENGTH), "", None, 0)]
        return
    for members in children(kind, "Members"):
        for member in children(members, "Member"):
            if member.get("Hidden") == "true":
                continue
            dimension = member.get("Dimension", "0")
            if not dimension.isdigit():
                report.warning(Place("%s: type %s" % (path, name)), None,
                               '"%s" is no dimension: left out' % dimension)
                continue
            fields.append((member.get("Name", ""),
                           rockwell_type(member.get("DataType", "?"), [dimension]),
                           child_text(member, "Description"), None, 0))
    source.types[name] = fields


def _l5x_instruction(source, kind, path, report):
    """The tag of an instruction: its inputs and outputs; what is passed by reference is elsewhere."""
    name, fields = kind.get("Name", ""), []
    for parameters in children(kind, "Parameters"):
        for p in children(parameters, "Parameter"):
            if p.get("Usage") not in ("Input", "Output") or p.get("TagType") == "Alias":
                continue
            found = _split_type("%s[%s]" % (p.get("DataType", ""), p.get("Dimensions", ""))
                                if p.get("Dimensions") else p.get("DataType", ""))
            if not found:
                report.warning(Place("%s: instruction %s" % (path, name)), None,
                               '"%s": no type that is known: left out' % p.get("Name", ""))
                continue
            fields.append((p.get("Name", ""), rockwell_type(*found), child_text(p, "Description"),
                           None, 0))
    source.types[name] = fields


def _l5x_tags(source, tags, scope, path, report):
    for tag in children(tags, "Tag"):
        name = tag.get("Name", "")
        if tag.get("TagType") == "Alias" or "DataType" not in tag.attrib:
            source.left_out += 1
            continue
        dims = re.split(r"[\s,]+", tag.get("Dimensions", ""))
        text = tag.get("DataType") + ("[%s]" % ",".join(d for d in dims if d) if any(dims) else "")
        _tag(source, name, scope, text, child_text(tag, "Description"),
             Place("%s: tag %s" % (path, name)), report)
        full = "Program:%s.%s" % (scope, name) if scope else name
        for comments in children(tag, "Comments"):
            for comment in children(comments, "Comment"):
                _comment(source, full + comment.get("Operand", ""), comment.text or "")


# --- L5K -------------------------------------------------------------------------------------

def is_l5k(text):
    return re.search(r"^\s*IE_VER\s*:=", text[:20000], re.M) is not None and "CONTROLLER" in text


_L5K = re.compile(r"""(?P<space>\s+|\(\*.*?\*\)) | (?P<string>"(?:[^"$]|\$.)*") |
    (?P<quoted>'(?:[^'$]|\$.)*') | (?P<sign>:=|[(),;]) | (?P<word>(?:(?!:=)[\w:.&\\-]|\[[^\]]*\])+)
    | (?P<other>.)""", re.X | re.S)


def _tokens(text):
    found, line, at = [], 1, 0
    while at < len(text):
        m = _L5K.match(text, at)
        if m.lastgroup != "space":
            found.append((m.lastgroup, m.group(), line))
        line += m.group().count("\n")
        at = m.end()
    found.append(("end", "", line))
    return found


class _L5kReader:
    def __init__(self, text, path, report):
        self.tokens, self.at = _tokens(text), 0
        self.path, self.report = path, report
        self.source = Source("Rockwell L5K", **KEYS)
        self.scope = ""

    def peek(self):
        return self.tokens[self.at][1]

    def next(self):
        token = self.tokens[self.at]
        if token[0] != "end":
            self.at += 1
        return token

    def place(self):
        return Place(self.path, self.tokens[self.at][2])

    def ended(self):
        return self.tokens[self.at][0] == "end"

    def run(self):
        while not self.ended():
            word = self.next()[1]
            if word == "DATATYPE":
                self.datatype()
            elif word == "TAG":
                self.tags()
            elif word == "PROGRAM":
                self.scope = self.next()[1]
                self.attributes()
            elif word == "END_PROGRAM":
                self.scope = ""
            elif word == "ADD_ON_INSTRUCTION_DEFINITION":
                self.instruction()
            elif word in ("MODULE", "ROUTINE", "ENCODED_DATA"):
                end = "END_" + word
                while not self.ended() and self.peek() != end:
                    self.next()
        return self.source

    def attributes(self, tag=""):
        """( Description := "...", COMMENT.member := "..." ): the description; or ''."""
        found = ""
        if self.peek() != "(":
            return found
        self.next()
        depth, last = 1, ""
        while depth and not self.ended():
            kind, word, _ = self.next()
            depth += {"(": 1, ")": -1}.get(word, 0) if kind == "sign" else 0
            if kind == "string" and last == "Description":
                found = unescape(word[1:-1])
            elif kind == "string" and tag and last.startswith("COMMENT"):
                _comment(self.source, tag + last[len("COMMENT"):], word[1:-1])
            if kind == "word":
                last = word
            elif word == ",":
                last = ""
        return found

    def datatype(self):
        """TYPE name[dim] (..); BIT name host : bit (..);"""
        name = self.next()[1]
        start = self.at
        self.attributes()
        is_text = any(t[1] == "StringFamily" for t in self.tokens[start:self.at])
        fields = []
        while not self.ended() and self.peek() != "END_DATATYPE":
            place = self.place()
            kind = self.next()[1]
            field = self.next()[1]
            if kind == "BIT":
                for _ in range(3):  # host : bit
                    self.next()
            begin = self.at
            text = self.attributes()
            hidden = any(t[1] == "Hidden" for t in self.tokens[begin:self.at])
            if self.next()[1] != ";":
                raise Refused("; expected after %s" % field[:40], place)
            found = _split_type("%s%s" % (kind, field[field.index("["):] if "[" in field else ""))
            if not found:
                self.report.warning(place, None, '"%s %s" is no member: left out'
                                    % (kind[:30], field[:30]))
            elif not hidden:
                fields.append((field.split("[")[0], rockwell_type(*found), text, None, place.line))
        self.next()
        self.source.types[name] = [("", Text(STRING_LENGTH), "", None, 0)] if is_text else fields

    def instruction(self):
        """PARAMETERS name : TYPE (Usage := Input ...); ... END_PARAMETERS, then its code"""
        name, fields = self.next()[1], []
        self.attributes()
        while not self.ended() and self.peek() not in ("PARAMETERS", "END_ADD_ON_INSTRUCTION_DEFINITION"):
            self.next()
        if self.peek() == "PARAMETERS":
            self.next()
        while not self.ended() and self.peek() not in ("END_PARAMETERS",
                                                       "END_ADD_ON_INSTRUCTION_DEFINITION"):
            place, field = self.place(), self.next()[1]
            colon, found, begin = self.next()[1], None, self.at
            if colon == ":":
                found = _split_type(self.next()[1])
                begin = self.at
                text = self.attributes()
            usage = {t[1] for t in self.tokens[begin:self.at]} & {"Input", "Output"}
            self._to_semicolon()
            if found and usage:
                fields.append((field, rockwell_type(*found), text, None, place.line))
        while not self.ended() and self.peek() != "END_ADD_ON_INSTRUCTION_DEFINITION":
            self.next()
        self.source.types[name] = fields

    def tags(self):
        """name : TYPE[dims] (..) := value;   name OF target: an alias"""
        while not self.ended() and self.peek() != "END_TAG":
            place = self.place()
            name = self.next()[1]
            word = self.next()[1]
            if word == "OF":
                self.source.left_out += 1
                self._to_semicolon()
                continue
            if word != ":":
                raise Refused('":" expected after the tag %s, not "%s"' % (name[:40], word[:20]),
                              place)
            kind = self.next()[1]
            text = self.attributes("Program:%s.%s" % (self.scope, name) if self.scope else name)
            self._to_semicolon()
            _tag(self.source, name, self.scope, kind, text, place, self.report)
        self.next()

    def _to_semicolon(self):
        while not self.ended() and self.peek() != ";":
            self.next()
        self.next()


def read_l5k(text, path, report):
    return _with_predefined(_L5kReader(text, path, report).run())
