"""DTYP "EtherIP": an IOC with nothing but ether_ip.dbd, and plcSim as its controller."""
import itertools
import re
import struct
import subprocess

import epics
import pytest

from client import ARCH, TOP
from demos import run_demo
from eipplant import rec
from soak import clock
from ioc import errors_in
from waiting import until, until_equal

PLC_TAG = TOP / "bin" / ARCH / "plcTag"


# --- Values -------------------------------------------------------------------------------

INTEGERS = {"SINT": (-128, 127), "INT": (-32768, 32767), "DINT": (-2**31, 2**31 - 1),
            "LINT": (-2**53, 2**53), "USINT": (0, 255), "UINT": (0, 65535),
            "UDINT": (0, 2**32 - 1), "ULINT": (0, 2**53)}


def test_integers(plant):
    """Each integer type is read and written by ao, longout and int64out with its sign and size"""
    plant.tags(*(f"tag {t} {t} = {low}" for t, (low, _) in INTEGERS.items()))
    plant.records(*(rec("ai", f"ai{t}", f"{t} S 0.05") + rec("int64in", f"i{t}", f"{t} S 0.05") +
                    rec("ao", f"ao{t}", f"{t} S 0.05") + rec("int64out", f"o{t}", f"{t} S 0.05") +
                    rec("longout", f"l{t}", f"{t} S 0.05") for t in INTEGERS))
    for t, (low, high) in INTEGERS.items():
        plant.ioc.wait_value(f"ai{t}", float(low))
        plant.ioc.wait_value(f"i{t}", low)
        plant.ioc.wait_value(f"o{t}", low)
        plant.ioc.put(f"o{t}", high)
        plant.wait_tag(t, str(high))
        plant.ioc.wait_value(f"ao{t}", float(high))
        plant.ioc.wait_value(f"ai{t}", float(high))
        plant.ioc.put(f"ao{t}", 100)
        plant.wait_tag(t, "100")
        plant.ioc.put(f"l{t}", 77)
        plant.wait_tag(t, "77")
        plant.ioc.wait_value(f"i{t}", 77)
    assert not errors_in(plant.ioc.log)


def test_reads_between_puts(plant):
    """Twenty puts of which each is a message of its own, to a slow PLC: it is read between them"""
    plant.tags("tag Seen DINT = 1", *(f"tag A{n} DINT[100]" for n in range(20)), profile="enet")
    plant.records(rec("longin", "seen", "Seen S 0.1"),
                  *(rec("aao", f"a{n}", f"A{n} S 100", "NELM=100", "FTVL=LONG") for n in range(20)))
    plant.ioc.wait_value("seen", 1)
    for n in range(20):
        plant.ioc.wait_alarm(f"a{n}", "NO_ALARM")
    plant.sim.command("etherip slow 100")
    for n in range(20):
        plant.ioc.put(f"a{n}", [n + 1] * 100, wait=False)
    for n in range(20):
        plant.wait_tag(f"A{n}[99]", f"{n + 1}")
    kinds = []
    for line in plant.sim.command("etherip received 1000").splitlines():
        for what, service in ("w", "4d:A"), ("r", "4c:Seen"):
            kinds += [what] if service in line else []
    puts = "".join(kinds)[kinds.index("w"):len(kinds) - kinds[::-1].index("w")]

    assert puts.count("w") == 20
    assert max(len(row) for row in puts.split("r")) <= 5, puts


def test_does_not_fit(plant):
    """A value that the tag's type has not is refused with words, and VAL goes back"""
    plant.tags("tag INT INT = 5", "tag USINT USINT = 6")
    plant.records(rec("ao", "a", "INT S 0.05"), rec("longout", "l", "USINT S 0.05"))
    plant.ioc.wait_value("a", 5.0)
    plant.ioc.wait_value("l", 6)
    plant.ioc.put("a", 70000)
    plant.ioc.put("l", -1)
    assert plant.ioc.alarm("a") == ("INVALID", "WRITE", "the value does not fit INT")
    assert plant.ioc.alarm("l") == ("INVALID", "WRITE", "the value does not fit USINT")
    assert plant.ioc.get("a") == 5 and plant.tag("INT") == "5" and plant.tag("USINT") == "6"
    plant.ioc.put("a", 7)
    plant.wait_tag("INT", "7")
    assert plant.ioc.severity("a") == "NO_ALARM"


def test_reals(plant):
    """REAL and LREAL keep their digits both ways; 0.1 is no news when it comes back"""
    plant.tags("tag REAL REAL = 2.5", "tag LREAL LREAL = 0.1")
    plant.records(rec("ao", "r", "REAL S 0.05"), rec("ao", "force", "REAL S 0.05 FORCE"),
                  rec("ai", "ri", "REAL S 0.05"), rec("ao", "lr", "LREAL S 0.05"),
                  rec("calcout", "c", "LREAL S 0.05", "CALC=A*2"))
    plant.ioc.wait_value("r", 2.5)
    plant.ioc.wait_value("lr", 0.1)
    plant.ioc.put("r", 0.1)
    until(lambda: abs(float(plant.tag("REAL")) - 0.1) < 1e-6, "0.1 in the tag")
    plant.ioc.wait_value("ri", 0.10000000149011612)
    plant.ioc.put("lr", 1 / 3)
    until(lambda: float(plant.tag("LREAL")) == pytest.approx(1 / 3, abs=1e-12), "1/3 in the tag")
    plant.ioc.put("c.A", 21)
    plant.wait_tag("LREAL", "42")


def test_strings(plant):
    """STRING and STRING_n: read, written whole, cut to the record; too long is refused"""
    plant.tags("udt Name string 10", 'tag S STRING = "hello"', "tag N Name = abc", "tag D DINT")
    plant.records(rec("stringin", "si", "S S 0.05"), rec("stringout", "so", "S S 0.05"),
                  rec("lsi", "li", "S S 0.05", "SIZV=100"), rec("lso", "lo", "S S 0.05", "SIZV=100"),
                  rec("lsi", "short", "S S 0.05", "SIZV=16"), rec("stringin", "ni", "N S 0.05"),
                  rec("stringout", "no", "N S 0.05"), rec("stringin", "bad", "D S 0.05"))
    plant.ioc.wait_value("si", "hello")
    plant.ioc.wait_value("so", "hello")
    plant.ioc.put("so", "")
    plant.ioc.wait_value("si", "")
    text = "x" * 82
    plant.ioc.put("lo.VAL$", text)
    until(lambda: text in plant.tag("S"), "82 characters")
    plant.ioc.wait_value("si", "x" * 39)
    until(lambda: plant.ioc.get("short", as_string=True) == "x" * 15)
    plant.ioc.wait_value("ni", "abc")
    plant.ioc.put("no", "0123456789")
    plant.ioc.wait_value("ni", "0123456789")
    plant.ioc.wait_alarm("bad", "INVALID", "READ", "the tag is a number, no string")


def test_string_arrays(plant):
    """Elements of an array of strings; a write leaves nothing of others behind the text"""
    plant.tags("tag Ss STRING[4]", "tag D DINT[3] = 7")
    plant.records(*(rec("stringin", f"i{n}", f"Ss[{n}] S 0.05") +
                    rec("stringout", f"o{n}", f"Ss[{n}] S 0.05") for n in range(4)))
    for n in range(4):
        plant.ioc.wait_value(f"o{n}", "")
    for n in (2, 0, 3, 1):
        plant.ioc.put(f"o{n}", "a long text of element %d" % n)
    for n in range(4):
        plant.ioc.put(f"o{n}", f"s{n}")
        plant.ioc.wait_value(f"i{n}", f"s{n}")
    raw = subprocess.run([PLC_TAG, "-n", "82", f"127.0.0.1:{plant.port}", "read", "Ss[2].DATA"],
                         capture_output=True, text=True, check=True).stdout
    assert raw.split("=")[1].split() == ["115", "50"] + ["0"] * 80


def test_bits(plant):
    """BOOL arrays by bit, B, tag.5 and whole BOOLs; writes change their own bit alone"""
    plant.tags("tag BOOLs BOOL[96]", "tag DINT DINT = 0x50", "tag BOOL BOOL", "tag INT INT = 0x8001")
    plant.records(
        *(rec("bi", f"b{n}", f"BOOLs[{n}] S 0.05") for n in (0, 31, 32, 95)),
        *(rec("bo", f"o{n}", f"BOOLs[{n}] S 0.05") for n in (0, 31, 32, 95)),
        rec("bi", "d4", "DINT.4 S 0.05"), rec("bi", "d5", "DINT S 0.05 B 5"),
        rec("bo", "od5", "DINT.5 S 0.05"), rec("bi", "w", "BOOL S 0.05"),
        rec("bo", "ow", "BOOL S 0.05"), rec("bi", "i15", "INT.15 S 0.05"),
        rec("bo", "oi14", "INT S 0.05 B 14"), rec("ai", "a6", "DINT.6 S 0.05"))
    for n in (0, 31, 32, 95):
        plant.ioc.wait_value(f"b{n}", 0)
        plant.ioc.put(f"o{n}", 1)
        until_equal(lambda: int(plant.tag(f"BOOLs[{n // 32}]")) >> n % 32 & 1, 1)
        plant.ioc.wait_value(f"b{n}", 1)
    plant.set("BOOLs[0]", 3)
    plant.ioc.wait_value("o31", 0)
    assert [plant.tag(f"BOOLs[{n}]") for n in range(3)] == ["3", "1", str(2**31)]
    plant.ioc.wait_value("d4", 1)
    plant.ioc.wait_value("a6", 1.0)
    assert plant.ioc.get("d5") == 0
    plant.ioc.put("od5", 1)
    plant.wait_tag("DINT", str(0x70))
    plant.ioc.put("od5", 0)
    plant.wait_tag("DINT", str(0x50))
    plant.ioc.wait_value("i15", 1)
    plant.ioc.put("oi14", 1)
    plant.wait_tag("INT", str(0xC001 - 0x10000))
    plant.ioc.put("ow", 1)
    plant.wait_tag("BOOL", "1")
    plant.ioc.wait_value("w", 1)
    plant.ioc.put("ow", 0)
    plant.wait_tag("BOOL", "0")


def test_multibit(plant):
    """mbbi and mbbo of every NOBT on SINT, INT, DINT: all values, no bit beside them changes; B counts, SHFT does not"""
    rows = [(kind, n) for kind in ("SINT", "INT", "DINT") for n in (1, 2, 3, 4)]
    plant.tags(*(f"tag {kind}{n} {kind} = {-2**n}" for kind, n in rows))
    plant.records(*(rec("mbbi", f"i{kind}{n}", f"{kind}{n} S 0.02", f"NOBT={n}") +
                    rec("mbbo", f"o{kind}{n}", f"{kind}{n} S 0.02", f"NOBT={n}")
                    for kind, n in rows),
                  rec("mbbi", "shifted", "DINT4 S 0.02 B 4", "NOBT=2", "SHFT=7"))
    plant.ioc.wait_value("shifted", 3)
    assert plant.ioc.get("shifted.SHFT") == 0
    for kind, n in rows:
        plant.ioc.wait_value(f"i{kind}{n}", 0)
        for value in range(2**n):
            plant.ioc.put(f"o{kind}{n}", value)
            assert plant.tag(f"{kind}{n}") == str(value - 2**n)
            plant.ioc.wait_value(f"i{kind}{n}", value)
            assert plant.ioc.get(f"o{kind}{n}") == value


def test_bits_across(plant):
    """Bits of an array that lie in two DINTs are read together, and written; an output follows the first of the two"""
    plant.tags("tag D DINT[3]")
    plant.set("D[0]", -2**30)  # bits 30 and 31
    plant.set("D[1]", 2)
    plant.records(rec("mbbi", "a", "D[30] S 0.05", "NOBT=4"),
                  rec("mbbiDirect", "b", "D[29] S 0.05", "NOBT=8"),
                  rec("mbbo", "o", "D[30] S 0.05", "NOBT=4"))
    plant.ioc.wait_value("a", 0b1011)
    plant.ioc.wait_value("b", 0b10110)
    plant.ioc.wait_value("o", 0b1011)
    plant.set("D[1]", -4)
    plant.ioc.put("o.OUT", "@P D[0] B 30 S 0.05")
    plant.ioc.wait_value("o", 0b0011)
    for value in range(16):
        plant.ioc.put("o", value)
        plant.ioc.wait_value("a", value)
        first = value % 4 * 2**30
        assert plant.tag("D[0]") == str(first if first < 2**31 else first - 2**32)
        plant.wait_tag("D[1]", str(-4 + value // 4))
    plant.set("D[0]", 2**30)
    plant.ioc.wait_value("o", 0b1101)  # it follows with the first of the two


def test_arrays(plant):
    """Arrays of 5,000 elements in fragments, of any FTVL; aao writes its elements"""
    plant.tags("tag Big DINT[5000]", "tag Reals REAL[40]", "tag M DINT[3,4]", "tag Sints SINT[7]")
    plant.set("Big[4999]", -5)
    plant.set("M[1,2]", 12)
    plant.records(rec("waveform", "big", "Big S 0.2", "FTVL=DOUBLE", "NELM=5000"),
                  rec("aai", "long", "Big S 0.2", "FTVL=LONG", "NELM=5000"),
                  rec("aao", "out", "Big S 0.2", "FTVL=LONG", "NELM=5000"),
                  rec("aao", "reals", "Reals S 0.05", "FTVL=DOUBLE", "NELM=40"),
                  rec("aao", "sints", "Sints S 0.05", "FTVL=LONG", "NELM=7"),
                  rec("longin", "m", "M[1,2] S 0.05"), rec("longout", "mo", "M[2,3] S 0.05"),
                  rec("longin", "last", "Big[4999] S 0.05"))
    until(lambda: plant.ioc.plain("big") == [0.0] * 4999 + [-5.0])
    until(lambda: plant.ioc.plain("long") == [0] * 4999 + [-5])
    plant.ioc.wait_value("last", -5)
    values = list(range(5000))
    plant.ioc.put("out", values)
    until(lambda: plant.ioc.plain("long") == values)
    plant.ioc.put("reals", [n / 4 for n in range(40)])
    plant.wait_tag("Reals[39]", "9.75")
    plant.ioc.put("sints", [1, 2, 200, 4, 5, 6, 7])
    assert plant.ioc.alarm("sints")[1:] == ("WRITE", "an element does not fit SINT")
    plant.ioc.put("sints", [1, 2, -3])
    plant.wait_tag("Sints[2]", "-3")
    plant.ioc.wait_value("m", 12)
    plant.ioc.put("mo", 23)
    plant.wait_tag("M[2,3]", "23")


def test_structures(plant):
    """Members of structures, whole and by member; a structure is read as one where that is less"""
    plant.tags("udt Axis Pos:INT State:SINT",
               "udt Motor Speed:DINT On:BOOL Fault:BOOL axis:Axis[2] Temps:REAL[4]",
               "tag M Motor", "tag Ms Motor[3]", "tag Program:Main.m Motor")
    plant.records(
        rec("longin", "speed", "M.Speed S 0.05"), rec("bi", "on", "M.On S 0.05"),
        rec("bi", "fault", "M.Fault S 0.05"), rec("longin", "pos", "M.axis[1].Pos S 0.05"),
        rec("ai", "temp", "M.Temps[3] S 0.05"), rec("longout", "ospeed", "M.Speed S 0.05"),
        rec("bo", "oon", "M.On S 0.05"), rec("longout", "opos", "Ms[2].axis[1].Pos S 0.05"),
        rec("longin", "prog", "Program:Main.m.Speed S 0.05"))
    plant.set("M.Temps[3]", 3.5)
    plant.set("M.Fault", 1)
    plant.set("M.axis[1].Pos", -7)
    plant.set("Program:Main.m.Speed", 99)
    plant.ioc.wait_value("temp", 3.5)
    plant.ioc.wait_value("fault", 1)
    plant.ioc.wait_value("pos", -7)
    plant.ioc.wait_value("prog", 99)
    plant.ioc.put("ospeed", 1234)
    plant.wait_tag("M.Speed", "1234")
    plant.ioc.wait_value("speed", 1234)
    plant.ioc.put("oon", 1)
    plant.ioc.wait_value("on", 1)
    assert plant.ioc.get("fault") == 1
    plant.ioc.put("opos", -3)
    plant.wait_tag("Ms[2].axis[1].Pos", "-3")
    assert not errors_in(plant.ioc.log)


# --- What others have wrong ---------------------------------------------------------------
#
# What ether_ip 3.10 was seen to do, and the test that shows it done right here:
#
#  1  one refused service ends the connection        test_nobody_is_hurt
#  2  mbbi without B: bits shifted                   test_multibit
#  3  mbbo without B: other bits written             test_multibit
#  4  sign and size of SINT, UINT                    test_integers, test_every_type
#  5  a UINT gets bytes of an old frame              test_integers, test_does_not_fit
#  6  USINT, UDINT, LINT: INVALID, a line each scan  test_integers
#  7  FORCE with REAL writes for ever                test_follow_and_force, test_reals
#  8  an index beyond the array hurts the others     test_nobody_is_hurt
#  9  puts just before a loss, puts while away       test_away, test_put_callback
# 10  arrays longer than the buffer                  test_arrays
# 11  one element put, all of them written           test_single_elements, test_bits
# 12  strings by length, two of an array             test_string_arrays, test_strings
# 13  a missing tag is never asked for again         test_retry
# 14  a[1,2] is taken as a[1]                        test_arrays
# 15  who asks waits for the network                 test_nobody_waits
# 16  answers and names unchecked                    test_lies; unit: eipFrameTest, eipWorkerTest
# 17  a jump of the clock stops the reads            (all waits are monotonic: plcWake, eipSocket)
# 18  links that change to tags nobody used          test_new_link
# 19  puts with a periodic SCAN are lost             test_puts_from_periodic_scan
# 20  bytes of other frames behind a text            test_string_arrays

def test_nobody_waits(plant):
    """While the PLC is silent, links change, reports are printed, records process: nothing waits for it"""
    plant.tags("tag A DINT = 1", "tag B DINT = 2")
    plant.records(rec("longin", "a", "A S 0.02"), rec("longin", "b", "B S 0.02"), rec("longout", "o", "B S 0.02"),
                  before="EIP_timeout(60000)")
    plant.ioc.wait_value("a", 1)
    until(lambda: plant.ioc.severity("o") == "NO_ALARM")
    plant.sim.command("etherip silent")
    plant.ioc.put("o", 5, wait=False)
    plant.ioc.put("a.INP", "@P B S 0.02")
    for command in ("drvEtherIP_report 6", "drvEtherIP_dump", "dbior drvEtherIP 2", "EIP_timeout 50000",
                    'drvEtherIP_define_PLC("R", "no.such.host.invalid", 0)'):
        plant.ioc.command(command)
    for name in ("a", "b"):
        plant.ioc.process_record(name)
    assert "1 made, 0 lost" in plant.ioc.command("drvEtherIP_report 1")  # it is silent still
    plant.ioc.command("drvEtherIP_restart")
    plant.sim.command("etherip normal")
    plant.ioc.wait_value("a", 2)
    until(lambda: plant.ioc.severity("a") == "NO_ALARM")


def test_nobody_is_hurt(plant):
    """A missing tag, an index beyond the end and a hidden tag: only their own records are bad"""
    plant.tags("tag Ints INT[40]", "tag Hidden DINT hidden", "tag Ro DINT readonly", "tag D DINT = 4")
    plant.records(rec("ai", "nix", "Nix S 0.05"), rec("ai", "beyond", "Ints[45] S 0.05"),
                  rec("ai", "last", "Ints[39] S 0.05"), rec("ai", "hidden", "Hidden S 0.05"),
                  rec("longout", "ro", "Ro S 0.05"), rec("longin", "d", "D S 0.05"),
                  *(rec("ai", f"i{n}", f"Ints[{n}] S 0.05") for n in range(0, 40, 5)))
    plant.set("Ints[39]", 9)
    plant.ioc.wait_value("last", 9.0)
    plant.ioc.wait_alarm("nix", "INVALID", "READ", "no such tag")
    plant.ioc.wait_alarm("beyond", "INVALID", "READ", "no such element")
    plant.ioc.wait_alarm("hidden", "INVALID", "READ", "no right to access it")
    until(lambda: all(plant.ioc.severity(f"i{n}") == "NO_ALARM" for n in range(0, 40, 5)))
    plant.ioc.put("ro", 3)
    plant.ioc.wait_alarm("ro", "INVALID", "WRITE", "no right to access it")
    plant.set("D", 5)
    plant.ioc.wait_value("d", 5)
    told = plant.ioc.log_count("tag Ints[45]: ")
    for link in ("Ints[38]", "Ints[37]"):  # others come and go: what was refused is not told again
        plant.set(link, int(link[5:7]))
        plant.ioc.put("d.INP", f"@P {link} S 0.05")
        plant.ioc.wait_value("d", int(link[5:7]))
    assert plant.ioc.log_count("tag Ints[45]: ") == told
    assert plant.ioc.severity("beyond") == "INVALID" and plant.ioc.severity("last") == "NO_ALARM"
    assert plant.ioc.command("drvEtherIP_report 1").count("1 made, 0 lost")


def test_silent(plant):
    """A controller that answers nothing for requestTimeout: COMM with the time, and values are back with it"""
    plant.tags("tag A DINT = 1")
    plant.records(rec("longin", "a", "A S 0.05"), before="EIP_timeout(500)")
    plant.ioc.wait_value("a", 1)
    plant.sim.command("etherip silent")
    plant.ioc.wait_alarm("a", "INVALID", "COMM", "no answer for 0.5 s")
    plant.set("A", 2)
    plant.sim.command("etherip normal")
    plant.ioc.wait_value("a", 2)
    plant.ioc.wait_alarm("a", "NO_ALARM")


def test_retry(plant):
    """A tag that comes into being is found, by a new program at once"""
    plant.tags("tag A DINT = 1")
    plant.records(rec("longin", "a", "A S 0.05"), rec("longin", "b", "B S 0.05"),
                  rec("longout", "c", "C S 0.05"))
    plant.ioc.wait_value("a", 1)
    plant.ioc.wait_alarm("c", "INVALID", "READ", "no such tag")
    plant.ioc.put("c", 4)
    plant.ioc.wait_alarm("c", "INVALID", "WRITE", "no such tag")
    plant.ioc.wait_alarm("b", "INVALID", "READ", "no such tag")
    plant.sim.command("etherip tag B DINT = 8")
    plant.sim.command("etherip tag C DINT")
    plant.sim.command("etherip download")
    plant.ioc.wait_value("b", 8)
    assert plant.ioc.severity("b") == "NO_ALARM"
    plant.ioc.wait_value("c", 0)
    plant.ioc.put("c", 5)
    assert plant.tag("C") == "5"
    assert plant.ioc.severity("c") == "NO_ALARM"


def test_download(plant):
    """After a download ids mean other tags: no record shows one of those"""
    plant.tags(*(f"tag T{n} DINT = {n}" for n in range(20)))
    plant.records(*(rec("longin", f"t{n}", f"T{n} S 0.02") for n in range(20)))
    for n in range(20):
        plant.ioc.wait_value(f"t{n}", n)
    until(lambda: plant.ioc.command("drvEtherIP_dump").count("instance") == 20)
    for n in range(20):
        plant.set(f"T{n}", n + 100)
    plant.sim.command("etherip download")
    for n in range(20):
        plant.ioc.wait_value(f"t{n}", n + 100)


def test_no_value_of_another(plant):
    """Through 50 downloads, by which ids mean other tags, no record ever shows another tag's value"""
    count = 40
    plant.tags(*(f"tag T{n} DINT = {n * 1000}" for n in range(count)), "udt U A:DINT B:DINT C:DINT",
               "tag X U", "tag Y U")
    for n, member in enumerate(("X.A", "X.B", "X.C", "Y.A", "Y.B", "Y.C")):
        plant.set(member, 100000 + n)
    wanted = {f"t{n}": n * 1000 for n in range(count)}
    wanted |= {name: 100000 + n for n, name in enumerate(("xA", "xB", "xC", "yA", "yB", "yC"))}
    plant.records(*(rec("longin", f"t{n}", f"T{n} S 0.1") for n in range(count)),
                  *(rec("longin", name, f"{name[0].upper()}.{name[1]} S 0.1")
                    for name in wanted if name[0] != "t"))
    wrong, events = [], []

    def seen(pvname, value, severity, **kw):
        events.append(pvname)
        name = pvname.removeprefix(plant.ioc.P)
        if severity == 0 and value != wanted[name]:
            wrong.append((name, value))

    for name, value in wanted.items():
        plant.ioc.wait_value(name, value)
    until(lambda: plant.ioc.command("drvEtherIP_dump").count("instance") == count + 6)
    pvs = [epics.PV(plant.ioc.P + name, callback=seen, auto_monitor=True) for name in wanted]
    until(lambda: len(set(events)) == len(wanted))
    for turn in range(50):
        known = turn % 3 != 0  # else this one comes while tags are learned
        if known:
            until(lambda: plant.ioc.command("drvEtherIP_dump").count("instance") == count + 6)
        before = programs(plant)
        plant.sim.command("etherip download shift")
        until(lambda: not known or programs(plant) > before, "the download is seen")
    assert not wrong
    for pv in pvs:
        pv.disconnect()
    plant.set("T7", 7777)
    plant.ioc.wait_value("t7", 7777)
    assert all(plant.ioc.severity(name) == "NO_ALARM" for name in wanted)


def programs(plant):
    return int(re.search(r"(\d+) new programs", plant.ioc.command("drvEtherIP_report 1")).group(1))


@pytest.mark.parametrize("how", ["download", "download shift"])
def test_put_at_download(plant, how):
    """A put right after a download arrives in its tag and in no other ({how})"""
    plant.tags(*(f"tag T{n} DINT" for n in range(20)), "tag B DINT[2]")
    plant.records(*(rec("longout", f"t{n}", f"T{n} S 1") for n in range(20)),
                  rec("bo", "b", "B[1].3 S 1"))
    until(lambda: plant.ioc.command("drvEtherIP_dump").count("instance") == 21)
    plant.sim.command(f"etherip {how}")
    plant.ioc.put("t5", 555)
    plant.ioc.put("b", 1)
    assert plant.ioc.alarm("t5")[:2] == ("NO_ALARM", "NO_ALARM")
    assert [plant.tag(f"T{n}") for n in range(20)] == ["0"] * 5 + ["555"] + ["0"] * 14
    assert plant.tag("B[1]") == "8"


def test_type_change(plant):
    """A tag of another type after a download is read with that type"""
    plant.tags("tag A DINT = 70000")
    plant.records(rec("ai", "a", "A S 0.05"), rec("ao", "o", "A S 0.05"))
    plant.ioc.wait_value("a", 70000.0)
    plant.sim.command("etherip tag A REAL = 2.5")
    plant.sim.command("etherip download")
    plant.ioc.wait_value("a", 2.5)
    plant.ioc.put("o", 0.25)
    plant.wait_tag("A", "0.25")


def test_puts_after_a_type_refused(plant):
    """Two puts to one tag that the PLC refuses for its type: it is learned again, and puts leave"""
    plant.tags("tag A DINT[20]", "tag B DINT")
    plant.records(*(rec("longout", f"a{n}", f"A[{n}] S 0.05") for n in (0, 2, 4)), rec("longout", "b", "B S 0.05"))
    for name in ("a0", "a2", "a4", "b"):
        until(lambda: plant.ioc.severity(name) == "NO_ALARM")
    plant.ioc.command("s7plcSetOption P holdoff 500")  # both leave in one message
    plant.sim.command("etherip status FF 2107 tag A write next 2")
    for n in (0, 2):
        plant.ioc.put(f"a{n}", 7, wait=False)
    for n in (0, 2):
        plant.ioc.wait_alarm(f"a{n}", "INVALID", "WRITE")
    plant.sim.command("etherip normal")
    plant.ioc.command("s7plcSetOption P holdoff 0")
    for n in (0, 2, 4):
        plant.ioc.put(f"a{n}", 8)
        plant.wait_tag(f"A[{n}]", "8")
    plant.ioc.put("b", 9)
    plant.wait_tag("B", "9")


def test_new_link(plant):
    """A link that changes to a tag nobody used before is served at once, in and out"""
    plant.tags("tag A DINT = 1", "tag B INT = 2", "tag C DINT[10] = 3")
    plant.records(rec("longin", "i", "A S 0.05"), rec("longout", "o", "A S 0.05"))
    plant.ioc.wait_value("i", 1)
    plant.ioc.put("i.INP", "@P B S 0.05")
    plant.ioc.wait_value("i", 2)
    plant.ioc.put("i.INP", "@P C[7] S 0.05")
    plant.set("C[7]", 37)
    plant.ioc.wait_value("i", 37)
    plant.ioc.put("o.OUT", "@P C[8] S 0.05")
    plant.ioc.put("o", 38)
    plant.wait_tag("C[8]", "38")


def test_single_elements(plant):
    """A put writes its own element, never its neighbours with old values"""
    plant.tags("tag A DINT[20]")
    plant.records(*(rec("longout", f"o{n}", f"A[{n}] S 0.1") for n in range(20)))
    plant.ioc.wait_value("o19", 0)
    plant.sim.command("etherip clear")
    plant.ioc.put("o7", 7)
    plant.wait_tag("A[7]", "7")
    for n in (6, 8):
        plant.set(f"A[{n}]", 100 + n)
        plant.ioc.put("o7", n)
        plant.wait_tag("A[7]", str(n))
        assert plant.tag(f"A[{n}]") == str(100 + n)


def test_follow_and_force(plant):
    """Outputs follow the PLC; with FORCE the record's value goes back to the PLC"""
    plant.tags("tag A DINT = 4", "tag B DINT = 5", "tag R REAL = 1")
    plant.records(rec("longout", "a", "A S 0.05"), rec("longout", "b", "B S 0.05 FORCE"),
                  rec("ao", "r", "R S 0.05 FORCE"))
    plant.ioc.wait_value("a", 4)
    plant.ioc.wait_value("b", 5)
    plant.set("A", 6)
    plant.ioc.wait_value("a", 6)
    plant.ioc.put("b", 50)
    plant.wait_tag("B", "50")
    plant.set("B", 7)
    plant.wait_tag("B", "50")
    assert plant.ioc.get("b") == 50
    plant.ioc.put("r", 0.1)
    until(lambda: abs(float(plant.tag("R")) - 0.1) < 1e-6)
    plant.sim.command("etherip clear")
    until(lambda: plant.requests() > 20)
    assert " 4d:R" not in plant.sim.command("etherip received 1000")
    assert plant.ioc.get("r") == 0.1


def test_puts_from_periodic_scan(plant):
    """No put to an output with a periodic SCAN is lost"""
    plant.tags("tag A DINT")
    plant.records(rec("longout", "a", "A S 0.05", "SCAN=.1 second"))
    plant.ioc.wait_value("a", 0)
    for value in range(1, 16):
        plant.ioc.put("a", value)
        plant.wait_tag("A", str(value))


def test_no_old_value_after_a_put(plant):
    """An output that is read seldom keeps its put: what was read before it is older"""
    plant.tags("tag A DINT = 1", "tag B DINT = 2", "tag W DINT", "tag S STRING", "tag F DINT")
    plant.records(rec("longout", "a", "A S 100"), rec("longout", "b", "B S 100", "SCAN=.1 second"),
                  rec("bo", "w", "W.3 S 100"), rec("stringout", "s", "S S 100"),
                  rec("longin", "f", "F S 0.02"))
    for name in ("a", "b", "w", "s", "f"):
        until(lambda: plant.ioc.severity(name) == "NO_ALARM")
    heard = []
    monitor = epics.PV(plant.ioc.P + "a", callback=lambda value, **_: heard.append(value))
    until(lambda: heard)
    for name, value in (("a", 11), ("b", 12), ("w", 1), ("s", "text")):
        plant.ioc.put(name, value)
    plant.wait_tag("S", '"text"')
    before = plant.total()
    until(lambda: plant.total() > before + 200)  # longer than a put may wait for its read-back
    assert [plant.ioc.get(name) for name in ("a", "b", "w", "s")] == [11, 12, 1, "text"]
    assert heard == [1, 11]
    monitor.disconnect()


def test_text_into_structure(plant):
    """A text that is put to a structure that is no string is refused, and the structure stays as it is"""
    plant.tags("udt Axis Pos:DINT Speed:DINT", "tag X Axis", "tag D DINT = 7")
    plant.records(rec("stringout", "s", "X S 0.05"), rec("longin", "d", "D S 0.05"))
    plant.ioc.wait_value("d", 7)
    plant.ioc.put("s", "ab")
    plant.ioc.wait_alarm("s", "INVALID", "WRITE", "structure")
    assert plant.tag("X.Pos") == "0" and plant.tag("X.Speed") == "0"


def test_text_of_structure(plant):
    """A text record on a structure that is no string says so, and never shows an empty text as good"""
    plant.tags("udt Axis Pos:DINT Speed:DINT", "udt Name string 10", "tag X Axis", "tag N Name = abc",
               "udt Motor Label:Name Speed:DINT", "tag M Motor")
    plant.records(rec("stringin", "s", "X S 0.02"), rec("lsi", "l", "X S 0.02", "SIZV=50"),
                  rec("stringin", "n", "N S 0.02"), rec("stringin", "m", "M.Label S 0.02"))
    plant.ioc.wait_alarm("s", "INVALID", "READ", "the tag is a structure, no string")
    plant.ioc.wait_alarm("l", "INVALID", "READ", "the tag is a structure, no string")
    plant.ioc.wait_value("n", "abc")
    plant.set("M.Label", "xyz")
    plant.ioc.wait_value("m", "xyz")
    assert plant.ioc.severity("n") == plant.ioc.severity("m") == "NO_ALARM"


def test_output_whose_tag_vanishes(plant):
    """An output whose tag vanishes has an alarm with the reason, until it is back"""
    plant.tags("tag A DINT = 5", "tag B DINT = 6", "tag S STRING = \"text\"")
    plant.records(rec("longout", "a", "A S 0.05", "HIGH=10", "HSV=MINOR"), rec("longout", "b", "B S 0.05"),
                  rec("stringout", "s", "S S 0.05"))
    plant.ioc.wait_value("a", 5)
    plant.ioc.wait_value("s", "text")
    plant.sim.command("etherip remove A")
    plant.sim.command("etherip remove S")
    for name in ("a", "s"):
        plant.ioc.wait_alarm(name, "INVALID", "READ", "no such tag")
    assert plant.ioc.severity("b") == "NO_ALARM"
    plant.ioc.put("a", 7)
    plant.ioc.wait_alarm("a", "INVALID", "WRITE", "no such tag")
    plant.sim.command("etherip tag A DINT = 20")
    plant.sim.command('etherip tag S STRING = "text"')
    plant.sim.command("etherip download")
    plant.ioc.wait_value("a", 20)
    plant.ioc.wait_alarm("s", "NO_ALARM")
    assert plant.ioc.alarm("a")[:2] == ("INVALID", "WRITE")  # 7 was not written: until the next put
    plant.ioc.put("a", 20)
    plant.ioc.wait_alarm("a", "MINOR", "HIGH")
    plant.sim.command("etherip remove A")
    plant.ioc.wait_alarm("a", "INVALID", "READ", "no such tag")
    plant.sim.command("etherip tag A DINT = 20")
    plant.sim.command("etherip download")
    plant.ioc.wait_alarm("a", "MINOR", "HIGH")


def test_limits_of_followers(plant):
    """The alarm of an output that follows is that of the value it shows, never of the one before"""
    plant.tags("tag A REAL = 5", "tag B DINT = 5", "tag F DINT = 5")
    limits = ("HIGH=10", "HSV=MINOR", "HIHI=100", "HHSV=MAJOR")
    plant.records(rec("ao", "a", "A S 0.02", *limits), rec("longout", "b", "B S 0.02", *limits),
                  rec("longout", "f", "F S 0.02 FORCE", *limits))
    plant.ioc.wait_value("a", 5.0)
    plant.ioc.wait_value("b", 5)
    plant.ioc.put("f", 50)
    plant.wait_tag("F", "50")
    for value, alarm in ((20, "MINOR"), (200, "MAJOR"), (3, "NO_ALARM"), (11, "MINOR")):
        for name, tag in (("a", "A"), ("b", "B"), ("f", "F")):
            plant.set(tag, value)
        plant.ioc.wait_value("a", value)
        plant.ioc.wait_value("b", value)
        assert plant.ioc.severity("a") == plant.ioc.severity("b") == alarm
        plant.wait_tag("F", "50")
        assert plant.ioc.get("f") == 50 and plant.ioc.severity("f") == "MINOR"


def test_put_callback(plant):
    """A put with callback ends when the PLC has the value, or has refused it; what it has already is sent, too"""
    plant.tags("tag A DINT", "tag B BOOL[32]", "tag Ro DINT readonly", "tag S STRING")
    plant.records(rec("longout", "a", "A S 1"), rec("bo", "b", "B[7] S 1"),
                  rec("longout", "ro", "Ro S 1"), rec("stringout", "s", "S S 1"))
    for name in ("a", "b", "ro", "s"):
        until(lambda: plant.ioc.severity(name) == "NO_ALARM")
    for value in range(1, 11):
        plant.ioc.put("a", value)
        assert plant.tag("A") == str(value)
        plant.ioc.put("b", value % 2)
        assert int(plant.tag("B[0]")) == value % 2 << 7
        plant.ioc.put("s", f"text {value}")
        assert f"text {value}" in plant.tag("S")
    plant.ioc.put("a", 10)  # that it has already: sent all the same
    writes = [line for line in plant.sim.command("etherip received 1000").splitlines() if "4d:A" in line]
    assert len(writes) == 11, writes
    plant.ioc.put("ro", 5)
    assert plant.ioc.alarm("ro") == ("INVALID", "WRITE", "PLC: no right to access it (0F)")
    plant.sim.command("etherip silent write next 1")
    plant.ioc.put("a", 99)  # does not wait for ever
    until(lambda: plant.ioc.get("a.PACT") == 0)


def test_order(plant):
    """Puts arrive in their order, and every edge of a bit does"""
    plant.tags(*(f"tag T{n} DINT" for n in range(5)), "tag B DINT")
    plant.records(*(rec("longout", f"t{n}", f"T{n} S 1") for n in range(5)),
                  rec("bo", "b", "B.3 S 1"))
    until(lambda: plant.ioc.severity("b") == "NO_ALARM")
    plant.sim.command("etherip clear")
    for n in (3, 0, 4, 1, 2):
        plant.ioc.put(f"t{n}", 1, wait=False)
    for value in (1, 0, 1, 0):
        plant.ioc.put("b", value, wait=value == 0)
    plant.wait_tag("T2", "1")
    received = plant.sim.command("etherip received 1000")
    assert re.findall(r"4d:(T\d)=00", received) == ["T3", "T0", "T4", "T1", "T2"]
    assert len(re.findall(r"4e:B=00", received)) == 4


# --- Connections --------------------------------------------------------------------------

def test_away(plant):
    """The PLC goes and comes: INVALID with COMM meanwhile, and values are back by themselves"""
    plant.tags("tag A DINT = 1", "tag B DINT")
    plant.records(rec("longin", "a", "A S 0.05"), rec("longout", "b", "B S 0.05"))
    plant.ioc.wait_value("a", 1)
    plant.ioc.put("b", 3)
    plant.wait_tag("B", "3")
    plant.sim.command("etherip refuse on")
    plant.sim.command("etherip close")
    plant.ioc.wait_alarm("a", "INVALID", "COMM")
    plant.ioc.put("b", 9)
    assert plant.ioc.alarm("b")[:2] == ("INVALID", "COMM")
    plant.set("A", 2)
    plant.sim.command("etherip refuse off")
    plant.ioc.wait_value("a", 2)
    until(lambda: plant.ioc.severity("a") == "NO_ALARM")
    plant.ioc.wait_alarm("b", "INVALID", "WRITE", "not written: PLC was away")
    assert str(plant.ioc.get("b")) == plant.tag("B") == "3"  # the PLC's value comes first
    plant.ioc.put("b", 4)
    plant.wait_tag("B", "4")
    assert plant.ioc.severity("b") == "NO_ALARM"


LIES = ["wrongcontext", "wrongsession", "wrongsequence", "wrongid", "wrongservice", "swap", "old",
        "short 30", "garbage 60", "length 5", "close", "drop", "silent"]


def test_lies(plant):
    """Answers with any lie give no wrong value, and the IOC recovers"""
    plant.tags(*(f"tag T{n} DINT = {n * 1000}" for n in range(8)))
    plant.records(*(rec("longin", f"t{n}", f"T{n} E S 0.02") for n in range(8)),
                  before="EIP_timeout(200)")
    for n in range(8):
        plant.ioc.wait_value(f"t{n}", n * 1000)
    for lie in LIES:
        for _ in range(2):
            plant.sim.command(f"etherip {lie} next 1")
            assert all(plant.ioc.get(f"t{n}") == n * 1000 for n in range(8)), lie
        plant.sim.command("etherip normal")
        until(lambda: all(plant.ioc.severity(f"t{n}") == "NO_ALARM" for n in range(8)), lie)
    plant.set("T3", 3333)
    plant.ioc.wait_value("t3", 3333)


@pytest.mark.parametrize("profile, way", [
    ("l8x", "connected, 4002 bytes"), ("enet", "connected, 504 bytes"),
    ("micro800", "connected, 504 bytes"), ("omron", "connected, 1994 bytes")])
def test_profiles(plant, profile, way):
    """A {profile} is read and written: {way}"""
    plant.tags("tag A DINT[100] = 7", "tag B BOOL[64]", "tag R REAL = 1.5", profile=profile)
    bit = "B[40] E" if profile == "omron" else "B[40]"  # there each BOOL is an element
    plant.records(rec("longin", "a", "A[99] S 0.05"), rec("longout", "o", "A[5] S 0.05"),
                  rec("bo", "b", f"{bit} S 0.05"), rec("bi", "bi", f"{bit} S 0.05"),
                  rec("ai", "r", "R S 0.05"), slot=-1 if profile in ("micro800", "omron") else 0)
    plant.ioc.wait_value("r", 1.5)
    plant.ioc.wait_value("a", 7)
    assert way in plant.ioc.command("drvEtherIP_report 1")
    plant.ioc.put("o", -8)
    plant.wait_tag("A[5]", "-8")
    plant.ioc.put("b", 1)
    plant.ioc.wait_value("bi", 1)


def test_slot(plant):
    """An empty slot is said in words"""
    plant.tags("tag A DINT")
    plant.records(rec("longin", "a", "A S 0.05"), slot=3)
    plant.ioc.wait_alarm("a", "INVALID", "COMM", "no module in that slot", ask=True)


def test_size(plant):
    """A size that the PLC refuses is learned from the refusal"""
    plant.tags("tag A DINT[400] = 3", size=600)
    plant.records(rec("waveform", "a", "A S 0.05", "FTVL=LONG", "NELM=400"))
    until(lambda: plant.ioc.plain("a") == [3] * 400)
    assert "connected, 600 bytes" in plant.ioc.command("drvEtherIP_report 1")


def test_few_requests(plant):
    """The paper's load: 352 BOOLs at 10 Hz and 120 REALs at 2 Hz are 10 requests a second"""
    plant.tags("tag BOOLs BOOL[352]", "tag REALs1 REAL[40]", "tag REALs2 REAL[40]",
               "tag REALs3 REAL[40] = 4")
    plant.records(*(rec("bi", f"b{n}", f"BOOLs[{n}] S 0.1") for n in range(352)),
                  *(rec("ai", f"r{k}{n}", f"REALs{k}[{n}] S 0.5")
                    for k, n in itertools.product((1, 2, 3), range(40))),
                  rec("ai", "time", "REALs1 S 0.1 TAG_TRANSFER_TIME", "SCAN=.1 second"))
    plant.ioc.wait_value("r339", 4.0)
    until(lambda: plant.ioc.get("time") > 0)
    until(lambda: "read in 4 parts by 1 requests" in plant.ioc.command("drvEtherIP_report 1"))


def test_many_tags(plant):
    """10,000 tags need no option; links that change at run time find room behind them"""
    count = 10000
    plant.tags(*(f"tag T{n} DINT = {n}" for n in range(count)), "tag Late DINT[20] = 9")
    plant.records(*(rec("longin", f"t{n}", f"T{n} S 1") for n in range(count)),
                  rec("longout", "o", "T7 S 1"), *(rec("longin", f"late{n}", "T0 S 0.1") for n in range(20)))
    for n in (count - 1, count // 2, 0):
        plant.ioc.wait_value(f"t{n}", n)
    assert re.search(r"in 1600\d\d bytes", plant.ioc.command("drvEtherIP_report 0"))
    for n in range(20):
        plant.ioc.put(f"late{n}.INP", f"@P Late[{n}] S 0.1")
    plant.set("Late[19]", 77)
    plant.ioc.wait_value("late19", 77)
    plant.ioc.wait_value("late0", 9)
    plant.ioc.put("o.OUT", "@P Late[3] S 0.1")
    plant.ioc.put("o", 33)
    plant.wait_tag("Late[3]", "33")
    plant.ioc.wait_value("late3", 33)
    assert plant.ioc.severity(f"t{count - 1}") == plant.ioc.severity("o") == "NO_ALARM"


@pytest.mark.parametrize("configure", [
    'etheripConfigure("Q", "127.0.0.1:{port}", 0, "image=64")',
    'drvEtherIP_image_size 64\ndrvEtherIP_define_PLC("Q", "127.0.0.1:{port}", 0)'], ids=["by option", "for all"])
def test_image_full(plant, configure):
    """A record that finds no room says so, and how much is allowed ({id})"""
    plant.tags("tag A DINT[9] = 4")
    plant.records(before="", configure=configure,
                  *[rec("longin", f"a{n}", f"A[{n}] S 0.1").replace("@P", "@Q") for n in range(5)])
    plant.ioc.wait_value("a3", 4)
    plant.ioc.process_record("a4")
    assert plant.ioc.alarm("a4")[:2] == ("INVALID", "LINK")
    assert "the image of Q is full: 64 bytes; allowed: more by etheripConfigure image=bytes" in plant.ioc.log


# --- Commands -----------------------------------------------------------------------------

def test_commands(plant):
    """The commands of ether_ip work, and plcTag does the same without an IOC"""
    plant.tags("udt Axis Pos:INT State:SINT", "tag A Axis", "tag D DINT[4] = 5")
    plant.records(rec("longin", "d", "D[3] S 0.05"), rec("ai", "errors", "D S 0.05 PLC_ERRORS",
                                                         "SCAN=.1 second"),
                  'record(bo, "$(P)reset") { field(DTYP, "EtherIPReset") }\n')
    plant.ioc.wait_value("d", 5)
    assert re.search(r"D +DINT\[4\]", plant.ioc.command("drvEtherIP_list"))
    kind = subprocess.run([PLC_TAG, f"127.0.0.1:{plant.port}", "describe", "A"],
                          capture_output=True, text=True, check=True).stdout
    assert re.search(r"\.Pos +INT", kind) and "4 bytes" in kind
    assert "D=5 5 5 5" in plant.ioc.command(
        f"drvEtherIP_read_tag 127.0.0.1:{plant.port} 0 D 4 1000")
    assert re.search(r"D +DINT, 4 bytes, every 0.05 s", plant.ioc.command("drvEtherIP_dump"))
    plant.ioc.put("reset", 1)
    for command in ("drvEtherIP_help", "EIP_verbosity(7)", "EIP_buffer_limit(450)",
                    "drvEtherIP_default_rate(0.5)", "drvEtherIP_reset_statistics",
                    "drvEtherIP_restart", "dbior drvEtherIP 2"):
        plant.ioc.command(command)
    plant.set("D[3]", 6)
    plant.ioc.wait_value("d", 6)
    assert plant.ioc.get("errors") >= 0


def test_settings(plant):
    """EIP_timeout, EIP_buffer_limit and the rest hold for PLCs that are there; silly ones are one line"""
    plant.tags("tag A DINT = 3", profile="enet")
    plant.records(rec("longin", "a", "A"), before="drvEtherIP_default_rate 0.05",
                  configure='etheripConfigure("Q", "127.0.0.1:{port}", 0, "connected=no")\n'
                            "EIP_timeout 1500\nEIP_buffer_limit 300")
    plant.ioc.wait_value("a", 3)
    report = plant.ioc.command("drvEtherIP_report 1")
    assert report.count("requestTimeout=1500") == 2 and "unconnected, 300 bytes" in report
    for line, words in [("EIP_timeout 5", 'EIP_timeout "5"; allowed: 10 to 60000 ms'),
                        ("EIP_timeout", 'EIP_timeout ""; allowed: 10 to 60000 ms'),
                        ("EIP_timeout x", 'EIP_timeout "x"; allowed'),
                        ("EIP_buffer_limit -3", "allowed: 100 to 1400 bytes"),
                        ("EIP_verbosity 99", "allowed: 0 to 10"),
                        ("drvEtherIP_default_rate nan", "allowed: 0 to 86400 s (0: none)"),
                        ("drvEtherIP_default_rate -1", "allowed: 0 to 86400 s (0: none)"),
                        ("drvEtherIP_default_rate 2", "those of iocInit keep theirs"),
                        ("drvEtherIP_image_size 3", "allowed: 64 to 16777216 bytes"),
                        ("drvEtherIP_image_size 64.5", "bytes, a whole number"),
                        ("EIP_buffer_limit 1e2", "bytes, a whole number"),
                        ("EIP_verbosity 1.5", "a whole number"),
                        ("drvEtherIP_report 4294967297", 'report "4294967297"; allowed'),
                        ("drvEtherIP_read_tag 127.0.0.1 4294967296 A", "allowed: -1 to 255 (slot)"),
                        ("drvEtherIP_read_tag 127.0.0.1 0 A 4294967297", "allowed: 0 to 65535 elements"),
                        ("drvEtherIP_read_tag 127.0.0.1 0 A 1 1e3", "allowed: 0 to 60000 ms")]:
        before = len(plant.ioc.lines)
        plant.ioc.command(line)
        said = [text for text in plant.ioc.lines[before:] if "allowed" in text or "theirs" in text]
        assert len(said) == 1 and words in said[0], (line, said)
    assert re.search(r'list: no PLC "q" by EtherNet/IP; configured: P Q$',
                     plant.ioc.command("drvEtherIP_list q"), re.M)
    assert "requestTimeout=1500" in plant.ioc.command("drvEtherIP_report 1")
    plant.ioc.command("EIP_timeout 700")
    assert plant.ioc.command("drvEtherIP_report 1").count("requestTimeout=700") == 2


def test_restart(plant):
    """drvEtherIP_restart connects anew, and the log says that and no other reason"""
    plant.tags("tag A DINT = 3")
    plant.records(rec("longin", "a", "A S 0.05"))
    plant.ioc.wait_value("a", 3)
    plant.ioc.command("drvEtherIP_restart")
    until(lambda: "2 made, 1 lost" in plant.ioc.command("drvEtherIP_report 1"))
    assert "address changed" not in plant.ioc.log and "connects anew by command" in plant.ioc.log
    until(lambda: plant.ioc.severity("a") == "NO_ALARM")


def test_forgotten_connection(plant):
    """A connection that the controller has forgotten is opened again; TCP stays, no value is lost"""
    plant.tags("tag A DINT = 3", "tag B DINT", "tag C DINT[4000] = 1")
    plant.records(rec("longin", "a", "A S 0.02"), rec("longout", "b", "B S 1"),
                  rec("waveform", "c", "C S 0.1", "FTVL=LONG", "NELM=4000"))
    plant.ioc.wait_value("a", 3)
    until(lambda: plant.ioc.severity("b") == "NO_ALARM")
    for n in range(1, 21):
        plant.sim.command("etherip timeout")
        plant.ioc.put("b", n)
        assert plant.tag("B") == str(n) and plant.ioc.severity("b") == "NO_ALARM"
        plant.set("A", n)
        plant.ioc.wait_value("a", n)
        assert plant.ioc.severity("a") == plant.ioc.severity("c") == "NO_ALARM"
    assert "1 made, 0 lost" in plant.ioc.command("drvEtherIP_report 1")
    assert "opened again" in plant.ioc.log


def test_describe(plant):
    """drvEtherIP_describe and plcTag describe take the number or name of a structure, or a tag"""
    plant.tags("udt Axis Pos:INT State:SINT", "udt Motor axis:Axis[2] Speed:DINT", "tag M Motor")
    plant.records(rec("longin", "s", "M.Speed S 0.05"))
    plant.ioc.wait_value("s", 0)
    for line in ("drvEtherIP_describe Motor", "drvEtherIP_describe P, motor", "drvEtherIP_describe M"):
        assert re.search(r"\.axis +Axis\[2\]", plant.ioc.command(line)), line
    assert re.search(r"\.Pos +INT", plant.ioc.command("drvEtherIP_describe P, Axis"))
    assert re.search(r"\.State +SINT", plant.ioc.command("drvEtherIP_describe P, M.axis[1]"))
    assert "lists no such tag" in plant.ioc.command("drvEtherIP_describe Nix")
    assert "allowed: 1 to 4095" in plant.ioc.command("drvEtherIP_describe 0")


def test_clock_jump(plant, tmp_path):
    """The time of day jumps to and fro by an hour: values, puts and periods go on, and nothing is lost"""
    clock.build(tmp_path)
    now = tmp_path / "now"
    now.write_bytes(bytes(8))
    plant.tags("tag A DINT counter", "tag B DINT", "tag C DINT counter")
    plant.records(rec("longin", "a", "A S 0.05"), rec("longout", "b", "B S 0.1"), rec("longin", "c", "C S 0.3"),
                  env=clock.environment(tmp_path, TOP / "bin" / ARCH / "eipIoc", now))
    until(lambda: plant.ioc.severity("b") == "NO_ALARM")

    def stamp():
        return plant.ioc.pv("a").get_with_metadata(form="time")["timestamp"]
    for turn, step in enumerate((3600, -3600, 3600, 0, -3600, 0)):
        before, offset = stamp(), struct.unpack("<q", now.read_bytes())[0] / 1e9
        with open(now, "r+b") as file:
            file.write(struct.pack("<q", int(step * 1e9)))
        for name in ("a", "c"):
            seen = plant.ioc.get(name)
            until(lambda: plant.ioc.get(name) > seen, name)
        plant.ioc.put("b", turn + 1)
        plant.wait_tag("B", str(turn + 1))
        until(lambda: abs(stamp() - before - (step - offset)) < 600, "the time of day that has jumped")
    assert not errors_in(plant.ioc.log)


def test_state(plant):
    """The state of a PLC that refuses some tags, or all, says so, with the first of them"""
    plant.tags("tag A DINT = 5", "tag B DINT hidden")
    plant.records(rec("longin", "a", "A S 0.05"), rec("longin", "b", "B S 0.05"), rec("longout", "o", "A S 0.05"))
    plant.ioc.wait_value("a", 5)

    def report():
        return plant.ioc.command("drvEtherIP_report 1")
    until(lambda: "some reads refused (B: no right to access it (0F) (1 of " in report(), report)
    assert plant.ioc.severity("a") == "NO_ALARM"
    plant.ioc.put("a.INP", "@P Nobody S 0.05")
    plant.ioc.put("o.OUT", "@P Nobody S 0.05")
    until(lambda: re.search(r"(?<!some )reads refused \((B|Nobody): .*2 of 2", report()), report)
    plant.ioc.put("a.INP", "@P A S 0.05")
    plant.ioc.put("o.OUT", "@P A S 0.05")
    until(lambda: "some reads refused" in report(), report)
    plant.ioc.put("b.INP", "@P A S 0.05")
    until(lambda: "refused (" not in report(), report)


def test_long_pause(plant):
    """Tags with a period longer than a connection may be silent: kept alive, no loss, and read in their turn"""
    plant.tags("tag A DINT = 5")
    plant.records(rec("longin", "a", "A S 100"), rec("longout", "o", "A S 100"))
    plant.ioc.wait_value("a", 5)
    looks = re.compile(r"services:.* 03=(\d+)")  # for the program: every 3 s

    def asked():
        found = looks.search(plant.sim.command("etherip"))
        return int(found.group(1)) if found else 0
    before = asked()
    until(lambda: asked() > before + 5)
    assert plant.ioc.severity("a") == plant.ioc.severity("o") == "NO_ALARM"
    assert not errors_in(plant.ioc.log)


def test_another_address(plant):
    """A PLC that is defined again without a port has the usual one"""
    plant.tags("tag A DINT = 3")
    plant.records(rec("longin", "a", "A S 0.05"))
    plant.ioc.wait_value("a", 3)
    assert "127.0.0.87:44818 now" in plant.ioc.command('drvEtherIP_define_PLC("P", "127.0.0.87", 0)')
    plant.ioc.wait_alarm("a", "INVALID", "COMM")
    assert "P 127.0.0.87:44818" in plant.ioc.command("drvEtherIP_report 0")
    plant.ioc.command(f'drvEtherIP_define_PLC("P", "127.0.0.1:{plant.port}", 0)')
    plant.ioc.wait_value("a", 3)
    until(lambda: plant.ioc.severity("a") == "NO_ALARM")


def test_unknown_plc(plant):
    """Questions about a PLC that is not there are one line"""
    plant.tags("tag A DINT")
    plant.records(rec("longin", "a", "A S 0.05"))
    for command in ("drvEtherIP_list Nix", "drvEtherIP_describe Nix, 300"):
        assert 'no PLC "Nix"' in plant.ioc.command(command)


def test_names_as_they_stand(plant):
    """A name that no tag can have goes to the PLC, which says so; S 0 says no period"""
    plant.tags("tag A DINT = 3")
    plant.records(rec("longin", "digits", "100 S 0.05"), rec("longin", "letters", "Não S 0.05"),
                  rec("longin", "a", "A S 0", "SCAN=.1 second"))
    for name in ("digits", "letters"):
        plant.ioc.wait_alarm(name, "INVALID", "READ", "PLC: no such tag or member (04)")
    plant.ioc.wait_value("a", 3)
    dump = plant.ioc.command("drvEtherIP_dump")
    assert re.search(r"^ *A .* every 0.1 s", dump, re.M), dump
    assert "is no name" not in plant.ioc.log


BAD_LINKS = [
    ("@P", "no tag"), ("@P a[", "an index is missing"), ("@P a%", "is not possible"),
    ("@P a S", "S has no number"), ("@P a B 64", "B 64"), ("@P a X", "is no flag; allowed: E, S seconds"),
    ("@Q a", 'no PLC "Q"'), ("@P a.3 B 4", "one of them")]


def test_bad_links(plant):
    """A bad link is one clear line, and LINK/INVALID"""
    plant.tags("tag a DINT")
    plant.records(*(f'record(longin, "$(P)bad{n}") {{ field(DTYP, "EtherIP") '
                    f'field(INP, "{link}") }}\n' for n, (link, _) in enumerate(BAD_LINKS)))
    for n, (_, words) in enumerate(BAD_LINKS):
        plant.ioc.process_record(f"bad{n}")
        assert plant.ioc.alarm(f"bad{n}")[:2] == ("INVALID", "LINK")
        line = next(line for line in plant.ioc.log.splitlines() if f'bad{n}"' in line)
        assert words in line


def test_no_offsets(plant):
    """A link by offset to a PLC with tags is one clear line, and LINK/INVALID, before and after iocInit"""
    plant.tags("tag a DINT")
    ioc = plant.new_ioc(f'etheripConfigure("P", "127.0.0.1:{plant.port}", 0)', rec("longin", "a", "a S 0.05")
                        + 'record(longin, "$(P)off") { field(DTYP, "S7plc") field(INP, "@P/0 T=INT32") }\n')
    lines = [line for line in ioc.log.splitlines() if "has tags, no offsets" in line]
    assert len(lines) == 1 and 'off"' in lines[0]
    until_equal(lambda: ioc.alarm("a")[0], "NO_ALARM")
    ioc.put("off.INP", "@P/8 T=INT32")
    ioc.process_record("off")
    assert ioc.alarm("off")[:2] == ("INVALID", "LINK")


def test_other_dtyp(plant):
    """A link of the other kind names the DTYP that it takes; a link that is refused has one line, no doubts before it"""
    plant.tags("tag a DINT")
    ioc = plant.new_ioc(f'etheripConfigure("P", "127.0.0.1:{plant.port}", 0)\n'
                        's7plcConfigure("B", "", 0, 4, 4, 1, 2000, 100)',
                        'record(bi, "$(P)flag") { field(DTYP, "S7plc") field(INP, "@P Flags[6]") }\n'
                        'record(ai, "$(P)level") { field(DTYP, "S7plc") field(INP, "@P Tank.Level S 0.1") }\n'
                        'record(ai, "$(P)off") { field(DTYP, "S7plc") field(INP, "@P/4") }\n'
                        'record(ai, "$(P)tag") { field(DTYP, "EtherIP") field(INP, "@B Tank.Level") }\n'
                        'record(waveform, "$(P)wave") { field(DTYP, "EtherIP") field(INP, "@P a E") field(NELM, "2") field(FTVL, "LONG") }\n'
                        'record(waveform, "$(P)bits") { field(DTYP, "EtherIP") field(INP, "@P a B 1") field(NELM, "2") field(FTVL, "LONG") }\n')
    for name, words in [("flag", 'a PLC by EtherNet/IP has tags, no offsets; needed: DTYP "EtherIP", as in @PLC Tank.Level'),
                        ("level", 'needed: DTYP "EtherIP", as in @PLC Tank.Level'), ("off", 'needed: DTYP "EtherIP"'),
                        ("tag", 'B is no PLC with tags; drvEtherIP_define_PLC or etheripConfigure makes one. '
                                'Here DTYP "S7plc" is needed, as in @B/0'), ("wave", "E is not for a waveform"), ("bits", "waveform has no bit 1")]:
        lines = [line for line in ioc.log.splitlines() if f':{name}"' in line and "record(" not in line]
        assert len(lines) == 1 and words in lines[0], lines


def test_wrong_definitions(plant):
    """A wrong argument of a definition is one line, and no PLC"""
    plant.tags("tag A DINT")
    plant.records(rec("longin", "a", "A S 0.05"))
    for line, words in [('drvEtherIP_define_PLC("Q", "127.0.0.1", 300)', "allowed: 0 to 255"),
                        ('drvEtherIP_define_PLC("Q", "127.0.0.1", x)', "allowed: 0 to 255"),
                        ('drvEtherIP_define_PLC("Q", "127.0.0.1:99999", 0)', "allowed: 1 to 65535"),
                        ('drvEtherIP_define_PLC("Q", "a b", 0)', "allowed: host name"),
                        ('drvEtherIP_define_PLC("Q", "192.168.1", 0)', "allowed: host name"),
                        ('etheripConfigure("Q", "0300.1.1.1:44818", 0)', "four numbers"),
                        ('drvEtherIP_define_PLC', "PLCname is missing"),
                        ('etheripConfigure("Q", "127.0.0.1", "1,0,")', "allowed: 0 to 255"),
                        ('etheripConfigure("Q", "127.0.0.1", 0, "image=1")', "allowed: image=64")]:
        assert words in plant.ioc.command(line), line
    assert "Q" not in plant.ioc.command("drvEtherIP_report 0")


def test_plctag_writes(plant):
    """plcTag writes numbers, bits and strings, and says why not"""
    plant.tags("udt Name string 4", "udt Axis Pos:DINT Speed:DINT", "tag X Axis", "tag D DINT[4]",
               "tag S STRING", "tag N Name", "tag R REAL")

    def tag(*words, status=0):
        done = subprocess.run([PLC_TAG, f"127.0.0.1:{plant.port}", *words], capture_output=True,
                              text=True, timeout=30)
        assert done.returncode == status, done
        return done.stdout + done.stderr

    tag("write", "D[1]", "5", "-6")
    tag("write", "D[3].4", "1")
    tag("write", "S", "a \"b\"")
    tag("write", "N", "abcd")
    tag("write", "R", "0.1")
    assert tag("read", "D[0]", "S", "N", "R") == 'D[0]=0\nS="a \\"b\\""\nN="abcd"\nR=0.1\n'
    assert [plant.tag(f"D[{n}]") for n in range(4)] == ["0", "5", "-6", "16"]
    assert "does not fit" in tag("write", "N", "abcde", status=1)
    tag("write", "X.Pos", "77")
    assert "its members" in tag("write", "X", "1", status=1)
    assert plant.tag("X.Pos") == "77"
    assert "does not fit DINT" in tag("write", "D", "1.5", status=1)
    assert "no such tag" in tag("read", "nix", status=1)
    assert tag("list", "R").split() == ["R", "REAL"]
    assert "1756-L83E" in tag("identify")
    assert tag("read", "a[", status=1)


def test_ether_ip_test(plant):
    """The command line of ether_ip's test program reads, writes, lists and describes"""
    plant.tags("udt Axis Pos:INT State:SINT", "tag A DINT = 7", "tag R REAL[4] = 1.5", "tag X Axis")

    def run(*words):
        return subprocess.run([TOP / "bin" / ARCH / "ether_ip_test", *words], capture_output=True, text=True,
                              timeout=60)
    here = ("-i", "127.0.0.1", f"-p{plant.port}", "-s", "0", "-t", "3000")
    assert run(*here, "A").stdout == "A=7\n"
    assert run(*here, "-a", "3", "R").stdout.split() == ["R=1.5", "1.5", "1.5"]
    assert run(*here, "-w", "12", "A").returncode == 0 and plant.tag("A") == "12"
    assert run(*here, "-W13", "A").returncode == 0 and plant.tag("A") == "13"
    assert run(*here, "-T", "3", "A").stdout.count("A=13") >= 1
    listed = run(*here, "-l").stdout
    assert re.search(r"^A +DINT", listed, re.M) and "Axis" in listed
    assert ".Pos" in run(*here, "-d", "Axis").stdout
    for wrong in ((), ("-i", "127.0.0.1"), (*here, "-q", "A"), (*here[2:], "A")):
        done = run(*wrong)
        assert done.returncode == 1 and "usage: ether_ip_test" in done.stderr
    assert run(*here, "Nobody").returncode != 0


def test_plctag_port(plant):
    """plcTag refuses a port that is no number from 1 to 65535, also when it begins like the right one"""
    plant.tags("tag D DINT")
    for port in ("", "0", "-1", "65536", "x", f"{plant.port}abc", f"{plant.port} 1", plant.port + 2**32):
        done = subprocess.run([PLC_TAG, f"127.0.0.1:{port}", "read", "D"], capture_output=True,
                              text=True, timeout=30)
        assert done.returncode == 2 and f"port {port}; allowed: 1 to 65535" in done.stderr, done


def test_plctag_programs_structures(plant):
    """plcTag lists programs, reads structures by members, and watches until a tag is refused"""
    plant.tags("udt Axis Pos:INT On:BOOL Off:BOOL", "udt Name string 4",
               "udt Motor axis:Axis[2] Speed:REAL name:Name", "tag M Motor", "tag Program:Main.x DINT = 7")

    def tag(*words, status=0, options=()):
        done = subprocess.run([PLC_TAG, *options, f"127.0.0.1:{plant.port}", *words], capture_output=True,
                              text=True, timeout=30)
        assert done.returncode == status, done
        return done.stdout + done.stderr

    assert tag("list", "Program:*").split() == ["Program:Main.x", "DINT"]
    assert "Program:Main.x  DINT" in tag("describe", "Program:Main.x")
    tag("write", "Program:Main.x", "-3")
    assert tag("read", "Program:Main.x") == "Program:Main.x=-3\n"
    for words in (("M.axis[1].Pos", "-5"), ("M.axis[1].Off", "1"), ("M.Speed", "1.5"), ("M.name", "ab")):
        tag("write", *words)
    assert tag("read", "M") == ('M={axis={Pos=0 On=0 Off=0} {Pos=-5 On=0 Off=1} Speed=1.5 '
                                'name="ab"}\n')
    assert tag("read", "M.axis[1]") == "M.axis[1]={Pos=-5 On=0 Off=1}\n"
    assert tag("watch", "M.axis[1]", options=("-w", "0.01", "-c", "3")).count("Pos=-5") == 1
    assert "no such tag" in tag("watch", "Nix", status=1, options=("-w", "0.01", "-c", "3"))


# --- The demonstration --------------------------------------------------------------------

def test_demo():
    """make demo-etherip shows tags, a put, a missing tag, and ends by itself"""
    shown = run_demo("iocEtherIP", 120)
    requests = re.search(r"Requests per second for all of it +([\d.]+)", shown)
    assert 5 < float(requests.group(1)) < 13


@pytest.mark.parametrize("scan", ["changed", "all"])
def test_scan(plant, scan):
    """With scan=all an input processes with each read; without it, when its bytes change"""
    plant.tags("tag A DINT = 3", "tag B DINT = 0")
    plant.records(rec("longin", "a", "A S 0.02", "FLNK=$(P)n"), rec("longin", "b", "B S 0.02"),
                  'record(calc, "$(P)n") { field(INPA, "$(P)n") field(CALC, "A+1") }\n',
                  configure=f"s7plcSetOption P scan {scan}\n")
    plant.ioc.wait_value("a", 3)
    plant.set("B", 1)
    plant.ioc.wait_value("b", 1)
    first = plant.ioc.get("n")
    if scan == "all":
        until(lambda: plant.ioc.get("n") >= first + 10)
    for number in range(2, 12):
        plant.set("B", number)
        plant.ioc.wait_value("b", number)
    assert scan == "all" or plant.ioc.get("n") == first


def test_scan_period(plant):
    """Without S the period is that of SCAN, else drvEtherIP_default_rate"""
    plant.tags(*(f"tag T{n} DINT" for n in range(4)))
    plant.records(rec("longin", "t0", "T0", "SCAN=.1 second"), rec("longin", "t1", "T1", "SCAN=5 second"),
                  rec("longin", "t2", "T2"), rec("longin", "t3", "T3 S 0.3", "SCAN=5 second"),
                  before="drvEtherIP_default_rate(0.7)")
    until(lambda: "T3 " in plant.ioc.command("drvEtherIP_dump"))
    until(lambda: plant.ioc.command("drvEtherIP_dump").count("every") == 4)
    dump = plant.ioc.command("drvEtherIP_dump")
    assert re.findall(r"every ([\d.]+) s", dump) == ["0.1", "5", "0.7", "0.3"]
    plant.set("T0", 5)
    plant.ioc.wait_value("t0", 5)
