"""EtherNet/IP: drvEtherIP_define_PLC against plcSim. Each put is acknowledged; outputs follow what the PLC holds."""

import functools

from . import judge
from .plan import Fault
from .world import IOC, PLC, WIRE, World
from .world import record as world_record

TAGS = 3


class EtherIp(World):
    NAME = "etherip"
    ORDER = "<"
    ACKNOWLEDGED = True
    ONE_CLIENT = False
    TIMEOUT = 2.6
    REQUEST_TIMEOUT = 500  # ms
    INPUTS = ("n", "a", "z")
    PLC_TEXT = ("in = 64\nperiod = 50 ms\nbyteorder = little\netherip_port = 0\n" + judge.signals() +
                "tag Probe DINT[16] -> in.0\n" + "".join(f"tag S{i} LINT\n" for i in range(1, TAGS + 1)))
    FAULTS = WIRE + PLC + IOC + [
        Fault("refusals", 4, 0.5, 3), Fault("slow", 3, 0.5, 3), Fault("silent", 3, 0.3, 2),
        Fault("bad answers", 5, 0.2, 1), Fault("sessions end", 3), Fault("download", 3, 0.2, 2),
        Fault("key", 2, 0.5, 2)]
    OPTIONS = {"requestTimeout": ("500", "300", "900"), "holdoff": ("0.2", "0", "20")}
    LINKS = (("n", "INP", "@PLC Probe[2] S 0.05", "@PLC Probe[1] S 0.05"),
             ("z", "INP", "@PLC Nobody S 0.05", "@PLC Probe[15] S 0.05"))

    def __init__(self, *args, **kw):
        super().__init__(*args, **kw)
        self.put_at = {}  # record -> which connection there was, or was to come, when it was put

    def target(self, proxy):
        return "127.0.0.1", self.sim.etherip_port

    def connection_ended(self, now):
        """Judged by the age of values."""

    def configure(self, dice):
        options = {"requestTimeout": str(self.REQUEST_TIMEOUT), "complete": dice.choice(("acknowledged", "sent"))}
        self.acknowledged = options["complete"] == "acknowledged"
        size = dice.choice(("4002", "500"))
        return (f'etheripConfigure PLC, "127.0.0.1:{self.proxies[0].port}", 0, "size={size}"\n'
                + "".join(f"s7plcSetOption PLC {k} {v}\n" for k, v in options.items()))

    def database(self):
        record = functools.partial(world_record, dtyp="EtherIP", plc="@PLC ")
        return (record("int64in", "n", "Probe[1] S 0.05")
                + record("waveform", "a", "Probe S 0.05", 'field(FTVL, "LONG") field(NELM, "16")')
                + record("int64in", "z", "Probe[15] S 0.05")
                + "".join(record("int64out", f"o{i}", f"S{i} S 0.1") for i in range(1, TAGS + 1)))

    def array(self, value):
        """The elements of the probe that are the block's number."""
        return [value[i] for i in (1, *range(4, 12), 15)]

    def put(self, record):
        if record not in self.pending:
            self.put_at[record] = self.connection()
        super().put(record)

    def connection(self):
        """Another one begins: outputs take what the PLC has, and what was put while there was none is void."""
        return self.losses, self.lives, sum(proxy.count for proxy in self.proxies)

    def put_ended(self, record, number, value, severity, status):
        if severity or value != judge.setpoint(record, number):  # refused; or the PLC was away, its value counts
            self.put_at[record] = None
        super().put_ended(record, number, value, severity, status)

    def outputs_settled(self):
        """Record and PLC agree; on the last put, unless the PLC was away since, or said no."""
        for record in range(1, TAGS + 1):
            value, severity, *_ = self.ask(f"o{record}")
            if severity:
                self.put(record)  # what was refused is not tried again by itself
                return f"o{record} has severity {severity}"
            wanted = self.outputs.puts[record][-1]
            put = judge.put_of(int(value))
            if not put or put[1] != wanted:
                if self.put_at.get(record) == self.connection():
                    return f"o{record} has {put}, put {wanted} was the last, the PLC has {judge.put_of(self.held(record))}"
                has = judge.put_of(self.held(record))
                self.put(record)
                return f"o{record} has {put}, the PLC {has}"
            if self.outputs.last.get(record) != wanted:
                return f"output {record}: put {wanted} was the last, the PLC has {self.outputs.last.get(record)}"
        return None

    held_at_rest = World.held_as_asked

    def held(self, record):  # hook
        return int(self.console(f"etherip get S{record}").split("=")[-1])

    def plc_died(self):
        self.put_at.clear()

    def normal(self):
        super().normal()
        self.console("etherip normal")
        self.console("etherip key remote")

    # --- Faults ---------------------------------------------------------------------------

    def _console(self, *commands):
        for command in commands:
            self.console(command)
        yield
        self.console("etherip normal")

    def fault_refusals(self, dice, seconds):
        self.outputs.refusing = True
        yield from self._console(f"etherip status {dice.choice(('05', '0F', 'FF 2107', '02'))} "
                                 f"{dice.choice(('write', 'tag S1', 'tag Probe', 'tag S2 write next 2'))}")

    def fault_slow(self, dice, seconds):
        yield from self._console(f"etherip slow {dice.randint(1, 700)}")

    def fault_silent(self, dice, seconds):
        yield from self._console(f"etherip silent {dice.choice(('', 'write', 'read', 'next 1'))}")

    def fault_bad_answers(self, dice, seconds):
        self.outputs.refusing = True
        yield from self._console("etherip " + dice.choice(
            ("drop", f"short {dice.randint(1, 40)}", f"short {dice.randint(1, 40)} close", "wrongcontext",
             "wrongsession", "wrongsequence", "wrongid", "wrongservice", f"garbage {dice.randint(1, 60)}",
             f"length {dice.randint(1, 30)}", "close")) + f" next {dice.randint(1, 4)}")

    def fault_sessions_end(self, dice, seconds):
        self.outputs.refusing = True  # what a forgotten connection has brought comes again by a new one
        yield from self._console(f"etherip {dice.choice(('timeout', 'close', 'reset'))}")

    def fault_download(self, dice, seconds):
        yield from self._console("etherip download")

    def fault_key(self, dice, seconds):
        self.outputs.refusing = True
        self.console("etherip key run")
        yield
        self.console("etherip key remote")
