"""A PLC on TCP whose program is SCL, with the console of plcSim: tests use either one.

A thread calls the program each CYCLE seconds. `configuration` is a .plc file as plcSim reads
it, or the part of it that the handshake needs.
"""
import re
import struct
import threading
import time

from . import tables, texts
from .link import Link
from .machine import Machine

CYCLE = 0.002   # s, of OB1

UNITS = {"ms": 0.001, "s": 1, "min": 60, "us": 1e-6, "": 0.001, "h": 3600}
TYPES = {"INT16": ">h", "UINT16": ">H", "INT32": ">i", "UINT32": ">I", "REAL32": ">f",
         "INT8": ">b", "UINT8": ">B"}


class Configuration:
    """Keys and statements of a .plc file."""

    def __init__(self, text, options=()):
        self.keys, self.statements = {}, []
        for line in text.splitlines():
            line = line.split("#", 1)[0] if "P#" not in line else line
            words = line.split()
            if len(words) > 2 and words[1] == "=":
                self.keys[words[0]] = " ".join(words[2:])
            elif words:
                self.statements.append(words)
        for option in options:
            key, value = option.split("=", 1)
            self.keys[key] = value

    def number(self, key, default=0):
        return int(self.keys.get(key, str(default)), 0)

    def seconds(self, key, default):
        match = re.match(r"([\d.]+)\s*(\w*)$", self.keys.get(key, default))
        return float(match[1]) * UNITS[match[2]]

    def named(self, word):
        return [words for words in self.statements if words[0] == word]


class SclPlc:
    """As sim.Sim: port, lines, command(), close()."""

    def __init__(self, directory, text, *options):
        self.config = Configuration(text, options[1::2])
        self.lines, self.lock, self.hmi = [], threading.RLock(), {}
        self.remote = self.config.keys.get("mode") != "local"
        self.in_size, self.out_size = self.config.number("in"), self.config.number("out")
        self.off_until = None
        self.timed_out = False
        self.machine = self.make_machine()
        self.load()
        pair = self.config.keys.get("role") == "pair"
        first = self.config.keys.get("address", "127.0.0.1")
        self.links = [Link(self.out_size, first)]
        if pair:
            head, last = first.rsplit(".", 1)
            self.links.append(Link(self.out_size, f"{head}.{int(last) + 1}", self.links[0].port))
        self.port, self.primary = self.links[0].port, 0
        self.machine.link = self.links[0]
        self.ended = threading.Event()
        self.thread = threading.Thread(target=self.run, daemon=True)
        self.thread.start()

    # --- the program -----------------------------------------------------------------------

    def make_machine(self):
        """The document's program for this configuration."""
        text = texts.blocks("plc-programming.md")
        counters = [words for words in self.config.named("signal") if words[3] == "counter"]
        pointers = [words for words in self.config.named("tx") if words[1].startswith("P#DB10")]
        text = texts.fitted(
            text, self.in_size, self.out_size, points=int(pointers[0][3]),
            tx=[f"IE_TX.DD{words[1]} := SIGNALS.DD0" for words in counters])
        text = PLANT + text + INSTANCE
        sizes = {int(words[1]): int(words[2]) for words in self.config.named("db")}
        return Machine(text, texts.symbols(text), sizes)

    def load(self):
        """Cold: the initial values."""
        self.machine.cold()
        for words in self.config.named("init"):
            self.set(words[1:])

    def count_signal(self):
        signals = self.machine.dbs[texts.symbols(PLANT)["SIGNALS"]]
        struct.pack_into(">I", signals, 0, (struct.unpack(">I", signals)[0] + 1) & 0xffffffff)

    def call_program(self, link):
        self.count_signal()
        self.machine.call_block(
            "IE_COMMS", "IE_COMMS_DB", REMOTE=self.remote, CONNECTED=link.connected,
            LAYOUT=self.config.number("layout"), PERIOD=self.ms("period", "100 ms"),
            WATCHDOG=self.ms("watchdog", "3 s"))

    def restart_program(self, cold):
        """OB100."""
        if cold:
            self.load()
        for number in (1, 2):
            self.machine.dbs[number][:] = bytes(len(self.machine.dbs[number]))
        self.machine.put("IE_COMMS_DB.SYNC", False)
        self.machine.put("IE_COMMS_DB.TIMEOUT", False)

    def ms(self, key, default):
        return int(self.config.seconds(key, default) * 1000)

    # --- the cycle -------------------------------------------------------------------------

    def run(self):
        try:
            while not self.ended.wait(CYCLE):
                with self.lock:
                    self.cycle()
        except Exception as error:  # tests see it at their next command
            self.lines.append(f"the program stopped: {error!r}")
            raise

    def cycle(self):
        if self.off_until is not None:
            if time.monotonic() < self.off_until:
                return
            self.off_until = None
            for link in self.links:
                link.plug()
        self.machine.ms = int(time.monotonic() * 1000) & 0x7fffffff
        for link in self.links:
            link.step()
        for number, link in enumerate(self.links):
            if number != self.primary:
                while link.receive(self.out_size):
                    pass
        self.call_program(self.machine.link)
        self.log_watchdog()

    def log_watchdog(self):
        now = self.machine.get("IE_COMMS_DB.TIMEOUT")
        if now and not self.timed_out:
            self.lines.append("RECEIVE watchdog: no block from the IOC for "
                              f"{self.config.seconds('watchdog', '3 s'):g} s")
        self.timed_out = now

    def close(self):
        self.ended.set()
        self.thread.join()
        for link in self.links:
            link.close()

    # --- the console -----------------------------------------------------------------------

    def command(self, text):
        words = text.split()
        with self.lock:
            assert self.thread.is_alive(), "\n".join(self.lines)
            return getattr(self, "do_" + words[0])(*words[1:]) or ""

    def do_dump(self, place):
        memory = self.machine.dbs[int(place[2:])]
        return "\n".join(f"{at:4d}: {memory[at:at + 16].hex(' ')}"
                         for at in range(0, len(memory), 16))

    def do_status(self):
        get = self.machine.get
        return (f"sync: {'SYNC' if get('IE_COMMS_DB.SYNC') else 'none'}"
                f"{', TIMEOUT' if get('IE_COMMS_DB.TIMEOUT') else ''}")

    def do_received(self, count="1"):
        link = self.machine.link
        lines = [f"blocks {link.count} bytes {link.count * self.out_size}"]
        lines += [f"{number} {when:.6f} {block.hex(' ')}"
                  for number, when, block in link.history[-int(count):]]
        return "\n".join(lines)

    def do_hmi(self, *words):
        if words[0] in ("receive", "check"):
            self.hmi[words[0]] = words[1:]
            self.watch_moments()
        else:
            self.set(words)

    def watch_moments(self):
        """The HMI acts when AG_RECV has brought a block, or when CHECKSYNC has said yes."""
        self.machine.received = lambda: self.hmi_acts("receive")
        self.wrap("CHECKSYNC", lambda equal: equal and self.hmi_acts("check"))

    def hmi_acts(self, moment):
        words = self.hmi.pop(moment, None)
        if words:
            self.set(words)

    def wrap(self, function, after, result=None):
        """Something happens behind a function of the program."""
        space = self.machine.namespace
        plain = space.setdefault("plain_" + function, space["f_" + function])

        def wrapped(*arguments):
            value = plain(*arguments)
            after(value)
            return value if result is None else result
        space["f_" + function] = wrapped

    def unwrap(self, function):
        space = self.machine.namespace
        space["f_" + function] = space.get("plain_" + function, space["f_" + function])

    def set(self, words):
        """DB10.4 INT16 5, DB10.DBX6.2 1, DB10.8 STRING[8] bread"""
        block, rest = words[0].split(".", 1)
        memory = self.machine.dbs[int(block[2:])]
        if rest.startswith("DBX"):
            byte, bit = map(int, rest[3:].split("."))
            memory[byte] = memory[byte] & ~(1 << bit) | int(words[1]) << bit
        elif words[1].startswith("STRING"):
            size, at = int(words[1][7:-1]), int(rest)
            memory[at:at + size] = words[2].encode().ljust(size, b"\0")[:size]
        else:
            form = TYPES[words[1]]
            struct.pack_into(form, memory, int(rest),
                             float(words[2]) if form == ">f" else int(words[2], 0))

    def do_local(self):
        self.remote = False

    def do_remote(self):
        self.remote = True

    def do_refuse(self, what=None, off=None):
        if what == "sync" and off is None:
            self.wrap("CHECKSYNC", lambda equal: None, result=False)
        elif what == "sync":
            self.unwrap("CHECKSYNC")
            if self.hmi:
                self.watch_moments()
        else:
            self.machine.link.refuse(what != "off")

    def do_close(self):
        self.machine.link.drop()

    def do_reset(self):
        self.machine.link.drop(with_reset=True)

    def do_cut(self, count):
        self.machine.link.cut = int(count)

    def do_unplug(self):
        self.machine.link.unplug()

    def do_plug(self):
        self.machine.link.plug()

    def do_restart(self, cold=None):
        for link in self.links:
            link.close(with_reset=True)
        self.restart_program(cold == "cold")
        self.off_until = time.monotonic() + self.config.seconds("restarttime", "500 ms")

    def do_switchover(self):
        """The other CPU goes on, with the same memory, over its own connection."""
        self.primary = 1 - self.primary
        self.machine.link = self.links[self.primary]
        self.machine.link.data = b""
        self.machine.link.connected = False     # for one cycle: the program must see an end


class SclTablesPlc(SclPlc):
    """The same with the tables of docs/plc-tables.scl."""

    def make_machine(self):
        self.sizes = {int(words[1]): int(words[2]) for words in self.config.named("db")}
        self.allow_map = self.config.keys.get("allow_map", "on") == "on"
        counters = [words for words in self.config.named("signal") if words[3] == "counter"]
        text = texts.fitted_tables(
            (texts.DOCS / tables.SCL).read_text(), self.in_size, self.out_size,
            self.config.number("map_rows", 32),
            [self.allow(words) for words in self.config.named("allow")],
            tx=[f"IE_TX.DD{words[1]} := SIGNALS.DD0" for words in counters])
        text = PLANT + text
        return Machine(text, texts.symbols(text), self.sizes)

    def allow(self, words):
        """allow read|write DB10 [first bytes]"""
        number = 0 if words[2] == "M" else int(words[2][2:])
        size = self.sizes.get(number, 256)
        first, count = map(int, words[3:5]) if len(words) > 3 else (0, size)
        return number, first, count, words[1] == "write"

    def load(self):
        super().load()
        tx = [self.row(words[1:4], words[5:6], 1) for words in self.config.named("tx")]
        rx = [self.row(words[3:6], words[1:2], 2) for words in self.config.named("rx")]
        if tx or rx:
            self.preload(tables.table(self.config.number("layout"), tx, rx))

    def row(self, pointer, place, db):
        match = re.match(r"P#(?:DB(\d+)\.DBX|M)(\d+)\.0$", pointer[0])
        area = 0x84 if match[1] else 0x83
        foreign = tables.pointer(int(match[1] or 0), int(match[2]), int(pointer[2]), area)
        ours = tables.pointer(db, int(place[0]), int(pointer[2]))
        return foreign + ours if db == 1 else ours + foreign

    def preload(self, table):
        self.machine.dbs[20][:len(table)] = table
        self.machine.put("MAP.Active", 20)
        self.machine.put("MAP.Status.InUse", tables.crc_of(table))
        self.machine.put("MAP.Status.State", tables.ACTIVE)

    def call_program(self, link):
        self.count_signal()
        self.machine.call_block(
            "IE_COMMS", "IE_COMMS_DB", REMOTE=self.remote, CONNECTED=link.connected,
            ALLOW_MAP=self.allow_map, PERIOD=self.ms("period", "100 ms"),
            WATCHDOG=self.ms("watchdog", "3 s"))

    def restart_program(self, cold):
        if cold:
            self.load()
        for number in (1, 2):
            self.machine.dbs[number][:] = bytes(len(self.machine.dbs[number]))
        self.machine.call("OB100")

    def do_status(self):
        state, error, row, crc = struct.unpack_from(">BBBI", self.machine.dbs[22], 1)
        words = ["none", "loading", "checking", "active", "refused"]
        return (f"map: {words[state]}, error {error}, row {row}, CRC 0x{crc:08x}, "
                f"{'allowed' if self.allow_map else 'locked'}\n" + super().do_status())

    def do_allowmap(self, on="on"):
        self.allow_map = on != "off"


PLANT = """DATA_BLOCK SIGNALS                  // DB30
STRUCT Count : DWORD; END_STRUCT
BEGIN END_DATA_BLOCK
"""
INSTANCE = """DATA_BLOCK IE_COMMS_DB IE_COMMS     // DB31
BEGIN END_DATA_BLOCK
"""
