"""What users type wrong: s7plcConfigure, links, options. One message each; the IOC goes on."""
import random
import re
import string

import pytest

from ports import free_port

DB = """
record(longin, "$(P)in") { field(DTYP, "S7plc") field(INP, "@PLC/0 T=INT32") field(SCAN, "I/O Intr") }
"""

WRONG = {
    "no arguments": "",
    "only a name": "B",
    "no port": "B, 127.0.0.1",
    "no sizes": "B, 127.0.0.1, 2000",
    "no outSize": "B, 127.0.0.1, 2000, 8",
    "an empty name": '"", 127.0.0.1, 2000, 8, 8, 1, 2000, 100',
    "a name of 300 characters": "x" * 300 + ", 127.0.0.1, 2000, 8, 8, 1, 2000, 100",
    "a name with a slash": "a/b, 127.0.0.1, 2000, 8, 8, 1, 2000, 100",
    "the name of another PLC": "PLC, 127.0.0.1, 2000, 8, 8, 1, 2000, 100",
    "a host with a blank": '"B", "two words", 2000, 8, 8, 1, 2000, 100',
    "a host of 5000 characters": "B, " + "h" * 5000 + ", 2000, 8, 8, 1, 2000, 100",
    "an address of three numbers": "B, 192.168.1, 2000, 8, 8, 1, 2000, 100",
    "an address of two numbers": "B, 10.1, 2000, 8, 8, 1, 2000, 100",
    "an address of five numbers": "B, 1.2.3.4.5, 2000, 8, 8, 1, 2000, 100",
    "an address in octal digits": "B, 0300.1.1.1, 2000, 8, 8, 1, 2000, 100",
    "an address in hex digits": "B, 0x7f.0.0.1, 2000, 8, 8, 1, 2000, 100",
    "port 0": "B, 127.0.0.1, 0, 8, 8, 1, 2000, 100",
    "port 70000": "B, 127.0.0.1, 70000, 8, 8, 1, 2000, 100",
    "port -1": "B, 127.0.0.1, -1, 8, 8, 1, 2000, 100",
    "a port that is a word": "B, 127.0.0.1, http, 8, 8, 1, 2000, 100",
    "a negative size": "B, 127.0.0.1, 2000, -8, 8, 1, 2000, 100",
    "a size of 2 GB": "B, 127.0.0.1, 2000, 2147483647, 8, 1, 2000, 100",
    "a size beyond 32 bits": "B, 127.0.0.1, 2000, 8, 99999999999, 1, 2000, 100",
    "bigEndian 7": "B, 127.0.0.1, 2000, 8, 8, 7, 2000, 100",
    "a negative timeout": "B, 127.0.0.1, 2000, 8, 8, 1, -5, 100",
    "a timeout of 99 days": "B, 127.0.0.1, 2000, 8, 8, 1, 8553600000, 100",
    "a fraction as interval": "B, 127.0.0.1, 2000, 8, 8, 1, 2000, 0.5",
    "nan as timeout": "B, 127.0.0.1, 2000, 8, 8, 1, nan, 100",
    "inf as interval": "B, 127.0.0.1, 2000, 8, 8, 1, 2000, inf",
    "a timeout of 9 ms": "B, 127.0.0.1, 2000, 8, 8, 1, 9, 100",
    "an interval of -1": "B, 127.0.0.1, 2000, 8, 8, 1, 2000, -1",
}


@pytest.mark.parametrize("wrong", WRONG.values(), ids=WRONG.keys())
def test_wrong_arguments(new_peer, new_ioc, wrong):
    """s7plcConfigure with {id}: one error line with what is allowed, the IOC goes on"""
    peer = new_peer(4, 0)
    ioc = new_ioc(f"{peer.configure()}\ns7plcConfigure {wrong}", DB)
    ioc.command("")
    errors = [line for line in ioc.log.splitlines()
              if "sevr=" in line and line.split("sevr=")[1].startswith(("major", "fatal"))]
    assert len(errors) == 1, errors
    assert "s7plcConfigure" in errors[0]
    assert "allowed" in errors[0] or "once" in errors[0], errors
    assert len(re.findall(r"^  \S", ioc.command("s7plcReport"), re.MULTILINE)) == 1  # the PLC that is good
    peer.wait_connected()
    peer.send(b"\0\0\0\x07")
    ioc.wait_value("in", 7)


GOOD = {
    "parentheses and quotes": 's7plcConfigure("PLC", "127.0.0.1", {port}, 4, 4, 1, 2000, 100)',
    "commas without quotes": "s7plcConfigure PLC,127.0.0.1,{port},4,4,1,2000,100",
    "blanks only": "s7plcConfigure PLC 127.0.0.1 {port} 4 4 1 2000 100",
    "hex numbers": "s7plcConfigure PLC, 127.0.0.1, {port}, 0x4, 0x4, 1, 0x7d0, 100",
    "zeros for the times": "s7plcConfigure PLC, 127.0.0.1, {port}, 4, 4, 1, 0, 0",
    "no times": "s7plcConfigure PLC, 127.0.0.1, {port}, 4, 4, 1",
    "a host name": "s7plcConfigure PLC, localhost, {port}, 4, 4, 1, 2000, 100",
}


@pytest.mark.parametrize("line", GOOD.values(), ids=GOOD.keys())
def test_good_arguments(new_peer, new_ioc, line):
    """s7plcConfigure with {id} works"""
    peer = new_peer(4, 4)
    ioc = new_ioc(line.format(port=peer.port), DB)
    peer.wait_connected()
    peer.send(b"\0\0\0\x07")
    ioc.wait_value("in", 7)
    assert "sevr=major" not in ioc.log


@pytest.mark.parametrize("name", ["PLC:1", "a-b_c.d", "x" * 200, "äöü"])
def test_names(new_peer, new_ioc, name):
    """a PLC may be called {id}"""
    peer = new_peer(4, 0)
    ioc = new_ioc(peer.configure(name=name), DB.replace("@PLC/", f"@{name}/"))
    peer.wait_connected()
    peer.send(b"\0\0\0\x07")
    ioc.wait_value("in", 7)


LATE = """
record(longin, "$(P)in") { field(DTYP, "S7plc") field(INP, "@PLC/0 T=INT32") field(SCAN, "I/O Intr") }
record(longin, "$(P)put") { field(DTYP, "S7plc") field(INP, "@PLC/0 T=INT32") field(SCAN, "I/O Intr") }
"""


def test_after_ioc_init(new_peer, new_ioc):
    """a PLC that is configured after iocInit is there for links that are put then, and for no others"""
    peer = new_peer(4, 0)
    ioc = new_ioc("", LATE)
    ioc.command(peer.configure())
    peer.wait_connected()
    ioc.put("put.INP", "@PLC/0 T=INT32")
    peer.send(b"\0\0\0\x07")
    ioc.wait_value("put", 7)
    ioc.process_record("in")
    assert ioc.alarm("in") == ("INVALID", "LINK", 'no PLC "PLC"')


def test_etherip_after_ioc_init(new_ioc):
    """a controller that is defined after iocInit has the options of tags, as one that was defined before"""
    ioc = new_ioc(f'drvEtherIP_define_PLC("early", "127.0.0.1:{free_port()}", 0)', "")
    ioc.command(f'drvEtherIP_define_PLC("late", "127.0.0.1:{free_port()}", 0)')
    options = [re.search(r"options: .*", ioc.command(f"s7plcReport {name} 2"))[0] for name in ("early", "late")]
    assert options[0] == options[1] and "scan=changed track=on" in options[1]


def malformed():
    """100 links that must be refused: (record type, field, link)."""
    links = [
        ("ai", "@"), ("ai", "@NOPLC/0"), ("ai", "@PLC/0 T=INT17"), ("ai", "@PLC/0 T="),
        ("ai", "@PLC/0 T"), ("ai", "@PLC/4-2"), ("ai", "@PLC/-1"), ("ai", "@PLC/63 T=INT16"),
        ("ai", "@PLC/64"), ("ai", "@PLC/65537"), ("ai", "@PLC/99999999999999999999"),
        ("ai", "@PLC/0x"), ("ai", "@PLC/0 X=3"), ("ai", "@PLC/0 T=STRING"),
        ("ai", "@PLC/0 T=TIME"), ("ai", "@PLC/0 L=5 H=5"), ("ai", "@PLC/0 L=abc"),
        ("bi", "@PLC/0 T=BYTE B=8"), ("bi", "@PLC/0 B=16"), ("bi", "@PLC/0 B=-1"),
        ("bi", "@PLC/0 T=FLOAT"), ("longin", "@PLC/0 T=FLOAT"), ("longin", "@PLC/62 T=INT32"),
        ("longin", "@PLC/0 T=INT16 T"), ("stringin", "@PLC/30 L=40"), ("stringin", "@PLC/0 L=x"),
        ("stringin", "@PLC/0 L=-3"), ("stringin", "@PLC/0 T=INT16"), ("mbbi", "@PLC/0 T=DOUBLE"),
        ("int64in", "@PLC/60 T=INT64"), ("int64in", "@PLC/0 T=FLOAT"), ("ao", "@PLC/64"),
        ("ao", "@PLC/0 T=STRING"), ("bo", "@PLC/0 T=WORD B=99"), ("longout", "@PLC/61 T=LONG"),
        ("stringout", "@PLC/60"), ("calcout", "@PLC/0 T=TIME"), ("mbbo", "@PLC/0 T=REAL32"),
        ("waveform", "@PLC/0"), ("waveform", "@PLC/0 T=FLOAT"), ("aai", "@PLC/60"),
        ("aao", "@PLC/60"), ("lsi", "@PLC/60 L=40"), ("lso", "@PLC/60 L=40"),
    ]
    chance = random.Random(7)
    letters = string.ascii_letters + string.digits + "/=+-' @#$%&*()<>?.,;:"
    while len(links) < 100:
        junk = "".join(chance.choice(letters) for _ in range(chance.randrange(1, 120)))
        kind = chance.choice(["ai", "bo", "longin", "stringin", "waveform", "calcout"])
        links.append((kind, "@PLC/0 Q" + junk.replace("$(", "$").replace("${", "$")))
    return links


def test_malformed_links(new_peer, new_ioc):
    """100 malformed links get a message each; the good records beside them work"""
    outputs = ("ao", "bo", "mbbo", "longout", "stringout", "calcout", "aao", "lso")
    db = DB
    for i, (kind, link) in enumerate(malformed()):
        field = "OUT" if kind in outputs else "INP"
        more = 'field(FTVL, "LONG") field(NELM, "17")' if kind in ("waveform", "aai", "aao") else ""
        more += 'field(NOBT, "2")' if kind in ("mbbi", "mbbo") else ""
        db += f'record({kind}, "$(P)bad{i}") {{ field(DTYP, "S7plc") field({field}, "{link}") {more} }}\n'
        db += (f'record(longin, "$(P)good{i}") {{ field(DTYP, "S7plc") field(INP, "@PLC/{i % 60} T=BYTE") '
               'field(SCAN, "I/O Intr") }\n')
    peer = new_peer(64, 64)
    ioc = new_ioc(peer.configure(), db)
    ioc.command("")
    silent = [f"{kind} {link}" for i, (kind, link) in enumerate(malformed())
              if f'"{ioc.P}bad{i}"' not in ioc.log]
    assert not silent, "no message for: " + "; ".join(silent)
    peer.wait_connected()
    peer.send(bytes(range(64)))
    ioc.wait_value("good99", 39)
    for i in range(100):
        assert ioc.get(f"good{i}") == i % 60
        ioc.process_record(f"bad{i}")
        assert ioc.severity(f"bad{i}") == "INVALID", malformed()[i]


def test_message_marks_the_place(new_peer, new_ioc):
    """the message for a wrong link names record, link, reason and what is allowed, and marks the place"""
    peer = new_peer(64, 0)
    ioc = new_ioc(peer.configure(), """
        record(ai, "$(P)bad") { field(DTYP, "S7plc") field(INP, "@PLC/8 T=INT17 L=0") }
        """)
    ioc.command("")
    lines = ioc.log.splitlines()
    first = next(i for i, line in enumerate(lines) if ":bad" in line and "S7plc ai" in line)
    assert "INT16" in lines[first] and "allowed" in lines[first]
    link, caret = lines[first + 1], lines[first + 2]
    assert link.strip() == "@PLC/8 T=INT17 L=0"
    assert link[caret.index("^"):].startswith("INT17")
