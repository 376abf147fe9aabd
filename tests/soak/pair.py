"""A redundant pair: phoenixplcConfigure against plcSim's pair. Records see one PLC, whichever leads."""
import time

import client

from . import judge, wire
from .blocks import OUT, Frames
from .plan import Fault
from .sim import PairSim
from .world import IOC, PLC, WIRE, World, record

SECOND = "127.0.0.2"  # where the proxy of SECOND listens


class Pair(World):
    NAME = "pair"
    PROGRAM = "phoenixIoc"
    TIMEOUT = 2.0
    INPUTS = ("n", "w", "a", "z")
    PLC_TEXT = (f"role = pair\naddress = 127.0.0.1\nsecond = 127.0.0.2\nin = 96\nout = {OUT}\nperiod = 50 ms\n"
                "switchover = 250 ms\n" + judge.signals())
    FAULTS = [f for f in WIRE + IOC if f.name != "options"] + [
        Fault("restart", 3, 0.1, 2), Fault("kill", 1, 0.1, 2), Fault("options", 3, 0.2, 2),
        Fault("switchover", 8, 0.2, 1), Fault("two primaries", 3, 0.2, 2), Fault("unplug", 6, 0.2, 3),
        Fault("restart one", 5, 0.2, 2), Fault("first silent", 3, 0.2, 3), Fault("to and fro", 2, 0.5, 2)]
    OPTIONS = {"sendInterval": ("50", "1", "200"), "holdoff": ("0.2", "0", "20"), "heartbeat": ("0", "300"),
               "pingPeriod": ("1000", "0", "100"), "minUpdate": ("0", "100")}
    LINKS = (("w", "INP", "@PLC/4 T=UINT32", "@PLC/8 T=UINT64"),)

    def __init__(self, *args, **kw):
        super().__init__(*args, **kw)
        self.got_by = [{}, {}]  # of FIRST, SECOND: record -> number
        self.leads = 0
        self.judge_gaps = False
        self.blind_until = 0.0
        self.unjudged = 0  # faults in force in which records may go INVALID

    def new_sim(self):
        return PairSim(self.directory, self.PLC_TEXT)

    def target(self, proxy):
        which = self.proxies.index(proxy)
        return f"127.0.0.{which + 1}", self.sim.ports[which]

    def begin_proxies(self):
        for _ in range(50):  # the same port on both addresses
            port = client.free_port()
            try:
                self.new_proxy(port=port)
                self.new_proxy(port=port, address=SECOND)
                return
            except OSError:
                for proxy in self.proxies:
                    proxy.close()
                self.proxies.clear()
        raise AssertionError("no port that is free on both addresses")

    def finders(self):
        return {wire.TO_IOC: lambda: judge.ProbeFinder(self.ORDER), wire.TO_PLC: lambda: Frames(OUT)}

    def connection_ended(self, now):
        """Data stays valid for recvTimeout: the other PLC may take over."""

    def plc_got(self, block, passage, now):
        which = self.proxies.index(passage.proxy)
        own = self.got_by[which]
        for record, at in enumerate((0, 8, 16), 1):
            put = judge.put_of(int.from_bytes(block[at:at + 8], "big"))
            if put is None:
                continue
            if put[0] != record or put[1] > self.outputs.number:
                raise judge.Wrong("wrong", f"output {record}: {put}")
            if put[1] < own.get(record, 0):
                raise judge.Wrong("doubled", f"output {record}: PLC {which + 1} got put {put[1]} after {own[record]}")
            own[record] = put[1]
            if put[1] > self.outputs.last.get(record, 0):
                self.outputs.got(record, put[1], passage.number, now)
            self.outputs.judged += 1

    def configure(self, dice):
        return (f'phoenixplcConfigure(PLC, "127.0.0.1,{SECOND}", {self.proxies[0].port}, 96, {OUT}, 1, 2000, 50, 1)\n'
                f"s7plcSetOption PLC scan {dice.choice(('all', 'changed'))}\n")

    def database(self):
        def status(kind, name):
            return (f'record({kind}, "$(P){name}") {{ field(DTYP, "phoenixplc") field(INP, "@PLC/{name}") '
                    'field(SCAN, "I/O Intr") }\n')
        return (record("int64in", "n", "4 T=UINT32") + record("int64in", "w", "8 T=UINT64")
                + record("waveform", "a", "16 T=INT32", 'field(FTVL, "LONG") field(NELM, "8")')
                + record("int64in", "z", "60 T=UINT32")
                + "".join(record("int64out", f"o{i}", f"{8 * i - 8} T=INT64") for i in range(1, 4))
                + status("longin", "primary") + status("longin", "switchovers") + status("ai", "lastSwitchDuration"))

    def inputs_of_client(self):
        return [*self.INPUTS, "primary"]

    def watched(self):
        return ["n", "a", "z", "primary", "lastSwitchDuration"]

    def start_ioc(self):
        self.seen_valid = False
        super().start_ioc()

    def heard(self):
        for name, value, _, _ in list(self.events):
            if name == "lastSwitchDuration" and value and value > 0:
                self.recorder.figure("switch-over", self.fault or "several", value / 1000)
        super().heard()

    def watch(self, name, severity, at, value):
        """No record goes INVALID over a switch-over within recvTimeout."""
        if name == self.INPUTS[0]:
            if severity == 0:
                self.seen_valid = True
            elif self.seen_valid and not self.stopped and at > self.blind_until:
                self.judge_gap(at)
                self.seen_valid = False
        super().watch(name, severity, at, value)

    def judge_gap(self, at):
        slack = self.pulse.slack()
        times = [t for t in list(self.inputs.times)[-200:] if t <= at] + [at]
        longest = max((b - a for a, b in zip(times, times[1:]) if b > at - self.TIMEOUT - slack), default=9)
        if slack < 1 and longest < self.TIMEOUT / 2:
            raise judge.Wrong("wrong", f"records went INVALID, and blocks came all the time (gap {longest:.2f} s)")

    def _unjudged(self, fault):
        """In this one, and a while after, records may go INVALID; others may overlap with it."""
        self.unjudged += 1
        self.blind_until = float("inf")
        yield from fault
        self.unjudged -= 1
        if not self.unjudged:
            self.blind_until = time.monotonic() + self.TIMEOUT

    def fault_stop(self, dice, seconds):
        yield from self._unjudged(super().fault_stop(dice, seconds))

    def fault_pause(self, dice, seconds):
        yield from self._unjudged(super().fault_pause(dice, seconds))

    def fault_trickle(self, dice, seconds):
        """Pieces that come slowly look like blocks of another size."""
        yield from self._unjudged(super().fault_trickle(dice, seconds))

    def fault_pieces(self, dice, seconds):
        yield from self._unjudged(super().fault_pieces(dice, seconds))

    def leading(self):
        """A BACKUP is silent in any case: that its connection is half-open nobody can know."""
        leads = int(self.ask("primary")[0])
        return [self.proxies[leads - 1]] if leads in (1, 2) else []

    def settled(self):
        last = super().settled()
        if last is None:
            self.leads = int(self.ask("primary")[0])
            if self.leads not in (1, 2):
                return f"PRIMARY is {self.leads}"
            for record in range(1, self.OUTPUTS + 1):
                wanted = self.outputs.puts.get(record, [None])[-1]
                has = self.got_by[self.leads - 1].get(record)
                if wanted is not None and has != wanted:
                    return f"output {record}: put {wanted} was the last, PLC {self.leads} has {has}"
        return last

    # --- Faults ---------------------------------------------------------------------------

    def _console(self, begin, end=None):
        self.console(begin)
        yield
        if end:
            self.console(end)

    def fault_switchover(self, dice, seconds):
        yield from self._console("switchover")

    def fault_to_and_fro(self, dice, seconds):
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            self.console("switchover")
            self.work(dice, time.monotonic() + dice.uniform(0, 0.3))
        yield

    def fault_two_primaries(self, dice, seconds):
        yield from self._console("twoprimaries on", "twoprimaries off")

    def fault_unplug(self, dice, seconds):
        which = dice.choice((1, 2))
        yield from self._console(f"unplug {which}", f"plug {which}")

    def fault_restart_one(self, dice, seconds):
        yield from self._console(f"restart {dice.choice((1, 2))} {int(seconds * 1000)}")

    def fault_restart(self, dice, seconds):
        self.console(f"restart 1 {int(seconds * 1000)}")
        yield from self._console(f"restart 2 {int(seconds * 1000)}")

    def fault_first_silent(self, dice, seconds):
        which = dice.choice(("first", "second"))
        yield from self._console(f"{which} silence on", f"{which} silence off")

    def normal(self):
        for proxy in self.proxies:
            proxy.refuse(False)
            proxy.normal()
        for command in ("first normal", "second normal", "twoprimaries off", "plug 1", "plug 2"):
            self.console(command)

    def fault_refuse(self, dice, seconds):
        chosen = self.some(dice)
        for proxy in chosen:
            proxy.refuse(True)
            proxy.end_all()
        yield
        for proxy in chosen:
            proxy.refuse(False)
