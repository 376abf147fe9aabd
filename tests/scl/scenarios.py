"""What the program of docs/plc-programming.md must do, told by one cycle after another.

Each function of ALL gets a fresh PLC and asserts. No network and no clock: a block arrives
when the scenario says so, and time is a number.
"""
import struct

from . import texts
from .machine import Machine

PERIOD, WATCHDOG, STEP = 100, 3000, 10      # ms
LAYOUT = 0x1201
IN, OUT = 32, 12


class Wire:
    """The communication processor: sends at once unless told to be busy."""

    def __init__(self):
        self.connected, self.stuck, self.pending = True, False, False
        self.sent, self.coming = [], []

    def busy(self):
        return self.stuck and self.pending

    def send(self, block):
        self.sent.append(block)
        self.pending = True

    def receive(self, size):
        return self.coming.pop(0) if self.coming else None


class Plc:
    def __init__(self, program):
        self.machine = Machine(program, {}, {10: 24, 11: 24})
        self.wire = self.machine.link = Wire()
        self.remote, self.layout = True, LAYOUT
        self.points[:] = bytes(range(1, 25))

    @property
    def points(self):
        return self.machine.dbs[10]

    @property
    def sync(self):
        return self.machine.get("IE_COMMS_DB.SYNC")

    def cycle(self, count=1):
        for _ in range(count):
            self.machine.ms += STEP
            self.machine.call_block("IE_COMMS", "IE_COMMS_DB", REMOTE=self.remote,
                                    CONNECTED=self.wire.connected, LAYOUT=self.layout)

    def take(self, flags, setpoints=None, layout=LAYOUT, cycles=1):
        setpoints = bytes(self.points[:8]) if setpoints is None else setpoints
        self.wire.coming.append(struct.pack(">BBH", flags, 0, layout) + setpoints)
        self.cycle(cycles)

    def synced(self):
        self.cycle(3)
        self.take(1)
        assert self.sync
        return self

    def next_block(self):
        """Of the blocks to come, the first."""
        count = len(self.wire.sent)
        for _ in range(40):
            self.cycle()
            if len(self.wire.sent) > count:
                return self.wire.sent[-1]
        raise AssertionError("nothing is sent")


def sends(plc):
    """The block shows what the PLC holds; counter, layout and period are right."""
    first = plc.next_block()
    assert first == struct.pack(">BBH", 2, 1, LAYOUT) + bytes(plc.points[:8]) + bytes(20)
    at = plc.machine.ms
    second = plc.next_block()
    assert second[1] == 2 and PERIOD <= plc.machine.ms - at <= PERIOD + 3 * STEP
    plc.points[3] = 77
    assert plc.next_block()[7] == 77


def sizes(plc):
    """The blocks are as long as the other side expects, the tables have sixteen rows."""
    assert {n: len(plc.machine.dbs[n]) for n in range(1, 7)} == {
        1: IN, 2: OUT, 3: 320, 4: 320, 5: OUT, 6: OUT}


def counts(plc):
    """The counter goes from 255 to 0."""
    plc.machine.put("IE_COMMS_DB.COUNTER", 254)
    assert [plc.next_block()[1] for _ in range(3)] == [255, 0, 1]


def agrees(plc):
    """A check with what the PLC holds sets SYNC, and takes nothing."""
    plc.cycle(3)
    before = bytes(plc.points)
    plc.take(1)
    assert plc.sync and bytes(plc.points) == before
    assert plc.next_block()[0] == 3
    plc.cycle(50)
    assert plc.sync


def disagrees(plc):
    """One byte that differs, and there is no SYNC."""
    for at in range(8):
        plc.synced()
        wrong = bytearray(plc.points[:8])
        wrong[at] ^= 0x40
        plc.take(1, bytes(wrong))
        assert not plc.sync
    assert plc.next_block()[0] == 2


def takes(plc):
    """Setpoints with SYNC are taken, the neighbours stay, SYNC stands."""
    plc.synced()
    plc.take(2, bytes(range(101, 109)))
    assert bytes(plc.points) == bytes(range(101, 109)) + bytes(range(9, 25))
    assert plc.machine.get("IE_COMMS_DB.PTR_ERR") == 0
    plc.cycle(30)
    assert plc.sync
    assert plc.next_block()[:12] == struct.pack(">BBH", 3, plc.wire.sent[-1][1], LAYOUT) + bytes(
        range(101, 109))


def ignores(plc):
    """Setpoints without SYNC, and blocks that are neither, move nothing."""
    before = bytes(plc.points)
    plc.cycle(3)
    plc.take(2, bytes(8))
    assert bytes(plc.points) == before and not plc.sync
    plc.synced()
    plc.take(0, bytes(8))
    plc.take(4, bytes(8))
    assert bytes(plc.points) == before and plc.sync and plc.next_block()[0] == 3


def hmi_in_time(plc):
    """A setpoint moved before the block with an old value: the block is not taken."""
    plc.synced()
    for at in (0, 7):
        plc.points[at] ^= 0x55
        before = bytes(plc.points)
        plc.take(2, bytes(8))
        assert not plc.sync and bytes(plc.points) == before
        plc.take(1)
        assert plc.sync


def hmi_while_sending(plc):
    """A setpoint moved in the cycle that sends: the block does not say SYNC."""
    plc.synced()
    plc.next_block()
    begin = plc.machine.ms
    plc.next_block()
    plc.cycle((plc.machine.ms - begin) // STEP - 1)
    sent = len(plc.wire.sent)

    def moves(number, plain=plc.machine.namespace["f_CHECKSYNC"]):
        value = plain(number)
        plc.points[2] ^= 1          # behind the comparison of step 3
        return value
    plc.machine.namespace["f_CHECKSYNC"] = moves
    plc.cycle()
    assert len(plc.wire.sent) == sent + 1 and plc.wire.sent[-1][0] & 1 == 0


def local(plc):
    """LOCAL ends SYNC; nothing is taken, no check is answered; REMOTE begins with a check."""
    plc.synced()
    plc.remote = False
    before = bytes(plc.points)
    plc.cycle()
    assert not plc.sync
    plc.take(1)
    plc.take(2, bytes(8))
    assert not plc.sync and bytes(plc.points) == before and plc.next_block()[0] == 0
    plc.remote = True
    plc.cycle(3)
    assert not plc.sync
    plc.take(1)
    assert plc.sync


def local_at_once(plc):
    """Setpoints that come in the cycle that goes LOCAL are not taken."""
    plc.synced()
    before = bytes(plc.points)
    plc.remote = False
    plc.take(2, bytes(8))
    assert bytes(plc.points) == before


def connection(plc):
    """The end of a connection ends SYNC, so does a new one; nothing is sent without."""
    plc.synced()
    plc.wire.connected = False
    plc.cycle()
    assert not plc.sync
    sent = len(plc.wire.sent)
    plc.cycle(40)
    assert len(plc.wire.sent) == sent
    plc.machine.put("IE_COMMS_DB.SYNC", True)
    plc.machine.put("IE_COMMS_DB.SENDING", True)
    plc.machine.put("IE_COMMS_DB.TX_PAUSE.STATE", 0)
    plc.wire.connected = plc.wire.stuck = plc.wire.pending = True
    plc.cycle()
    assert not plc.sync and not plc.machine.get("IE_COMMS_DB.SENDING")


def layouts(plc):
    """Two layouts that differ: SYNC falls, nothing is taken; 0 on either side is any."""
    before = bytes(plc.points)
    plc.synced()
    plc.take(2, bytes(8), layout=LAYOUT + 1)
    assert not plc.sync and bytes(plc.points) == before
    plc.take(1, layout=LAYOUT + 1)
    assert not plc.sync
    plc.take(1, layout=0)
    assert plc.sync
    plc.layout = 0
    plc.take(1, layout=7)
    assert plc.sync


def watchdog(plc):
    """No block for the time of the watchdog: TIMEOUT, no SYNC; a check takes it back."""
    plc.synced()
    plc.cycle(WATCHDOG // STEP - 1)
    assert plc.sync and plc.wire.sent[-1][0] == 3
    plc.cycle(2)
    assert not plc.sync and plc.next_block()[0] == 6
    plc.take(2, bytes(8))
    assert plc.next_block()[0] == 6
    plc.take(1)
    assert plc.sync and plc.next_block()[0] == 3
    for _ in range(6):
        plc.take(0, cycles=WATCHDOG // STEP - 5)
    assert plc.sync


def watchdog_rests(plc):
    """Without a connection the watchdog does not run."""
    plc.wire.connected = False
    plc.cycle(WATCHDOG // STEP * 2)
    assert not plc.machine.get("IE_COMMS_DB.TIMEOUT")


def busy(plc):
    """While SEND is busy no other block begins; one that never ends is given up."""
    plc.next_block()
    plc.wire.stuck = True
    plc.cycle(PERIOD // STEP + 2)
    sent = len(plc.wire.sent)
    plc.cycle(200)
    assert len(plc.wire.sent) == sent
    plc.wire.stuck = False
    assert plc.next_block()[1] == plc.wire.sent[-2][1] + 1
    plc.machine.put("IE_COMMS_DB.SENDING", True)
    plc.wire.stuck = True
    plc.cycle(995)
    assert plc.machine.get("IE_COMMS_DB.SENDING")
    plc.cycle(10)
    assert not plc.machine.get("IE_COMMS_DB.SENDING")


def send_fails(plc):
    """An error of SEND ends it, and the next block is made."""
    plc.next_block()
    plc.wire.stuck = True
    plc.cycle(PERIOD // STEP + 2)
    assert plc.machine.get("IE_COMMS_DB.SENDING")
    plc.wire.connected = False
    plc.machine.call_block("IE_COMMS", "IE_COMMS_DB", CONNECTED=True)
    assert not plc.machine.get("IE_COMMS_DB.SENDING")


def row(plc, table, number, source, target, count=1, area=0x84):
    at = number * 20
    plc.machine.dbs[table][at:at + 20] = b"".join(
        struct.pack(">BBHHI", 0x10, 2, count, db, (area if db != 1 and db != 2 else 0x84) << 24
                    | byte * 8) for db, byte in (source, target))


def bad_pointer(plc):
    """A bad pointer is told, the others are served."""
    row(plc, 3, 1, (99, 0), (1, 12))
    row(plc, 3, 2, (11, 0), (1, 13))
    plc.machine.dbs[11][0] = 55
    assert plc.next_block()[13] == 55
    assert plc.machine.get("IE_COMMS_DB.PTR_ERR") & 0xffff == 0x813a
    row(plc, 3, 1, (11, 3), (1, 12))
    plc.next_block()
    assert plc.machine.get("IE_COMMS_DB.PTR_ERR") == 0


def bad_pointer_in(plc):
    """The same where setpoints go."""
    plc.synced()
    row(plc, 4, 1, (2, 4), (11, 0), 4)
    plc.machine.dbs[11][:4] = plc.points[:4]
    plc.machine.dbs[4][1] = 0x13        # no type of bytes
    plc.take(1)
    plc.take(2, bytes(4) + bytes(plc.points[4:8]))
    assert plc.machine.dbs[11][0] == 0
    assert plc.machine.get("IE_COMMS_DB.PTR_ERR") & 0xffff == 0x8101


def row_beyond(plc):
    """A row beyond its block is told, and stops neither the CPU nor the others."""
    plc.synced()
    row(plc, 4, 1, (2, 8), (11, 22), 4)
    plc.cycle()
    assert plc.sync
    plc.take(2, bytes(range(31, 39)))
    assert plc.machine.get("IE_COMMS_DB.PTR_ERR") & 0xffff == 0x8322
    assert bytes(plc.points[:8]) == bytes(range(31, 39))


def sixteen(plc):
    """Tables of sixteen rows are served to the last, both ways, and compared to the last."""
    for number in range(16):
        row(plc, 3, number, (11, number), (1, 4 + number))
        row(plc, 4, number, (2, 4 + number % 8), (10 if number < 8 else 11, number))
    plc.machine.dbs[11][:16] = bytes(range(50, 66))
    assert plc.next_block()[4:20] == bytes(range(50, 66))
    plc.points[:8] = bytes(range(8))
    plc.machine.dbs[11][8:16] = bytes(range(8))
    plc.synced()
    plc.take(2, bytes(range(70, 78)))
    assert bytes(plc.points[:8]) == bytes(plc.machine.dbs[11][8:16]) == bytes(range(70, 78))
    plc.machine.dbs[11][15] ^= 1
    plc.cycle()
    assert not plc.sync


def one_row(plc):
    """The first row whose source has no byte 0 ends a table, whatever follows."""
    for table in (3, 4):
        row(plc, table, 1, (11, 0), (1, 20))
        plc.machine.dbs[table][20] = 0
    row(plc, 3, 2, (11, 0), (1, 20))
    row(plc, 4, 2, (2, 4), (11, 0))
    plc.machine.dbs[11][0] = 9
    assert plc.next_block()[20] == 0
    plc.synced()
    plc.take(2, bytes(8))
    assert plc.machine.dbs[11][0] == 9 and plc.sync


def flags_area(plc):
    """Setpoints in flags (M) are taken and compared there."""
    row(plc, 4, 1, (2, 10), (0, 39), 2, 0x83)
    plc.machine.areas["M"][39:41] = plc.points[6:8]
    plc.machine.areas["M"][0] = 1
    plc.synced()
    plc.take(2, bytes(range(31, 39)))
    assert plc.machine.areas["M"][40] == 38 and plc.machine.areas["M"][41] == 0
    plc.machine.areas["M"][40] = 3
    plc.cycle()
    assert not plc.sync


def far_address(plc):
    """Addresses beyond 4095 bytes need more than 16 bits of the pointer."""
    plc.machine.dbs[12] = bytearray(9000)
    row(plc, 4, 1, (2, 4), (12, 8200))
    row(plc, 3, 1, (12, 8200), (1, 14))
    plc.machine.dbs[12][8200] = plc.points[0]
    plc.synced()
    plc.take(2, bytes(range(31, 39)))
    assert plc.machine.dbs[12][8200] == 31 and plc.next_block()[14] == 31


def status(plc):
    """RX_STAT and TX_STAT have what AG_RECV and AG_SEND said."""
    plc.cycle()
    assert plc.machine.get("IE_COMMS_DB.RX_STAT") == 0x8180
    plc.wire.stuck = True
    plc.next_block()
    assert plc.machine.get("IE_COMMS_DB.TX_STAT") == 0x8181
    plc.wire.stuck = False
    plc.cycle()
    assert plc.machine.get("IE_COMMS_DB.TX_STAT") == 0


ALL = (sizes, sends, agrees, disagrees, takes, ignores, hmi_in_time, local, local_at_once,
       connection, layouts, watchdog, watchdog_rests, busy, send_fails, hmi_while_sending,
       bad_pointer, bad_pointer_in, row_beyond, sixteen, one_row, flags_area, far_address,
       status, counts)

INSTANCE = "DATA_BLOCK IE_COMMS_DB IE_COMMS     // DB31\nBEGIN END_DATA_BLOCK\n"


def document():
    return texts.blocks("plc-programming.md") + INSTANCE
