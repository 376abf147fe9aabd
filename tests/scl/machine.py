"""A CPU: memory, and the blocks of a program that run on it, one call after another.

Knows no sockets and no clock: `ms` is set by who runs it.
"""
import struct

from . import blocks
from .check import Place
from .compile import Program
from .parse import SclError
from .types import BOOL, leaves

FILE = "<scl>"


class Machine:
    """text: SCL. symbols: name of a data block -> number. extra: further DBs, number -> size."""

    def __init__(self, text, symbols, extra=None):
        self.program = text if isinstance(text, Program) else Program(text, symbols)
        self.ms = 0
        self.link = None
        self.protected = set()
        self.areas = {area: bytearray(256) for area in "MIQ"}
        self.sizes = {number: kind.size for number, kind in self.program.dbs.values()}
        self.sizes.update(extra or {})
        self.dbs = {number: bytearray(size) for number, size in self.sizes.items()}
        self.namespace = self.helpers()
        self.namespace.update(self.areas)
        self.namespace.update({f"DB{n}": memory for n, memory in self.dbs.items()})
        exec(compile(self.program.source, FILE, "exec"), self.namespace)
        self.cold()

    def cold(self):
        """All memory as loaded. In place: the program holds on to it."""
        for memory in list(self.areas.values()) + list(self.dbs.values()):
            memory[:] = bytes(len(memory))
        for number, _ in self.program.dbs.values():
            self.guard(self.namespace[f"init_{number}"])

    def call(self, name, *arguments):
        """A function, or an organization block."""
        return self.guard(self.namespace["f_" + name], *arguments)

    def call_block(self, name, instance, **inputs):
        """A function block with a data block as its instance."""
        number, kind = self.program.dbs[instance]
        assert self.program.fbs[name] is kind
        for field, value in inputs.items():
            self.put(f"{instance}.{field}", value)
        self.guard(self.namespace["f_" + name], self.dbs[number], 0)

    def guard(self, function, *arguments):
        """What goes wrong in the program is told with its place in the text."""
        try:
            return function(*arguments)
        except (SclError, NameError, IndexError, struct.error, ZeroDivisionError) as e:
            raise SclError(self.where(e), self.words(e)) from e

    def where(self, error):
        pos, trace = None, error.__traceback__
        while trace:
            if trace.tb_frame.f_code.co_filename == FILE:
                pos = self.program.positions[trace.tb_lineno - 1] or pos
            trace = trace.tb_next
        return pos

    def words(self, error):
        if isinstance(error, NameError):
            name = str(error).split("'")[1]
            return ("the result is not set" if name == "r_result" else
                    f"{name[2:]} is read before it is written")
        return str(error)

    # --- memory by name, for tests ---------------------------------------------------------

    def find(self, path):
        """"IE_COMMS_DB.SYNC" to (memory, byte, bit, type)."""
        db, _, rest = path.upper().partition(".")
        number, kind = self.program.dbs[db]
        for name, byte, bit, part in leaves(kind):
            if name.upper() == rest:
                return self.dbs[number], byte, bit, part
        raise KeyError(path)

    def get(self, path):
        memory, byte, bit, kind = self.find(path)
        if kind == BOOL:
            return bool(memory[byte] >> bit & 1)
        return struct.unpack_from(">" + kind.format, memory, byte)[0]

    def put(self, path, value):
        memory, byte, bit, kind = self.find(path)
        if kind == BOOL:
            memory[byte] = memory[byte] & ~(1 << bit) | bool(value) << bit
        else:
            struct.pack_into(">" + kind.format, memory, byte, value)

    # --- for those who watch ---------------------------------------------------------------

    def moved(self, memory, byte, size):
        """BLKMOV wrote there."""

    def received(self):
        """AG_RECV brought a block."""

    # --- what the Python of the program calls ------------------------------------------------

    def helpers(self):
        names = {"_system": self._system, "_timer": self._standard, "_db": self._db,
                 "_any": any_pointer, "_index": index, "_bit": bit, "_set_bit": set_bit,
                 "_cut": cut, "_paste": paste, "_div": divide, "_mod": modulo, "_rol": rotate,
                 "_bits": bits_of, "_real": real_of}
        for code in "BHhIif":
            one = struct.Struct(">" + code)
            names[f"_get_{code}"] = lambda m, at, f=one.unpack_from: f(m, at)[0]
            names[f"_put_{code}"] = one.pack_into
            names[f"_check_get_{code}"] = lambda m, at, s=one: s.unpack_from(
                m, inside(m, at, s.size))[0]
            names[f"_check_put_{code}"] = lambda m, at, value, s=one: s.pack_into(
                m, inside(m, at, s.size), value)
        return names

    def _system(self, name, *inputs):
        system = blocks.SYSTEM[name]
        result = system.run(self, *inputs)
        return result if system.outputs else result[0]

    def _standard(self, name, memory, byte):
        kind, _, run = blocks.STANDARD[name]
        place = {f.name: Place(f.type, byte=str(byte + f.byte), bit=str(f.bit))
                 for f in kind.fields.values()}

        def get(field):
            f, at = place[field], int(place[field].byte)
            if f.type == BOOL:
                return bit(memory, at, int(f.bit))
            if not f.type.format:
                return cut(memory, at, f.type.size)
            return struct.unpack_from(">" + f.type.format, memory, at)[0]

        def put(field, value):
            f, at = place[field], int(place[field].byte)
            if f.type == BOOL:
                set_bit(memory, at, int(f.bit), value)
            else:
                struct.pack_into(">" + f.type.format, memory, at, value)
        run(self, get, put)

    def _db(self, number):
        memory = self.dbs.get(number)
        if memory is None:
            raise SclError(None, f"DB{number} does not exist")
        return memory


def inside(memory, at, size):
    if not 0 <= at <= len(memory) - size:
        raise SclError(None, f"byte {at} is outside of a block of {len(memory)} bytes")
    return at


def any_pointer(number, byte, size):
    return struct.pack(">BBHHI", 0x10, 2, size, number, 0x84000000 | byte * 8)


def index(value, low, high):
    if not low <= value <= high:
        raise SclError(None, f"index {value} is outside {low}..{high}")
    return value - low


def bit(memory, byte, number):
    return memory[inside(memory, byte, 1)] >> number & 1 == 1


def set_bit(memory, byte, number, value):
    inside(memory, byte, 1)
    memory[byte] = memory[byte] & ~(1 << number) | value << number


def cut(memory, byte, size):
    return bytes(memory[byte:byte + size])


def paste(memory, byte, size, value):
    memory[byte:byte + size] = value


def divide(a, b):
    """Towards zero, as the CPU does."""
    return abs(a) // abs(b) * (1 if (a < 0) == (b < 0) else -1)


def modulo(a, b):
    return a - b * divide(a, b)


def bits_of(value):
    return struct.unpack(">I", struct.pack(">f", value))[0]


def real_of(bits):
    return struct.unpack(">f", struct.pack(">I", bits))[0]


def rotate(value, count, bits):
    count %= bits
    return (value << count | value >> bits - count) & (1 << bits) - 1
