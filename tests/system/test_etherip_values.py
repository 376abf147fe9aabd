"""DTYP "EtherIP": values at the edges of types and records, bits that a type has not, links and types that
change at run time. Nothing that is not so is shown as good, and each refusal names its reason."""
import re
import socket

import pytest

from eipplant import rec
from waiting import until, until_equal

INTEGERS = {"SINT": (-2**7, 2**7 - 1), "INT": (-2**15, 2**15 - 1), "DINT": (-2**31, 2**31 - 1),
            "LINT": (-2**63, 2**63 - 1), "USINT": (0, 2**8 - 1), "UINT": (0, 2**16 - 1),
            "UDINT": (0, 2**32 - 1), "ULINT": (0, 2**64 - 1)}
BITS = {"BYTE": 8, "WORD": 16, "DWORD": 32, "LWORD": 64}
RECORDS = {"longin": 32, "int64in": 64}


def exact(ioc, name):
    """VAL as the IOC has it: CA has no integers of 64 bits."""
    return int(re.search(r"DBF_\w+:\s*(-?\d+)", ioc.command(f"dbgf {ioc.P}{name}")).group(1))


@pytest.mark.parametrize("kind", INTEGERS)
def test_read_edges(plant, kind):
    """longin and int64in show the lowest and the highest of each integer type, or say what it is and their limit"""
    low, high = INTEGERS[kind]
    plant.tags(f"tag T {kind} = 1")
    plant.records(*(rec(record, record, "T S 0.02") for record in RECORDS))
    for value in (low, high, 0, high, low):
        plant.set("T", value)
        for record, bits in RECORDS.items():
            least, most = -2**(bits - 1), 2**(bits - 1) - 1
            if least <= value <= most:
                until_equal(lambda: exact(plant.ioc, record), value)
                plant.ioc.wait_alarm(record, "NO_ALARM")
                continue
            brief = f"{'-' if value < 0 else ''}2^{bits - 1}{'' if value < 0 else '-1'}"
            words = f"{value} is {'below' if value < 0 else 'above'} "
            words += brief if bits == 64 or len(str(value)) > 16 else str(least if value < 0 else most)
            until_equal(lambda: plant.ioc.alarm(record), ("INVALID", "READ", words))


@pytest.mark.parametrize("kind", INTEGERS)
def test_write_edges(plant, kind):
    """longout, int64out, ao and calcout write what an integer type has, and are refused what it has not"""
    low, high = INTEGERS[kind]
    plant.tags(f"tag T {kind} = 1")
    plant.records(*(rec(record, record, "T S 0.02") for record in ("longout", "int64out", "ao")),
                  rec("calcout", "calcout", "T S 0.02", "CALC=A"), rec("aao", "aao", "T S 0.02", "FTVL=DOUBLE", "NELM=1"))
    plant.ioc.wait_value("longout", 1)
    for record, field in (("longout", "longout"), ("int64out", "int64out"), ("ao", "ao"), ("calcout", "calcout.A"),
                          ("aao", "aao")):
        least, most = {"longout": (-2**31, 2**31 - 1), "int64out": (-2**63, 2**63 - 1)}.get(record, (-2**70, 2**70))
        values = {low - 1, high + 1, -1} if most < 2**64 else {low - 1 if low > -2**53 else low * 4, high + 1, -1, float("nan")}
        if record in ("ao", "aao"):
            values |= {float("inf"), -float("inf")}
        for value in values:
            if value == value and not least <= value <= most:
                continue
            fits = value == value and low <= value <= high
            plant.set("T", 5)
            for each in ("longout", "int64out", "ao", "aao"):
                plant.ioc.wait_value(each, 5)
            if record == "int64out":
                plant.ioc.command(f"dbpf {plant.ioc.P}{field} {value}")
            else:
                plant.ioc.put(field, value)
            if fits:
                plant.wait_tag("T", str(value))
            else:
                words = "an element" if record == "aao" else "the value"
                assert plant.ioc.alarm(record) == ("INVALID", "WRITE", f"{words} does not fit {kind}"), (record, value)
                assert plant.tag("T") == "5"


def test_bits_stay_bits(plant):
    """BYTE to LWORD are bits: a longin has those of a DWORD, int64in those of an LWORD, both ways"""
    plant.tags(*(f"tag {kind} {kind}" for kind in BITS))
    plant.records(*(rec("longin", f"l{kind}", f"{kind} S 0.02") + rec("int64in", f"i{kind}", f"{kind} S 0.02") +
                    rec("longout", f"lo{kind}", f"{kind} S 0.02") + rec("int64out", f"io{kind}", f"{kind} S 0.02")
                    for kind in BITS))
    for kind, n in BITS.items():
        plant.set(kind, 2**n - 1)
        until_equal(lambda: exact(plant.ioc, f"i{kind}"), -1 if n == 64 else 2**n - 1)
        if n < 64:
            until_equal(lambda: exact(plant.ioc, f"l{kind}"), -1 if n == 32 else 2**n - 1)
        else:
            plant.ioc.wait_alarm(f"l{kind}", "INVALID", "READ", f"{2**64 - 1} is above 2^31-1")
        plant.set(kind, 1)
        until_equal(lambda: exact(plant.ioc, f"lo{kind}"), 1)
        plant.ioc.put(f"lo{kind}", -1)
        if n < 32:
            assert plant.ioc.alarm(f"lo{kind}") == ("INVALID", "WRITE", f"the value does not fit {kind}")
        else:
            plant.wait_tag(kind, str(2**32 - 1))
        plant.ioc.command(f"dbpf {plant.ioc.P}io{kind} -1")
        if n < 64:
            plant.ioc.wait_alarm(f"io{kind}", "INVALID", "WRITE", f"the value does not fit {kind}")
        else:
            plant.wait_tag(kind, str(2**64 - 1))


def test_large_without_sign(plant):
    """ai and ao on a ULINT, an LWORD show their largest values, rounded, and none below 0"""
    plant.tags("tag U ULINT", "tag L LWORD")
    plant.records(*(rec(kind, f"{kind}{tag}", f"{tag} S 0.02") for kind in ("ai", "ao") for tag in "UL"))
    for value in 2**63, 2**64 - 2**32, 2**64 - 4096, 2**64 - 1:
        for tag in "UL":
            plant.set(tag, value)
            for kind in "ai", "ao":
                until_equal(lambda: plant.ioc.get(f"{kind}{tag}"), float(value))


def test_real_edges(plant):
    """A REAL goes to integer records rounded, or they say what it is; NaN is no whole number, nor a state"""
    plant.tags("tag R REAL", "tag I INT = 3", "tag L LREAL")
    plant.records(rec("longin", "l", "R S 0.02"), rec("int64in", "i", "R S 0.02"), rec("longout", "o", "R S 0.02"),
                  rec("bi", "b", "R S 0.02"), rec("mbbi", "m", "R S 0.02", "NOBT=3"), rec("ai", "a", "R S 0.02"),
                  rec("waveform", "w", "R S 0.02", "FTVL=LONG", "NELM=1"),
                  rec("waveform", "f", "L S 0.02", "FTVL=FLOAT", "NELM=1"), rec("bo", "bit", "I.4 S 0.02"),
                  rec("calcout", "c", "I.5 S 0.02", "CALC=A"), rec("ao", "abit", "I.6 S 0.02"))
    for text, value, words in (("2.5", 3, None), ("1e30", None, "1e+30 is above 2147483647"),
                               ("-3e9", -3e9, "-3000000000 is below -2147483648"), ("4.4", 4, None),
                               ("nan", None, "NaN is no whole number"), ("-inf", None, "-inf is below -2147483648"),
                               ("0", 0, None)):
        plant.set("R", text)
        if words is None:
            for record in ("l", "i", "o", "m"):
                plant.ioc.wait_value(record, value)
                plant.ioc.wait_alarm(record, "NO_ALARM")
            plant.ioc.wait_value("b", int(value != 0))
            plant.ioc.wait_value("w", value)
            continue
        for record in ("l", "o", "w"):
            plant.ioc.wait_alarm(record, "INVALID", "READ", words)
        if value is None:
            plant.ioc.wait_alarm("i", "INVALID", "READ", words.replace(str(2**31 - 1), "2^63-1").replace(str(-2**31), "-2^63"))
        else:
            plant.ioc.wait_value("i", value)
        if text == "nan":
            plant.ioc.wait_alarm("b", "INVALID", "READ", words)
            plant.ioc.wait_alarm("m", "INVALID", "READ", words)
            plant.ioc.wait_alarm("a", "INVALID")
    plant.set("R", 9)
    plant.ioc.wait_alarm("m", "INVALID", "READ", "9 is above 7")
    plant.set("L", "1e300")
    plant.ioc.wait_alarm("f", "INVALID", "READ", "1e+300 is above 3.4028235e+38")
    plant.ioc.put("c.A", 1)
    plant.wait_tag("I", str(3 + 32))
    for record, field in (("c", "c.A"), ("abit", "abit")):
        plant.ioc.put(field, 2)
        assert plant.ioc.alarm(record) == ("INVALID", "WRITE", "the value does not fit its bits")
        plant.ioc.put(field, float("nan"))
        assert plant.ioc.alarm(record)[:1] == ("INVALID",)
    assert plant.tag("I") == str(3 + 32)


def test_scaled_ao(plant):
    """An ao with a scale reaches all values of a UDINT, and is refused NaN"""
    plant.tags("tag U UDINT = 8", "tag D DINT = 8")
    plant.records(rec("ao", "u", "U S 0.02", "LINR=SLOPE", "ESLO=2"), rec("ao", "d", "D S 0.02", "LINR=SLOPE", "ESLO=2"))
    plant.ioc.wait_value("u", 16.0)
    plant.ioc.put("u", 8e9)
    plant.wait_tag("U", "4000000000")
    plant.ioc.wait_value("d", 16.0)
    for value in (8e9, float("nan")):
        plant.ioc.put("d", value)
        assert plant.ioc.alarm("d")[0] == "INVALID"
        assert plant.tag("D") == "8"


def test_arrays_edges(plant):
    """Arrays of which an element does not fit the record's are not shown; characters and BOOL arrays stay bits"""
    plant.tags("tag U UDINT[3] = 5", "tag S SINT[3] = -1", "tag B BOOL[64]", "tag D DINT[3] = 200", "tag UL ULINT[3] = 5")
    plant.set("B[1]", 2**32 - 1)
    plant.records(rec("waveform", "u", "U S 0.02", "FTVL=LONG", "NELM=3"), rec("aao", "uo", "U S 0.02", "FTVL=LONG", "NELM=3"),
                  rec("waveform", "uu", "U S 0.02", "FTVL=ULONG", "NELM=3"),
                  rec("waveform", "s", "S S 0.02", "FTVL=UCHAR", "NELM=3"), rec("aao", "so", "S S 0.02", "FTVL=UCHAR", "NELM=3"),
                  rec("waveform", "b", "B S 0.02", "FTVL=LONG", "NELM=2"), rec("waveform", "c", "D S 0.02", "FTVL=CHAR", "NELM=3"),
                  rec("aai", "sh", "D S 0.02", "FTVL=SHORT", "NELM=3"), rec("waveform", "ul", "UL S 0.02", "FTVL=INT64", "NELM=3"),
                  rec("waveform", "long", "D S 0.02", "FTVL=LONG", "NELM=4"))
    until_equal(lambda: plant.ioc.plain("u"), [5, 5, 5])
    until_equal(lambda: plant.ioc.plain("uo"), [5, 5, 5])
    until_equal(lambda: plant.ioc.plain("s"), [255, 255, 255])
    until_equal(lambda: plant.ioc.plain("so"), [255, 255, 255])
    until_equal(lambda: plant.ioc.plain("b"), [0, -1])
    until_equal(lambda: [v & 255 for v in plant.ioc.plain("c")], [200, 200, 200])
    plant.set("U[1]", 4000000000)
    plant.set("D[2]", 70000)
    plant.set("UL[1]", 2**63)
    for record in ("u", "uo"):
        plant.ioc.wait_alarm(record, "INVALID", "READ", "4000000000 is above 2147483647")
        assert plant.ioc.plain(record) == [5, 5, 5]
    plant.ioc.wait_alarm("c", "INVALID", "READ", "70000 is above 255")
    plant.ioc.wait_alarm("sh", "INVALID", "READ", "70000 is above 32767")
    plant.ioc.wait_alarm("ul", "INVALID", "READ", f"{2**63} is above 2^63-1")
    assert plant.ioc.severity("uu") == "NO_ALARM"
    plant.ioc.wait_alarm("long", "INVALID", "READ", "index beyond the end")
    plant.ioc.put("so", [1, 200, 3])
    plant.wait_tag("S[1]", str(200 - 256))
    plant.set("U[1]", 7)
    until_equal(lambda: plant.ioc.plain("uo"), [5, 7, 5])
    plant.ioc.wait_alarm("uo", "NO_ALARM")


# --- Bits that are not there ---------------------------------------------------------------------

MISSING = [("bi", "SINT B 9", "SINT has bits 0 to 7"), ("bo", "SINT B 9", "SINT has bits 0 to 7"),
           ("bi", "D.32", "DINT has bits 0 to 31"), ("bo", "D.32", "DINT has bits 0 to 31"),
           ("bi", "D B 40", "DINT has bits 0 to 31"), ("ai", "D.32", "DINT has bits 0 to 31"),
           ("bi", "R B 2", "REAL has no bits"), ("bo", "R B 2", "REAL has no bits"),
           ("longin", "R.2", "REAL has no bits"), ("bi", "Rs[3]", "REAL has no bits"),
           ("mbbi", "Rs[30]", "REAL has no bits"), ("mbbo", "Rs[30]", "REAL has no bits"),
           ("bi", "BOOL B 3", "BOOL has bit 0 only"), ("bo", "BOOL.3", "BOOL has bit 0 only"),
           ("bo", "SINTs[9]", "SINT has bits 0 to 7"), ("mbboDirect", "SINT", "SINT has bits 0 to 7"),
           ("mbbi", "SINT B 8", "SINT has bits 0 to 7")]


def test_missing_bits(plant):
    """Bits that the tag's type has not are READ/INVALID as soon as it is known, and a put is WRITE; what is allowed is said"""
    plant.tags("tag SINT SINT = -1", "tag D DINT = -1", "tag R REAL = 1.5", "tag Rs REAL[4]", "tag BOOL BOOL = 1",
               "tag SINTs SINT[9] = -1")
    plant.records(*(rec(kind, f"r{n}", f"{link} S 0.02", *(["NOBT=9"] if kind.startswith("mbb") else []))
                    for n, (kind, link, _) in enumerate(MISSING)),
                  rec("mbbi", "part", "SINT S 0.02", "NOBT=9"), rec("bi", "counted", "SINTs[9] S 0.02"),
                  rec("mbbi", "int", "D S 0.02", "NOBT=3"))
    for n, (kind, _, words) in enumerate(MISSING):
        until_equal(lambda: plant.ioc.alarm(f"r{n}"), ("INVALID", "READ", words))
        if kind in ("bo", "mbbo", "mbboDirect"):
            plant.ioc.put(f"r{n}", 1)
            assert plant.ioc.alarm(f"r{n}") == ("INVALID", "WRITE", words)
    plant.ioc.wait_value("part", 255)
    plant.ioc.wait_value("int", 7)
    plant.ioc.wait_value("counted", 0)
    assert [plant.tag(name) for name in ("SINT", "D", "R", "BOOL", "SINTs[0]")] == ["-1", "-1", "1.5", "1", "-1"]


def test_bits_beyond_the_end(plant):
    """Bits of which a part is beyond the end of a BOOL array: refused as a whole, also after a download that shrank it"""
    plant.tags("tag B BOOL[64]", "tag D DINT[3]")
    plant.records(rec("mbboDirect", "o", "B[60] S 0.02", "NOBT=8"), rec("mbbiDirect", "i", "B[60] S 0.02", "NOBT=8"),
                  rec("mbboDirect", "d", "D[60] S 0.02", "NOBT=8"), rec("mbboDirect", "good", "D[20] S 0.02", "NOBT=8"))
    plant.ioc.wait_alarm("o", "INVALID", "READ", "PLC: no such element (05)")
    plant.ioc.wait_alarm("i", "INVALID", "READ", "PLC: index beyond the end (FF 2105)")
    plant.ioc.put_direct("o", 0xA5)
    assert plant.ioc.alarm("o") == ("INVALID", "WRITE", "PLC: no such element (05)")
    assert plant.tag("B[1]") == "0"
    plant.ioc.wait_value("d", 0)
    plant.ioc.put_direct("d", 0xA5)
    plant.wait_tag("D[2]", "10")
    assert plant.ioc.severity("d") == "NO_ALARM"
    plant.sim.command("etherip tag D DINT[2]")
    plant.ioc.wait_alarm("d", "INVALID", "READ", "no such element")
    plant.ioc.put_direct("d", 0xFF)
    assert plant.ioc.alarm("d")[:2] == ("INVALID", "WRITE")
    assert plant.tag("D[1]") == "0"
    plant.sim.command("etherip tag D DINT[3]")
    plant.ioc.put_direct("good", 0x5A)
    plant.wait_tag("D[0]", str(0x5A << 20))


# --- Links and types that change -------------------------------------------------------------------

def test_link_to_zero(plant):
    """A link that changes to a tag with the value 0 shows it; one that comes back never shows what its tag was"""
    plant.tags("tag A DINT = 5", "tag Z DINT", "tag R REAL", "tag S STRING", "tag W INT[3]", "tag B BOOL[32]")
    plant.records(rec("longin", "l", "A S 0.02"), rec("ai", "a", "A S 0.02"), rec("bi", "b", "A S 0.02"),
                  rec("stringin", "s", "S S 0.02"), rec("aai", "w", "A S 0.02", "FTVL=LONG", "NELM=1"))
    plant.ioc.wait_value("l", 5)
    for link in ("Z", "R", "B[0]", "A", "W[1]"):
        for name in ("l", "a", "b"):
            plant.ioc.put(f"{name}.INP", f"@P {link} S 0.02")
            plant.ioc.wait_value(name, (1 if name == "b" else 5) if link == "A" else 0)
            plant.ioc.wait_alarm(name, "NO_ALARM")
    plant.ioc.put("w.INP", "@P W S 0.02")
    plant.ioc.wait_value("w", 0)
    plant.ioc.wait_alarm("w", "NO_ALARM")
    plant.ioc.put("l.INP", "@P A S 0.02")
    plant.ioc.wait_value("l", 5)
    plant.ioc.put("l.INP", "@P Z S 0.02")
    plant.ioc.wait_value("l", 0)
    for name in ("a", "b", "w"):
        plant.ioc.put(f"{name}.INP", "@P Z S 0.02")
    plant.set("A", 6)
    until(lambda: "A" not in plant.ioc.command("drvEtherIP_dump").split(), "A is wanted by nobody")
    seen = plant.ioc.watch("l")
    plant.ioc.put("l.INP", "@P A S 0.02")
    plant.ioc.wait_value("l", 6)
    assert 5 not in seen


OUTPUTS = [("longout", [], 1, 2), ("ao", [], 1.0, 2.0), ("bo", ["ZNAM=0", "ONAM=1"], 1, 0), ("mbboDirect", ["NOBT=8"], 1, 2),
           ("stringout", [], "one", "two"), ("aao", ["FTVL=LONG", "NELM=2"], [1, 1], [2, 2])]


@pytest.mark.parametrize("kind,fields,first,second", OUTPUTS, ids=[row[0] for row in OUTPUTS])
@pytest.mark.parametrize("before", ["@P A", "@nix A"])
def test_output_joins(plant, kind, fields, first, second, before):
    """An output whose link changes, from {before}, to a tag that another one has, shows its value and writes no other: {kind}"""
    if kind == "stringout":
        plant.tags('tag A STRING = "one"', 'tag B STRING = "two"')
    elif kind == "aao":
        plant.tags("tag A DINT[2] = 1 1", "tag B DINT[2] = 2 2")
    else:
        plant.tags("tag A DINT = 1", f"tag B DINT = {int(second)}")
    link = (" B 0" if kind == "bo" else "") + " S 0.05"
    plant.records(rec(kind, "o", "A" + link, *fields).replace("@P A", before),
                  rec(kind, "other", "B" + link, *fields))
    plant.ioc.wait_alarm("other", "NO_ALARM")
    plant.ioc.wait_alarm("o", "INVALID" if "nix" in before else "NO_ALARM")
    was = plant.tag("B")
    plant.ioc.put("o.OUT", f"@P B{link}")
    value = plant.ioc.text if kind == "stringout" else plant.ioc.plain
    until_equal(lambda: value("o"), second)
    plant.ioc.wait_alarm("o", "NO_ALARM")
    plant.ioc.process_record("o")
    until_equal(lambda: value("other"), second)
    assert plant.tag("B") == was and plant.ioc.severity("o") == "NO_ALARM"


def test_types_change(plant):
    """A download that changes the type of a tag changes what records show of it, and what they cannot show"""
    plant.tags("tag T DINT = 5", "tag A INT[3] = 2")
    plant.records(rec("longin", "l", "T S 0.02"), rec("longout", "o", "T S 0.02"), rec("ai", "a", "T S 0.02"),
                  rec("bo", "b", "T.20 S 0.02"), rec("bi", "bi", "T.20 S 0.02"), rec("stringin", "s", "T S 0.02"),
                  rec("waveform", "w", "A S 0.02", "FTVL=SHORT", "NELM=3"))
    plant.ioc.wait_value("o", 5)
    plant.ioc.wait_alarm("s", "INVALID", "READ", "the tag is a number, no string")
    for line, value, longs, bits in (
            ("T REAL = 7.5", 7.5, 8, "REAL has no bits"), ("T UDINT = 4000000000", 4e9, "4000000000 is above 2147483647", None),
            ("T SINT = -3", -3.0, -3, "SINT has bits 0 to 7"), ("T DINT = 0", 0.0, 0, None),
            ("T BOOL = 1", 1.0, 1, "BOOL has bit 0 only"), ('T STRING = "x"', None, "no number", "no number"),
            ("T LINT = 1048576", 1048576.0, 1048576, None)):
        plant.sim.command(f"etherip tag {line}")
        if value is not None:
            plant.ioc.wait_value("a", value)
        for name in ("l", "o"):
            if isinstance(longs, str):
                plant.ioc.wait_alarm(name, "INVALID", "READ", longs)
            else:
                plant.ioc.wait_value(name, longs)
                plant.ioc.wait_alarm(name, "NO_ALARM")
        for name in ("b", "bi"):
            plant.ioc.wait_alarm(name, *(("INVALID", "READ", bits) if bits else ("NO_ALARM",)))
        if value is None:
            plant.ioc.wait_value("s", "x")
    plant.ioc.wait_value("b", 1)
    plant.sim.command("etherip tag A REAL[3] = 1.5")
    until_equal(lambda: plant.ioc.plain("w"), [2, 2, 2])
    plant.sim.command("etherip tag A INT[2] = 4")
    plant.ioc.wait_alarm("w", "INVALID", "READ", "beyond the end")


REFUSED_TAGS = ["A NOTYPE", "A DINT[0]", "A DINT[3] = 1 2", "A DINT = 1 2", "A DINT -> DB99.0", "A DINT ramp 0", "A"]


def test_refused_tag(plant):
    """A tag that the console refuses in the place of another one leaves that one: its value and its signal"""
    plant.tags("tag First DINT", "tag A DINT = 5", "tag S DINT ramp 0 100 3s", "tag Last DINT = 7", "db 10 20")
    for line in REFUSED_TAGS:
        with pytest.raises(AssertionError):
            plant.sim.command("etherip tag " + line)
        with pytest.raises(AssertionError):
            plant.sim.command("etherip tag " + line.replace("A", "S", 1))
        assert plant.tag("A") == "5" and plant.tag("Last") == "7"
    before = plant.tag("S")
    until(lambda: plant.tag("S") != before)
    plant.sim.command("etherip tag S DINT = 9")  # one that is taken has its own value, and the signal is gone
    plant.sim.command("etherip tag A DINT -> DB10.0 ramp 0 100 3s")
    plant.sim.command("etherip tag A DINT -> DB10.0 ramp 500 600 3s")
    until(lambda: 500 <= int(plant.tag("A")) <= 600)
    assert plant.tag("S") == "9"


def test_limits_of_plcsim(plant):
    """plcSim has 32 clients at a time, one more is closed at once; a line of the console has 128 words"""
    plant.tags("tag A DINT[130]")
    clients = [socket.create_connection(("127.0.0.1", plant.port), 10) for _ in range(33)]
    until(lambda: "clients=32" in plant.sim.command("etherip") and "sent_away=1" in plant.sim.command("etherip"))
    assert clients[32].recv(1) == b""
    for client in clients:
        client.close()
    plant.sim.command("etherip set A[0] " + "7 " * 125)
    with pytest.raises(AssertionError, match="more than 128 words"):
        plant.sim.command("etherip set A[0] " + "7 " * 126)
