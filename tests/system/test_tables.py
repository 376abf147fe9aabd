"""Tables of pointers that the IOC brings: the real IOC against plcSim and against the SCL."""
import os
import signal
import struct

import pytest

from client import SECOND_IOC
from demos import run_demo
from scl import tables
from scl.plc import SclTablesPlc
from sim import Sim
from waiting import until, until_equal

# With the SCL of plc-tables.scl as the PLC; PLCLINK_ALL=1 runs the others so, too
SCL_ALWAYS = ("test_download", "test_forbidden", "test_hundred_rows")

TABLE_PLCS = {"plcSim": Sim, "SCL": SclTablesPlc}

# DB10 setpoints: REAL Temp, INT Speed, INT Mode. DB11 measurements. DB12 is nobody's business.
PLC = """
in = 48
out = 32
period = 20 ms
sync = on
map = on
map_rows = 32
layout = 0x1201
watchdog = 10 min
restarttime = 100 ms
db 10 24
db 11 256
db 12 16
init DB10.0 REAL32 21.5
init DB10.4 INT16 100
init DB10.6 INT16 7
init DB11.8 REAL32 3.25
init DB11.12 REAL32 77
allow write DB10
allow read DB11
signal 44 UINT32 counter
"""
# What an earlier IOC has left in it: without Level
OLD = """tx P#DB10.DBX0.0 BYTE 8 -> 16
rx 4 -> P#DB10.DBX0.0 BYTE 8
"""
PTR = """# plant
layout 0x1202
tx P#DB10.DBX0.0 BYTE 8 -> 16 Temp Speed Mode
tx P#DB11.DBX8.0 BYTE 8 -> 24 Level
rx 4 -> P#DB10.DBX0.0 BYTE 8 Temp Speed Mode
"""
DB = """
record(ao, "$(P)Temp")       { field(DTYP, "S7plc") field(OUT, "@PLC/4 T=REAL32") field(VAL, "80") field(PINI, "YES") }
record(longout, "$(P)Speed") { field(DTYP, "S7plc") field(OUT, "@PLC/8 T=INT16") field(VAL, "-9") field(PINI, "YES") }
record(longout, "$(P)Mode")  { field(DTYP, "S7plc") field(OUT, "@PLC/10 T=INT16") }
record(ai, "$(P)Level")      { field(DTYP, "S7plc") field(INP, "@PLC/24 T=REAL32") field(SCAN, "I/O Intr") }
record(int64in, "$(P)Blocks") { field(DTYP, "S7plc") field(INP, "@PLC/44 T=UINT32") field(SCAN, "I/O Intr") }
"""
HELD = struct.pack(">fhh", 21.5, 100, 7) + bytes(16)
TEMPLATES = [("s7plcSync.db", "P=$(P),PLC=PLC"), ("s7plcTables.db", "P=$(P),PLC=PLC")]


@pytest.fixture(params=TABLE_PLCS.values(), ids=TABLE_PLCS)
def new_plc(request, tmp_path, closing):
    def make(text, *options):
        plc = request.param(tmp_path, text, *options)
        closing(plc)
        return plc
    return make


@pytest.fixture
def new_table_ioc(new_ioc, tmp_path):
    """An IOC with a table; ptr=None: without one."""
    def make(port, ptr=PTR, mode="download", text=DB, more="", sizes="48, 32",
             configure=None, **kw):
        file = tmp_path / f"table{len(list(tmp_path.glob('*.ptr')))}.ptr"
        if ptr:
            file.write_text(ptr)
        lines = configure or f's7plcConfigure("PLC", "127.0.0.1", {port}, {sizes}, 1, 5000, 20)\n'
        lines += ("s7plcSetOption PLC sync on\ns7plcSetOption PLC readback 12\n"
                  f"s7plcSetOption PLC map {mode}\n{more}")
        if ptr:
            lines += f's7plcTables PLC "{file}"\n'
        return new_ioc(lines, text, templates=TEMPLATES, **kw)
    return make


def crc(ptr=PTR):
    """Of a .ptr file."""
    tx_rows, rx_rows, layout = [], [], 0
    for words in (line.split() for line in ptr.splitlines()):
        if words[:1] == ["layout"]:
            layout = int(words[1], 0)
        elif words[:1] == ["tx"]:
            tx_rows.append(row(words[1:4]) + tables.pointer(1, int(words[5]), int(words[3])))
        elif words[:1] == ["rx"]:
            rx_rows.append(tables.pointer(2, int(words[1]), int(words[5])) + row(words[3:6]))
    return tables.crc_of(tables.table(layout, tx_rows, rx_rows))


def row(words):
    db, byte = words[0][4:].split(".DBX")
    return tables.pointer(int(db), int(byte[:-2]), int(words[2]))


def memory(plc, number=10):
    lines = plc.command(f"dump DB{number}").splitlines()
    return bytes.fromhex("".join(line.split(":", 1)[1] for line in lines))


def plc_crc(plc):
    line = next(line for line in plc.command("status").splitlines() if line.startswith("map: "))
    return int(line.split("CRC 0x")[1][:8], 16)


def commands(plc):
    """The commands to the loader among the blocks that have come."""
    lines = plc.command("received 1000").splitlines()[1:]
    blocks = [bytes.fromhex("".join(line.split()[2:])) for line in lines]
    assert not [block for block in blocks if block[0] & tables.TABLE and block[0] & (tables.CHECK | tables.DATA)]
    return [block[4] for block in blocks if block[0] & tables.TABLE]


def wait_synced(ioc, level=3.25):
    until(lambda: ioc.text("Sync") == "synced", lambda: f"synced: {ioc.text('Sync')}\n{ioc.log}")
    assert ioc.text("Map") == "equal" and ioc.get("Map:Progress") == 100 and ioc.severity("Map") == "NO_ALARM"
    until_equal(lambda: ioc.text("Map:Reason.VAL$"), "")
    until_equal(lambda: (ioc.get("Temp"), ioc.get("Speed"), ioc.get("Mode")), (21.5, 100, 7))
    if level is not None:
        ioc.wait_value("Level", level)


def wait_reason(ioc, state, reason):
    until_equal(lambda: (ioc.text("Map"), ioc.text("Map:Reason.VAL$")), (state, reason))


@pytest.mark.parametrize("before", ["", OLD], ids=["no table", "another one"])
def test_download(new_plc, new_table_ioc, before):
    """a PLC with {id} takes the IOC's, values live, and not a byte of the plant moves"""
    plc = new_plc(PLC + before)
    ioc = new_table_ioc(plc.port)
    wait_synced(ioc)
    assert memory(plc) == HELD and plc_crc(plc) == crc() == ioc.get("Map:PlcCrc") == ioc.get("Map:Crc")
    assert commands(plc) == [1, 2, 2, 2, 2, 3]      # 70 bytes, 20 a block
    assert ioc.get("Map:Downloads") == 1 and ioc.get("Map:Refusals") == 0
    assert ioc.alarm("Level")[0] == "NO_ALARM"
    ioc.put("Speed", 123)
    until_equal(lambda: memory(plc)[4:6], struct.pack(">h", 123))
    plc.command("hmi DB11.8 REAL32 4.5")
    ioc.wait_value("Level", 4.5)
    assert "table of pointers: equal, 100 %" in ioc.command("s7plcReport PLC 1")


def test_little_endian(new_sim, new_table_ioc):
    """where numbers are little endian the table is big endian all the same"""
    plc = new_sim(PLC + OLD, "-o", "byteorder=little")
    ioc = new_table_ioc(plc.port, configure='s7plcConfigure("PLC", "127.0.0.1", '
                        f"{plc.port}, 48, 32, 0, 5000, 20)\n")
    wait_synced(ioc)
    assert plc_crc(plc) == crc() == ioc.get("Map:PlcCrc")
    assert commands(plc) == [1, 2, 2, 2, 2, 3]


def test_equal(new_plc, new_table_ioc):
    """the same table: nothing is sent; so it is after a restart of the PLC and of the IOC"""
    plc = new_plc(PLC)
    ioc = new_table_ioc(plc.port)
    wait_synced(ioc)
    first = commands(plc)
    plc.command("restart")
    until(lambda: ioc.get("Sync:Count") >= 2 and ioc.text("Sync") == "synced", "synced again")
    ioc.close()
    second = new_table_ioc(plc.port, mode="check")
    wait_synced(second)
    assert commands(plc) == first and plc_crc(plc) == crc()


def test_check(new_plc, new_table_ioc):
    """map=check never sends: inputs and puts say that the PLC has another table"""
    plc = new_plc(PLC + OLD)
    ioc = new_table_ioc(plc.port, mode="check")
    wait_reason(ioc, "map mismatch", "the PLC has another table")
    assert ioc.severity("Map") == "MAJOR" and ioc.text("Sync") == "map mismatch"
    ioc.put("Speed", 5)
    assert ioc.alarm("Speed") == ("INVALID", "WRITE", "PLC has another table of pointers")
    ioc.wait_alarm("Level", "INVALID", "COMM", "PLC has another table of pointers")
    assert plc.command("received").startswith("blocks 0 ")
    assert memory(plc) == HELD and ioc.log_count("map mismatch: the PLC has another table") == 1


def test_forbidden(new_plc, new_table_ioc):
    """a table that reaches for a forbidden DB is refused with the row named; the old one stays"""
    plc = new_plc(PLC + OLD)
    old = plc_crc(plc)
    ioc = new_table_ioc(plc.port, PTR + "tx P#DB12.DBX0.0 BYTE 4 -> 32 Secret.Key\n")
    reason = "row 2: memory that the PLC does not allow: Secret.Key"
    wait_reason(ioc, "refused", reason)
    assert reason in ioc.log and ioc.get("Map:Refusals") == 1 and ioc.severity("Map") == "MAJOR"
    assert (ioc.get("Map:PlcCrc"), ioc.get("Map:Crc")) == (old, crc(PTR + "tx P#DB12.DBX0.0 BYTE 4 -> 32\n"))
    ioc.put("Speed", 5)
    assert ioc.alarm("Speed")[:2] == ("INVALID", "WRITE")
    assert memory(plc) == HELD and plc_crc(plc) == old
    assert commands(plc).count(1) == 1
    ioc.close()
    good = new_table_ioc(plc.port)
    wait_synced(good)


def test_too_long(new_sim, new_table_ioc):
    """a table with more rows than the PLC has room for is not begun, and both numbers are told"""
    plc = new_sim(PLC + OLD)
    old = plc_crc(plc)
    ioc = new_table_ioc(plc.port, PTR + "tx P#DB11.DBX0.0 BYTE 1 -> 40\n" * 30)
    wait_reason(ioc, "map mismatch", "table of 33 rows, the PLC has 32")
    assert commands(plc) == [] and plc_crc(plc) == old


def test_spoilt(new_sim, new_table_ioc):
    """a bit that flips in the PLC's table: inputs are INVALID, and the IOC brings its table again"""
    plc = new_sim(PLC)
    ioc = new_table_ioc(plc.port)
    wait_synced(ioc)
    ioc.put("Speed", 55)
    until_equal(lambda: memory(plc)[4:6], struct.pack(">h", 55))
    plc.command("set DB20.DBB14 0x7f")
    until(lambda: ioc.get("Map:Downloads") == 2 and ioc.text("Sync") == "synced",
          lambda: ioc.log)
    assert plc_crc(plc) == crc() and ioc.get("Speed") == 55
    assert memory(plc)[4:6] == struct.pack(">h", 55)


@pytest.mark.parametrize("locked,unlocked,reason", [
    ("allowmap off", "allowmap on", "another table; the PLC's are locked"),
    ("local", "remote", "another table; PLC in LOCAL")], ids=["key switch", "LOCAL"])
def test_waits(new_plc, new_table_ioc, locked, unlocked, reason):
    """with {id} against it the IOC waits and says so, and downloads when it may"""
    plc = new_plc(PLC + OLD)
    plc.command(locked)
    ioc = new_table_ioc(plc.port)
    wait_reason(ioc, "map mismatch", reason)
    assert commands(plc) == []
    plc.command(unlocked)
    wait_synced(ioc)
    if locked == "allowmap off":  # with the table that it has all goes on
        plc.command(locked)
        until(lambda: "locked" in plc.command("status"), lambda: plc.command("status"))
        ioc.put("Speed", 55)
        until_equal(lambda: memory(plc)[4:6], struct.pack(">h", 55))
        assert ioc.text("Sync") == "synced"


def test_old_plc(new_plc, new_table_ioc, new_sim):
    """a PLC without tables goes on as it was, and says nothing of them"""
    plc = new_sim(PLC.replace("map = on\nmap_rows = 32\n", "").replace("allow", "# allow")
                  .replace("0x1201", "0x1202")
                  + OLD + "tx P#DB11.DBX8.0 BYTE 8 -> 24\n")
    ioc = new_table_ioc(plc.port)
    until(lambda: ioc.text("Sync") == "synced", lambda: ioc.log)
    assert ioc.text("Map") == "fixed tables" and commands(plc) == []
    ioc.put("Speed", 5)
    until_equal(lambda: memory(plc)[4:6], struct.pack(">h", 5))


def test_old_ioc(new_plc, new_ioc):
    """an IOC that knows of no tables works with a PLC that has one"""
    plc = new_plc(PLC + OLD)
    ioc = new_ioc(f's7plcConfigure("PLC", "127.0.0.1", {plc.port}, 48, 32, 1, 5000, 20)\n'
                  "s7plcSetOption PLC sync on\ns7plcSetOption PLC readback 12\n"
                  "s7plcSetOption PLC layout 0x1201\n", DB, templates=TEMPLATES)
    until(lambda: ioc.text("Sync") == "synced", lambda: ioc.log)
    ioc.put("Speed", 5)
    until_equal(lambda: memory(plc)[4:6], struct.pack(">h", 5))


def slow(plc_text):
    """A PLC slow enough to be caught in the middle of a download."""
    return plc_text.replace("period = 20 ms", "period = 60 ms")


def middle(ioc):
    until(lambda: 0 < ioc.get("Map:Progress") < 100, "the middle of a download")


FAULTS = ["restart", "killed", "second IOC"] + ["close", "reset"] * ("PLCLINK_ALL" in os.environ)


@pytest.mark.parametrize("fault", FAULTS)
def test_middle(new_plc, new_table_ioc, fault):
    """in the middle of a download: {fault}; the PLC keeps its table, and then gets the new one"""
    plc = new_plc(slow(PLC) + OLD)
    old = plc_crc(plc)
    long = PTR + "".join(f"tx P#DB11.DBX{i}.0 BYTE 1 -> {i}\n" for i in range(32, 44))
    ioc = new_table_ioc(plc.port, long)
    middle(ioc)
    assert plc_crc(plc) == old
    second = None
    if fault == "killed":
        ioc.process.kill()
        ioc.process.wait()
        ioc.process.returncode = 0      # it was meant to die
    elif fault == "second IOC":
        os.kill(ioc.process.pid, signal.SIGSTOP)
        second = new_table_ioc(plc.port, env={**os.environ,
                                              "EPICS_CAS_INTF_ADDR_LIST": SECOND_IOC})
    else:
        plc.command(fault)
    try:
        if fault == "killed":
            assert plc_crc(plc) == old and memory(plc) == HELD
            ioc = new_table_ioc(plc.port, long)
        wait_synced(second or ioc)
        assert plc_crc(plc) == (crc() if second else crc(long)) and memory(plc) == HELD
        if second:
            second.close()
    finally:
        if fault == "second IOC":
            os.kill(ioc.process.pid, signal.SIGCONT)


def test_hundred_rows(new_plc, new_table_ioc):
    """100 rows go in as many blocks as arithmetic says, and progress rises from 0 to 100 %"""
    plc = new_plc(PLC.replace("map_rows = 32", "map_rows = 104")
                  .replace("in = 48", "in = 240").replace("44 UINT32", "220 UINT32") + OLD)
    ptr = PTR + "".join(f"tx P#DB11.DBX{i}.0 BYTE 1 -> {i}\n" for i in range(32, 129))
    ioc = new_table_ioc(plc.port, ptr, text=DB.replace("/44", "/220"), sizes="240, 32",
                        start=False)
    ioc.start()
    seen, alarms = [0], set()

    def done():
        if seen[-1]:
            ioc.put("Speed", 5)
            alarms.add(ioc.alarm("Speed"))
            alarms.add((ioc.text("Map"), ioc.severity("Map")))
        seen.append(ioc.get("Map:Progress"))
        return seen[-1] == 100
    until(done, lambda: f"100 %: {seen[-1]}\n{ioc.log}")
    assert {("INVALID", "WRITE", "PLC is getting its table of pointers"), ("loading", "MINOR")} <= alarms, alarms
    wait_synced(ioc)
    assert commands(plc) == [1] + 101 * [2] + [3]       # 2010 bytes, 20 a block
    assert seen == sorted(seen) and plc_crc(plc) == crc(ptr)


@pytest.mark.parametrize("mode", ["check", "download"])
def test_pair(new_sim, new_table_ioc, mode):
    """a new PRIMARY with another table: map={mode}"""
    first = new_sim(PLC + OLD, "-o", "address=127.0.0.2")
    second = new_sim(PLC + OLD.replace("-> 16", "-> 20"), "-o", "address=127.0.0.3",
                     "-p", str(first.port))
    second.command("silence")
    ioc = new_table_ioc(
        first.port, mode="download", program="phoenixIoc",
        configure=f'phoenixplcConfigure("PLC", "127.0.0.2", {first.port}, 48, 32, 1, 5000, 20, 1)\n')
    wait_synced(ioc)
    old = plc_crc(second)
    if mode == "check":
        second.command("allowmap off")
    first.command("silence")
    second.command("silence off")
    if mode == "check":
        wait_reason(ioc, "map mismatch", "another table; the PLC's are locked")
        ioc.put("Speed", 5)
        assert ioc.alarm("Speed") == ("INVALID", "WRITE", "PLC has another table of pointers")
        assert plc_crc(second) == old and memory(second) == HELD
    else:
        until(lambda: ioc.get("Map:Downloads") == 2, lambda: ioc.log)
        wait_synced(ioc)
        assert plc_crc(second) == crc() and memory(second) == HELD


def test_pair_of_one_memory(new_sim, new_table_ioc):
    """an H system, whose memory is one: the new PRIMARY has the table, nothing is sent again"""
    plc = new_sim(PLC, "-o", "role=pair", "-o", "address=127.0.0.2")
    ioc = new_table_ioc(
        plc.port, program="phoenixIoc",
        configure=f'phoenixplcConfigure("PLC", "127.0.0.2", {plc.port}, 48, 32, 1, 5000, 20, 1)\n')
    wait_synced(ioc)
    for turn in range(2, 5):
        plc.command("switchover")
        until(lambda: ioc.get("Sync:Count") >= turn and ioc.text("Sync") == "synced",
              lambda: ioc.log)
        assert plc_crc(plc) == crc() and memory(plc) == HELD
    assert ioc.get("Map:Downloads") == 1


@pytest.mark.parametrize("lines,words", [
    ("s7plcSetOption PLC map download\n", "option map: sync=on first"),
    ("s7plcTables PLC none.ptr\n", 's7plcTables PLC: cannot read "none.ptr": No such file'),
    ("s7plcTables PLC\n", 's7plcTables PLC: cannot read "": no file given'),
    ("s7plcTables OTHER x.ptr\n", 's7plcTables: no PLC "OTHER"; configured: PLC'),
    ("s7plcTables PLC {bad}\n", "line 1: \"rows\"; allowed: layout, ie_tx"),
    ("s7plcSetOption PLC sync on\ns7plcSetOption PLC map check\n",
     "option map is set, and there is no table: s7plcTables"),
    ("s7plcSetOption PLC sync on\ns7plcSetOption PLC map check\n"
     "s7plcSetOption PLC layout 5\ns7plcTables PLC {good}\n",
     "option layout is 5, the table has 4610, which counts"),
    ("s7plcTables PLC {crc}\n", "the file says crc 0x00000001, its rows have 0x"),
    ("s7plcTables PLC {good}\niocInit\ns7plcTables PLC {good}\n", "only before iocInit"),
], ids=range(9))
def test_messages(new_ioc, tmp_path, lines, words):
    """what is wrong is said in one line: {words}"""
    (tmp_path / "bad.ptr").write_text("rows 5\n")
    (tmp_path / "good.ptr").write_text(PTR)
    (tmp_path / "crc.ptr").write_text(PTR + "crc 1\n")
    lines = lines.format(crc=tmp_path / "crc.ptr", bad=tmp_path / "bad.ptr", good=tmp_path / "good.ptr")
    ioc = new_ioc(f's7plcConfigure("PLC", "127.0.0.1", 1, 48, 32, 1, 5000, 20)\n{lines}', "")
    assert words in ioc.log

def test_demo():
    """make demo-tables without a terminal ends by itself and says demo ok"""
    run_demo("iocTables", 120)
