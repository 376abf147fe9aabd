"""Sources of data blocks and types: AWL and SCL of STEP 7, external sources of TIA Portal, and
the TYPE ... END_TYPE of IEC 61131-3. Offsets come from the layout rules (types.py)."""
import re

from ..problems import Place, Refused
from ..types import (Array, ELEMENTARY, Elementary, Named, Struct, Text, TypeProblem, ALIASES,
                     MAX_COUNT, MAX_TEXT, MAX_WTEXT)
from .common import Source

_TOKEN = re.compile(r"""
    (?P<space>[ \t\r\f\v\u00a0\ufeff]+) | (?P<line>\n)
  | (?P<comment>//[^\n]*) | (?P<block>\(\*.*?\*\)) | (?P<attribute>\{[^}]*\})
  | (?P<title>TITLE[ \t]*=[^\n]*)
  | (?P<name>"[^"\n]*"|\#?[^\W\d]\w*(?:\#[^\s;,\])]*)?)
  | (?P<text>'(?:[^'$\n]|\$.)*')
  | (?P<number>\d+(?:\.\d+)?(?![.\d]*\.\.)(?:[eE][+-]?\d+)?|\d+)
  | (?P<sign>:=|\.\.|.)""", re.X | re.S | re.I)
DEPTH = 40
_ATTRIBUTES = {"TITLE", "AUTHOR", "FAMILY", "NAME", "VERSION", "KNOW_HOW_PROTECT", "NON_RETAIN",
               "RETAIN", "UNLINKED", "READ_ONLY", "CODE_VERSION1", "STANDARD"}
_SECTIONS = ["VAR_INPUT", "VAR_OUTPUT", "VAR_IN_OUT", "VAR", "VAR_STAT"]


class Token:
    __slots__ = ("kind", "text", "line")

    def __init__(self, kind, text, line):
        self.kind = kind
        self.text = text
        self.line = line


def tokens(text):
    """All tokens but blanks; the last is the end."""
    found, line, at = [], 1, 0
    while at < len(text):
        m = _TOKEN.match(text, at)
        kind = m.lastgroup
        if kind in ("comment", "name", "text", "number", "sign", "attribute"):
            found.append(Token(kind, m.group(), line))
        line += m.group().count("\n")
        at = m.end()
    found.append(Token("end", "", line))
    return found


class Parser:
    """Reads a source. types: {name: [(field, type, comment, at)]}; blocks: [(name, kind, line,
    optimised)]; fbs: interfaces of function blocks."""

    def __init__(self, text, path):
        self.tokens = tokens(text)
        self.at = 0
        self.path = path
        self.types = {}
        self.type_lines = {}
        self.blocks = []
        self.fbs = {}

    # --- tokens ----------------------------------------------------------------------------

    def fail(self, what, token=None):
        token = token or self.peek()
        raise Refused('%s, not "%s"' % (what, token.text[:40] or "the end"),
                      Place(self.path, token.line))

    def _skip(self):
        while self.tokens[self.at].kind in ("comment", "attribute"):
            self.at += 1

    def peek(self):
        self._skip()
        return self.tokens[self.at]

    def word(self):
        return self.peek().text.upper()

    def next(self):
        token = self.peek()
        if token.kind != "end":
            self.at += 1
        return token

    def expect(self, text):
        if self.word() != text:
            self.fail("%s expected" % text)
        return self.next()

    def accept(self, text):
        if self.word() == text:
            self.next()
            return True
        return False

    def skip_to(self, *words):
        while self.peek().kind != "end" and self.word() not in words:
            self.next()

    def name(self):
        """A name, also UDT 1000 and DB 10."""
        token = self.next()
        if token.kind != "name":
            self.fail("a name expected", token)
        text = token.text
        if text.upper() in ("DB", "UDT", "FB", "SFB") and self.peek().kind == "number":
            text += self.next().text
        return text.strip('"#')

    # --- blocks ----------------------------------------------------------------------------

    def run(self):
        readers = {"TYPE": self.type_block, "DATA_BLOCK": self.data_block,
                   "FUNCTION_BLOCK": self.function_block}
        while self.peek().kind != "end":
            word = self.word()
            if word in readers:
                self.next()
                readers[word]()
            elif word in ("FUNCTION", "ORGANIZATION_BLOCK", "PROGRAM"):
                self.next()
                self.skip_to("END_" + word)
                self.next()
            else:
                self.next()
        return self

    def attributes(self, *ends):
        """What stands between a name and its declaration. True: optimised access."""
        optimised = False
        while self.tokens[self.at].kind != "end":
            token = self.tokens[self.at]
            if token.kind == "attribute":
                optimised = optimised or bool(re.search(
                    r"S7_Optimized_Access\s*:=\s*'TRUE'", token.text, re.I))
                self.at += 1
            elif token.kind == "comment":
                self.at += 1
            elif token.text.upper() in ends:
                break
            elif token.text.upper() in _ATTRIBUTES:
                self._attribute()
            elif token.text in (";", "=", ":", ",", "-"):
                self.at += 1
            else:
                break
        return optimised

    def _attribute(self):
        """AUTHOR : x, VERSION : 0.1, KNOW_HOW_PROTECT"""
        line = self.tokens[self.at].line
        self.at += 1
        if self.tokens[self.at].text in (":", "="):
            while self.tokens[self.at].kind != "end" and self.tokens[self.at].line == line:
                self.at += 1

    def type_block(self):
        """TYPE n STRUCT ... of STEP 7, or TYPE n : STRUCT ...; m : (A, B); of IEC."""
        first = True
        while first or (self.peek().kind == "name" and self.word() != "END_TYPE"):
            token = self.peek()
            name = self.name()
            self.attributes("STRUCT", ":")
            kind = self._type_body(name)
            if kind is not None:
                if name.upper() in {t.upper() for t in self.types}:
                    self.fail("type %s is there already; another name expected" % name, token)
                self.types[name] = kind
                self.type_lines[name] = token.line
            first = False
        self.expect("END_TYPE")
        self.accept(";")

    def _type_body(self, name):
        self.accept(":")
        if self.word() == "STRUCT":
            struct = self.type_(0)
            self.accept(";")
            return struct.fields
        if self.word() == "(":  # an enumeration: an INT
            self.skip_to(";")
            self.accept(";")
            return [("", ELEMENTARY["INT"], "", None, 0)]
        kind = self.type_(0)
        self.skip_to(";", "END_TYPE")
        self.accept(";")
        return [("", kind, "", None, 0)]

    def data_block(self):
        token = self.peek()
        name = self.name()
        optimised = self.attributes("STRUCT", "BEGIN", "VAR", "END_DATA_BLOCK")
        word = self.word()
        if word == "STRUCT":
            kind = self.type_(0)
        elif word == "VAR":
            self.next()
            kind = Struct(self.fields("END_VAR", 0))
        elif self.peek().kind == "name" and word not in ("BEGIN", "END_DATA_BLOCK"):
            kind = self.type_(0)
        else:
            self.fail("STRUCT or a type expected")
        self.blocks.append((name, kind, token.line, optimised))
        self.skip_to("END_DATA_BLOCK")
        self.expect("END_DATA_BLOCK")

    def function_block(self):
        """Its interface: what an instance DB looks like. Structures in VAR_IN_OUT are pointers."""
        name = self.name()
        fields = {section: [] for section in _SECTIONS}
        while self.peek().kind != "end" and self.word() not in ("BEGIN", "END_FUNCTION_BLOCK"):
            word = self.word()
            if word in fields:
                self.next()
                while self.word() in ("RETAIN", "CONSTANT", "NON_RETAIN"):
                    self.next()
                found = self.fields("END_VAR", 0)
                if word == "VAR_IN_OUT":
                    found = [f if isinstance(f[1], Elementary) else
                             (f[0], ELEMENTARY["POINTER"]) + f[2:] for f in found]
                fields[word] += found
            elif word.startswith("VAR"):
                self.skip_to("END_VAR")
                self.next()
            else:
                self.next()
        self.skip_to("END_FUNCTION_BLOCK")
        self.next()
        self.fbs[name] = [f for section in _SECTIONS for f in fields[section]]

    # --- declarations ------------------------------------------------------------------------

    def fields(self, end, depth):
        """a, b : T := v; // comment ... up to `end`."""
        found = []
        while self.word() != end:
            if self.peek().kind == "end":
                self.fail("%s expected" % end)
            line = self.peek().line
            names = [self.name()]
            self._field_attributes()
            while self.accept(","):
                names.append(self.name())
            self.expect(":")
            kind = self.type_(depth + 1)
            self._initial(end)
            closing = self.tokens[self.at]
            self.accept(";")
            comment = self._comment(closing.line)
            found += [(n, kind, comment, None, line) for n in names]
        self.next()
        return found

    def _field_attributes(self):
        if self.word() == "AT":  # another view of the same bytes
            self.fail("a field expected; AT views have no bytes of their own")

    def _initial(self, end):
        """Skips := value up to the semicolon."""
        depth = 0
        while self.peek().kind != "end":
            word = self.word()
            if depth == 0 and (word == ";" or word == end):
                return
            depth += {"(": 1, "[": 1, ")": -1, "]": -1}.get(word, 0)
            if word in ("END_TYPE", "END_DATA_BLOCK", "DATA_BLOCK"):
                self.fail("; expected")
            self.next()

    def _comment(self, line):
        """The comment behind a field, in its line."""
        token = self.tokens[self.at]
        if token.kind == "comment" and token.line == line:
            self.at += 1
            return token.text[2:].strip()
        return ""

    def type_(self, depth):
        if depth > DEPTH:
            self.fail("not more than %d levels" % DEPTH)
        token = self.next()
        word = token.text.upper()
        if word == "STRUCT":
            fields = self.fields("END_STRUCT", depth)
            return Struct(fields)
        if word == "ARRAY":
            return self._array(depth, token)
        if word in ("STRING", "WSTRING"):
            return self._string(word == "WSTRING", token)
        if token.kind != "name":
            self.fail("a type expected", token)
        if token.text.startswith('"'):
            return Named(token.text.strip('"'))
        if word in ("UDT", "FB", "SFB", "DB") and self.peek().kind == "number":
            return Named(word + self.next().text)
        word = ALIASES.get(word, word)
        if word in ELEMENTARY:
            return ELEMENTARY[word]
        text = token.text
        while self.word() == ".":  # a library's name in front
            self.next()
            text = self.name()
        return Named(text)

    def _bound(self):
        sign = -1 if self.accept("-") else 1
        token = self.next()
        if token.kind != "number" or not token.text.isdigit() or len(token.text) > 9:
            self.fail("a number expected", token)
        return sign * int(token.text)

    def _array(self, depth, token):
        self.expect("[")
        bounds = []
        while True:
            low = self._bound()
            self.expect("..")
            bounds.append((low, self._bound()))
            if bounds[-1][1] < low:
                self.fail("bounds %d..%d: the first must not be greater" % bounds[-1], token)
            if not self.accept(","):
                break
        self.expect("]")
        self.expect("OF")
        element = self.type_(depth + 1)
        if isinstance(element, Array):
            bounds, element = bounds + element.bounds, element.element
        array = Array(bounds, element)
        if array.count() > MAX_COUNT or len(bounds) > 6:
            self.fail("at most %d elements and 6 dimensions" % MAX_COUNT, token)
        return array

    def _string(self, wide, token):
        length = 254
        for opening, closing in (("[", "]"), ("(", ")")):
            if self.accept(opening):
                length = self._bound()
                self.expect(closing)
        if not 1 <= length <= (MAX_WTEXT if wide else MAX_TEXT):
            self.fail("STRING[1] to STRING[%d] expected" % MAX_TEXT, token)
        return Text(length, wide)


def is_source(text):
    """Begins with a type or a data block, behind comments and titles."""
    bare = re.sub(r"\(\*.*?\*\)|//[^\n]*|\{[^}]*\}", " ", text[:20000], flags=re.S)
    return re.match(r"\s*(TYPE\s+\S|DATA_BLOCK\s+\S|FUNCTION_BLOCK\s+\S|FUNCTION\s+\S|"
                    r"ORGANIZATION_BLOCK\s)", bare, re.I) is not None


def read(text, path, report):
    parser = Parser(text, path).run()
    source = Source("source of data blocks and types")
    if re.search(r"\{[^}]*S7_Optimized_Access", text, re.I):
        source.keys["family"] = "tia"
    for name, fields in parser.types.items():
        source.types[name] = [f[:4] for f in fields]
    for name, fields in parser.fbs.items():
        source.types.setdefault(name, [f[:4] for f in fields])
    for name, kind, line, optimised in parser.blocks:
        place = Place(path, line)
        if optimised:
            report.error(place, None, '"%s" has optimised access and so no offsets: set the block '
                         "to standard access" % name)
            continue
        source.add(name, "", kind, "", place)
    if not parser.types and not parser.blocks and not parser.fbs:
        raise Refused("no type and no data block in this source", Place(path))
    return source


__all__ = ["read", "is_source", "Parser", "TypeProblem"]
