"""A PLC whose program is the SCL that plcmap generates, run by the interpreter of tests/scl, with
as much of plcSim's console as `plcmap prove` needs."""
import re
import shlex
import struct
import sys
from pathlib import Path

from conftest import TOP

sys.path.insert(0, str(TOP / "tests"))
from scl.machine import Machine  # noqa: E402
from scl.plc import SclPlc  # noqa: E402
from scl.texts import symbols  # noqa: E402

INSTANCE = "\nDATA_BLOCK IE_COMMS_DB IE_COMMS     // DB65000\nBEGIN END_DATA_BLOCK\n"
NUMBERS = {"BYTE": "B", "UINT8": "B", "USINT": "B", "SINT": "b", "INT": "h", "UINT": "H", "WORD": "H",
           "INT16": "h", "UINT16": "H", "DINT": "i", "INT32": "i", "UDINT": "I", "DWORD": "I",
           "UINT32": "I", "REAL": "f", "LREAL": "d", "LINT": "q", "ULINT": "Q", "LWORD": "Q",
           "DATE": "H", "S5TIME": "H", "LTIME": "q", "LTOD": "Q", "LDT": "q"}


class Plc(SclPlc):
    """The generated program. `folder` has its .scl and its .plc file."""

    def __init__(self, folder, text):
        self.folder = Path(folder)
        super().__init__(folder, text)

    def make_machine(self):
        text = next(self.folder.glob("*-step7.scl")).read_text(encoding="utf-8") + INSTANCE
        sizes = {int(words[1]): int(words[2]) for words in self.config.named("db")}
        return Machine(text, symbols(text), sizes)

    def count_signal(self):
        pass

    def call_program(self, link):
        """LAYOUT and the times are those of the program."""
        self.machine.call_block("IE_COMMS", "IE_COMMS_DB", REMOTE=self.remote,
                                CONNECTED=link.connected, PERIOD=20,
                                LAYOUT=self.config.number("layout"),
                                WATCHDOG=self.ms("watchdog", "3 s"))

    # --- places and values -------------------------------------------------------------------

    def place(self, text):
        """(memory, byte, bit or None) of DB10.4, DB10.DBX4.3, M4.3, M20"""
        m = re.match(r"^DB(\d+)\.(?:DBX)?(\d+)(?:\.(\d))?$", text)
        if m:
            return self.machine.dbs[int(m[1])], int(m[2]), None if m[3] is None else int(m[3])
        m = re.match(r"^([MIQ])(\d+)(?:\.(\d))?$", text)
        return self.machine.areas[m[1]], int(m[2]), None if m[3] is None else int(m[3])

    def do_set(self, place, kind, *words):
        memory, byte, bit = self.place(place)
        if bit is not None:
            memory[byte] = memory[byte] & ~(1 << bit) | int(words[0]) << bit
            return
        data = self.bytes_of(kind, words)
        memory[byte:byte + len(data)] = data

    @staticmethod
    def bytes_of(kind, words):
        m = re.match(r"^(\w+?)(?:\[(\d+)\])?$", kind)
        name, count = m[1], int(m[2] or 1)
        if name in ("STRING", "S7STRING"):
            text = words[0].encode("latin-1")[:count]
            head = bytes([count, len(text)]) if name == "S7STRING" else b""
            return head + text.ljust(count, b"\0")
        if name in ("TIME", "DTL"):
            return bytes.fromhex(words[0])
        convert = float if NUMBERS[name] in "fd" else int
        return struct.pack(">%d%s" % (count, NUMBERS[name]), *map(convert, words))

    def do_get(self, place, kind):
        memory, byte, bit = self.place(place)
        if bit is not None:
            return "%s = %d" % (place, memory[byte] >> bit & 1)
        m = re.match(r"^(\w+?)(?:\[(\d+)\])?$", kind)
        name, count = m[1], int(m[2] or 1)
        if name in ("STRING", "S7STRING"):
            start = byte + 2 if name == "S7STRING" else byte
            size = memory[byte + 1] if name == "S7STRING" else count
            return '%s = "%s"' % (place, memory[start:start + size].split(b"\0")[0].decode("latin-1"))
        if name in ("TIME", "DTL"):
            return "%s = %s" % (place, memory[byte:byte + (8 if name == "TIME" else 12)].hex())
        values = struct.unpack_from(">%d%s" % (count, NUMBERS[name]), memory, byte)
        return "%s = %s" % (place, " ".join(repr(v) for v in values))


class SclSimulator:
    """As prove.Simulator."""

    def __init__(self, program, file, folder):
        self.plc = Plc(folder, Path(file).read_text(encoding="utf-8"))
        self.port, self.modbus, self.addresses = self.plc.port, None, ["127.0.0.1"]

    def ask(self, commands):
        """In one cycle of the program, as an HMI would not, but a test may."""
        answers = []
        with self.plc.lock:
            assert self.plc.thread.is_alive(), "\n".join(self.plc.lines)
            for command in commands:
                words = shlex.split(command)
                answers.append(getattr(self.plc, "do_" + words[0])(*words[1:]) or "")
        return answers

    def close(self):
        self.plc.close()
