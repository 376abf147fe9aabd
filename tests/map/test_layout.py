"""Layout of data blocks by the rules of S7: cases that are known from compiled blocks, written
anew as sources, each with its offsets; and rules one by one."""
import pytest

from plcmaplib.imports.s7source import Parser
from plcmaplib.types import Array, Layout, Struct, TypeProblem, parse_type


def outline(source):
    """["name byte.bit"] of all entries of the first data block, depth first; and its size."""
    parser = Parser(source, "test").run()
    layout = Layout({n.upper(): [(f[0], f[1], f[3]) for f in t] for n, t in parser.types.items()})
    found = []

    def walk(kind, base):
        for name, inner, byte, bit in layout.fields(kind)[0]:
            found.append("%s %d.%d" % (name, base + byte, bit or 0))
            element = inner.element if isinstance(inner, Array) else inner
            if isinstance(element, Struct) or element.__class__.__name__ == "Named":
                walk(element, base + byte)

    kind = parser.blocks[0][1]
    walk(kind, 0)
    return found, layout.size(kind)


def block(fields):
    return 'DATA_BLOCK "X"\nSTRUCT\n%s\nEND_STRUCT\nBEGIN\nEND_DATA_BLOCK' % fields


CASES = [
    ("bits fill a byte, the ninth begins another",
     "".join("b%d : BOOL;\n" % i for i in range(10)),
     ["b%d %d.%d" % (i, i // 8, i % 8) for i in range(10)], 2),
    ("a number after bits begins at an even byte", "a : BOOL; b : INT;", ["a 0.0", "b 2.0"], 4),
    ("a byte after bits begins at the next byte", "a : BOOL; b : BYTE; c : BYTE; d : INT;",
     ["a 0.0", "b 1.0", "c 2.0", "d 4.0"], 6),
    ("nothing is aligned to four", "a : INT; b : REAL; c : INT; d : LREAL;",
     ["a 0.0", "b 2.0", "c 6.0", "d 8.0"], 16),
    ("the block's length is even", "a : REAL; b : BYTE;", ["a 0.0", "b 4.0"], 6),
    ("all times and dates", "a : S5TIME; b : DATE; c : TIME; d : TIME_OF_DAY; e : DATE_AND_TIME; "
     "f : STRING; g : INT;", ["a 0.0", "b 2.0", "c 4.0", "d 8.0", "e 12.0", "f 20.0", "g 276.0"], 278),
    ("an odd text and a byte", "a : STRING[5]; b : BYTE; c : BOOL; d : INT;",
     ["a 0.0", "b 7.0", "c 8.0", "d 10.0"], 12),
    ("a structure begins even and ends even", "a : BOOL; b : STRUCT x : BOOL; END_STRUCT; c : BOOL;",
     ["a 0.0", "b 2.0", "x 2.0", "c 4.0"], 6),
    ("structures in structures", "a : STRUCT b : STRUCT c : BOOL; d : BYTE; END_STRUCT; e : BYTE; "
     "END_STRUCT; f : INT;", ["a 0.0", "b 0.0", "c 0.0", "d 1.0", "e 2.0", "f 4.0"], 6),
    ("an array of bytes and what follows", "a : ARRAY [0..2] OF BYTE; b : BYTE;", ["a 0.0", "b 4.0"], 6),
    ("an array of bits and what follows", "a : ARRAY [1..9] OF BOOL; b : BOOL;", ["a 0.0", "b 2.0"], 4),
    ("an array of structures of 33 bits and numbers",
     "a : ARRAY [0..1600] OF STRUCT %s r : REAL; i : DINT; END_STRUCT; z : BOOL;"
     % "".join("b%d : BOOL; " % i for i in range(33)),
     ["a 0.0"] + ["b%d %d.%d" % (i, i // 8, i % 8) for i in range(33)] +
     ["r 6.0", "i 10.0", "z 22414.0"], 22416),
    ("an array of structures of a number and a byte",
     "a : ARRAY [1..10] OF INT; b : ARRAY [1..10] OF STRUCT c : INT; d : BYTE; END_STRUCT; "
     "e : ARRAY [1..10, 1..10] OF INT; f : BYTE;",
     ["a 0.0", "b 20.0", "c 20.0", "d 22.0", "e 60.0", "f 260.0"], 262),
    ("texts in an array of structures",
     "a : ARRAY [1..10] OF STRUCT t : S5TIME; s : STRING[254]; END_STRUCT; b : ARRAY [33..38] OF INT;",
     ["a 0.0", "t 0.0", "s 2.0", "b 2580.0"], 2592),
    ("rows of bits begin in a new byte", "a : ARRAY [0..1, 0..9] OF BOOL; b : BYTE;",
     ["a 0.0", "b 4.0"], 6),
    ("rows of bytes do not", "a : ARRAY [0..1, 0..2] OF BYTE; b : BYTE;", ["a 0.0", "b 6.0"], 8),
    ("odd texts in an array begin even", "a : ARRAY [0..1] OF STRING[3]; b : BYTE;",
     ["a 0.0", "b 12.0"], 14),
    ("pointers", "a : BYTE; b : ANY; c : POINTER; d : BYTE;", ["a 0.0", "b 2.0", "c 12.0", "d 18.0"], 20),
    ("types of S7-1500", "a : BYTE; b : LINT; c : DTL; d : WSTRING[3]; e : LTIME; f : USINT;",
     ["a 0.0", "b 2.0", "c 10.0", "d 22.0", "e 32.0", "f 40.0"], 42),
    ("several names of one type", "a, b : INT; c : BOOL;", ["a 0.0", "b 2.0", "c 4.0"], 6),
]


@pytest.mark.parametrize("title, fields, expected, size", CASES, ids=[c[0] for c in CASES])
def test_layout(title, fields, expected, size):
    """{title}"""
    assert outline(block(fields)) == (expected, size)


def test_types_by_name():
    """UDTs by number and name, and data blocks of a type"""
    source = '''
TYPE UDT 1000
TITLE = what ; stands here, is no source : STRUCT
VERSION : 0.1
STRUCT
    a : BOOL;   // first
    b : STRUCT x : BYTE := B#16#05; y : ARRAY[0..1] OF INT := 2(7); END_STRUCT;
END_STRUCT;
END_TYPE
TYPE "My Type"
VERSION : 0.1
   STRUCT
      "01" : Bool;
      u : UDT1000;
   END_STRUCT;
END_TYPE
DATA_BLOCK DB 7
TITLE =
AUTHOR : me
"My Type"
BEGIN
   u.a := TRUE;
END_DATA_BLOCK
'''
    assert outline(source) == (["01 0.0", "u 2.0", "a 2.0", "b 4.0", "x 4.0", "y 6.0"], 10)


def test_function_block():
    """An instance DB is laid out as the interface of its function block"""
    source = '''
FUNCTION_BLOCK FB 5
VAR_INPUT
    start : BOOL;
END_VAR
VAR_IN_OUT
    s : STRING[10];
END_VAR
VAR
    n : INT;
END_VAR
VAR_TEMP
    t : INT;
END_VAR
BEGIN
NETWORK
      U     #start;
      =     "x y".z;
END_FUNCTION_BLOCK
DATA_BLOCK DB 9
 FB 5
BEGIN
END_DATA_BLOCK
'''
    parser = Parser(source, "t").run()
    layout = Layout({n.upper(): [(f[0], f[1], f[3]) for f in t] for n, t in parser.fbs.items()})
    placed, size = layout.fields(parser.blocks[0][1])
    assert [(p[0], p[2]) for p in placed] == [("start", 0), ("s", 2), ("n", 8)] and size == 10


@pytest.mark.parametrize("text", ["ARRAY[1..2] OF ARRAY[1..2] OF INT", "ARRAY[1..2,1..2] OF INT"])
def test_array_of_array(text):
    """{text} has 8 bytes"""
    assert Layout({}).size(parse_type(text)) == 8


def test_pinned_fields():
    """Fields with a place of their own lie there"""
    layout = Layout({"T": [("a", parse_type("INT"), (4, None)), ("b", parse_type("BOOL"), (0, 3)),
                           ("c", parse_type("BYTE"), None)]})
    placed, size = layout.fields(parse_type("T"))
    assert [(p[0], p[2], p[3]) for p in placed] == [("a", 4, None), ("b", 0, 3), ("c", 1, None)]
    assert size == 6


def test_unknown():
    """A type that is not there is said so"""
    with pytest.raises(TypeProblem, match='unknown type "X"'):
        Layout({}).size(parse_type("X"))
