"""What is generated: the same bytes each time, nothing of others overwritten, and files that their
readers take: the database, XML, plcSim, and the SCL, which is compiled and run."""
import random
import re
import struct
import subprocess
import sys
import xml.etree.ElementTree as ET
import zlib
from pathlib import Path

import pytest

import maps
import tank as example
from conftest import TOP, plcmap
from plcmaplib.files import load
from plcmaplib.problems import Report
from plcmaplib.transfer import layout_crc, layout_id, table, transfers

sys.path.insert(0, str(TOP / "tests"))
from scl.machine import Machine  # noqa: E402
from scl.texts import symbols  # noqa: E402

PLANTS = {
    "tank": None,
    "sixty rows": (60, 11, {"readback": "0"}),
    "setpoints one by one": (150, 12, {}),
    "no handshake": (150, 13, {"sync": "off", "layout_at": "0"}),
    "inputs only": (80, 14, {"sync": "off"}),
    "download": (60, 15, {"readback": "12", "download": "on"}),
}


def test_groups_of_one_file_name(tmp_path):
    """Groups whose names make the same file name get two files"""
    rows = "symbol,type,tx,pv,group\nA,INT,4,A,Pump 1\nB,INT,6,B,Pump/1\nC,INT,8,C,PUMP 1\n"
    folder = example.write(tmp_path / "a--b", map=rows, types="type,field,ftype\n",
                           enums="enum,value,text\n")
    assert plcmap("generate", folder, "-o", tmp_path / "g").status == 0
    files = sorted((tmp_path / "g").glob("*.bob"))
    assert len(files) == 3
    assert sorted(re.findall("pv_name>tank:(.)<", "".join(f.read_text() for f in files))) == ["A", "B", "C"]
    for file in files + [tmp_path / "g" / "a--b.svg", tmp_path / "g" / "a--b-alarms.xml"]:
        ET.parse(file)


def test_symbol_with_blanks(tmp_path):
    """The blanks of a symbol of an S7 stay"""
    folder = example.write(tmp_path / "m", plc="key,value\n", types="type,field,ftype\n",
                           map="symbol,plc,type,tx,pv\nA,Motor  1 on,INT,0,A\n", enums="enum,value,text\n")
    assert plcmap("generate", folder, "-o", tmp_path / "g").status == 0
    assert 'INT_TO_WORD("Motor 1 on")' in (tmp_path / "g" / "m-step7.scl").read_text()


def test_note_of_lines(tmp_path):
    """A note of several lines is one cell of the table"""
    rows = 'symbol,type,tx,pv,note\nA,INT,4,A,"one\ntwo"\n'
    folder = example.write(tmp_path / "m", map=rows, types="type,field,ftype\n", enums="enum,value,text\n")
    assert plcmap("generate", folder, "-o", tmp_path / "g").status == 0
    assert "one two |" in (tmp_path / "g" / "m.md").read_text()


def plant(tmp_path, name, **keys):
    """A map with places."""
    if PLANTS[name] is None:
        return example.write(tmp_path / "tank")
    count, seed, plc = PLANTS[name]
    rows = maps.rows(count, seed, outputs=name != "inputs only")
    if "readback" in plc:
        rows = [r for r in rows if r["dir"] != "cmd"]
    folder = maps.write(tmp_path / "p", rows, {**plc, **keys})
    result = plcmap("place", folder)
    assert result.status == 0, result.err
    return folder


def generated(folder, out):
    result = plcmap("generate", folder, "-o", out)
    assert result.status == 0, result.err
    return {f.name: f.read_bytes() for f in out.iterdir()}


def model(folder):
    return load(str(folder), Report())


@pytest.mark.parametrize("name", PLANTS)
def test_same_bytes(tmp_path, name):
    """{name}: generated twice, the same bytes, and nothing is written the second time"""
    folder = plant(tmp_path, name)
    first = generated(folder, tmp_path / "a")
    assert generated(folder, tmp_path / "b") == first
    assert "0 of them new" in plcmap("generate", folder, "-o", tmp_path / "a").out
    ident = "layout id %d" % layout_id(layout_crc(model(folder)))
    for file, data in first.items():
        assert ident in "\n".join(data.decode().splitlines()[:3]), file


def test_others_files_stay(tank, tmp_path):
    """A file that plcmap has not made is not overwritten, and nothing else is written"""
    out = tmp_path / "gen"
    out.mkdir()
    (out / "tank.db").write_text("# mine\n")
    result = plcmap("generate", tank, "-o", out)
    assert result.status == 1 and "tank.db: is there and was not made by plcmap" in result.err
    assert [f.name for f in out.iterdir()] == ["tank.db"]


def test_xml(tank, tmp_path):
    """Displays, alarm tree and pictures are well-formed, with a display for each group"""
    files = generated(tank, tmp_path / "gen")
    assert {"tank-Tank.bob", "tank-Valves.bob", "tank.bob"} <= set(files)
    for file, data in files.items():
        if file.endswith((".bob", ".xml", ".svg")):
            ET.fromstring(data)
    names = {e.get("name") for e in ET.fromstring(files["tank-alarms.xml"]).iter("pv")}
    assert names == {"tank:Temp", "tank:Level", "tank:Door", "tank:V101:Fault", "tank:V102:Fault",
                     "tank:Mode"}
    html = files["tank.html"].decode()
    assert "tank:V101:Pos" in html and "<svg" in html
    assert "| V102.Fault | DB12.DBX8.2 | BOOL | in | 108.2 |" in files["tank.md"].decode()


def test_lists(tank, tmp_path):
    """Archive and autosave lists"""
    files = generated(tank, tmp_path / "gen")
    assert files["tank.archive"].decode().splitlines()[1:] == [
        "tank:Level 1 monitor", "tank:Temp 1 monitor", "tank:TempSP 1 monitor",
        "tank:TempSP:RBV 1 monitor"]
    assert files["tank.req"].decode().splitlines()[1:] == ["tank:SpeedSP.VAL", "tank:TempSP.VAL"]


def test_pointer_table(tank, tmp_path):
    """The pointer table byte by byte: layout id, rows, CRC-32, ANY pointers"""
    map_ = model(tank)
    data = table(map_, layout_id(layout_crc(map_)), transfers(map_, "tx"), transfers(map_, "rx"))
    ident, tx, rx, crc = struct.unpack(">HHHI", data[:10])
    assert (tx, rx) == (4, 1) and ident == layout_id(layout_crc(map_))
    assert crc == zlib.crc32(data[:6] + bytes(4) + data[10:])
    assert data[10:30].hex() == "10020032000a84000000" + "10020032000184000020"
    assert data[90:110].hex() == "10020032000284000020" + "10020032000a84000000"
    assert len(data) == 110


def test_pointer_file(tmp_path):
    """With download=on the file of the table has its rows and its CRC"""
    folder = plant(tmp_path, "download")
    map_ = model(folder)
    text = generated(folder, tmp_path / "gen")["p.ptr"].decode()
    data = table(map_, layout_id(layout_crc(map_)), transfers(map_, "tx"), transfers(map_, "rx"))
    assert "crc 0x%s" % data[6:10].hex().upper() in text
    assert len(re.findall(r"^(?:tx|rx) ", text, re.M)) == (len(data) - 10) // 20


def test_records(tank, tmp_path):
    """Records: links, read-backs, scales, states, limits"""
    db = generated(tank, tmp_path / "gen")["tank.db"].decode()
    for text in ['record(ao, "tank:TempSP") {', 'field(OUT, "@TANK/4 T=REAL32")',
                 'record(ai, "tank:TempSP:RBV") {', 'field(INP, "@TANK/58 T=INT16 L=0 H=27648")',
                 'field(OUT, "@TANK/14 T=S7STRING L=16")', 'field(THST, "service")',
                 'field(THSV, "MINOR")', 'field(HHSV, "MAJOR")', 'field(OSV, "MAJOR")']:
        assert text in db, text


def test_setpoints_one_by_one(tmp_path):
    """Without the key readback each setpoint has its own R=, a command has none"""
    folder = plant(tmp_path, "setpoints one by one")
    leaves = model(folder).leaves()
    db = b"".join(generated(folder, tmp_path / "g")[f] for f in ("p.db",)).decode()
    outs = [l for l in leaves if l.dir == "out" and l.field is None and "[" not in l.member]
    assert outs and any(l.dir == "cmd" for l in leaves)
    for leaf in outs:
        body = db.split('"p1:%s") {' % leaf.pv)[1].split("}")[0]
        assert " R=%d\"" % leaf.tx[0] in body
    for leaf in leaves:
        if leaf.dir == "cmd":
            body = db.split('"p1:%s") {' % leaf.pv)[1].split("}")[0]
            assert "R=" not in body and 'field(HIGH, "1")' in body


def test_etherip(tmp_path):
    """EtherNet/IP: tags in links, no places, no blocks"""
    rows = [{"symbol": "A", "plc": "Program:Main.A", "type": "DINT", "pv": "A"},
            {"symbol": "B", "plc": "B", "type": "REAL", "dir": "out", "pv": "B"},
            {"symbol": "V", "plc": "Valve1", "type": "VALVE", "pv": "V:"}]
    folder = maps.write(tmp_path / "e", rows, {"wire": "etherip", "sync": "off", "period": "500",
                                             "family": "none", "address": "10.0.0.1", "slot": "2"})
    files = generated(folder, tmp_path / "g")
    db = files["e.db"].decode()
    assert 'field(DTYP, "EtherIP")' in db and 'field(INP, "@P1 Program:Main.A S 0.5")' in db
    assert 'field(OUT, "@P1 B S 0.5")' in db and 'record(ai, "p1:B:RBV")' in db
    assert "@$(PLC) $(TAG).Open" in files["e-VALVE.template"].decode()
    assert '{ "P1", "p1:V:", "Valve1", "" }' in files["e.substitutions"].decode()
    assert 'drvEtherIP_define_PLC("P1", "$(P1_ADDRESS=10.0.0.1)", 2)' in files["e.cmd"].decode()
    assert "tag Program:Main.A DINT\ntag B REAL\ntag Valve1 T_Valve1\n" in files["e.plc"].decode()
    assert not [f for f in files if f.endswith((".ptr", ".scl"))]


def test_pair(tmp_path):
    """A redundant pair: both addresses in the command, and a pair for plcSim"""
    rows = [{"symbol": "A", "plc": "DB10.DBW0", "type": "INT", "pv": "A"}]
    folder = maps.write(tmp_path / "e", rows, {"sync": "off", "address": "10.0.0.1",
                                               "second": "10.0.0.9"})
    assert plcmap("place", folder).status == 0
    files = generated(folder, tmp_path / "g")
    assert 'phoenixplcConfigure("P1", "$(P1_ADDRESS=10.0.0.1),$(P1_SECOND=10.0.0.9)", ' \
        '$(P1_PORT=2000), 2, 0, 1, 2000, 100, 1)' in files["e.cmd"].decode()
    assert "\nrole      = pair\n" in files["e.plc"].decode()


@pytest.mark.parametrize("name", PLANTS)
def test_simulator_takes_it(tmp_path, name):
    """{name}: plcSim takes its file"""
    program = next(TOP.glob("bin/*/plcSim"), None)
    if program is None:
        pytest.skip("plcSim is not built")
    files = generated(plant(tmp_path, name), tmp_path / "gen")
    file = next(f for f in files if f.endswith(".plc"))
    run = subprocess.run([program, "--check", tmp_path / "gen" / file], capture_output=True, text=True)
    assert run.returncode == 0, run.stdout + run.stderr


# --- the SCL, compiled and run -------------------------------------------------------------------

OWN = ("tx_ptrs", "rx_ptrs", "held_db")
INSTANCE = "\nDATA_BLOCK IE_COMMS_DB IE_COMMS     // DB999\nBEGIN END_DATA_BLOCK\n"


def machine(folder, out):
    """The generated program on a CPU of its own, and the map."""
    files = generated(folder, out)
    text = next(d for f, d in files.items() if f.endswith("-step7.scl")).decode() + INSTANCE
    map_ = model(folder)
    sizes = {}
    for leaf in map_.leaves():
        if leaf.address is not None and leaf.address.area == "DB":
            sizes[leaf.address.db] = max(sizes.get(leaf.address.db, 0),
                                         leaf.address.byte + leaf.size() + 1)
    return Machine(text, symbols(text), sizes), map_


def memory(cpu, address):
    return cpu.dbs[address.db] if address.area == "DB" else cpu.areas[address.area]


def bits_of(block, byte, bit, size):
    """A value's bytes, or its bit."""
    return bytes(block[byte:byte + size]) if bit is None else block[byte] >> bit & 1


def noise(block, rnd):
    block[:] = rnd.randbytes(len(block))


@pytest.mark.parametrize("name", PLANTS)
def test_scl_packs(tmp_path, name):
    """{name}: PACK_TX_DB brings every value to its place, from its own place"""
    cpu, map_ = machine(plant(tmp_path, name), tmp_path / "gen")
    rnd = random.Random(7)
    own = {map_.number(k) for k in OWN} | {999}
    for number, block in cpu.dbs.items():
        if number not in own:
            noise(block, rnd)
    noise(cpu.areas["M"], rnd)
    assert cpu.call("PACK_TX_DB") == 0
    leaves = [l for l in map_.leaves() if l.tx is not None]
    assert leaves
    for leaf in leaves:
        there = bits_of(memory(cpu, leaf.address), leaf.address.byte,
                        leaf.address.bit if leaf.is_bit() else None, leaf.size())
        here = bits_of(cpu.dbs[1], leaf.tx[0], leaf.tx[1], leaf.size())
        assert here == there, leaf.symbol


@pytest.mark.parametrize("name", [n for n in PLANTS if n != "inputs only"])
def test_scl_unpacks(tmp_path, name):
    """{name}: UNPACK_RX_DB brings every setpoint to its place, and touches nothing else"""
    cpu, map_ = machine(plant(tmp_path, name), tmp_path / "gen")
    rnd = random.Random(8)
    own = {map_.number(k) for k in OWN} | {999}
    for number, block in cpu.dbs.items():
        if number not in own:
            noise(block, rnd)
    before = {n: bytes(b) for n, b in cpu.dbs.items()}
    assert cpu.call("UNPACK_RX_DB") == 0
    mine = {}
    for leaf in map_.leaves():
        if leaf.rx is None:
            continue
        a = leaf.address
        there = bits_of(memory(cpu, a), a.byte, a.bit if leaf.is_bit() else None, leaf.size())
        assert there == bits_of(cpu.dbs[2], leaf.rx[0], leaf.rx[1], leaf.size()), leaf.symbol
        for byte in range(a.byte, a.byte + leaf.size()):
            mine[a.db, byte] = mine.get((a.db, byte), 0) | (1 << a.bit if leaf.is_bit() else 0xFF)
    mirrored = map_.number("readback") is not None  # unused bits and bytes between come back
    for number, block in cpu.dbs.items():
        for byte, value in enumerate(block):
            mask = 0xFF & ~mine.get((number, byte), 0)
            near = mirrored and any((number, byte + d) in mine for d in (-1, 0, 1))
            assert near or value & mask == before[number][byte] & mask, (number, byte)


@pytest.mark.parametrize("name", ["tank", "sixty rows", "setpoints one by one", "download"])
def test_scl_compares(tmp_path, name):
    """{name}: CHECKSYNC finds each setpoint that differs, and no command"""
    cpu, map_ = machine(plant(tmp_path, name), tmp_path / "gen")
    rnd = random.Random(9)
    noise(cpu.dbs[2], rnd)
    assert cpu.call("UNPACK_RX_DB") == 0
    assert cpu.call("CHECKSYNC", 2) is True
    for leaf in map_.leaves():
        if leaf.rx is None:
            continue
        block, byte = memory(cpu, leaf.address), leaf.address.byte + leaf.size() - 1
        old = block[byte]
        block[byte] ^= 1 << (leaf.address.bit if leaf.is_bit() else rnd.randrange(8))
        assert cpu.call("CHECKSYNC", 2) is (leaf.dir == "cmd"), leaf.symbol
        block[byte] = old
    assert cpu.call("CHECKSYNC", 2) is True


@pytest.mark.parametrize("family, ending", [("tia", "-tia.scl"), ("codesys", ".st")])
def test_other_families(tmp_path, family, ending):
    """{family}: every value is moved once in each direction, blocks end where they begin"""
    if family == "codesys":  # has variables
        rows = [dict(r, plc="GVL.v%d" % n) for n, r in enumerate(maps.rows(150, 12))]
        folder = maps.write(tmp_path / "p", rows, {"family": family, "byteorder": "little"})
        assert plcmap("place", folder).status == 0
    else:
        folder = plant(tmp_path, "setpoints one by one", family=family)
    text = generated(folder, tmp_path / "g")["p" + ending].decode()
    for word in ("FUNCTION", "FUNCTION_BLOCK", "DATA_BLOCK", "IF", "FOR", "VAR", "TYPE", "PROGRAM"):
        bare = re.sub(r"//[^\n]*|'[^']*'", "", text)
        ends = len(re.findall(r"\bEND_%s\b" % word, bare))
        begins = len(re.findall(r"(?<![_\w])%s(?:_INPUT|_OUTPUT|_TEMP|_GLOBAL)?\b(?!_)" % word
                                if word == "VAR" else r"(?<![_\w])%s\b(?!_)" % word, bare))
        assert begins == ends, word
    for leaf in model(folder).leaves():
        if family == "codesys":
            assert text.count("// %s\n" % leaf.symbol) == (leaf.tx is not None) + (leaf.rx is not None)


def test_installed():
    """The tool runs from bin/ of the built tree"""
    script = next(TOP.glob("bin/*/plcmap"), None)
    if script is None:
        pytest.skip("the tree is not built")
    run = subprocess.run([sys.executable, script, "--version"], capture_output=True, text=True)
    assert run.returncode == 0 and run.stdout.strip(), run.stderr
    package = {p.relative_to(TOP / "s7plcApp/map") for p in (TOP / "s7plcApp/map").rglob("*.py")}
    assert all((script.parent / p).exists() for p in package)


def test_speed(tmp_path):
    """5,000 rows: checked and generated"""
    folder = maps.write(tmp_path / "big", maps.rows(5000, 6))
    assert plcmap("place", folder).status == 0
    assert plcmap("check", folder).status == 0
    assert len(generated(folder, tmp_path / "g")) > 15
    assert isinstance(Path(tmp_path), Path)
