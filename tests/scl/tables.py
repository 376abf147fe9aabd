"""Tables of pointers: their bytes, the blocks of a download, and the PLC of
docs/plc-tables.scl, all without a network.
"""
import struct
import zlib

from . import texts
from .machine import Machine
from .scenarios import Wire

SCL = "plc-tables.scl"
IN, OUT, ROWS = 48, 32, 32
BEGIN, PART, COMMIT, ABORT = 1, 2, 3, 4
CHECK, DATA, TABLE = 1, 2, 4
SYNC, REMOTE, TIMEOUT, MAP = 1, 2, 4, 8
NONE, LOADING, CHECKING, ACTIVE, REFUSED = range(5)
PIECE = OUT - 12
STEP = 10       # ms


def pointer(db, byte, count, area=0x84, head=0x1002, bit=0):
    return struct.pack(">HHHI", head, count & 0xffff, db & 0xffff, area << 24 | byte * 8 | bit)


def tx(db, byte, count, to, **kw):
    return pointer(db, byte, count, **kw) + pointer(1, to, count)


def rx(of, db, byte, count, **kw):
    return pointer(2, of, count) + pointer(db, byte, count, **kw)


def table(layout, tx_rows, rx_rows, crc=None):
    head = struct.pack(">HHH", layout, len(tx_rows), len(rx_rows))
    body = b"".join(list(tx_rows) + list(rx_rows))
    right = zlib.crc32(head + bytes(4) + body)
    return head + struct.pack(">I", right if crc is None else crc) + body


def crc_of(data):
    return zlib.crc32(data[:6] + bytes(4) + data[10:])


def block(flags, layout=0, body=b""):
    return struct.pack(">BBH", flags, 0, layout) + body.ljust(OUT - 4, b"\0")


def command(what, session, offset=0, length=0, piece=b""):
    return block(TABLE, 0, struct.pack(">BBHHH", what, session, offset & 0xffff,
                                       length & 0xffff, 0) + piece)


def download(data, session, piece=PIECE, crc=None):
    """All blocks of a download."""
    parts = [command(PART, session, at, len(data[at:at + piece]), data[at:at + piece])
             for at in range(0, len(data), piece)]
    crc = crc_of(data) if crc is None else crc
    return [command(BEGIN, session)] + parts + [
        command(COMMIT, session, piece=struct.pack(">I", crc))]


# A plant: setpoints in DB10 (24 bytes), measurements in DB11 (64), something secret in DB12
PLANT = {10: 24, 11: 64, 12: 16}
GOOD = table(0x1201, [tx(10, 0, 12, 16), tx(11, 8, 8, 28)], [rx(4, 10, 0, 12)])
OTHER = table(0x1202, [tx(10, 4, 16, 20), tx(11, 0, 4, 40), tx(0, 120, 2, 16, area=0x83)],
              [rx(8, 10, 4, 4), rx(20, 10, 12, 8)])


def document():
    return (texts.DOCS / SCL).read_text()


class Plc:
    """The SCL, one cycle at a time."""

    def __init__(self, program):
        self.machine = Machine(program, {}, PLANT)
        self.wire = self.machine.link = Wire()
        self.remote = self.allow = True
        for number, seed in ((10, 1), (11, 101), (12, 201)):
            size = PLANT[number]
            self.memory(number)[:] = bytes((seed + i) & 255 for i in range(size))
        self.machine.areas["M"][:] = bytes(range(256))

    def memory(self, number):
        return self.machine.dbs[number] if number else self.machine.areas["M"]

    @property
    def sync(self):
        return self.machine.get("IE_COMMS_DB.SYNC")

    def status(self):
        """state, error, row, CRC in use, expected, session, rows"""
        return struct.unpack(">BBBIHBB", self.memory(22)[1:12])

    def cycle(self, block=None, ms=STEP):
        """Returns the block that it has sent, or None."""
        if block:
            self.wire.coming.append(block)
        self.machine.ms += ms
        count = len(self.wire.sent)
        self.machine.call_block("IE_COMMS", "IE_COMMS_DB", REMOTE=self.remote,
                                CONNECTED=self.wire.connected, ALLOW_MAP=self.allow)
        return self.wire.sent[-1] if len(self.wire.sent) > count else None

    def cycles(self, count):
        return [sent for sent in (self.cycle() for _ in range(count)) if sent]

    def restart(self):
        for number in (1, 2):
            self.memory(number)[:] = bytes(len(self.memory(number)))
        self.machine.call("OB100")

    def load(self, data, session=1, **kw):
        """A whole download, and its check."""
        for what in download(data, session, **kw):
            self.cycle(what)
        for _ in range(200):
            if self.status()[0] != CHECKING:
                break
            self.cycle()
        return self.status()

    def values(self, layout=0x1201, of=None):
        """The setpoints of GOOD as the PLC holds them, with CHECK or DATA."""
        return bytes(self.memory(10)[:12]) if of is None else of
