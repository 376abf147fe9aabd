"""Modbus/TCP: modbusplcConfigure against plcSim. Every put is acknowledged, and leaves once a connection."""
from . import judge
from .plan import Fault
from .world import IOC, PLC, WIRE, WRITE, World, record


class Modbus(World):
    NAME = "modbus"
    ACKNOWLEDGED = True
    ONE_CLIENT = False
    TIMEOUT = 2.2  # shortest period, two requestTimeouts of 0.5 s, 1 s
    INPUTS = ("n", "w", "a", "z")
    PLC_TEXT = ("in = 64\nperiod = 50 ms\nmodbus_port = 0\n" + judge.signals() +
                "db 10 64\nmodbus input 0 32 -> in.0\nmodbus holding 0 32 -> DB10.0\n")
    FAULTS = WIRE + PLC + IOC + [
        Fault("refusals", 4, 0.5, 3), Fault("busy", 3), Fault("slow", 3, 0.5, 3), Fault("silent", 3, 0.3, 2),
        Fault("bad answers", 4, 0.2, 1), Fault("plc closes", 2), Fault("plc resets", 2)]
    OPTIONS = {"requestTimeout": ("500", "300", "900"), "holdoff": ("0.2", "0", "20"),
               "readPeriod": ("1000", "100", "0"), "maxRegisters": ("125", "32"),
               "writes": ("newest", "all"), "requestPause": ("0", "10")}
    LINKS = (("w", "INP", "@PLC/4 T=UINT32", "@PLC/8 T=UINT64"),
             ("w", "INP", "@PLC/200 T=UINT64", "@PLC/8 T=UINT64"))

    def target(self, proxy):
        return "127.0.0.1", self.sim.modbus_port

    def connection_ended(self, now):
        """A device may hang up when nobody asks: that alone is no alarm."""

    def configure(self, dice):
        options = {"scan": dice.choice(("all", "changed")), "writes": dice.choice(("newest", "all")),
                   "scanThread": dice.choice(("own", "callback")),
                   "complete": dice.choice(("acknowledged", "acknowledged", "sent"))}
        self.acknowledged = options["complete"] == "acknowledged"
        return (f'modbusplcConfigure PLC, 127.0.0.1, {self.proxies[0].port}, 1, "input 0 32 every 50", '
                '"holding 0 12", 500\n' + "".join(f"s7plcSetOption PLC {k} {v}\n" for k, v in options.items()))

    def database(self):
        return (record("int64in", "n", "4 T=UINT32") + record("int64in", "w", "8 T=UINT64")
                + record("waveform", "a", "16 T=INT32", 'field(FTVL, "LONG") field(NELM, "8")')
                + record("int64in", "z", "60 T=UINT32")
                + "".join(record("int64out", f"o{i}", f"{8 * i - 8} T=INT64") for i in range(1, 4)))

    given_up = frozenset()  # records with a write that was, in this episode

    held_at_rest = World.held_as_asked

    def held(self, record):  # hook
        return int(self.console(f"get DB10.{8 * record - 8} UINT64").split("=")[-1])

    def normal(self):
        super().normal()
        self.given_up = set()
        if self.outputs.refusing:  # what was refused is not tried again by itself
            for record in range(1, self.OUTPUTS + 1):
                self.put_once_more(record)

    def outputs_settled(self):
        """A write that is not answered twice is given up: its record says so until the next put, which people make."""
        for record in range(1, self.OUTPUTS + 1):
            _, severity, status, *_ = self.ask(f"o{record}")
            if severity and status == WRITE and record not in self.given_up and not self.holds(record):
                self.given_up.add(record)
                self.put_once_more(record)
        return super().outputs_settled()

    def holds(self, record):
        """The PLC has what was put last."""
        wanted = self.outputs.puts.get(record)
        return not wanted or self.held(record) == judge.setpoint(record, wanted[-1])

    def put_once_more(self, record):
        while record in self.pending:
            self.completions()
            self.check()
        self.put(record)

    def _console(self, *commands):
        for command in commands:
            self.console(command)
        yield
        self.console("modbus normal")

    def fault_refusals(self, dice, seconds):
        self.outputs.refusing = True
        # 2, 3 and 4 make the IOC read in pieces: then the judge does not see whole probes
        yield from self._console("modbus exception " + dice.choice(
            ("1 write", "2 write", "3 holding 4 4 write", "4 write", "6 write", "11 write", "1 read", "6 read",
             "11 input", "2 holding 4 4 write", "3 write next 2")))

    def fault_busy(self, dice, seconds):
        self.outputs.refusing = True
        yield from self._console(f"modbus busy {dice.randint(1, 20)}")

    def fault_slow(self, dice, seconds):
        yield from self._console(f"modbus slow {dice.randint(1, 700)}")

    def fault_silent(self, dice, seconds):
        yield from self._console(f"modbus silent {dice.choice(('', 'write', 'read', 'next 1'))}")

    def fault_bad_answers(self, dice, seconds):
        yield from self._console("modbus " + dice.choice(
            ("wrongunit", "wrongid", f"short {dice.randint(1, 12)}", f"short {dice.randint(1, 12)} close",
             "close reply", f"garbage {dice.randint(1, 60)}")) + f" next {dice.randint(1, 5)}")

    def fault_plc_closes(self, dice, seconds):
        yield from self._console("modbus close")

    def fault_plc_resets(self, dice, seconds):
        yield from self._console("modbus reset")
