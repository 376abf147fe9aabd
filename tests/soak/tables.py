"""Tables of pointers: each IOC brings another one to the PLC, which must work with it, and with it alone."""
from . import judge, plan, wire
from .plan import Fault
from .sync import POINTS, SETPOINTS, Sync
from .world import IOC, PLC, WIRE, record

OUT = 4 + SETPOINTS + 16  # bytes
MIRROR = 12 + OUT         # the end of what the PLC shows of it
IN = MIRROR + 64 + 40
GUARD = 0x77


class Tables(Sync):
    """Setpoint i is bytes 8 (i - 1) of DB10 whatever the table; where it lies in the blocks, each table says."""

    NAME = "tables"
    LIFE = 3
    PLC_TEXT = (f"in = {IN}\nout = {OUT}\nperiod = 50 ms\nsync = on\nmap = on\nmap_rows = 32\nlayout = 1\n"
                f"watchdog = 1 s\nrestarttime = 200 ms\ndb 10 {SETPOINTS + 8}\ndb 11 64\n"
                f"init DB10.{SETPOINTS} UINT8 {GUARD}\nallow write DB10\nallow read DB11\n"
                + judge.signals(0, "DB11."))
    FAULTS = WIRE + PLC + [f for f in IOC if f.name != "links"] + [Fault("exit", 6), 
        Fault("local", 2, 0.2, 2), Fault("hmi", 4, 0.2, 1.5), Fault("silence", 2, 0.5, 4),
        Fault("plc resets", 2), Fault("key", 3, 0.2, 2)]

    def finders(self):
        return {wire.TO_IOC: lambda: judge.ProbeFinder(self.ORDER)}

    def passed(self, way, what, passage, now):
        with self.lock:
            self.inputs.delivered(now, what)

    def turn(self, dice):
        super().turn(dice)
        self.look_at_memory()

    def look_at_memory(self):
        """The PLC's memory, asked from itself."""
        answer = self.console("dump DB10")
        if not answer:
            return
        data = bytes.fromhex("".join(line.split(":", 1)[1] for line in answer.splitlines()))
        with self.lock:
            for record in range(1, POINTS + 1):
                self.held.shows(record, int.from_bytes(data[8 * record - 8:8 * record], "big"))
        if data[SETPOINTS] != GUARD or any(data[SETPOINTS + 1:]):
            raise judge.Wrong("wrong", f"memory that no table has was written: {data[SETPOINTS:].hex()}")

    def configure(self, dice):
        self.order = dice.sample(range(POINTS), POINTS)  # setpoint i is the order[i]-th in the blocks
        self.probe_at = MIRROR + 8 * dice.randrange(6)
        rows = "".join(f"tx P#DB10.DBX{8 * i}.0 BYTE 8 -> {16 + 8 * at}\n" for i, at in enumerate(self.order))
        rows += f"tx P#DB11.DBX0.0 BYTE 64 -> {self.probe_at}\n"
        rows += "".join(f"rx {4 + 8 * at} -> P#DB10.DBX{8 * i}.0 BYTE 8\n" for i, at in enumerate(self.order))
        file = self.directory / "table.ptr"
        file.write_text(f"layout {100 + dice.randrange(60000)}\n{rows}")
        return (f's7plcConfigure("PLC", "127.0.0.1", {self.proxies[0].port}, {IN}, {OUT}, 1, 2000, 50)\n'
                "s7plcSetOption PLC sync on\ns7plcSetOption PLC readback 12\ns7plcSetOption PLC map download\n"
                f's7plcSetOption PLC heartbeat 300\ns7plcTables PLC "{file}"\n')

    def database(self):
        at = self.probe_at
        return (record("int64in", "n", f"{at + 4} T=UINT32") + record("int64in", "w", f"{at + 8} T=UINT64")
                + record("waveform", "a", f"{at + 16} T=INT32", 'field(FTVL, "LONG") field(NELM, "8")')
                + record("int64in", "z", f"{at + 60} T=UINT32")
                + "".join(record("int64out", f"o{i + 1}", f"{4 + 8 * place} T=INT64",
                                 'field(VAL, "4711") field(PINI, "YES")')
                          for i, place in enumerate(self.order)))

    def settled(self):
        self.look_at_memory()
        return super().settled()

    def fault_key(self, dice, seconds):
        yield from self._console("allowmap off", "allowmap on")

    def normal(self):
        super().normal()
        self.console("allowmap on")
