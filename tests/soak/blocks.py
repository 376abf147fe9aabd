"""Blocks over TCP: s7plcConfigure against plcSim."""
import time

from . import judge, wire
from .plan import Fault
from .world import IOC, PLC, WIRE, World, record

OUT = 32  # bytes: 3 setpoints, then a word of bits


class Frames:
    """Blocks of fixed size from the beginning of a connection."""

    def __init__(self, size):
        self.size, self.held = size, b""

    def feed(self, data):
        self.held += data
        found = []
        while len(self.held) >= self.size:
            found.append(self.held[:self.size])
            self.held = self.held[self.size:]
        return found


class Edges:
    """A bit that is put to and fro: the PLC sees each edge while the connection holds."""

    def __init__(self):
        self.put = self.seen = self.value = self.last = 0
        self.losses = None

    def next(self):
        self.value ^= 1
        self.put += 1
        return self.value

    def got(self, bit):
        if bit != self.last:
            self.last = bit
            self.seen += 1

    def settled(self):
        return self.last == self.value

    def quiet(self, losses):
        """All is well; losses: connections lost so far."""
        if self.losses == losses and self.seen != self.put:
            raise judge.Wrong("lost", f"{self.put} edges of a bit were put, the PLC saw {self.seen}")
        self.put = self.seen = 0
        self.losses = losses


# Blocks that begin elsewhere than they did are found out by the quiet between them, and not when bytes of one
# block do not arrive together, or there is no quiet (docs/architecture.md).
SLIPS = {"slip", "truncate", "garbage"}
NO_QUIET = {"pieces", "trickle", "fragment", "fast", "hold", "hold in", "delay", "stop"}


class Blocks(World):
    NAME = "blocks"
    APART = ((SLIPS, NO_QUIET), (SLIPS, SLIPS))
    TIMEOUT = 2.0
    INPUTS = ("n", "w", "a", "z")
    FAULTS = WIRE + PLC + IOC + [
        Fault("slip", 4, 0.5, 2), Fault("silence", 3, 0.5, 4), Fault("plc closes", 2), Fault("plc resets", 2),
        Fault("unplug", 2, 0.5, 4), Fault("truncate", 2, 0.5, 2), Fault("garbage", 2), Fault("fast", 2, 0.3, 1),
        Fault("freeze", 2, 0.5, 3), Fault("fragment", 2, 0.5, 2), Fault("stall", 2, 0.5, 3),
        Fault("plc cuts", 2)]
    PLC_TEXT = (f"in = 96\nout = {OUT}\nperiod = 50 ms\nrcvbuf = 2048\n" + judge.signals())
    OPTIONS = {"recvTimeout": ("2000", "1000", "1500"), "sendInterval": ("50", "1", "200"),
               "holdoff": ("0.2", "0", "20"), "heartbeat": ("0", "300", "20"), "minUpdate": ("0", "100", "300"),
               "alive": ("off", "4,UINT32"), "aliveTimeout": ("1000", "500"), "log": ("info", "error")}
    LINKS = (("w", "INP", "@PLC/4 T=UINT32", "@PLC/8 T=UINT64"),
             ("w", "INP", "@PLC/200 T=UINT64", "@PLC/8 T=UINT64"),
             ("w", "INP", "@NOBODY/8", "@PLC/8 T=UINT64"))

    def __init__(self, *args, **kw):
        super().__init__(*args, **kw)
        self.edges = Edges()
        self.whole = False

    def finders(self):
        return {wire.TO_IOC: lambda: judge.ProbeFinder(self.ORDER), wire.TO_PLC: lambda: Frames(OUT)}

    def configure(self, dice):
        self.edges = Edges()
        self.whole = dice.random() < 0.5
        options = {"scan": dice.choice(("all", "changed")), "wholeBlock": "on" if self.whole else "off",
                   "scanThread": dice.choice(("own", "callback")), "aliveTimeout": "1000"}
        return (f's7plcConfigure("PLC", "127.0.0.1", {self.proxies[0].port}, 96, {OUT}, 1, 2000, 50)\n'
                + "".join(f"s7plcSetOption PLC {key} {value}\n" for key, value in options.items()))

    def database(self):
        return (record("int64in", "n", "4 T=UINT32") + record("int64in", "w", "8 T=UINT64")
                + record("waveform", "a", "16 T=INT32", 'field(FTVL, "LONG") field(NELM, "8")')
                + record("int64in", "z", "60 T=UINT32", 'field(PHAS, "1") field(FLNK, "$(P)t")')
                + 'record(calc, "$(P)t") { field(INPA, "$(P)n MS") field(INPB, "$(P)z MS") field(CALC, "A#B") }\n'
                + "".join(record("int64out", f"o{i}", f"{8 * i - 8} T=INT64") for i in range(1, 4))
                + record("bo", "b", "24 T=UINT16 B=3"))

    def inputs_of_client(self):
        return [*self.INPUTS, "t"]

    def outputs_of_client(self):
        return [*super().outputs_of_client(), "b"]

    def watched(self):
        return ["n", "a", "z", "t"]

    def plc_got(self, block, passage, now):
        self.outputs.got_block([int.from_bytes(block[i:i + 8], "big") for i in (0, 8, 16)], passage.number, now)
        if block[24] | block[25] & ~8 | any(block[26:]):
            raise judge.Wrong("wrong", f"bytes that nobody wrote: {block[24:].hex()}")
        self.edges.got(block[25] >> 3 & 1)

    def heard(self):
        for name, value, severity, *_ in list(self.events):
            if name == "t" and value and self.whole and not severity:
                raise judge.Wrong("torn", "wholeBlock=on, and one pass saw two blocks")
        super().heard()

    def put_bit(self, value):
        done = []
        self.pending["b"] = (self.edges.put, time.monotonic(), done, self.patience())
        self.pvs["b"].put(value, wait=False, callback=lambda **kw: done.append(1))

    def put_again(self, record):
        if record == "b":
            self.put_bit(self.edges.value)
        else:
            super().put_again(record)

    def act(self, dice):
        if dice.random() < 0.3 and "b" not in self.pending:
            with self.lock:
                value = self.edges.next()
            self.put_bit(value)
        else:
            super().act(dice)

    def completions(self):
        if "b" in self.pending and self.pending["b"][2]:
            del self.pending["b"]
        super().completions()

    def outputs_settled(self):
        if not self.edges.settled():
            return f"bit {self.edges.value} was the last, the PLC has {self.edges.last}"
        return super().outputs_settled()

    def held_at_rest(self, record):
        super().held_at_rest(record)
        if record == 1:
            with self.lock:
                self.edges.quiet((self.losses, self.lives))

    # --- Faults of the PLC ----------------------------------------------------------------

    def _console(self, begin, end=None):
        self.console(begin)
        yield
        if end:
            self.console(end)

    def fault_silence(self, dice, seconds):
        yield from self._console("silence on", "silence off")

    def fault_plc_closes(self, dice, seconds):
        yield from self._console("close")

    def fault_plc_resets(self, dice, seconds):
        yield from self._console("reset")

    def fault_unplug(self, dice, seconds):
        yield from self._console("unplug", "plug")

    def fault_truncate(self, dice, seconds):
        yield from self._console(f"truncate {dice.choice((40, 64, 90, 95, 97, 100, 150))}", "truncate off")

    def fault_garbage(self, dice, seconds):
        count = dice.randint(1, 300)  # of just the size of a block nobody can tell it from one
        yield from self._console(f"garbage {count + (count % 96 == 0)}")

    def fault_fast(self, dice, seconds):
        yield from self._console("period 2", "period 50")

    def fault_freeze(self, dice, seconds):
        yield from self._console("freeze heartbeat", "unfreeze")

    def fault_fragment(self, dice, seconds):
        yield from self._console(f"fragment {dice.randint(1, 60)} {dice.randint(0, 5)}", "fragment off")

    def fault_stall(self, dice, seconds):
        yield from self._console("stall on", "stall off")

    def fault_plc_cuts(self, dice, seconds):
        yield from self._console(f"cut {dice.randint(1, 90)}", "cut off")
