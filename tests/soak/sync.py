"""The sync handshake: an HMI and clients move the same setpoints, with puts that the PLC has to agree to."""
import time

from . import judge, wire
from .plan import Fault
from .world import IOC, PLC, WIRE, WRITE, World, record

POINTS = 3
SETPOINTS = 8 * POINTS  # bytes


class ProbeAndHeld(judge.ProbeFinder):
    """A probe, and behind it what the PLC holds."""

    def __init__(self):
        super().__init__(">", judge.PROBE + SETPOINTS)

    def what(self, number, data):
        return number, [int.from_bytes(data[judge.PROBE + i:judge.PROBE + i + 8], "big")
                        for i in range(0, SETPOINTS, 8)]


class Sync(World):
    NAME = "sync"
    TIMEOUT = 2.0
    OUTPUTS = POINTS
    PLC_TEXT = (f"in = {4 + judge.PROBE + SETPOINTS}\nout = {4 + SETPOINTS}\nperiod = 50 ms\nsync = on\n"
                f"layout = 77\nwatchdog = 1 s\ndb 10 {SETPOINTS} Setpoints\n"
                f"tx P#DB10.DBX0.0 BYTE {SETPOINTS} -> {4 + judge.PROBE}\n"
                f"rx 4 -> P#DB10.DBX0.0 BYTE {SETPOINTS}\n" + judge.signals(4))
    FAULTS = WIRE + PLC + IOC + [
        Fault("local", 4, 0.2, 2), Fault("hmi", 6, 0.2, 1.5), Fault("refuse sync", 2, 0.3, 2),
        Fault("silence", 3, 0.5, 4), Fault("plc resets", 2), Fault("unplug", 2, 0.5, 4)]
    OPTIONS = {"recvTimeout": ("2000", "1000"), "sendInterval": ("50", "1", "200"), "holdoff": ("0.2", "0", "20"),
               "heartbeat": ("300", "100", "500"), "minUpdate": ("0", "100")}
    LINKS = (("w", "INP", "@PLC/8 T=UINT32", "@PLC/12 T=UINT64"),)

    def __init__(self, *args, **kw):
        super().__init__(*args, **kw)
        self.held = judge.Held()
        self.accepted = {}

    def finders(self):
        return {wire.TO_IOC: ProbeAndHeld}

    def passed(self, way, what, passage, now):
        try:
            with self.lock:
                self.inputs.delivered(now, what[0])
                for record, value in enumerate(what[1], 1):
                    self.held.shows(record, value)
        except judge.Wrong as error:
            self.fail(error)

    def configure(self, dice):
        return (f's7plcConfigure("PLC", "127.0.0.1", {self.proxies[0].port}, {4 + judge.PROBE + SETPOINTS}, '
                f"{4 + SETPOINTS}, 1, 2000, 50)\ns7plcSetOption PLC sync on\ns7plcSetOption PLC layout 77\n"
                f"s7plcSetOption PLC readback {judge.PROBE}\ns7plcSetOption PLC heartbeat 300\n"
                f"s7plcSetOption PLC scan {dice.choice(('all', 'changed'))}\n")

    def database(self):
        stale = 'field(VAL, "4711") field(PINI, "YES")'  # as autosave brings it
        return (record("int64in", "n", "8 T=UINT32") + record("int64in", "w", "12 T=UINT64")
                + record("waveform", "a", "20 T=INT32", 'field(FTVL, "LONG") field(NELM, "8")')
                + record("int64in", "z", "64 T=UINT32")
                + "".join(record("int64out", f"o{i}", f"{8 * i - 4} T=INT64", stale)
                          for i in range(1, POINTS + 1)))

    def put(self, record):
        if record in self.pending:
            return
        with self.lock:
            value = self.held.new(record, "put")
        done = []
        self.pending[record] = (value & 0xFFFFFF, time.monotonic(), done, self.patience())
        self.pvs[f"o{record}"].put(float(value), wait=False, callback=lambda **kw: done.append(1))
        self.recorder.count("puts")

    def put_ended(self, record, number, value, severity, status):
        if severity and status == WRITE:
            self.held.refuse(number)
            self.recorder.count("puts refused")

    def hmi(self, dice):
        record = 1 + dice.randrange(POINTS)
        with self.lock:
            value = self.held.new(record, "HMI")
        self.console(f"hmi DB10.{8 * record - 8} UINT64 {value}")
        self.recorder.count("HMI changes")

    def act(self, dice):
        if dice.random() < 0.25:
            self.hmi(dice)
        else:
            super().act(dice)

    def plc_died(self):
        with self.lock:
            self.held.memory_lost()

    def outputs_settled(self):
        """Record and PLC hold the same, and a put passes."""
        for record in range(1, POINTS + 1):
            value, severity, status, *_ = self.ask(f"o{record}")
            if severity:
                if status == WRITE:
                    self.put(record)
                return f"o{record} has severity {severity}"
            with self.lock:
                put = judge.put_of(int(value))
                if (put[1] if put else 0) != self.held.last.get(record, 0):
                    return f"o{record} has {put}, the PLC {self.held.last.get(record)}"
        return None

    def held_at_rest(self, record):
        """A put now reaches the PLC."""
        over = self.patience()
        while not self.arrives(record, over):
            pass

    def arrives(self, record, over):
        """Puts, and waits until the PLC has it; true, too, where it was refused: settle has shown that puts pass. False:
        the handshake began anew before it had left, and the record shows what the PLC has instead."""
        self.put(record)
        number = self.pending[record][0]
        seen = len(self.sim.lines)
        while self.held.last.get(record) != number:
            self.check()
            self.completions()
            self.look_at_memory()
            if number in self.held.refused:
                return True
            if record not in self.pending and any("SYNC falls" in line for line in self.sim.lines[seen:]):
                value, severity, *_ = self.ask(f"o{record}")
                if not severity and int(value) != judge.setpoint(record, number):
                    self.recorder.count("puts given up with SYNC")
                    return False
            if over():
                raise judge.Wrong("lost", f"setpoint {record}: put {number} was accepted, the PLC holds "
                                          f"{self.held.last.get(record)} after {over.words()}")
            time.sleep(0.01)  # the pace of the looks
        return True

    def look_at_memory(self):  # hook
        """Asks the PLC what it has, where blocks do not show it."""

    def counts(self):
        super().counts()
        self.recorder.data["counts"]["setpoints judged"] = self.held.judged

    # --- Faults ---------------------------------------------------------------------------

    def _console(self, begin, end=None):
        self.console(begin)
        yield
        if end:
            self.console(end)

    def fault_local(self, dice, seconds):
        yield from self._console("local", "remote")

    def fault_hmi(self, dice, seconds):
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            self.hmi(dice)
            if self.answering():
                self.put(1 + dice.randrange(POINTS))
                self.completions()
            time.sleep(dice.uniform(0, 0.05))  # the pace of the HMI
        yield

    def fault_refuse_sync(self, dice, seconds):
        yield from self._console("refuse sync on", "refuse sync off")

    def fault_silence(self, dice, seconds):
        yield from self._console("silence on", "silence off")

    def fault_plc_resets(self, dice, seconds):
        yield from self._console("reset")

    def fault_unplug(self, dice, seconds):
        yield from self._console("unplug", "plug")

    def normal(self):
        super().normal()
        for command in ("plug", "remote", "refuse sync off"):
            self.console(command)
