"""Puts to tags, and what their records show after them: what the PLC makes of a value counts, and
what was read before it never comes back."""
import re
import time

import epics
import pytest

from eipplant import rec
from ioc import SINCE_7_0_6
from waiting import until, until_equal

# Only a read ends what a record shows after its put: by time it would last for an hour.
NO_TIME = 's7plcSetOption("P", "readPeriod", "3600000")'

# kind, tag, put, what the PLC makes of it, more fields
KINDS = [("longout", "D DINT", 5, 3), ("int64out", "L LINT", 5, 3), ("ao", "R REAL", 5.5, 2.5),
         ("bo", "B BOOL", 1, 0), ("bo", "Bs[1] BOOL[64]", 1, 0), ("bo", "W.3 DINT", 1, 0),
         ("mbbo", "M DINT", 2, 1, "NOBT=2"), *([("mbboDirect", "Md[1] DINT[3]", 0b1010, 0b0010, "NOBT=4")] if SINCE_7_0_6 else []),
         ("stringout", "S STRING", "put", "plc"), ("lso", "Ls STRING", "put", "plc", "SIZV=83"),
         ("aao", "A DINT[3]", [4, 5, 6], [4, 5, 3], "FTVL=LONG", "NELM=3")]


def heard(ioc, name):
    """A list that gets (value, SEVR) of each monitor; it has the first."""
    seen = []
    ioc.pvs[f"{name}, heard"] = epics.PV(
        ioc.P + name, callback=lambda value=None, severity=None, **_: seen.append((value, severity)))
    until(lambda: seen, f"the first monitor of {name}")
    return seen


def text_of(value):
    if isinstance(value, str):
        return f'"{value}"'
    return " ".join(map(str, value)) if isinstance(value, list) else str(value)


def tag_of(row):
    return row[1].split()[0].split(".")[0]


def declared(rows):
    return [f"tag {name.split('[')[0].split('.')[0]} {kind}" for name, kind in
            (row[1].split() for row in rows)]


def of_bit(row, value):
    """What the tag's number is, when its bits are these."""
    name = row[1].split()[0]
    return value << 3 if name == "W.3" else value << 1 if name in ("Bs[1]", "Md[1]") else value


def console_tag(row):
    return "Bs[0]" if tag_of(row) == "Bs[1]" else "Md[0]" if tag_of(row) == "Md[1]" else tag_of(row)


def value_of(ioc, row):
    return ioc.plain(row[0])


@pytest.mark.parametrize("row", KINDS, ids=lambda row: f"{row[0]}, {row[1]}")
def test_other_value(plant, row):
    """What the PLC makes of a put shows with the next read, though none has shown the put: {id}"""
    kind, _, put, made, *fields = row
    plant.tags(*declared([row]), "tag F DINT")
    plant.records(rec(kind, "o", row[1].split()[0] + " S 0.05", *fields), configure=NO_TIME)
    until(lambda: plant.ioc.severity("o") == "NO_ALARM")
    field = "o.VAL$" if kind == "lso" else "o"
    plant.sim.command("etherip slow 200 write next 1")  # done at once, answered later
    done = plant.ioc.put_callback(field, put)
    plant.wait_tag(console_tag(row), text_of(of_bit(row, put)))
    plant.set(console_tag(row), text_of(of_bit(row, made)))
    until(done.is_set)
    until_equal(lambda: plant.ioc.text("o") if kind == "lso" else plant.ioc.plain("o"), made)
    assert plant.ioc.severity("o") == "NO_ALARM"


@pytest.mark.parametrize("row", KINDS, ids=lambda row: f"{row[0]}, {row[1]}")
def test_refused(plant, row):
    """A put that the PLC refuses ends with the PLC's value and an alarm, which the next put ends: {id}"""
    kind, _, put, other, *fields = row
    plant.tags(*declared([row]), "tag F DINT")
    plant.records(rec(kind, "o", row[1].split()[0] + " S 0.05", *fields), rec("longin", "f", "F S 0.02"),
                  configure=NO_TIME)
    until(lambda: plant.ioc.severity("o") == "NO_ALARM")
    field = "o.VAL$" if kind == "lso" else "o"
    before = shown(plant, kind)
    seen = heard(plant.ioc, "o")
    plant.sim.command("etherip key run")
    plant.ioc.put(field, put)
    assert shown(plant, kind) == before
    assert plant.ioc.alarm("o") == ("INVALID", "WRITE", "PLC: key switch not in REM (10 2101)")
    plant.set(console_tag(row), text_of(of_bit(row, other)))
    until_equal(lambda: shown(plant, kind), other)
    assert plant.ioc.alarm("o")[:2] == ("INVALID", "WRITE")
    plant.sim.command("etherip key remote")
    plant.ioc.put(field, put)
    assert shown(plant, kind) == put and plant.ioc.severity("o") == "NO_ALARM"
    assert [s for _, s in seen[1:-1]].count(0) == 0, seen


def shown(plant, kind):
    return plant.ioc.text("o") if kind == "lso" else plant.ioc.plain("o")


@pytest.mark.parametrize("back", [5, 20])
def test_tag_comes_back(plant, back):
    """A put to a tag that is not there: its value never shows as good, when the tag is back with {back}"""
    plant.tags("tag A DINT = 5", "tag B DINT")
    plant.records(rec("longout", "a", "A S 0.05"), rec("longin", "b", "B S 0.02"), configure=NO_TIME)
    plant.ioc.wait_value("a", 5)
    seen = heard(plant.ioc, "a")
    for _ in range(5):
        plant.sim.command("etherip remove A")
        plant.ioc.wait_alarm("a", "INVALID", "READ", "no such tag")
        plant.ioc.put("a", 7)
        assert plant.ioc.alarm("a")[:2] == ("INVALID", "WRITE")
        plant.sim.command(f"etherip tag A DINT = {back}")
        plant.sim.command("etherip download")
        plant.ioc.wait_value("a", back)
        assert plant.ioc.alarm("a")[:2] == ("INVALID", "WRITE")  # until the next put
        plant.ioc.put("a", back)
        plant.ioc.wait_alarm("a", "NO_ALARM")
    assert (7, 0) not in seen


NOT_CONFIRMED = [("silent write next 1", 5, "no answer for 0.3 s"), ("drop write next 1", 5, "connection closed by PLC"),
                 ("close write next 1", 9, ""), ("short 30 close write next 1", 9, ""),
                 ("wrongcontext write next 1", 9, "")]


@pytest.mark.parametrize("fault, holds, reason", NOT_CONFIRMED, ids=lambda p: str(p))
def test_not_confirmed(plant, fault, holds, reason):
    """A put without an answer ends, and has an alarm until the next one, but where the PLC holds it: {fault}"""
    plant.tags("tag A DINT = 5", "tag B DINT", "tag W DINT = 1")
    plant.records(rec("longout", "a", "A S 0.05"), rec("longout", "b", "B S 0.05"),
                  rec("bo", "w", "W.0 S 0.05"), rec("longin", "in", "B S 0.05"),
                  before="EIP_timeout(300)", configure=NO_TIME)
    plant.ioc.wait_value("a", 5)
    seen = heard(plant.ioc, "a")
    plant.sim.command(f"etherip {fault}")
    plant.ioc.put("a", 9)
    plant.ioc.wait_alarm("in", "NO_ALARM")
    plant.ioc.put("b", 7)
    plant.ioc.wait_value("in", 7)
    for _ in range(2):  # it is the same after one more connection
        plant.ioc.wait_alarm("a", *(("INVALID", "WRITE", reason) if reason else ("NO_ALARM", "NO_ALARM")))
        assert plant.ioc.message("a") == reason
        assert plant.ioc.get("a") == holds and plant.tag("A") == str(holds)
        plant.ioc.wait_alarm("b", "NO_ALARM")
        plant.ioc.wait_alarm("w", "NO_ALARM")
        reconnect(plant)
    assert (holds == 9 or seen[-1][1] == 3) and all(s for v, s in seen[1:] if v != holds), seen
    plant.ioc.put("a", 11)
    assert plant.ioc.alarm("a") == ("NO_ALARM", "NO_ALARM", "") and plant.tag("A") == "11"


def reconnect(plant):
    lost = plant.ioc.log_count("disconnected")
    plant.sim.command("etherip close")
    until(lambda: plant.ioc.log_count("disconnected") > lost)
    plant.ioc.wait_alarm("in", "NO_ALARM")
    plant.ioc.wait_alarm("b", "NO_ALARM")


def test_force_at_start(plant):
    """FORCE with PINI writes at the start, and after a reconnect; without a value of its own it follows"""
    plant.tags("tag A DINT = 5", "tag B DINT = 6", "tag C DINT = 7")
    plant.records(rec("longout", "a", "A S 0.05 FORCE", "PINI=YES", "VAL=77"), rec("longout", "b", "B S 0.05 FORCE"),
                  rec("longout", "c", "C S 0.05", "PINI=YES", "VAL=77"), rec("longin", "in", "A S 0.05"))
    plant.wait_tag("A", "77")
    plant.ioc.wait_value("b", 6)
    plant.ioc.wait_value("c", 7)
    plant.sim.command("etherip refuse on")
    plant.sim.command("etherip close")
    plant.ioc.wait_alarm("in", "INVALID", "COMM")
    plant.set("A", 8)
    plant.set("B", 9)
    plant.sim.command("etherip refuse off")
    plant.wait_tag("A", "77")
    plant.ioc.wait_value("b", 9)
    assert plant.tag("B") == "9" and plant.tag("C") == "7" and plant.ioc.get("a") == 77


def asked(plant, tag):
    """The reads and writes of the tag, in their order."""
    return "".join({"4c": "r", "4d": "w"}[service] for service in
                   re.findall(rf"(4[cd]):{tag}=", plant.sim.command("etherip received 1000")))


@pytest.mark.parametrize("way", ["read-only", "key switch"])
def test_force_refused(plant, way):
    """FORCE that the PLC refuses is written once after each read, and its alarm stays until it is taken"""
    plant.tags(f"tag A DINT {'readonly' * (way == 'read-only')} = 5", "tag F DINT counter")
    plant.records(rec("longout", "a", "A S 0.1 FORCE"), rec("longin", "f", "F S 0.02"))
    ioc = plant.ioc
    ioc.wait_value("a", 5)
    reason = "PLC: no right to access it (0F)"
    if way == "key switch":
        ioc.put("a", 7)
        reason = "PLC: key switch not in REM (10 2101)"
        plant.sim.command("etherip key run")
        plant.set("A", 98)
    else:
        ioc.put("a", 7)
    ioc.wait_alarm("a", "INVALID", "WRITE", reason)
    seen = heard(ioc, "a")
    plant.sim.command("etherip clear")
    until(lambda: asked(plant, "A").count("w") >= 6, "rewrites")
    assert "ww" not in asked(plant, "A") and asked(plant, "A").count("w") < 20
    assert ioc.alarm("a") == ("INVALID", "WRITE", reason) and set(seen) == {(7, 3)}
    assert ioc.log_count("write of A: ") == 1, ioc.log
    if way == "key switch":
        plant.sim.command("etherip key remote")
        plant.wait_tag("A", "7")
    else:
        plant.set("A", 7)
    ioc.wait_alarm("a", "NO_ALARM")
    assert ioc.get("a") == 7


AWAY = "not written: PLC was away"


def test_put_while_away(plant):
    """A put while the PLC is away is void, and says so until the next put, whatever the PLC shows; not if it has that value"""
    plant.tags("tag A DINT = 5", "tag B DINT = 6")
    plant.records(rec("longout", "a", "A S 0.05"), rec("longout", "b", "B S 0.05"), rec("longin", "in", "A S 0.05"))
    plant.ioc.wait_value("b", 6)
    plant.sim.command("etherip refuse on")
    plant.sim.command("etherip close")
    plant.ioc.wait_alarm("in", "INVALID", "COMM")
    plant.ioc.put("a", 9)
    plant.ioc.put("b", 8)
    assert plant.ioc.alarm("a")[:2] == plant.ioc.alarm("b")[:2] == ("INVALID", "COMM")
    plant.set("A", 7)
    plant.set("B", 8)
    plant.sim.command("etherip refuse off")
    plant.ioc.wait_alarm("a", "INVALID", "WRITE", AWAY)
    plant.ioc.wait_alarm("b", "NO_ALARM")
    assert plant.ioc.get("a") == 7 and plant.ioc.get("b") == 8
    plant.set("A", 10)
    plant.ioc.wait_value("a", 10)
    assert plant.ioc.alarm("a") == ("INVALID", "WRITE", AWAY)
    plant.ioc.put("a", 11)
    assert plant.tag("A") == "11" and plant.ioc.severity("a") == "NO_ALARM"


def test_puts_at_reconnects(plant):
    """Puts with completion at the moment of a loss and of the reconnect: in the PLC, or the alarm says why not"""
    plant.tags("tag A DINT = 5")
    plant.records(rec("longout", "a", "A S 0.05"), before="EIP_timeout(300)")
    plant.ioc.wait_value("a", 5)
    void = 0
    for value in range(100, 160):
        plant.sim.command("etherip close" if value % 3 else "etherip close write next 1")
        done = plant.ioc.put_callback("a", value)
        until(done.is_set)
        severity = plant.ioc.severity("a")
        assert severity == "INVALID" or plant.tag("A") == str(value)
        until(lambda: plant.ioc.alarm("a")[1] != "COMM")
        until(lambda: str(plant.ioc.get("a")) == plant.tag("A"))
        if plant.tag("A") == str(value):
            plant.ioc.wait_alarm("a", "NO_ALARM")
        else:
            void += 1
            assert plant.ioc.alarm("a")[:2] == ("INVALID", "WRITE") and plant.ioc.text("a.AMSG")
    plant.ioc.put("a", 1)
    plant.ioc.wait_alarm("a", "NO_ALARM")
    assert void, "no put was void"


def test_behind_a_silent_read(plant):
    """A put that waits behind a read without answer was not on its way: it is not told 'no answer'"""
    plant.tags("tag A DINT = 5", "tag E DINT")
    plant.records(rec("longout", "a", "A S 100"), rec("longin", "e", "E S 0.02"), before="EIP_timeout(400)")
    plant.ioc.wait_value("a", 5)
    reasons = set()
    for value in range(10, 20):
        asked = plant.sim.command("etherip")
        plant.sim.command("etherip silent tag E read next 1")
        plant.ioc.process_record("e")
        until(lambda: plant.sim.command("etherip") != asked)
        done = plant.ioc.put_callback("a", value)
        until(done.is_set)
        plant.ioc.wait_alarm("e", "NO_ALARM")
        until(lambda: plant.ioc.alarm("a")[1] != "COMM")
        reason = plant.ioc.text("a.AMSG")
        assert (reason == "") == (plant.tag("A") == str(value)), reason
        reasons.add(reason)
    assert reasons <= {"", AWAY} and AWAY in reasons


def test_slow_and_refused(plant):
    """A refused put goes back to the put before it, though that was not read yet"""
    plant.tags("tag A DINT = 5")
    plant.records(rec("longout", "a", "A S 100"))
    plant.ioc.wait_value("a", 5)
    plant.ioc.put("a", 21)
    assert plant.tag("A") == "21"
    plant.sim.command("etherip key run")
    plant.ioc.put("a", 22)
    plant.ioc.wait_value("a", 21)
    assert plant.ioc.alarm("a") == ("INVALID", "WRITE", "PLC: key switch not in REM (10 2101)")


def test_whose_alarm(plant):
    """The alarm of a refused put is of the record that has put: not of others on the tag; it stays until that one puts again"""
    plant.tags("tag A INT = 5")
    plant.records(rec("longout", "a", "A S 0.05"), rec("longout", "a2", "A S 0.05"), rec("bo", "bit", "A.0 S 0.05"))
    plant.ioc.wait_value("bit", 1)
    plant.ioc.put("a", 70000)
    plant.sim.command("etherip key run")
    plant.ioc.put("a2", 8)
    for value in (6, 7):
        plant.set("A", value)
        for name in ("a", "a2"):
            plant.ioc.wait_value(name, value)
        assert plant.ioc.alarm("a") == ("INVALID", "WRITE", "the value does not fit INT")
        assert plant.ioc.alarm("a2") == ("INVALID", "WRITE", "PLC: key switch not in REM (10 2101)")
        assert plant.ioc.severity("bit") == "NO_ALARM"
    plant.set("A", 8)
    plant.ioc.wait_alarm("a2", "NO_ALARM")  # the PLC has what was put
    assert plant.ioc.alarm("a") == ("INVALID", "WRITE", "the value does not fit INT")


def test_put_after_link_change(plant):
    """A put to a new link, made before its value has come while the PLC goes away, is void with its alarm"""
    plant.tags("tag A DINT = 5", "tag B DINT = 6")
    plant.records(rec("longout", "o", "A S 0.05"))
    plant.ioc.wait_alarm("o", "NO_ALARM")
    plant.sim.command("etherip refuse on")
    plant.sim.command("etherip close")
    plant.ioc.wait_log("disconnected")
    plant.ioc.put("o.OUT", "@P B S 0.05")
    plant.ioc.put("o", 77)
    plant.sim.command("etherip refuse off")
    plant.ioc.wait_alarm("o", "INVALID", "WRITE", "not written: PLC was away")
    until_equal(lambda: plant.ioc.plain("o"), 6)
    assert plant.tag("B") == "6"


def test_others_after_loss(plant):
    """One put around a loss, 20 times: outputs on the same tag that did not put have no alarm after it"""
    plant.tags("tag A DINT = 5")
    names = [f"o{i}" for i in range(6)]
    plant.records(*(rec("longout", name, "A S 0.05") for name in names))
    for name in names:
        plant.ioc.wait_alarm(name, "NO_ALARM")
    for value in range(10, 30):
        plant.sim.command("etherip reset")
        plant.ioc.put("o0", value)
        for name in names[1:]:
            plant.ioc.wait_alarm(name, "NO_ALARM")


def test_end_of_a_pulse_refused(plant):
    """The end of a pulse that the PLC refuses is tried again; when it is taken, its alarm ends"""
    plant.tags("tag B BOOL")
    plant.records(rec("bo", "b", "B S 0.05", "HIGH=2", "ZNAM=0", "ONAM=1"))
    plant.ioc.wait_alarm("b", "NO_ALARM")
    plant.ioc.put("b", 1)
    plant.wait_tag("B", "1")
    plant.sim.command("etherip key run")
    plant.ioc.wait_alarm("b", "INVALID", "WRITE", "key switch")
    plant.sim.command("etherip key remote")
    plant.wait_tag("B", "0")
    plant.ioc.wait_alarm("b", "NO_ALARM")


# --- Tags that can be written and not read ----------------------------------------------------------

@pytest.mark.parametrize("force", ["", " FORCE"])
def test_not_shown(plant, force):
    """What the PLC takes and does not show ({force}) is no good value: the alarm of the read is there again with the end of the put"""
    plant.tags("tag W DINT[3] = 8", "tag D DINT = 8")
    plant.records(rec("aao", "w", f"W S 0.05{force}", "FTVL=LONG", "NELM=5"), rec("longout", "d", f"D S 0.05{force}"),
                  rec("ao", "a", f"D S 0.05{force}"), rec("calcout", "c", f"D S 0.05{force}", "CALC=A"), rec("longin", "in", "D S 0.05"))
    plant.ioc.wait_value("in", 8)
    plant.sim.command("etherip status 0F service 4c tag D")
    refused = "PLC: no right to access it (0F)"
    for name in ("d", "a", "c"):
        plant.ioc.wait_alarm(name, "INVALID", "READ", refused)
    plant.ioc.wait_alarm("w", "INVALID", "READ", "PLC: index beyond the end (FF 2105)")
    heard_of = {name: heard(plant.ioc, name) for name in ("w", "d", "a")}
    plant.ioc.put("w", [1, 2, 3])
    plant.wait_tag("W", "1 2 3")
    assert plant.ioc.alarm("w") == ("INVALID", "READ", "PLC: index beyond the end (FF 2105)")
    for value, name in enumerate(("d", "a"), 20):
        plant.ioc.put(name, value)
        plant.wait_tag("D", str(value))
        assert plant.ioc.alarm(name) == ("INVALID", "READ", refused)
    plant.ioc.put("c.A", 30)
    plant.ioc.put("c.PROC", 1)
    plant.wait_tag("D", "30")
    plant.ioc.wait_alarm("c", "INVALID", "READ", refused)
    assert not [name for name, seen in heard_of.items() if any(severity == 0 for _, severity in seen)]
    plant.sim.command("etherip normal")
    for name in ("d", "a", "c", "in"):
        plant.ioc.wait_alarm(name, "NO_ALARM")


@pytest.mark.parametrize("kind, tag, fields, words", [
    ("bo", "B B 9", [], "SINT has bits 0 to 7"), ("mbbo", "F", ["NOBT=4"], "REAL has no bits"),
    ("mbboDirect", "B", ["NOBT=9"], "SINT has bits 0 to 7")])
def test_no_bits_and_away(plant, kind, tag, fields, words):
    """An output for bits that the tag has not stays INVALID, in the same words, while the PLC is away ({kind} {tag})"""
    plant.tags("tag B SINT = 3", "tag F REAL = 2")
    plant.records(rec(kind, "o", f"{tag} S 0.05", *fields), rec("longin", "in", "B S 0.05"))
    plant.ioc.wait_alarm("o", "INVALID", "READ", words)
    plant.ioc.wait_value("in", 3)
    seen = heard(plant.ioc, "o")
    for _ in range(2):
        plant.sim.command("etherip refuse on")
        plant.sim.command("etherip reset")
        plant.ioc.wait_alarm("in", "INVALID", "COMM", "connection refused")
        assert plant.ioc.alarm("o") == ("INVALID", "READ", words)
        plant.sim.command("etherip refuse off")
        plant.ioc.wait_alarm("in", "NO_ALARM")
        assert plant.ioc.alarm("o") == ("INVALID", "READ", words)
    assert not any(severity == 0 for _, severity in seen)
    plant.sim.command("etherip tag B DINT = 1023")
    plant.sim.command("etherip tag F DINT = 7")
    plant.sim.command("etherip download")
    plant.ioc.wait_alarm("o", "NO_ALARM")


def test_time_of_following(plant):
    """An output with TSE=-2 has the time at which it took the PLC's value, was put, or its put ended"""
    plant.tags("tag A DINT = 5", "tag F REAL = 1.5", "tag W INT[5] = 2", "tag R DINT readonly = 5")
    plant.records(rec("longout", "a", "A S 0.05", "TSE=-2"), rec("ao", "f", "F S 0.05", "TSE=-2"),
                  rec("bo", "b", "A S 0.05 B 3", "TSE=-2"), rec("aao", "w", "W S 0.05", "FTVL=SHORT", "NELM=5", "TSE=-2"),
                  rec("longout", "r", "R S 0.05", "TSE=-2"))
    for name, value in (("a", 5), ("f", 1.5), ("b", 0), ("w", [2] * 5), ("r", 5)):
        plant.ioc.wait_value(name, value)
    for value in (8, 16, 24):
        began = time.time()
        for tag in ("A", "F", "W"):
            plant.set(tag, value)
        for name, shown in (("a", value), ("f", value), ("b", value // 8 % 2), ("w", [value] * 5)):
            plant.ioc.wait_value(name, shown)
            assert plant.ioc.stamp(name) >= began
        began = time.time()
        plant.ioc.put("a", value + 1)
        plant.ioc.put("r", value)
        assert min(plant.ioc.stamp("a"), plant.ioc.stamp("r")) >= began
        assert plant.ioc.alarm("r")[:2] == ("INVALID", "WRITE")


def test_behind_fragments(plant):
    """An array that does not fit one message is read to its end: a put, and other tags, wait for it"""
    plant.tags("tag R REAL[600] = 1", "tag O DINT = 1", "tag X DINT = 3", size=504)
    plant.records(rec("waveform", "r", "R S 0.1", "FTVL=FLOAT", "NELM=600"), rec("longout", "o", "O S 0.1"), rec("longin", "x", "X S 0.1"))
    plant.ioc.wait_value("o", 1)
    plant.ioc.wait_alarm("r", "NO_ALARM")
    plant.sim.command("etherip slow 30")
    for value in range(2, 12):
        plant.ioc.put("o", value)
        plant.wait_tag("O", str(value))
    seen = "".join("f" if "R=06" in line else "e" if "52:R=00" in line else "w" if "4d:O=00" in line else "."
                   for line in plant.sim.command("etherip received 1000").splitlines())
    assert seen.count("w") == 10 and "ffff" in seen
    assert not re.search("f[w.]", seen)
