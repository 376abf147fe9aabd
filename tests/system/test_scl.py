"""The SCL of the documents: types, layout, and what the program does, cycle by cycle."""
import os
import re

import pytest

from scl import mutate, scenarios, texts
from scl.compile import Program
from scl.machine import Machine
from scl.parse import SclError, parse
from scl.types import leaves

DOCUMENT = scenarios.document()


@pytest.fixture(scope="module")
def program():
    return Program(DOCUMENT, texts.symbols(DOCUMENT))


@pytest.mark.parametrize("scenario", scenarios.ALL, ids=lambda s: s.__name__)
def test_scenario(program, scenario):
    """the program of plc-programming.md, cycle by cycle: {id}"""
    scenario(scenarios.Plc(program))


def test_nan(program):
    """a REAL that is NaN is equal to itself: the program compares bytes"""
    plc = scenarios.Plc(program)
    plc.points[:4] = b"\x7f\xc0\0\1"
    plc.synced()
    plc.take(2)
    plc.cycle(30)
    assert plc.sync and bytes(plc.points[:4]) == b"\x7f\xc0\0\1"


def test_pointer(program):
    """P#DB10.DBX0.0 BYTE 8 is in the tables as the page shows it, source and then destination"""
    page = (texts.DOCS / "plc-programming.md").read_text()
    shown = bytes.fromhex(re.search(r"^ {6}(10( +[0-9A-F]{2}){9})$", page, re.M)[1])
    dbs = scenarios.Plc(program).machine.dbs
    assert bytes(dbs[3][:10]) == shown == bytes(dbs[4][10:20])


# --- What the compiler must refuse ------------------------------------------------------------

DECLARATIONS = """VAR_INPUT IN1 : BOOL; END_VAR
VAR_TEMP B : BYTE; W : WORD; D : DWORD; I : INT; L : DINT; R : REAL; T : TIME; S : S5TIME;
  F : BOOL; A : ARRAY [1..4] OF INT; P : ANY; END_VAR"""


@pytest.mark.parametrize("statement,words", [
    ("W := I;", "INT assigned to WORD"),
    ("I := W;", "WORD assigned to INT"),
    ("B := W;", "WORD assigned to BYTE"),
    ("B := 0;", "INT assigned to BYTE"),
    ("W := 16#10;", "INT assigned to WORD"),
    ("I := L;", "DINT assigned to INT"),
    ("L := R;", "REAL assigned to DINT"),
    ("F := 1;", "INT assigned to BOOL"),
    ("T := S5T#1S;", "S5TIME assigned to TIME"),
    ("S := T#1S;", "TIME assigned to S5TIME"),
    ("T := 100;", "INT assigned to TIME"),
    ("F := W > W#16#5;", "WORD > WORD"),
    ("F := W = I;", "WORD = INT"),
    ("F := B = 0;", "BYTE = INT"),
    ("W := W + W#16#1;", "WORD + WORD"),
    ("I := I AND 1;", "INT AND INT"),
    ("I := NOT I;", "NOT INT"),
    ("W := -W;", "- WORD"),
    ("I := SHR(IN := I, N := 1);", "SHR of INT"),
    ("W := SHR(IN := W);", "SHR takes IN and N"),
    ("W := INT_TO_WORD(W);", "WORD given for INT_TO_WORD"),
    ("W := INT_TO_WORD(IN := I);", "one argument without a name"),
    ("IF I THEN L := 1; END_IF;", "a condition is BOOL, not INT"),
    ("CASE W OF 1: L := 1; END_CASE;", "CASE of WORD"),
    ("CASE I OF 1..3: L := 1; 2: L := 2; END_CASE;", "2 is there already"),
    ("A[W] := 1;", "an index is INT, not WORD"),
    ("A[0] := 1;", "index 0 is outside 1..4"),
    ("A[1, 2] := 1;", "2 indices; wanted: 1"),
    ("I[1] := 1;", "INT is no array"),
    ("Q1 := 1;", "Q1 is not declared before"),
    ("IN1 := FALSE;", "an input is not written"),
    ("FOR I := 1 TO 3 DO I := 2; END_FOR;", "I counts this loop"),
    ("FOR R := 1.0 TO 3.0 DO L := 2; END_FOR;", "of type INT or DINT"),
    ("EXIT;", "EXIT outside of a loop"),
    ("BLKMOV(SRCBLK := P, DSTBLK := P);", "must go somewhere"),
    ("I := BLKMOV(SRCBLK := P);", "DSTBLK is missing"),
    ("I := BLKMOV(SRCBLK := P, DSTBLK := P, N := 1);", "there is no parameter N"),
    ("I := BLKMOV(SRCBLK := D0, DSTBLK := P);", "D0 is a block, not what is in it"),
    ("I := BLKMOV(SRCBLK := P#DB1.DBX0.0 BYTE 4, DSTBLK := P);", "no P# constants"),
    ("I := BLKMOV(SRCBLK := 5, DSTBLK := P);", "ANY wants a variable"),
    ("D0.X := 1;", "STRUCT has no X"),
    ("B := B#16#100;", "does not fit into BYTE"),
    ("T := T#;", "what is"),
    ("T := T#5;", "T#5 is no duration"),
    ("S := S5T#3H;", "too long for S5TIME"),
    ("LATER(X := 1);", "LATER is not declared before"),
    ("I := 1", "; expected"),
    ("I := (1;", ") expected"),
    ("I = 1;", ":= expected"),
    ("THIS_NAME_HAS_25_LETTERS_A := 1;", "26 characters; allowed: 24"),
    ("A__B := 1;", "an underscore stands between two characters"),
    ("TO_ := 1;", "an underscore stands between two characters"),
    ("WORD := 1;", "not a keyword"),
], ids=lambda value: value.split(" ")[0])
def test_refused(statement, words):
    """what classic SCL does not compile is refused: {statement}"""
    text = ("DATA_BLOCK D0 STRUCT A : INT; END_STRUCT BEGIN END_DATA_BLOCK\n"
            f"FUNCTION F1 : VOID\n{DECLARATIONS}\nBEGIN\n{statement}\nEND_FUNCTION\n"
            "FUNCTION LATER : VOID VAR_INPUT X : INT; END_VAR BEGIN END_FUNCTION")
    with pytest.raises(SclError) as refused:
        Program(text, {"D0": 1})
    assert words in str(refused.value)
    assert refused.value.pos[0] in (7, 8), refused.value


@pytest.mark.parametrize("text,words", [
    ("FUNCTION F : INT VAR_TEMP A : INT; A : INT; END_VAR BEGIN END_FUNCTION", "declared twice"),
    ("FUNCTION F : INT VAR A : INT; END_VAR BEGIN END_FUNCTION", "here it is VAR_TEMP"),
    ("FUNCTION F : INT VAR_TEMP A : INT := 1; END_VAR BEGIN END_FUNCTION", "no initial value"),
    ("FUNCTION F : INT VAR_TEMP V AT A : ANY; A : INT; END_VAR BEGIN END_FUNCTION",
     "AT A: not declared before"),
    ("FUNCTION F : INT VAR_TEMP A : INT; V AT A : ANY; END_VAR BEGIN END_FUNCTION",
     "ANY is longer than A"),
    ("FUNCTION F : INT VAR_TEMP T : TON; END_VAR BEGIN END_FUNCTION", "belongs into VAR"),
    ("FUNCTION F : INT VAR_TEMP T : OTHER; END_VAR BEGIN END_FUNCTION", "type OTHER is not"),
    ("TYPE T STRUCT A : INT; A : INT; END_STRUCT END_TYPE", "declared twice"),
    ("TYPE T STRUCT A : ARRAY [3..1] OF INT; END_STRUCT END_TYPE", "has no element"),
    ("TYPE T STRUCT A : INT := W#16#1; END_STRUCT END_TYPE", "WORD assigned to INT"),
    ("DATA_BLOCK D STRUCT A : INT; END_STRUCT BEGIN B := 1; END_DATA_BLOCK", "no field"),
    ("DATA_BLOCK NONE STRUCT A : INT; END_STRUCT BEGIN END_DATA_BLOCK", "symbol table"),
    ("DATA_BLOCK D STRUCT A : INT; END_STRUCT BEGIN END_DATA_BLOCK\n"
     "DATA_BLOCK D STRUCT A : INT; END_STRUCT BEGIN END_DATA_BLOCK", "exists already"),
    ("DATA_BLOCK D STRUCT A : INT; END_STRUCT BEGIN END_DATA_BLOCK\n"
     "DATA_BLOCK E STRUCT A : INT; END_STRUCT BEGIN END_DATA_BLOCK", "and so is another one"),
    ("ORGANIZATION_BLOCK MAIN BEGIN END_ORGANIZATION_BLOCK", "VAR_TEMP only"),
    ("FUNCTION F : INT BEGIN F := 1;", "END_FUNCTION expected"),
    ("FUNCTION F : INT BEGIN § END_FUNCTION", "what is"),
], ids=range(17))
def test_refused_declaration(text, words):
    """declarations that classic SCL does not compile are refused ({words})"""
    with pytest.raises(SclError) as refused:
        Program(text, {"D": 1, "E": 1})
    assert words in str(refused.value)


@pytest.mark.parametrize("body,words", [
    ("I := V;", "V is read before it is written"),
    ("RETURN;", "the result is not set"),
    ("V := 9; I := A[V];", "index 9 is outside 0..3"),
    ("V := 100; I := WORD_TO_INT(D0.DW[V]);", "byte 100 is outside of a block of 8 bytes"),
    ("V := 77; I := WORD_TO_INT(WORD_TO_BLOCK_DB(INT_TO_WORD(V)).DW0);", "DB77 does not exist"),
    ("V := 0; I := 5 / V;", "division"),
])
def test_stops(body, words):
    """what stops a CPU, or is garbage on its stack, is told with its line ({words})"""
    text = ("DATA_BLOCK D0 STRUCT A : ARRAY [0..3] OF INT; END_STRUCT BEGIN END_DATA_BLOCK\n"
            "FUNCTION F : INT\nVAR_TEMP I : INT; V : INT; A : ARRAY [0..3] OF INT; END_VAR\n"
            f"BEGIN\n{body}\nF := I;\nEND_FUNCTION\n")
    machine = Machine(text, {"D0": 1})
    with pytest.raises(SclError) as stopped:
        machine.call("F")
    assert words in str(stopped.value)


# --- Values -------------------------------------------------------------------------------------

@pytest.mark.parametrize("expression,kind,value", [
    ("32767 + 1", "INT", -32768), ("-7 / 2", "INT", -3), ("-7 MOD 2", "INT", -1),
    ("7 DIV -2", "INT", -3), ("100 * 1000", "INT", -31072), ("100 * L#1000", "DINT", 100000),
    ("WORD_TO_INT(W#16#FFFF)", "INT", -1), ("INT_TO_BYTE(300)", "BYTE", 44),
    ("NOT B#16#0F", "BYTE", 0xf0), ("B#16#F0 OR W#16#1", "WORD", 0xf1),
    ("SHL(IN := W#16#8001, N := 1)", "WORD", 2), ("ROR(IN := B#16#01, N := 1)", "BYTE", 128),
    ("DINT_TO_INT(DWORD_TO_DINT(DW#16#FFFFFFFE))", "INT", -2), ("2 + 3 * 4", "INT", 14),
    ("REAL_TO_INT(2.5 * 2.0)", "INT", 5), ("T#1M2S3MS - T#1S", "TIME", 61003),
    ("NOT (1 = 2) AND 3 <> 4", "BOOL", True), ("TRUE XOR 1 < 2", "BOOL", False),
    ("S5T#12S", "S5TIME", 0x1120), ("ABS(-5)", "INT", 5), ("2#1010", "INT", 10),
    ("TIME_TO_DINT(T#1D)", "DINT", 86400000), ("'A' = 'A'", "BOOL", True),
], ids=range(23))
def test_value(expression, kind, value):
    """{expression} is {value} of type {kind}"""
    text = (f"FUNCTION F : {kind}\nVAR_TEMP R : {kind}; END_VAR\nBEGIN\nR := {expression};\n"
            "F := R;\nEND_FUNCTION")
    assert Machine(text, {}).call("F") == value


def test_statements():
    """CASE, FOR with BY, WHILE, REPEAT, CONTINUE, EXIT and RETURN do what they say"""
    text = """FUNCTION SUM : INT
VAR_INPUT N : INT; END_VAR VAR_OUTPUT LAST : INT; END_VAR
VAR_TEMP I : INT; S : INT; END_VAR
BEGIN
    S := 0; LAST := -1;
    FOR I := N TO 0 BY -2 DO
        CASE I OF 0: S := S + 1000; 1..3, 5: CONTINUE; ELSE S := S + I; END_CASE;
        LAST := I;
    END_FOR;
    I := 0;
    WHILE TRUE DO I := I + 1; IF I = 5 THEN EXIT; END_IF; END_WHILE;
    REPEAT I := I + 1; UNTIL I > 7 END_REPEAT;
    SUM := S * 10 + I;
    IF N = 99 THEN SUM := 0; RETURN; END_IF;
END_FUNCTION
FUNCTION CALLER : INT
VAR_TEMP R : INT; L : INT; END_VAR
BEGIN R := SUM(N := 8, LAST := L); CALLER := R + L; END_FUNCTION"""
    machine = Machine(text, {})
    assert machine.call("SUM", 8) == ((8 + 6 + 4 + 1000) * 10 + 8, 0)
    assert machine.call("SUM", 3) == (8, -1)
    assert machine.call("SUM", 99)[0] == 0
    assert machine.call("CALLER") == 10188


def test_timers():
    """TON, TOF and TP run in the memory of their instance"""
    text = """FUNCTION_BLOCK FB1 VAR_INPUT S : BOOL; END_VAR VAR_OUTPUT A : BOOL; B : BOOL; C : BOOL;
END_VAR VAR ON : TON; OFF : TOF; PULSE : TP; END_VAR
BEGIN ON(IN := S, PT := T#100MS); OFF(IN := S, PT := T#100MS); PULSE(IN := S, PT := T#100MS);
A := ON.Q; B := OFF.Q; C := PULSE.Q; END_FUNCTION_BLOCK
DATA_BLOCK I FB1 BEGIN END_DATA_BLOCK"""
    machine = Machine(text, {"I": 9})

    def at(ms, on):
        machine.ms = ms
        machine.call_block("FB1", "I", S=on)
        return "".join(str(int(machine.get(f"I.{q}"))) for q in "ABC")
    assert [at(*step) for step in [(0, 0), (10, 1), (50, 1), (109, 1), (110, 1), (200, 1),
                                   (210, 0), (250, 0), (309, 0), (310, 0), (320, 1), (330, 0),
                                   (419, 0), (420, 0)]] == [
        "000", "011", "011", "011", "110", "110", "010", "010", "010", "000", "011", "011",
        "011", "010"]


# --- Layout --------------------------------------------------------------------------------------

def layout(fields):
    text = f"DATA_BLOCK D STRUCT {fields} END_STRUCT BEGIN END_DATA_BLOCK"
    number, kind = Program(text, {"D": 1}).dbs["D"]
    return kind.size, " ".join(f"{name}@{byte}.{bit}" if str(t) == "BOOL" else f"{name}@{byte}"
                               for name, byte, bit, t in leaves(kind))


@pytest.mark.parametrize("fields,size,places", [
    ("A : BOOL; B : BOOL; C : BYTE; D : BOOL; E : INT;", 6, "A@0.0 B@0.1 C@1 D@2.0 E@4"),
    ("A : BYTE; B : CHAR; C : BYTE; D : DINT;", 8, "A@0 B@1 C@2 D@4"),
    ("A : BOOL; B : STRUCT X : BOOL; END_STRUCT; C : BOOL;", 6, "A@0.0 B.X@2.0 C@4.0"),
    ("A : BYTE; B : ARRAY [1..3] OF BYTE; C : BYTE;", 8, "A@0 B[1]@2 B[2]@3 B[3]@4 C@6"),
    ("A : ARRAY [0..1, 0..2] OF BOOL; B : BOOL;", 4,
     "A[0,0]@0.0 A[0,1]@0.1 A[0,2]@0.2 A[1,0]@1.0 A[1,1]@1.1 A[1,2]@1.2 B@2.0"),
    ("A : ARRAY [0..1, 0..2] OF BYTE; B : BYTE;", 8,
     "A[0,0]@0 A[0,1]@1 A[0,2]@2 A[1,0]@3 A[1,1]@4 A[1,2]@5 B@6"),
    ("A : STRING[3]; B : BYTE; C : INT;", 8, "A@0 B@5 C@6"),
    ("A : ARRAY [1..2] OF STRING[3]; B : BYTE;", 14, "A[1]@0 A[2]@6 B@12"),
    ("A : BYTE; B : ANY; C : DATE_AND_TIME; D : TIME;", 24, "A@0 B@2 C@12 D@20"),
    ("A : REAL; B : BOOL; C : S5TIME;", 8, "A@0 B@4.0 C@6"),
])
def test_layout(fields, size, places):
    """the layout of a standard block: {fields}"""
    assert layout(fields) == (size, places)


def test_first_error():
    """a text that does not parse names line and column"""
    with pytest.raises(SclError, match="^line 2:3: TYPE, DATA_BLOCK"):
        parse("// text\n  X := 1;\n")


# --- Mutants --------------------------------------------------------------------------------------

# Changes that no test can see, and why.
HARMLESS = {
    "4 -> 5": "a field of bytes that begins one later; the block is as long, rounded up to even",
    "WORD -> INT": "IE_ACC and IE_HELD are compared as bytes",
    "B#16#02 -> B#16#03": "CHAR is as long as BYTE, and DATA without CHECK is only asked in "
                          "REMOTE, where CHECK alone was asked before",
    "8 -> 9": "BLKMOV moves as many bytes as the shorter of the two has",
    "DW#16#00FFFFFF -> DW#16#00FFFFFE": "the lowest bit of a bit address is shifted out",
    "SRC -> DST": "both counts of a row are equal",
    "T#100MS -> T#101MS": "shorter than a cycle",
    "BOOL -> BYTE": "a BYTE holds a BOOL, and compares as one",
    "IE_TX -> IE_RX": "AG_SEND without ACT only asks how far it is",
    "32 -> 33": "AG_SEND without ACT only asks how far it is",
}
HARMLESS_COUNT = 20


def alive(program):
    """True when no scenario notices."""
    for scenario in scenarios.ALL:
        try:
            scenario(scenarios.Plc(program))
        except (AssertionError, SclError):
            return False
    return True


def test_mutants():
    """slips of the keyboard in the SCL are refused, or fail, or have no effect for a reason

    PLCLINK_MUTANTS: each how-manieth is tried, 7 by default; 1 takes 20 s.
    """
    step = int(os.environ.get("PLCLINK_MUTANTS", "7"))
    refused, failed, left = mutate.tried(DOCUMENT, step, lambda text, program: alive(program))
    assert [spot for spot in left if spot[0] not in HARMLESS] == []
    assert refused + failed >= 300 // step - 5 and len(left) <= HARMLESS_COUNT
    assert mutate.agrees((texts.DOCS / "plc-programming.md").read_text(),
                         r"of (\d+) slips of the keyboard put into it (\d+) do not compile, (\d+) are noticed, and (\d+)",
                         DOCUMENT, step, (refused, failed, len(left)))
