"""The databases that show the health of a PLC: names, how little they post, orders."""
import collections
import re
import subprocess
import sys
import time

import epics
import pytest

from client import ARCH, TOP
from waiting import LIMIT, until

sys.path.insert(0, str(TOP / "s7plcApp/op"))
from plcdisplays import lint  # noqa: E402

DATABASES = ["s7plcStation.db", "s7plcSync.db", "s7plcModbus.db", "s7plcTables.db",
             "s7plcStatus.template"]

BLOCKS = "name = PLC\nin = 32\nout = 16\nbyteorder = big\nperiod = 100 ms\n"
# What plcSim plays, the command, the databases, the IOC
QUIET = {
    "a pair": (BLOCKS + "role = pair\naddress = 127.0.0.2\nsignal 0 UINT32 counter\n",
               'phoenixplcConfigure(PLC, "127.0.0.2", {port}, 32, 16, 1, 5000, 100, 1)',
               ["s7plcStation.db", "phoenixplcStatus.db"], "phoenixIoc"),
    "a Modbus server": ("name = PLC\nbyteorder = big\nmodbus_port = 0\ndb 1 16\n"
                        "modbus holding 0 8 -> DB1.0\n",
                        'modbusplcConfigure(PLC, "127.0.0.1", {port}, 1, "holding 0 4 every 100", '
                        '"holding 4 4")', ["s7plcStation.db", "s7plcModbus.db"], "s7plcIoc"),
    "a controller": ("name = PLC\nbyteorder = little\netherip_port = 0\ntag Count DINT counter 0.1\n",
                     'drvEtherIP_define_PLC("PLC", "127.0.0.1:{port}", 0)',
                     ["s7plcStation.db", "s7plcModbus.db", "eip_stat.db"], "s7plcIoc"),
    "a handshake with tables": ((TOP / "iocBoot/iocTables/tables.plc").read_text(),
                                "s7plcConfigure(PLC, 127.0.0.1, {port}, 64, 32, 1, 2000, 100)\n"
                                "s7plcSetOption PLC, sync, on\ns7plcSetOption PLC, map, download\n"
                                's7plcTables PLC "{folder}/plc.ptr"',
                                ["s7plcStation.db", "s7plcSync.db", "s7plcTables.db"], "s7plcIoc"),
    "a PLC with an asyn port": (BLOCKS + "signal 0 UINT32 counter\n",
                                "s7plcConfigure(PLC, 127.0.0.1, {port}, 32, 16, 1, 2000, 100)\n"
                                "drvAsynS7plcConfigure(PORT, PLC)",
                                ["s7plcStation.db", "s7plcStatus.template"], "s7plcAsynIoc"),
}
# A controller is asked for what records want.
USED = {"a controller": 'record(longin, "$(P)count") { field(DTYP, "EtherIP") '
                        'field(INP, "@PLC Count S 0.1") field(SCAN, "I/O Intr") }\n'}


def record_names(files, macros):
    text = "".join((TOP / "db" / file).read_text() for file in files)
    return [lint.expand(name, macros)
            for name in re.findall(r'record\(\s*\w+\s*,\s*"([^"]+)"', text)]


@pytest.fixture
def load(new_sim, new_ioc):
    """load(files, macros) -> a PLC of plcSim and its IOC with these databases, connected."""
    def make(files, macros="", signals="signal 0 UINT16 constant 7", options=""):
        sim = new_sim("name = PLC\nin = 32\nout = 16\nbyteorder = big\nperiod = 100 ms\n"
                      f"{signals}\n")
        configure = f"s7plcConfigure(PLC, 127.0.0.1, {sim.port}, 32, 16, 1, 5000, 100)\n{options}"
        ioc = new_ioc(configure, "", templates=[(f, "P=$(P),PLC=PLC" + macros) for f in files])
        return sim, ioc
    return make


class Posts:
    """Counts what a set of PVs posts, as a client with monitors sees it."""

    def __init__(self, names):
        self.count = collections.Counter()
        self.pvs = [epics.PV(n, callback=self._came, auto_monitor=epics.dbr.DBE_VALUE |
                             epics.dbr.DBE_ALARM) for n in names]
        for pv in self.pvs:
            assert pv.wait_for_connection(LIMIT), pv.pvname

    def _came(self, pvname, **_):
        self.count[pvname] += 1

    def close(self):
        for pv in self.pvs:
            pv.disconnect()


def silent(pvs):
    """What is known of PVs without a first value: is it the client that has not asked, or the IOC?"""
    return [f"{pv.pvname}: {pv.connected=}, subscribed: {pv._monref is not None}, "
            f"asked now: {pv.get(use_monitor=False, timeout=5)}" for pv in pvs]


def posts_little(posts, beat, seconds=20):
    """Less than one value in 10 s, but for the heartbeat: one a second.

    A machine that is late for a block counts it in Skipped or Coalesced: then the wire was not quiet, and
    the next `seconds` are looked at.
    """
    until(lambda: len(posts.count) == len(posts.pvs),
          lambda: f"no first values: {silent(pv for pv in posts.pvs if pv.pvname not in posts.count)}")
    start = posts.count[beat]
    until(lambda: posts.count[beat] >= start + 2)  # what came with the connection is over
    late = [beat.replace("BlocksIn", name) for name in ("Skipped", "Coalesced")]

    def quiet():
        before = collections.Counter(posts.count)
        until(lambda: posts.count[beat] >= before[beat] + seconds)
        more = posts.count - before
        del more[beat]
        return None if any(more[name] for name in late) else more
    # A Counter without entries is false, too: in a list.
    more = until(lambda: [found] if (found := quiet()) is not None else None, f"{seconds} s without a late block")[0]
    assert sum(more.values()) < seconds / 10, more


@pytest.mark.parametrize("wire", QUIET)
def test_quiet_wires(new_sim, new_ioc, tmp_path, wire):
    """{wire} where nothing happens posts as little"""
    text, configure, files, program = QUIET[wire]
    if not (TOP / "bin" / ARCH / program).exists():
        pytest.skip("s7plcAsyn is not built: ASYN is not set in configure/RELEASE.local")
    sim = new_sim(text)
    port = sim.modbus_port or sim.etherip_port or sim.port
    (tmp_path / "plc.ptr").write_text("layout 0x1201\ntx P#DB11.DBX0.0 BYTE 8 -> 16\n")
    ioc = new_ioc(configure.format(port=port, folder=tmp_path), USED.get(wire, ""), program=program,
                  templates=[(f, "P=$(P),PLC=PLC,IOC=$(P)stat,TAG=Count S 0.1,QUIET=1e9") for f in files])
    ioc.wait_value("State", 3)
    posts = Posts(record_names(files, {"P": ioc.P, "IOC": ioc.P + "stat"}))
    try:
        posts_little(posts, ioc.P + "BlocksIn")
    finally:
        posts.close()


def test_quiet(load):
    """a PLC where nothing happens posts less than one value in 10 s, but for its heartbeat"""
    sim, ioc = load(DATABASES, options="s7plcSetOption PLC, heartbeat, 500")
    ioc.wait_value("State", 3)
    names = record_names(DATABASES, {"P": ioc.P})
    assert len(names) > 80
    posts = Posts(names)
    beat = ioc.P + "BlocksIn"
    try:
        posts_little(posts, beat)
        ioc.put("Live", 1)
        before = collections.Counter(posts.count)
        moving = [ioc.P + n for n in ("BytesIn", "BlocksOut", "Period", "ConnectedFor", "BlockTime",
                                      "PeriodHistogram")]
        until(lambda: all(posts.count[n] > before[n] + 2 for n in moving),
              lambda: f"all of {moving} each second: {posts.count - before}")
        ioc.put("Live", 0)
        until(lambda: ioc.get("BytesIn.MDEL") == 1000000000)
    finally:
        posts.close()


def test_shapes(load):
    """BlockTime and histograms are posted when the state changes and each 300 s; Live ends after 600 s"""
    sim, ioc = load(["s7plcStation.db"])
    ioc.wait_value("State", 3)
    shapes = [ioc.P + name for name in ("BlockTime", "PeriodHistogram")]
    posts = Posts(shapes)
    try:
        until(lambda: all(posts.count[name] for name in shapes))
        for cause in (lambda: ioc.put("LiveTick.E", 299), lambda: sim.command("unplug")):
            blocks = ioc.get("BlocksIn")
            until(lambda: ioc.get("BlocksIn") > blocks + 20)  # or the time of the last one is what it was
            before = collections.Counter(posts.count)
            cause()
            until(lambda: all(posts.count[name] > before[name] for name in shapes), lambda: f"{posts.count} {before} {ioc.text('BlockTime')} {ioc.get('LiveTick.E')} {ioc.get('State')}")
    finally:
        posts.close()
    assert ioc.get("Live.HIGH") == 600 and ioc.text("LiveTick.SCAN") == "1 second"
    assert ">=300;" in ioc.text("LiveTick.CALC")


def test_reason(load):
    """the alarm of State says why, and when data was lost is known"""
    sim, ioc = load(["s7plcStationSmall.db"])
    ioc.wait_value("State", 3)
    assert ioc.text("LostTime") == "" and ioc.text("Name") == "PLC"
    assert ioc.text("Setpoints") == "they pass"
    sim.command("unplug")
    ioc.wait_alarm("State", "MAJOR", "STATE")
    until(lambda: ioc.text("Reason") and ioc.message("State") == ioc.text("Reason")[:39],
          lambda: f'{ioc.message("State")!r}, {ioc.text("Reason")!r}')
    ioc.wait_value("Setpoints", 0)
    until(lambda: ioc.text("LostTime").startswith("20"))
    sim.command("plug")
    ioc.wait_value("State", 3)
    assert ioc.alarm("State")[0] == "NO_ALARM" and ioc.message("State") == ""
    assert ioc.text("LostTime").startswith("20")


def test_pair_moves(new_sim, new_ioc):
    """a new address of a pair is that of FIRST, SECOND is at the next one, and the time of a switch-over is a number, too"""
    text = "name = PLC\nin = 32\nout = 16\nbyteorder = big\nperiod = 100 ms\nrole = pair\nsignal 0 UINT32 counter\n"
    old, new = new_sim(text + "address = 127.0.0.2\n"), new_sim(text + "address = 127.0.0.22\n")
    ioc = new_ioc(f'phoenixplcConfigure(PLC, "127.0.0.2", {old.port}, 32, 16, 1, 5000, 100, 1)',
                  'record(ai, "$(P)When") { field(DTYP, "phoenixplc") field(INP, "@PLC/lastSwitchTime") field(SCAN, "I/O Intr") }',
                  program="phoenixIoc", templates=[(f, "P=$(P),PLC=PLC") for f in (
                      "phoenixplcStatus.db", "s7plcStation.db", "s7plcStatus.template")])
    ioc.wait_value("Pair", 1)
    ioc.put("AddressSet", f"127.0.0.22:{new.port}")
    until(lambda: ioc.text("AddressFirst") == f"127.0.0.22:{new.port}")
    assert ioc.text("AddressSecond") == f"127.0.0.23:{new.port}"
    until(lambda: ioc.text("Backup") == "plc-2nd linked", lambda: ioc.text("Backup"))
    before = time.time()
    new.command("switchover")
    until(lambda: ioc.text("Primary") == "SECOND")
    until(lambda: before - 2 < ioc.get("When") < time.time() + 2, lambda: str(ioc.get("When")))


def test_macros(load):
    """SEV is the severity of State, ASG and ASG_ORDER are the groups of what is read and of orders"""
    sim, ioc = load(["s7plcStation.db"], ",SEV=MINOR,ASG=look,ASG_ORDER=order")
    sim.command("unplug")
    ioc.wait_alarm("State", "MINOR", "STATE")
    orders = {name for name in (n[len(ioc.P):] for n in record_names(["s7plcStation.db"], {"P": ioc.P}))
              if ioc.text(name + ".ASG") != "look"}
    assert orders == {"Reset", "Send", "Live"}
    assert {ioc.text(name + ".ASG") for name in orders} == {"order"}


def test_archived():
    """State, Reconnects and Jitter have info(archive, ...), what has limits info(autosaveFields, ...), and the how-tos count the records right"""
    counts = {}
    for file in ("s7plcStation.db", "s7plcStationSmall.db", "s7plcStatus.template"):
        text = (TOP / "db" / file).read_text()
        records = re.findall(r"^record\(.*?^}", text, re.M | re.S)
        counts[file] = len(records)
        if file == "s7plcStation.db":
            archived = {re.search(r"N_(\w+)", record)[1] for record in records if "info(archive, " in record}
            limits = [record for record in records if "_HIGH=" in record]
            assert len(limits) > 5 and all('info(autosaveFields, "' in record for record in limits)
    assert {"State", "Reconnects", "Jitter"} <= archived and len(archived) < counts["s7plcStation.db"] / 2
    text = " ".join((TOP / "docs/howto/many-plcs.md").read_text().split())
    assert abs(int(re.search(r"some (\d+) records a PLC", text)[1]) - counts["s7plcStation.db"]) < 5
    for file in ("s7plcStationSmall.db", "s7plcStatus.template"):
        assert f"`{file}` ({counts[file]}" in text, file


def test_orders(load):
    """Reset sets the counters to 0, Send makes a block leave"""
    sim, ioc = load(["s7plcStation.db"])
    ioc.wait_value("State", 3)
    sent = ioc.get("BlocksOut")
    ioc.put("Send", 1)
    until(lambda: ioc.get("BlocksOut") > sent)
    until(lambda: ioc.get("BlocksIn") > 20)
    ioc.put("Reset", 1)
    until(lambda: ioc.get("BlocksIn") < 20)
    assert ioc.get("Connects") == 0


def test_names(load):
    """names may have ends of their own, or be other names altogether"""
    sim, ioc = load(["s7plcStation.db"], ",R=-R,S=-S,N_Reason=$(P)Why,BLOCKAGE_HIGH=-1,"
                                         "BLOCKAGE_HSV=MINOR")
    ioc.wait_value("State-R", 3)
    ioc.put("Reset-S", 1)
    assert ioc.text("Why") == ""
    ioc.wait_alarm("BlockAge-R", "MINOR", "HIGH")


def test_generated():
    """the databases are what their generator writes"""
    run = subprocess.run([sys.executable, TOP / "s7plcApp/Db/generate.py", "--check"],
                         capture_output=True, text=True)
    assert run.returncode == 0, run.stdout + run.stderr


def test_switched(new_sim, new_ioc):
    """Pair says that a switch-over was, until somebody has seen it; the old names are there"""
    sim = new_sim("name = PLC\nin = 32\nout = 16\nbyteorder = big\nperiod = 100 ms\nrole = pair\n"
                  "address = 127.0.0.2\nswitchover = 300 ms\nsignal 0 UINT32 counter\n")
    configure = f'phoenixplcConfigure(PLC, "127.0.0.2", {sim.port}, 32, 16, 1, 5000, 100, 1)'
    ioc = new_ioc(configure, 'record(longin, "$(P)leader") { field(DTYP, "S7plc stats") field(INP, "@PLC/leader") '
                             'field(SCAN, "I/O Intr") }', program="phoenixIoc",
                  templates=[(f, "P=$(P),PLC=PLC") for f in ("phoenixplcStatus.db",
                                                             "s7plcStation.db")])
    ioc.wait_value("Pair", 1)
    ioc.wait_value("leader", 0)
    assert ioc.text("AddressFirst") == f"127.0.0.2:{sim.port}"
    assert ioc.text("AddressSecond") == f"127.0.0.3:{sim.port}"
    sim.command("switchover")
    ioc.wait_value("Pair", 5)
    assert ioc.text("PRIMARY") == ioc.text("Primary") == "SECOND"
    ioc.wait_value("leader", 1)
    ioc.process_record("SwitchSeen")
    ioc.wait_value("Pair", 2)
    ioc.wait_alarm("Pair", "NO_ALARM")
    sim.command("twoprimaries on")
    ioc.wait_alarm("Pair", "MAJOR")
    assert ioc.text("Pair") == "two PRIMARIES"
    sim.command("twoprimaries off")
    ioc.wait_alarm("Pair", "NO_ALARM")
    for half in ("first", "second"):
        sim.command(f"{half} unplug")
    ioc.wait_alarm("Pair", "MAJOR")
    assert ioc.text("Pair") == "no PRIMARY"
    ioc.wait_value("leader", -1)
