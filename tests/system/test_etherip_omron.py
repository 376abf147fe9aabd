"""DTYP "EtherIP" and plcTag against plcSim as an Omron NJ: what such a controller offers, as its manual has it."""
import re
import subprocess

import pytest

from client import ARCH, TOP
from eipplant import rec
from waiting import until

PLC_TAG = TOP / "bin" / ARCH / "plcTag"
TAGS = ["udt Axis Pos:DINT[4] On:BOOL Name:STRING Bits:BOOL[20]", "udt Motor axis:Axis[2] Speed:REAL",
        "tag D DINT = 7", "tag A DINT[40] = 5", "tag L DINT[3000]", "tag R LREAL[10]", "tag B BOOL", "tag S SINT = -5",
        "tag F BOOL[100]", "tag M Motor[3]", "tag Grid INT[3,5]", "tag T STRING = ab", "tag Texts STRING[3]"]


def omron(plant):
    return plant.tags(*TAGS, profile="omron")


def good(plant, *names):
    for name in names:
        until(lambda: plant.ioc.severity(name) == "NO_ALARM", name)


@pytest.mark.parametrize("options", ["connected=auto", "connected=no"])
def test_arrays(plant, options):
    """Omron: elements and whole arrays are read and written, longer ones in parts ({options})"""
    omron(plant)
    plant.records(rec("ai", "a3", "A[3] S 0.05"), rec("ai", "a0", "A[0] S 0.05"), rec("ao", "o0", "A[0] S 0.05"),
                  rec("ao", "o39", "A[39] S 0.05"), rec("waveform", "w", "A S 0.05", "FTVL=LONG", "NELM=40"),
                  rec("aao", "l", "L S 0.1", "FTVL=LONG", "NELM=3000"), rec("waveform", "wl", "L S 0.1", "FTVL=LONG", "NELM=3000"),
                  rec("ai", "l9", "L[2999] S 0.1"), rec("aao", "r", "R S 0.05", "FTVL=DOUBLE", "NELM=10"),
                  rec("longout", "g", "Grid[1,4] S 0.05"), rec("longout", "g0", "Grid[2,0] S 0.05"),
                  rec("waveform", "row", "Grid[2,0] S 0.05", "FTVL=SHORT", "NELM=5"), rec("ai", "beyond", "A[40] S 0.05"),
                  before=f'etheripConfigure("P", "127.0.0.1:{plant.port}", -1, "{options}")', slot=-1)
    good(plant, "a3", "a0", "o0", "o39", "w", "l", "wl", "r", "g", "g0", "row")
    plant.ioc.put("o0", 11)
    plant.ioc.put("o39", 12)
    plant.wait_tag("A", " ".join(["11", *["5"] * 38, "12"]))
    until(lambda: list(plant.ioc.plain("w")) == [11, *[5] * 38, 12])
    plant.ioc.put("l", list(range(3000)))
    until(lambda: list(plant.ioc.plain("wl")) == list(range(3000)), "an array of 12,000 bytes and back")
    assert plant.ioc.plain("l9") == 2999 and plant.ioc.severity("l") == "NO_ALARM"
    plant.ioc.put("r", [n / 8 for n in range(10)])
    until(lambda: plant.tag("R[9]") == "1.125")
    plant.ioc.put("g", -3)
    plant.ioc.put("g0", 4)
    until(lambda: list(plant.ioc.plain("row")) == [4, 0, 0, 0, 0])
    assert plant.tag("Grid[1,4]") == "-3"
    plant.ioc.wait_alarm("beyond", "INVALID", "READ", "no such")
    room = "connected, 1994 bytes" if options == "connected=auto" else "unconnected, 490 bytes"
    assert room in plant.ioc.command("drvEtherIP_report 1")


def test_bools_and_bits(plant):
    """Omron: BOOLs, elements of BOOL arrays with E, whole ones as arrays, and bits of integers"""
    omron(plant)
    plant.records(rec("bi", "b", "B S 0.05"), rec("bo", "bo", "B S 0.05"), rec("bi", "f45", "F[45] E S 0.05"),
                  rec("bo", "fo45", "F[45] E S 0.05"), rec("bo", "fo0", "F[0] E S 0.05"), rec("bo", "fo99", "F[99] E S 0.05"),
                  rec("waveform", "wf", "F S 0.05", "FTVL=UCHAR", "NELM=100"), rec("aao", "af", "F S 0.05", "FTVL=UCHAR", "NELM=100"),
                  rec("longout", "s", "S S 0.05"), rec("bo", "d4", "D.4 S 0.05"), rec("mbbo", "m", "A[2] S 0.05 B 4", "NOBT=3"),
                  rec("bi", "without", "F[45] S 0.05"))
    good(plant, "b", "bo", "f45", "fo45", "fo0", "fo99", "wf", "af", "s", "d4", "m")
    for name, tag in ("bo", "B"), ("fo45", "F[45]"), ("fo0", "F[0]"), ("fo99", "F[99]"):
        plant.ioc.put(name, 1)
        until(lambda: plant.tag(tag) in ("1", "true"), tag)
    plant.ioc.wait_value("b", 1)
    plant.ioc.wait_value("f45", 1)
    until(lambda: [n for n, on in enumerate(plant.ioc.plain("wf")) if on] == [0, 45, 99])
    plant.ioc.put("fo0", 0)
    until(lambda: [n for n, on in enumerate(plant.ioc.plain("wf")) if on] == [45, 99])
    plant.ioc.put("af", [n % 2 for n in range(100)])
    until(lambda: list(plant.ioc.plain("wf")) == [n % 2 for n in range(100)])
    plant.ioc.wait_value("fo45", 1)
    plant.ioc.put("s", -128)
    plant.wait_tag("S", "-128")
    plant.ioc.put("d4", 1)
    plant.wait_tag("D", "23")
    plant.ioc.put("m", 5)
    plant.wait_tag("A[2]", "85")
    plant.ioc.wait_alarm("without", "INVALID", "READ", "BOOL")
    good(plant, "bo", "fo45", "fo0", "fo99", "s", "d4", "m", "af")


def test_each_text_is_a_request(plant):
    """Omron: elements of an array of texts are read one by one, those of an array of numbers together"""
    omron(plant)
    plant.records(*(rec("stringin", f"t{n}", f"Texts[{n}] S 0.05") for n in range(3)), *(rec("ai", f"a{n}", f"A[{n}] S 0.05") for n in range(3)))
    good(plant, *(f"{what}{n}" for what in "ta" for n in range(3)))

    def read():
        return set(re.findall(r"4c:([^=\s]+)", plant.sim.command("etherip received 30")))
    until(lambda: {"Texts[0]", "Texts[1]", "Texts[2]"} <= read(), lambda: read())
    assert len({name for name in read() if name.partition("[")[0] == "A"}) == 1, read()


def test_structures_and_texts(plant):
    """Omron: members, arrays in structures, BOOL arrays there, texts and arrays of texts"""
    omron(plant)
    plant.records(rec("ai", "v", "M[2].Speed S 0.05"), rec("ao", "vo", "M[2].Speed S 0.05"),
                  rec("longin", "p0", "M[1].axis[1].Pos[0] S 0.05"), rec("longout", "po0", "M[1].axis[1].Pos[0] S 0.05"),
                  rec("longout", "po3", "M[1].axis[1].Pos[3] S 0.05"), rec("bo", "on", "M[0].axis[0].On S 0.05"),
                  rec("waveform", "wp", "M[1].axis[1].Pos S 0.05", "FTVL=LONG", "NELM=4"),
                  rec("aao", "ap", "M[0].axis[1].Pos S 0.05", "FTVL=LONG", "NELM=4"),
                  rec("bo", "bit", "M[0].axis[1].Bits[19] E S 0.05"), rec("stringout", "n", "M[0].axis[0].Name S 0.05"),
                  rec("waveform", "wb", "M[0].axis[1].Bits S 0.05", "FTVL=UCHAR", "NELM=20"),
                  rec("stringout", "t", "T S 0.05"), rec("stringout", "t2", "Texts[2] S 0.05"), rec("stringin", "ti2", "Texts[2] S 0.05"),
                  rec("lso", "t0", "Texts[0] S 0.05", "SIZV=257"))
    good(plant, "v", "vo", "p0", "po0", "po3", "on", "wp", "ap", "bit", "n", "wb", "t", "t2", "t0")
    plant.ioc.put("vo", 1.5)
    plant.ioc.wait_value("v", 1.5)
    plant.ioc.put("po0", 7)
    plant.ioc.put("po3", 9)
    plant.ioc.wait_value("p0", 7)
    until(lambda: list(plant.ioc.plain("wp")) == [7, 0, 0, 9])
    plant.ioc.put("ap", [1, 2, 3, 4])
    plant.wait_tag("M[0].axis[1].Pos", "1 2 3 4")
    plant.ioc.put("on", 1)
    plant.ioc.put("bit", 1)
    until(lambda: list(plant.ioc.plain("wb")) == [0] * 19 + [1])
    assert plant.tag("M[0].axis[0].On") in ("1", "true")
    for name, tag, text in ("n", "M[0].axis[0].Name", "axis"), ("t", "T", "x"), ("t2", "Texts[2]", "third"), ("t0.VAL$", "Texts[0]", "y" * 250):
        plant.ioc.put(name, text)
        plant.wait_tag(tag, f'"{text}"')
    plant.ioc.wait_value("ti2", "third")
    good(plant, "vo", "po0", "po3", "on", "ap", "bit", "n", "t", "t2", "t0")


def test_own_types(plant):
    """Omron: ENUM and its times in nanoseconds are whole numbers"""
    plant.tags("tag E ENUM = 3", "tag D DATE_AND_TIME_NSEC[2] = 1700000000000000", "tag T TIME_NSEC = -5", profile="omron")
    plant.records(rec("mbbi", "e", "E S 0.05"), rec("longout", "eo", "E S 0.05"), rec("int64in", "d", "D[1] S 0.05"),
                  rec("int64out", "t", "T S 0.05"))
    plant.ioc.wait_value("e", 3)
    plant.ioc.wait_value("d", 1700000000000000)
    plant.ioc.wait_value("t", -5)
    plant.ioc.put("eo", 4)
    plant.ioc.put("t", 10**12)
    plant.ioc.wait_value("e", 4)
    plant.wait_tag("T", str(10**12))
    assert "E=4" in subprocess.run([PLC_TAG, f"127.0.0.1:{plant.port}", "read", "E"], capture_output=True, text=True).stdout


def test_many_texts(plant):
    """Omron: texts that are too long for one answer do not make messages smaller for good"""
    plant.tags(*(f'tag T{n} STRING = {"x" * 200}' for n in range(40)), *(f"tag D{n} DINT" for n in range(40)), profile="omron")
    plant.records(*(rec("lsi", f"t{n}", f"T{n} S 0.2", "SIZV=257") for n in range(40)),
                  *(rec("longin", f"d{n}", f"D{n} S 0.2") for n in range(40)))
    good(plant, *(f"t{n}" for n in range(40)), *(f"d{n}" for n in range(40)))
    assert plant.ioc.get("t39.VAL$", as_string=True) == "x" * 200 and "bytes at most" not in plant.ioc.log
    assert "bytes from now on" not in plant.ioc.log


def test_plctag(plant):
    """plcTag with an Omron: elements, arrays in parts, BOOLs, bits; refusals in words"""
    omron(plant)

    def tag(*words, status=0):
        done = subprocess.run([PLC_TAG, *words], capture_output=True, text=True, timeout=60)
        assert done.returncode == status, done
        return done.stdout + done.stderr
    here = f"127.0.0.1:{plant.port}"
    assert tag(here, "read", "D", "A", "A[3]", "B", "S", "F", "T") == "D=7\nA=5\nA[3]=5\nB=0\nS=-5\nF=0\nT=\"ab\"\n"
    tag(here, "write", "A[1]", "1", "2", "3")
    tag(here, "write", "A", "8", "9")
    tag(here, "write", "F[2]", "1")
    tag(here, "write", "F[17]", "1", "true")
    for name, value in ("B", "1"), ("S", "-7"), ("D.4", "1"), ("T", "hello"), ("M[1].axis[0].Pos[3]", "6"), ("Texts[1]", "two"):
        tag(here, "write", name, value)
    assert tag("-n", "5", here, "read", "A") == "A=8 9 2 3 5\n"
    assert tag("-n", "20", here, "read", "F") == f"F={' '.join('1' if n in (2, 17, 18) else '0' for n in range(20))}\n"
    assert tag(here, "read", "F[2]", "F[3]", "B", "S", "D", "T", "Texts[1]") == \
        'F[2]=1\nF[3]=0\nB=1\nS=-7\nD=23\nT="hello"\nTexts[1]="two"\n'
    assert plant.tag("M[1].axis[0].Pos[3]") == "6"
    plant.set("L[2999]", 5)
    assert tag("-n", "3000", here, "read", "L").split() == ["L=0", *["0"] * 2998, "5"]
    assert "index beyond the end (20 8018)" in tag("-n", "3", here, "read", "A[38]", status=1)
    assert "no such tag (05)" in tag(here, "read", "Nix", status=1)
