"""The databases that show the health of a PLC: names, how little they post, orders."""
import collections
import re
import subprocess
import sys

import epics
import pytest

from client import TOP
from waiting import LIMIT, until

sys.path.insert(0, str(TOP / "s7plcApp/op"))
from plcdisplays import lint  # noqa: E402

DATABASES = ["s7plcStation.db", "s7plcSync.db", "s7plcModbus.db", "s7plcTables.db",
             "s7plcStatus.template"]


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


def test_quiet(load):
    """a PLC where nothing happens posts less than one value in 10 s, but for its heartbeat"""
    sim, ioc = load(DATABASES, options="s7plcSetOption PLC, heartbeat, 500")
    ioc.wait_value("State", 3)
    names = record_names(DATABASES, {"P": ioc.P})
    assert len(names) > 80
    posts = Posts(names)
    beat = ioc.P + "BlocksIn"
    try:
        until(lambda: len(posts.count) == len(names),
              lambda: f"first values of {set(names) - set(posts.count)}")
        start = posts.count[beat]
        until(lambda: posts.count[beat] >= start + 2)  # what came with the connection is over
        before = collections.Counter(posts.count)
        until(lambda: posts.count[beat] >= before[beat] + 20)  # one a second
        more = posts.count - before
        del more[beat]
        assert sum(more.values()) < 2, more
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


def test_reason(load):
    """the alarm of State says why, and when data was lost is known"""
    sim, ioc = load(["s7plcStationSmall.db"])
    ioc.wait_value("State", 3)
    assert ioc.text("LostTime") == "" and ioc.text("Name") == "PLC"
    assert ioc.text("Setpoints") == "they pass"
    sim.command("unplug")
    ioc.wait_alarm("State", "MAJOR", "STATE")
    until(lambda: ioc.text("State.AMSG") and ioc.text("State.AMSG") == ioc.text("Reason")[:39],
          lambda: f'{ioc.text("State.AMSG")!r}, {ioc.text("Reason")!r}')
    ioc.wait_value("Setpoints", 0)
    until(lambda: ioc.text("LostTime").startswith("20"))
    sim.command("plug")
    ioc.wait_value("State", 3)
    assert ioc.alarm("State")[0] == "NO_ALARM" and ioc.text("State.AMSG") == ""
    assert ioc.text("LostTime").startswith("20")


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
    ioc = new_ioc(configure, "", program="phoenixIoc",
                  templates=[(f, "P=$(P),PLC=PLC") for f in ("phoenixplcStatus.db",
                                                             "s7plcStation.db")])
    ioc.wait_value("Pair", 1)
    assert ioc.text("AddressFirst") == f"127.0.0.2:{sim.port}"
    assert ioc.text("AddressSecond") == f"127.0.0.3:{sim.port}"
    sim.command("switchover")
    ioc.wait_value("Pair", 5)
    assert ioc.text("PRIMARY") == ioc.text("Primary") == "SECOND"
    ioc.process_record("SwitchSeen")
    ioc.wait_value("Pair", 2)
