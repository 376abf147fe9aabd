"""The tags of a controller that a map over EtherNet/IP names in column plc: `Line.Motors[3].Speed`,
`Flags[45]`, `Status.5`, `Program:Main.Count`. Pure; knows no record and no file.

Members of one tag are a structure, indices an array as long as the greatest; a bit of a number, and
bits of an array, lie in whole numbers.
"""
import re

from .types import Array, Elementary, Text

_PART = re.compile(r"([^.\[\]\s,;]+)((?:\[[^\]]*\])?)(?:\.|$)")
_PROGRAM = re.compile(r"^Program:[^.]+\.", re.I)
TYPES = ("BOOL SINT INT DINT LINT USINT UINT UDINT ULINT REAL LREAL BYTE WORD DWORD LWORD").split()
STRING = 82  # characters of the STRING of a controller
MAX_DIMENSIONS = 3
BITS = 32    # of an element of an array of BOOL


class TagProblem(Exception):
    """str() says what is wrong with a name, or with two of them."""


class Node:
    """A tag or member: members, or the kind of its elements; dims: lengths of an array."""
    __slots__ = ("members", "kind", "dims")

    def __init__(self):
        self.members = {}  # upper-case name -> (name, Node)
        self.kind = None   # "REAL", ("text", 20), "bits"
        self.dims = []


def tag_name(leaf):
    """The whole name of a value's tag."""
    return leaf.address.symbol if leaf.address is not None else leaf.symbol


def parts(text):
    """[(name, [indices])] of a tag's name; the program stands in the first."""
    program = _PROGRAM.match(text)
    at = program.end() if program else 0
    found = []
    while at < len(text):
        m = _PART.match(text, at)
        if not m:
            raise TagProblem('"%s" is no name of a tag; allowed: such as Tank.Level, '
                             "Motors[3].Speed, Program:Main.Count" % text)
        index = m.group(2)[1:-1].split(",") if m.group(2) else []
        if len(index) > MAX_DIMENSIONS or not all(re.match(r"^\s*\d{1,6}\s*$", i) for i in index):
            raise TagProblem('"%s": an index is a number; allowed: up to three, with commas' % text)
        found.append((m.group(1).strip(), [int(i) for i in index]))
        at = m.end()
    if not found:
        raise TagProblem("the name of a tag is missing")
    if program:
        found[0] = (program.group() + found[0][0], found[0][1])
    return found


def place(leaf):
    """(tag, element or None, bit or None) of a value: what holds its bytes. An array of BOOL
    has 32 bits in each element."""
    path = parts(tag_name(leaf))
    name, index = path[-1]
    if _is_bit(leaf) and name.isdigit() and len(path) > 1 and not index:
        return _text(path[:-1]), int(name)
    if _is_bit(leaf) and index:
        number = index[0]
        return _text(path[:-1] + [(name, [number // BITS])]), number % BITS
    return _text(path), None


def _text(path):
    return ".".join(n + ("[%s]" % ",".join(map(str, i)) if i else "") for n, i in path)


def _is_bit(leaf):
    return isinstance(leaf.type, Elementary) and leaf.type.kind == "bool"


def kind_of(kind):
    """What a tag has for a type of the map."""
    element = kind.element if isinstance(kind, Array) else kind
    if isinstance(element, Text) and not element.wide:
        return "text", element.length
    if isinstance(element, Elementary) and element.name in TYPES:
        return element.name
    raise TagProblem("a controller has no %s; allowed: %s, STRING[n], arrays and types of them"
                     % (element, " ".join(TYPES)))


def tree(leaves):
    """{upper-case name: (name, Node)} of all tags. Raises TagProblem with the second of two
    names that do not fit each other."""
    root = Node()
    for leaf in leaves:
        add(root, leaf)
    return root.members


def add(root, leaf):
    """One more value. TagProblem: it does not fit what is there."""
    path = parts(tag_name(leaf))
    kind = kind_of(leaf.type)
    if _is_bit(leaf) and len(path) > 1 and path[-1][0].isdigit() and not path[-1][1]:
        kind, path = ("bit", int(path[-1][0])), path[:-1]
    node = root
    for name, index in path:
        if node.kind is not None:
            raise TagProblem("%s: %s is a number or a text, and has no members" % (
                tag_name(leaf), name))
        node = node.members.setdefault(name.upper(), (name, Node()))[1]
        _index(node, index, tag_name(leaf))
    if isinstance(leaf.type, Array):
        _index(node, [high for _, high in leaf.type.bounds], tag_name(leaf))
    if node.members:
        raise TagProblem("%s has members, and is no %s" % (tag_name(leaf), leaf.type))
    _kind(node, kind, tag_name(leaf))


def _index(node, index, name):
    if not index:
        return
    if node.dims and len(node.dims) != len(index):
        raise TagProblem("%s: the array has %d dimensions elsewhere" % (name, len(node.dims)))
    node.dims = [max(a, i + 1) for a, i in zip(node.dims or [0] * len(index), index)]


def _kind(node, kind, name):
    """A bit of a number goes with any whole number; else two must be the same."""
    bits = [k for k in (kind, node.kind) if isinstance(k, tuple) and k[0] == "bit"]
    others = [k for k in (kind, node.kind) if k is not None and k not in bits]
    if bits and any(isinstance(k, tuple) or k in ("BOOL", "REAL", "LREAL") for k in others):
        raise TagProblem("%s: only whole numbers have bits, and %s is none" % (
            name, _word(others[0])))
    if isinstance(kind, tuple) and kind[0] == "bit":
        if node.kind is None or isinstance(node.kind, tuple) and node.kind[0] == "bit":
            node.kind = ("bit", max(kind[1], node.kind[1] if node.kind else 0))
        return
    if isinstance(node.kind, tuple) and node.kind[0] == "bit":
        node.kind = None
    if node.kind not in (None, kind):
        raise TagProblem("%s is %s elsewhere" % (name, _word(node.kind)))
    node.kind = kind


def _word(kind):
    return "STRING[%d]" % kind[1] if isinstance(kind, tuple) else kind
