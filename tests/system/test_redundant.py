"""A redundant pair: records see one PLC, whichever of the two leads."""
import datetime
import os
import random
import re
import signal
import subprocess
import threading
import time
from pathlib import Path

import epics
import pytest

from client import ARCH, TOP
from demos import run_demo
from ioc import Ioc
from netns import DelayProxy, Plant
from sim import Sim
from waiting import LIMIT, until, until_equal

PROGRAM = TOP / "bin" / ARCH / "phoenixIoc"
STATUS = TOP / "db/phoenixplcStatus.db"
PERIOD = 0.1
NTH = ("1st", "2nd")
EPISODES = int(os.environ.get("EPISODES", 8))
PUTS = 8  # setpoints, 4 bytes each

BLOCKS = f"""
name = PLC
port = 2000
in = 64
out = 32
period = {PERIOD * 1000:g} ms
signal 0 UINT32 counter
mirror 0 32 -> 32
"""
PAIR = BLOCKS + "role = pair\nswitchover = 500 ms\n"
HALF = BLOCKS + """switchover = 500 ms
interface = eth0
interface_second = eth0
signal 4 UINT16 constant """


def records(plc, prefix=""):
    """Database text: counter, who sends, setpoints with read-backs."""
    def record(kind, name, link, more=""):
        field = "OUT" if kind == "longout" else "INP"
        scan = 'field(DOL,"0")field(PINI,"YES")' if kind == "longout" else 'field(SCAN,"I/O Intr")'
        return (f'record({kind},"$(P){prefix}{name}"){{field(DTYP,"S7plc")'
                f'field({field},"@{plc}/{link}"){scan}{more}}}\n')
    text = record("longin", "cnt", "0 T=UINT32") + record("longin", "who", "4 T=UINT16")
    for i in range(PUTS):
        text += record("longout", f"out{i}", f"{4 * i} T=INT32")
        text += record("longin", f"rb{i}", f"{32 + 4 * i} T=INT32")
    return text


class PhoenixIoc(Ioc):
    """phoenixIoc, with status records of the PLCs named (prefix X-: for PLC X)."""

    def __init__(self, directory, configure, plcs):
        super().__init__(directory, "", "")
        db = directory / f"{self.P[:-1]}.db"
        db.write_text("".join(records(plc, f"{plc}:") for plc in plcs))
        status = "\n".join(f'dbLoadRecords("{STATUS}","P={self.P}{plc}:,PLC={plc}")'
                           for plc in plcs)
        self.script.write_text(
            f'dbLoadDatabase("{TOP / "dbd/phoenixIoc.dbd"}")\n'
            "phoenixIoc_registerRecordDeviceDriver(pdbbase)\n"
            f"{configure}\n"
            f'dbLoadRecords("{db}","P={self.P}")\n{status}\niocInit\n')

    def start(self, limit=60):
        self.process = subprocess.Popen(
            [str(PROGRAM), str(self.script)], stdin=subprocess.PIPE,
            stdout=subprocess.PIPE, stderr=subprocess.STDOUT)
        threading.Thread(target=self._read, daemon=True).start()
        self.command("", limit)
        return self


class Recorder:
    """All monitors of some PVs: (time, value, severity), in the IOC's time."""

    def __init__(self, ioc, *names):
        self.events = {name: [] for name in names}
        self.pvs = []
        for name in names:
            pv = epics.PV(ioc.P + name, form="time", auto_monitor=True,
                          callback=self._callback(name))
            self.pvs.append(pv)
            assert pv.wait_for_connection(LIMIT)
        until(lambda: all(self.events.values()), "the first monitors")

    def _callback(self, name):
        def note(value=None, severity=None, timestamp=None, **_):
            self.events[name].append((timestamp, value, severity))
        return note

    def invalid(self):
        return [(name, event) for name, events in self.events.items() for event in events
                if event[2] == 3]

    def first(self, name, value, after=0):
        """The time at which the PV first had this value."""
        def find():
            return next((t for t, v, _ in list(self.events[name]) if v == value and t > after),
                        None)
        return until(find, lambda: f"{name} = {value}: {self.events[name][-5:]}")

    def close(self):
        for pv in self.pvs:
            pv.disconnect()


def report(capsys, text):
    """A figure for whoever reads the test's output."""
    with capsys.disabled():
        print(f"\n      {text}", end="")


def log_time(sim, text):
    """The time of the first line of the simulator's log with this text, s since 1970."""
    line = until(lambda: next((x for x in sim.lines if text in x), None),
                 lambda: f"{text} in " + "\n".join(sim.lines))
    return datetime.datetime.fromisoformat(line[:23]).timestamp()


def received(sim, n=1000):
    """The first words of the blocks that the PLC got, and their number."""
    text = sim.command(f"received {n}")
    blocks = re.findall(r"^\s*\d+\s+[\d.]+\s+([0-9a-f ]+)$", text, re.M)
    return [bytes.fromhex(b.replace(" ", "")) for b in blocks]


def configure(name, address, port, redundancy=1, recv_timeout=2000):
    return (f'phoenixplcConfigure("{name}","{address}",{port},64,32,1,{recv_timeout},20,'
            f'{redundancy})')


@pytest.fixture
def new_pair(tmp_path, closing):
    """new_pair(recvTimeout) starts a pair on 127.0.0.2 and .3, and an IOC with it as "A"."""
    def make(**kw):
        sim = Sim(tmp_path, PAIR + "address = 127.0.0.2\nsignal 4 UINT16 constant 1\n")
        closing(sim)
        ioc = PhoenixIoc(tmp_path, configure("A", "127.0.0.2", sim.port, **kw), ["A"])
        closing(ioc)
        ioc.start()
        until_equal(lambda: ioc.text("A:BACKUP"), "plc-2nd linked")
        return ioc, sim
    return make


@pytest.fixture
def record(closing):
    def make(*args):
        recorder = Recorder(*args)
        closing(recorder)
        return recorder
    return make


@pytest.fixture
def plant(closing):
    if os.geteuid() != 0:
        pytest.skip("network namespaces need root")
    plant = Plant(2)
    closing(plant)
    return plant


@pytest.fixture
def field(tmp_path, closing, plant):
    """A pair in two namespaces with a fibre between them, and an IOC with it as "A"."""
    halves = []
    for i, role in enumerate(("first", "second")):
        halves.append(Sim(tmp_path, HALF + str(i + 1), "-o", f"role={role}", "-o",
                          f"fibre={tmp_path}/fibre", "-a", plant.address(i), "-p", "2000",
                          wrapper=plant.wrapper(i)))
        closing(halves[-1])
    ioc = PhoenixIoc(tmp_path, configure("A", plant.address(0), 2000), ["A"])
    closing(ioc)
    ioc.start()
    until_equal(lambda: ioc.text("A:BACKUP"), "plc-2nd linked")
    return ioc, halves, plant


ALL = ["A:cnt", "A:who", *[f"A:out{i}" for i in range(PUTS)], *[f"A:rb{i}" for i in range(PUTS)]]

# --- loopback: needs no privileges -------------------------------------------------------------


def test_orderly(new_pair, record, capsys):
    """Orderly switch-over: new values within about a block period, none INVALID."""
    ioc, sim = new_pair()
    ioc.put("A:out0", 1)
    ioc.wait_value("A:rb0", 1)
    seen = record(ioc, *ALL)
    gaps = []
    for n in range(1, 7):
        time.sleep(0.013 * n)  # another phase of the block period each time
        sim.command("switchover")
        until_equal(lambda: ioc.get("A:SWITCHOVERS"), n)
        gaps.append(ioc.get("A:SWITCH_DURATION"))
        until_equal(lambda: ioc.text("A:BACKUP"), f"plc-{'1st' if n % 2 else '2nd'} linked")
        ioc.put("A:out0", 100 + n)
        ioc.wait_value("A:rb0", 100 + n)
        last = len(seen.events["A:cnt"])
        until(lambda: len(seen.events["A:cnt"]) > last + 10, "values of the new PRIMARY")
    assert not seen.invalid()
    assert ioc.log_count("is PRIMARY now") >= 6
    report(capsys, f"last block of the old to first of the new: median "
           f"{sorted(gaps)[len(gaps) // 2]:.1f} ms, max {max(gaps):.1f} ms, "
           f"period {PERIOD * 1000:.0f} ms")
    assert sorted(gaps)[len(gaps) // 2] < 2000 * PERIOD


def test_unplug(new_pair, record):
    """The PRIMARY falls silent: the other leads after its switch-over time, none INVALID."""
    ioc, sim = new_pair()
    seen = record(ioc, *ALL)
    sim.command("unplug 1")
    for i in range(PUTS):
        ioc.put(f"A:out{i}", 1000 + i)
    until_equal(lambda: ioc.text("A:PRIMARY"), "SECOND")
    for i in range(PUTS):
        ioc.wait_value(f"A:rb{i}", 1000 + i)
    until_equal(lambda: ioc.text("A:BACKUP"), "plc-1st unlinked")
    assert ioc.severity("A:BACKUP") == "MINOR"
    sim.command("plug 1")
    until_equal(lambda: ioc.text("A:BACKUP"), "plc-1st linked")
    assert ioc.severity("A:BACKUP") == "NO_ALARM"
    assert ioc.get("A:SWITCHOVERS") == 1 and not seen.invalid()


def test_restart(new_pair, record):
    """The PRIMARY restarts: the other takes over, the restarted one is BACKUP then."""
    ioc, sim = new_pair()
    ioc.put("A:out3", 33)
    ioc.wait_value("A:rb3", 33)
    seen = record(ioc, *ALL)
    sim.command("restart 1 1500")
    until_equal(lambda: ioc.text("A:BACKUP"), "plc-1st unlinked")
    until_equal(lambda: ioc.text("A:BACKUP"), "plc-1st linked")
    assert ioc.text("A:PRIMARY") == "SECOND" and ioc.get("A:SWITCHOVERS") == 1
    assert "FIRST disconnected" in ioc.text("A:SWITCH_REASON")
    for command in ("dbior phoenixplc 1", "s7plcReport A 1"):
        assert re.search(r"PRIMARY:? SECOND", ioc.command(command)), ioc.command(command)
    ioc.wait_value("A:rb3", 33)
    assert not seen.invalid()


def test_two_primaries(new_pair, record):
    """Both send: the present PRIMARY stays, an alarm tells, puts go to it alone."""
    ioc, sim = new_pair()
    seen = record(ioc, *ALL)
    sim.command("twoprimaries on")
    ioc.wait_alarm("A:TWO_PRIMARIES", "MAJOR")
    assert ioc.text("A:PRIMARY") == "FIRST" and ioc.get("A:TWO_PRIMARIES_COUNT") == 1
    ioc.wait_alarm("A:BACKUP", "MINOR", "STATE", "both PLCs send")
    assert ioc.text("A:BACKUP") == "unknown"
    before = sim.command("second received")
    ioc.put("A:out1", 5)
    ioc.wait_value("A:rb1", 5)
    assert sim.command("second received") == before
    sim.command("twoprimaries off")
    ioc.wait_alarm("A:TWO_PRIMARIES", "NO_ALARM")
    until_equal(lambda: ioc.text("A:BACKUP"), "plc-2nd linked")
    assert ioc.text("A:PRIMARY") == "FIRST" and ioc.get("A:SWITCHOVERS") == 0
    assert not seen.invalid()


def test_nobody(new_pair):
    """Neither sends: INVALID after recvTimeout, with words, and all well when one sends again."""
    ioc, sim = new_pair(recv_timeout=700)
    sim.command("first silence on")
    ioc.wait_alarm("A:cnt", "INVALID", "COMM", "no PRIMARY")
    assert ioc.text("A:PRIMARY") == "none" and ioc.text("A:BACKUP") == "unknown"
    assert ioc.severity("A:BACKUP") == "MINOR"
    sim.command("first silence off")
    ioc.wait_alarm("A:cnt", "NO_ALARM")
    assert ioc.text("A:PRIMARY") == "FIRST" and ioc.get("A:SWITCHOVERS") == 0


def test_stopped(new_pair, record):
    """An IOC that stood still for longer than recvTimeout: blocks that it has not read yet are no silence."""
    ioc, _ = new_pair(recv_timeout=700)
    seen = record(ioc, *ALL)
    for _ in range(3):
        ioc.process.send_signal(signal.SIGSTOP)
        time.sleep(1.5)  # so long it stands still
        ioc.process.send_signal(signal.SIGCONT)
        last = len(seen.events["A:cnt"])
        until(lambda: len(seen.events["A:cnt"]) > last + 10, "values")
    assert ioc.get("A:SWITCHOVERS") == 0 and not seen.invalid()


def test_delayed(tmp_path, closing, record):
    """A block of the old PRIMARY comes after the first of the new one: no flapping."""
    sim = Sim(tmp_path, PAIR + "address = 127.0.0.2\nsignal 4 UINT16 constant 1\n")
    closing(sim)
    proxy = DelayProxy("127.0.0.9", "127.0.0.2", sim.port, 1.5 * PERIOD)
    closing(proxy)
    ioc = PhoenixIoc(tmp_path, configure("A", "127.0.0.9,127.0.0.3", sim.port), ["A"])
    closing(ioc)
    ioc.start()
    until_equal(lambda: ioc.text("A:BACKUP"), "plc-2nd linked")
    seen = record(ioc, *ALL, "A:PRIMARY")
    sim.command("switchover")
    until_equal(lambda: ioc.text("A:PRIMARY"), "SECOND")
    last = len(seen.events["A:cnt"])
    until(lambda: len(seen.events["A:cnt"]) > last + 15, "values of the new PRIMARY")
    assert [v for _, v, _ in seen.events["A:PRIMARY"]] == [1, 2]
    assert ioc.get("A:TWO_PRIMARIES_COUNT") == 0 and not seen.invalid()


def test_no_cross_talk(tmp_path, closing, record):
    """Two pairs and two single PLCs in one IOC: what happens to one is not seen in the others."""
    names = {"A": (2, 1), "B": (20, 1), "C": (40, 0), "D": (50, 0)}
    sims, lines = {}, []
    for n, (name, (last, redundancy)) in enumerate(names.items()):
        text = (PAIR if redundancy else BLOCKS) + f"address = 127.0.0.{last}\n"
        sims[name] = Sim(tmp_path, text + f"signal 4 UINT16 constant {n + 1}\n")
        closing(sims[name])
        lines.append(configure(name, f"127.0.0.{last}", sims[name].port, redundancy))
    ioc = PhoenixIoc(tmp_path, "\n".join(lines), list(names))
    closing(ioc)
    ioc.start()
    for n, name in enumerate(names):
        ioc.put(f"{name}:out0", 10 + n)
        ioc.wait_value(f"{name}:rb0", 10 + n)
    seen = record(ioc, *[f"{name}:{r}" for name in names for r in ("who", "cnt", "rb0")])
    for turn, command in enumerate(("switchover", "unplug 2", "plug 2")):
        sims["A"].command(command)
        ioc.put("A:out0", 100 + turn)
        ioc.wait_value("A:rb0", 100 + turn)
    sims["C"].command("restart")
    until_equal(lambda: ioc.severity("C:cnt"), "INVALID")
    until_equal(lambda: ioc.severity("C:cnt"), "NO_ALARM")
    assert ioc.get("A:SWITCHOVERS") == 2 and ioc.get("B:SWITCHOVERS") == 0
    assert ioc.text("B:PRIMARY") == "FIRST" and ioc.text("B:BACKUP") == "plc-2nd linked"
    assert ioc.text("C:BACKUP") == "no partner" and ioc.text("D:BACKUP") == "no partner"
    assert ioc.text("C:CONNECTED2") == "no partner" and ioc.severity("C:CONNECTED2") == "NO_ALARM"
    assert ioc.text("B:BACKUP_LINK").startswith("TCP") and ioc.text("C:BACKUP_LINK") == "no partner"
    for n, name in enumerate(names):
        assert {v for _, v, s in seen.events[f"{name}:who"] if s != 3} == {n + 1}
        if name != "A":
            assert ioc.get(f"{name}:rb0") == 10 + n
    assert {name for name, _ in seen.invalid()} <= {"C:who", "C:cnt", "C:rb0"}


def test_record_types(tmp_path, closing):
    """Each record type that the page names shows a key; the template has each key of the page."""
    ioc = PhoenixIoc(tmp_path, configure("A", "127.0.0.2", 1), ["A"])
    closing(ioc)
    kinds = ("ai", "longin", "int64in", "bi", "mbbi", "stringin", "lsi")
    db = tmp_path / "kinds.db"
    db.write_text("".join(f'record({kind},"{ioc.P}{kind}"){{field(DTYP,"phoenixplc")field(INP,"@A/connected1")}}\n'
                          for kind in kinds))
    ioc.script.write_text(ioc.script.read_text().replace("iocInit", f'dbLoadRecords("{db}")\niocInit'))
    ioc.start()
    for kind in kinds:
        ioc.process_record(kind)
        assert ioc.severity(kind) == "NO_ALARM" and ioc.get(kind) in (0, "0", "not connected"), (kind, ioc.get(kind))
    keys = set(re.findall(r"^\| `(\w+)`(?:, `(\w+)`)? \| `[A-Z_0-9]+`", (TOP / "docs/redundancy.md").read_text(), re.M))
    shown = set(re.findall(r'"@\$\(PLC\)/(\w+)"', Path(STATUS).read_text()))
    assert {key for pair in keys for key in pair if key} - {"backup"} == shown  # that one is the mbbi without a key


def test_refused_links(tmp_path, closing):
    """Wrong links of status records: a message each, the records are INVALID, the IOC starts."""
    ioc = PhoenixIoc(tmp_path, configure("A", "127.0.0.2", 1), ["A"])
    closing(ioc)
    db = tmp_path / "wrong.db"
    db.write_text("".join(
        f'record({kind},"{ioc.P}w{i}"){{field(DTYP,"phoenixplc")field(INP,"{link}")}}\n'
        for i, (kind, link) in enumerate([("longin", "@B/primary"), ("longin", "@A/primay"),
                                          ("ai", "@A/lastSwitchReason"), ("mbbi", "@"),
                                          ("longin", "@A/primary")])))
    text = ioc.script.read_text().replace("iocInit", f'dbLoadRecords("{db}")\niocInit')
    ioc.script.write_text(text)
    ioc.start()
    for i in range(4):
        ioc.process_record(f"w{i}")
        assert ioc.severity(f"w{i}") == "INVALID"
        assert f'"{ioc.P}w{i}" INP' in ioc.log
    assert "allowed: backup primary" in ioc.log

    def stamp():
        return ioc.pv("w4").get_with_metadata(form="time", use_monitor=False)["timestamp"]
    ioc.process_record("w4")
    ioc.wait_alarm("w4", "NO_ALARM")
    before = stamp()
    ioc.put("w4.INP", "@A/primay")
    ioc.wait_alarm("w4", "INVALID", "LINK", "wrong link")
    assert stamp() > before, "an alarm has a time of its own"


def test_demo():
    """make demo-redundant walks through the paper's three steps."""
    shown = run_demo("iocPhoenix", 200)
    states = re.findall(r"PLC-A +PRIMARY: (\w+) +BACKUP: (.+)", shown)
    assert states == [("FIRST", "plc-2nd linked"), ("SECOND", "plc-1st unlinked"),
                      ("SECOND", "plc-1st linked")]


# --- network namespaces: cables that are really pulled ------------------------------------------


def test_cable_of_primary(field, record, capsys):
    """The cable of the PRIMARY is pulled: no record INVALID, no put lost or applied twice."""
    ioc, (first, second), plant = field
    ioc.put("A:out0", 1)
    ioc.wait_value("A:rb0", 1)
    seen = record(ioc, *ALL, "A:BACKUP", "A:PRIMARY")
    before = len(received(first))
    pulled = time.time()
    plant.pull(0)
    value = 1
    while ioc.get("A:who") != 2 and time.time() < pulled + LIMIT:
        value += 1
        ioc.put(f"A:out{value % PUTS}", value)
    wanted = {value - i for i in range(min(PUTS, value - 1))}
    for v in wanted:
        ioc.wait_value(f"A:rb{v % PUTS}", v)
    blocks = received(second)
    assert len(blocks) == len(set(blocks)), "a block was sent twice"
    new = seen.first("A:who", 2)
    report(capsys, f"pulled, first new value after {(new - pulled) * 1000:.0f} ms, "
           f"{(new - log_time(second, 'PRIMARY:')) * 1000:.1f} ms after SECOND became PRIMARY; "
           f"{value - 1} puts meanwhile, {len(blocks)} blocks to SECOND")
    unlinked = seen.first("A:BACKUP", 1)
    plugged = time.time()
    plant.plug(0)
    linked = seen.first("A:BACKUP", 3, plugged)
    report(capsys, f"status: unlinked {(unlinked - pulled) * 1000:.0f} ms after the pull, "
           f"linked {(linked - plugged) * 1000:.0f} ms after the plug")
    for n in range(5):
        ioc.put("A:out0", 5000 + n)
        ioc.wait_value("A:rb0", 5000 + n)
    assert len(received(first)) == before, "the old PRIMARY got something more"
    assert ioc.text("A:PRIMARY") == "SECOND" and ioc.get("A:SWITCHOVERS") == 1
    assert not seen.invalid()


def test_cable_of_backup(field, record, capsys):
    """The cable of the BACKUP is pulled and plugged: the status follows, values do not care."""
    ioc, _, plant = field
    seen = record(ioc, *ALL, "A:BACKUP")
    delays = {2: [], 4: []}
    for n in range(4):
        for act, state in ((plant.pull, 2), (plant.plug, 4)):
            time.sleep(0.3 * n)  # another phase of the watch each time
            now = time.time()
            act(1)
            delays[state].append(seen.first("A:BACKUP", state, now) - now)
    report(capsys, f"status: unlinked at most {max(delays[2]) * 1000:.0f} ms after a pull, "
           f"linked at most {max(delays[4]) * 1000:.0f} ms after a plug")
    assert max(delays[2]) < 4 and max(delays[4]) < 4
    assert ioc.get("A:SWITCHOVERS") == 0 and not seen.invalid()


def test_dropped(field):
    """All packets of the PRIMARY are dropped, without RST: INVALID in time, and all well after."""
    ioc, _, plant = field
    plant.firewall(0, "-A", "INPUT", "-j", "DROP")
    plant.firewall(0, "-A", "OUTPUT", "-j", "DROP")
    ioc.wait_alarm("A:cnt", "INVALID", "COMM", "no PRIMARY")
    assert ioc.text("A:BACKUP") == "unknown" and ioc.text("A:PRIMARY") == "none"
    until_equal(lambda: ioc.text("A:CONNECTED1"), "not connected")
    ioc.put("A:out2", 77)
    plant.firewall(0, "-F")
    ioc.wait_alarm("A:cnt", "NO_ALARM")
    ioc.wait_value("A:rb2", 77)
    assert ioc.text("A:PRIMARY") == "FIRST" and ioc.get("A:SWITCHOVERS") == 0


def test_rejected(field, record):
    """The BACKUP refuses TCP but answers ping: it is unlinked, and linked when it takes it."""
    ioc, (_, second), plant = field
    seen = record(ioc, *ALL)
    plant.firewall(1, "-A", "INPUT", "-p", "tcp", "--dport", "2000", "-j", "REJECT",
                   "--reject-with", "tcp-reset")
    second.command("reset")
    until_equal(lambda: ioc.text("A:BACKUP"), "plc-2nd unlinked")
    until_equal(lambda: ioc.text("A:REACHABLE2"), "answers")
    plant.firewall(1, "-F")
    until_equal(lambda: ioc.text("A:BACKUP"), "plc-2nd linked")
    assert ioc.text("A:PRIMARY") == "FIRST" and not seen.invalid()


def test_never_answered(field):
    """A PLC that never answered ICMP echo though it takes connections is linked: TCP alone tells."""
    ioc, _, plant = field
    ioc.exit()
    plant.firewall(1, "-A", "INPUT", "-p", "icmp", "-j", "DROP")
    ioc.start()

    def unanswered():
        return int(re.search(r"^ *(\d+)", plant.firewall(1, "-nvxL", "INPUT").splitlines()[2])[1])

    until(lambda: unanswered() >= 20, "five questions have no answer")
    assert (ioc.text("A:BACKUP"), ioc.text("A:BACKUP_LINK")) == ("plc-2nd linked", "TCP, ICMP not known")
    assert ioc.text("A:REACHABLE2") == "not known"
    plant.firewall(1, "-A", "INPUT", "-p", "tcp", "--dport", "2000", "-j", "REJECT", "--reject-with", "tcp-reset")
    until_equal(lambda: ioc.text("A:BACKUP"), "plc-2nd unlinked")


def test_random_loss(field, record, capsys):
    """One packet in ten is lost: no switch-over, no record INVALID, every put arrives."""
    ioc, _, plant = field
    for i in (0, 1):
        plant.firewall(i, "-A", "INPUT", "-m", "statistic", "--mode", "random",
                       "--probability", "0.1", "-j", "DROP")
    seen = record(ioc, *ALL)
    for n in range(60):
        ioc.put(f"A:out{n % PUTS}", n)
        ioc.wait_value(f"A:rb{n % PUTS}", n)
    report(capsys, f"{len(seen.events['A:cnt'])} values, {len(seen.invalid())} of them INVALID")
    assert ioc.text("A:PRIMARY") == "FIRST" and ioc.get("A:SWITCHOVERS") == 0
    assert not seen.invalid()


def primary(halves):
    """The half that says that it is PRIMARY: 0 or 1; None while not exactly one does."""
    roles = ["role: PRIMARY" in half.command("status") for half in halves]
    return roles.index(True) if sum(roles) == 1 else None


def both(halves):
    """What the PLCs say."""
    return "\n".join(line for half in halves
                     for line in [half.command("status"), *half.lines[-9:]])


def test_random_episodes(field, record, capsys):
    """Random pulls, plugs, switch-overs and restarts: the right PRIMARY, every put, no INVALID."""
    ioc, halves, plant = field
    seed = int.from_bytes(os.urandom(4), "big")
    dice = random.Random(seed)
    seen = record(ioc, *ALL)
    story = []
    for n in range(EPISODES):
        leads = until(lambda: primary(halves) is not None and [primary(halves)],
                      "one PRIMARY")[0]
        act = dice.choice(["pull", "glitch", "backup", "switchover", "restart", "put"])
        story.append(f"{act} {leads + 1}")
        pulled = 1 - leads if act == "backup" else leads
        if act in ("pull", "glitch", "backup"):
            plant.pull(pulled)
            ioc.put(f"A:out{n % PUTS}", 1000 + n)
            if act == "glitch":
                time.sleep(dice.random() * 0.4)  # how long the cable is out
            elif act == "pull":
                until(lambda: primary(halves) == 1 - pulled, lambda: both(halves), 10)
            else:
                until_equal(lambda: ioc.text("A:BACKUP"), f"plc-{NTH[pulled]} unlinked")
            plant.plug(pulled)
        elif act == "switchover":
            halves[leads].command("switchover")
        elif act == "restart":
            halves[leads].command("restart")
        ioc.put(f"A:out{n % PUTS}", n)
        until(lambda: primary(halves) is not None and
              ioc.text("A:PRIMARY") == ("FIRST", "SECOND")[primary(halves)] and
              ioc.text("A:BACKUP") == f"plc-{NTH[1 - primary(halves)]} linked",
              lambda: f"seed {seed}: {story}: {ioc.text('A:PRIMARY')}, {ioc.text('A:BACKUP')}\n"
                      + both(halves) + ioc.log)
        ioc.wait_value(f"A:rb{n % PUTS}", n)
        assert not seen.invalid(), f"seed {seed}: {story}"
    report(capsys, f"seed {seed}: {' '.join(story)}; {ioc.get('A:SWITCHOVERS')} switch-overs")
