"""Random lives of a PLC with tables: downloads with every fault, at every moment, while two
programs run side by side, the SCL and plcSim's. After each cycle both must have sent the
same bytes, and PLC memory must be what the rows in force allow: see Episode.look().
"""
import random
import struct

from . import scenarios, tables
from .machine import Machine
from .tables import (ACTIVE, BEGIN, CHECK, COMMIT, DATA, NONE, PART, TABLE, crc_of, rx, tx)

ROWS_BAD = [
    [tx(12, 0, 4, 16)],                             # forbidden
    [tx(10, 0, 4, 16), tx(10, 4, 4, 18)],           # two rows, one byte
    [tx(10, 20, 8, 16)],                            # beyond the end
    [tx(20, 0, 4, 16)], [tx(22, 0, 4, 16)],         # the program's own
    [tx(99, 0, 4, 16)],                             # no such block
    [tx(10, 0, 4, 12)],                             # into the status
    [tx(10, 0, 4, 16, bit=1)], [tx(10, 0, 4, 16, head=0x1001)], [tx(10, 0, 4, 16, area=0x82)],
    [tx(10, 0, 4, 46)], [tx(10, 0, 0, 16)], [tx(10, 0, 2000, 16)], [tx(0, 30, 4, 16, area=0x83)],
]
RX_BAD = [[rx(4, 11, 0, 4)], [rx(4, 10, 12, 4)], [rx(2, 10, 0, 4)], [rx(4, 12, 0, 2)],
          [rx(4, 10, 0, 4), rx(8, 10, 2, 4)], [rx(4, 0, 120, 2, area=0x83)], [rx(30, 10, 0, 4)]]


def good_table(chance):
    """Rows that the PLC takes."""
    tx_rows, rx_rows, to, of = [tx(10, 0, 12, 16)], [], 28, 4
    for _ in range(chance.randrange(4)):
        count = chance.randrange(1, 5)
        if to + count > 48:
            break
        tx_rows.append(chance.choice([tx(11, chance.randrange(60), count, to),
                                      tx(10, chance.randrange(20), count, to),
                                      tx(0, chance.randrange(100, 190), count, to, area=0x83)]))
        to += count
    at = 0
    for _ in range(chance.randrange(4)):
        count = chance.randrange(1, 5)
        if at + count > 12:
            break
        rx_rows.append(rx(of, 10, at, count))
        of, at = of + count, at + count
    return tables.table(chance.randrange(3) and chance.randrange(1, 65536), tx_rows, rx_rows)


def bad_table(chance):
    if chance.randrange(2):
        return tables.table(7, chance.choice(ROWS_BAD), [])
    return tables.table(7, [tx(10, 0, 12, 16)], chance.choice(RX_BAD))


class Episode:
    def __init__(self, program, step, seed):
        self.chance = random.Random(seed)
        self.plc, self.step = tables.Plc(program), step
        self.blocks = []            # that the IOC will send
        self.tables = {0}           # CRCs of tables that may be in force
        self.session = 0
        self.spoilt = False
        self.log = [f"episode {seed}"]
        self.now = 1000

    # --- one cycle of both ---------------------------------------------------------------

    def cycle(self, block=None, ms=tables.STEP):
        plc = self.plc
        self.now += ms
        plc.machine.ms = self.now - ms
        before = {n: bytes(plc.memory(n)) for n in (0, 10, 11, 12)}
        was_sync, in_force = plc.sync, self.in_force()
        sent = plc.cycle(block, ms)
        theirs = self.step.cycle(self.now, plc.wire.connected, plc.remote, plc.allow,
                                 sent is not None, block)
        self.look(block, before, was_sync, in_force)
        assert sent == theirs or self.spoilt, self.told(f"SCL {sent.hex()}\nsim {theirs.hex()}")
        if sent:
            self.look_sent(sent)

    def told(self, text):
        return "\n".join(self.log[-60:]) + "\n" + text

    def in_force(self):
        """Bytes of the table in use, b"" without one."""
        active = int.from_bytes(self.plc.memory(22)[12:14], "big")
        if not active:
            return b""
        memory = self.plc.memory(active)
        rows = int.from_bytes(memory[2:4], "big") + int.from_bytes(memory[4:6], "big")
        return bytes(memory[:10 + 20 * rows])

    def look(self, block, before, was_sync, in_force):
        """Memory of the plant changes only where a row in force says so, to what the block
        has, and only with SYNC; the table in use is one that was brought whole and good."""
        now, crc = self.in_force(), self.plc.status()[3]
        if not self.spoilt:
            assert crc == (crc_of(now) if now else 0), self.told("the table in use is broken")
            assert crc in self.tables, self.told(f"CRC {crc:08x} in force")
        allowed = {n: set() for n in before}
        if block and block[0] & DATA and not block[0] & (CHECK | TABLE) and was_sync:
            for of, number, byte, count in rx_rows(in_force):
                for i in range(count):
                    allowed[number].add((byte + i, block[of + i]))
        for number, old in before.items():
            new = self.plc.memory(number)
            if new != old:
                changed = {(i, new[i]) for i in range(len(old)) if new[i] != old[i]}
                assert changed <= allowed[number], self.told(f"DB{number}: {changed}")

    def look_sent(self, block):
        """What goes out is what rows in force name, and nothing of other memory."""
        if self.spoilt or not self.in_force():
            return
        expected = bytearray(32)
        for number, byte, to, count in tx_rows(self.in_force()):
            expected[to - 16:to - 16 + count] = self.plc.memory(number)[byte:byte + count]
        assert block[16:] == bytes(expected), self.told(block.hex())

    # --- what may happen -------------------------------------------------------------------

    def run(self, actions=40):
        self.restart(quiet=True)
        for _ in range(3):
            self.cycle()
        for _ in range(actions):
            what = self.chance.choices(list(self.CHANCES), self.CHANCES.values())[0]
            self.log.append(what)
            getattr(self, what)()
        for number in (0, 10, 11, 12, 20, 21):
            assert self.step.memory(number) == bytes(self.plc.memory(number)), self.told(
                f"DB{number} differs")
        self.plc.wire.connected = True
        count = len(self.plc.wire.sent)
        for _ in range(14):
            self.cycle()
        assert len(self.plc.wire.sent) > count, self.told("nothing is sent")

    CHANCES = {"begin": 12, "go_on": 40, "wait": 8, "fault": 8, "values": 14, "cut": 3,
               "switch": 4, "restart": 1, "pause": 2, "hmi": 4, "garbage": 3, "spoil": 1}

    def begin(self):
        """An IOC begins a download, of a good table or of a bad one."""
        data = (bad_table if self.chance.randrange(4) == 0 else good_table)(self.chance)
        self.session = self.session % 255 + 1
        piece = self.chance.choice([20, 20, 7])
        self.blocks = tables.download(data, self.session, piece)
        self.data = data
        self.log.append(f"{len(self.blocks)} blocks, CRC {crc_of(data):08x}")
        self.cycle(self.blocks.pop(0))

    def go_on(self):
        for _ in range(self.chance.randrange(1, 6)):
            if not self.blocks:
                break
            block = self.blocks.pop(0)
            if not self.blocks and is_good(self.data):
                self.tables.add(crc_of(self.data))
            self.cycle(block)
        if not self.blocks:
            self.wait()

    def wait(self):
        for _ in range(self.chance.randrange(30)):
            self.cycle()

    def fault(self):
        """One block is lost, comes twice, is another, or the IOC gives up."""
        kind = self.chance.randrange(6)
        if kind == 0 and self.blocks:
            del self.blocks[self.chance.randrange(len(self.blocks))]
        elif kind == 1 and self.blocks:
            self.blocks.insert(0, self.blocks[0])
        elif kind == 2:
            self.cycle(tables.command(tables.ABORT, self.session))
        elif kind == 3:
            self.cycle(tables.command(PART, self.session + 1, 0, 4, bytes(4)))
        elif kind == 4:
            self.cycle(tables.command(self.chance.choice([PART, COMMIT, 9]), self.session,
                                      self.chance.choice([0, 20, 640, 65000]),
                                      self.chance.choice([0, 1, 20, 21, 40000])))
        elif self.blocks:
            bad = bytearray(self.blocks[-1])
            bad[12] ^= 1
            self.blocks[-1] = bytes(bad)

    def values(self):
        """An IOC that knows the table in force shows what the PLC holds, and puts."""
        plc = self.plc
        shown = bytearray(28)
        for of, number, byte, count in rx_rows(self.in_force()):
            shown[of - 4:of - 4 + count] = plc.memory(number)[byte:byte + count]
        layout = int.from_bytes(self.in_force()[:2] or b"\0\0", "big")
        if self.chance.randrange(5) == 0:
            shown[self.chance.randrange(28)] ^= 1
        if self.chance.randrange(6) == 0:
            layout = self.chance.randrange(65536)
        self.cycle(tables.block(CHECK, layout, bytes(shown)))
        for _ in range(self.chance.randrange(3)):
            data = self.chance.randbytes(28)
            self.cycle(tables.block(self.chance.choice([DATA, DATA, 0]), layout, data))

    def cut(self):
        """The connection ends; another one, perhaps another IOC's, comes later."""
        self.plc.wire.connected = False
        for _ in range(self.chance.randrange(1, 4)):
            self.cycle()
        self.plc.wire.connected = True
        self.blocks = []
        self.cycle()

    def switch(self):
        name = self.chance.choice(["remote", "allow"])
        setattr(self.plc, name, not getattr(self.plc, name))
        self.cycle()
        if self.chance.randrange(2):
            setattr(self.plc, name, True)
            self.cycle()

    def restart(self, quiet=False):
        self.plc.restart()
        self.step.order("restart")
        for number in (1, 2):
            self.step.put(number, 0, bytes(len(self.plc.memory(number))))
        self.plc.machine.put("IE_COMMS_DB.COUNTER", 0)
        if quiet:
            self.same_memory()
        self.cut()      # its connections end with it

    def same_memory(self):
        for number in (0, 10, 11, 12, 20, 21):
            self.step.put(number, 0, bytes(self.plc.memory(number)))
        self.step.put(22, 0, bytes(32))
        self.step.order("restart")

    def pause(self):
        """Nothing comes for longer than a download may rest."""
        self.cycle()
        self.cycle(ms=self.chance.choice([4000, 6000]))
        self.cycle()

    def hmi(self):
        number, byte = self.chance.choice([(10, self.chance.randrange(24)),
                                           (11, self.chance.randrange(64))])
        value = bytes([self.chance.randrange(256)])
        self.plc.memory(number)[byte:byte + 1] = value
        self.step.put(number, byte, value)

    def garbage(self):
        self.cycle(self.chance.randbytes(32))
        self.session = self.plc.status()[5]

    def spoil(self):
        """A byte of the table in use changes: the PLC must find it, and have none."""
        active = int.from_bytes(self.plc.memory(22)[12:14], "big")
        if not active:
            return
        size = len(self.in_force())
        byte = self.chance.randrange(10, size) if size > 10 else 0
        value = bytes([self.plc.memory(active)[byte] ^ 0x10])
        saved = {n: bytes(self.plc.memory(n)) for n in (0, 10, 11, 12)}
        self.spoilt = True
        self.plc.memory(active)[byte:byte + 1] = value
        self.step.put(active, byte, value)
        for _ in range(2 * size // 4 + 4):
            self.cycle()
        now = int.from_bytes(self.plc.memory(22)[12:14], "big")
        assert now != active, self.told("the spoilt table is in use")
        assert now or self.plc.status()[0] in (NONE, tables.LOADING, tables.REFUSED)
        assert saved == {n: bytes(self.plc.memory(n)) for n in saved}
        self.spoilt = False


def fields(data, at):
    number, byte = struct.unpack_from(">xxxxHI", data, at)
    return number, (byte & 0xffffff) // 8


def rx_rows(data):
    """(byte of IE_RX, DB, byte, count)"""
    if not data:
        return
    first, count = struct.unpack_from(">HH", data, 2)
    for row in range(first, first + count):
        at = 10 + 20 * row
        number, byte = fields(data, at + 10)
        yield fields(data, at)[1], number, byte, struct.unpack_from(">xxH", data, at)[0]


def tx_rows(data):
    """(DB, byte, byte of IE_TX, count)"""
    if not data:
        return
    for row in range(struct.unpack_from(">H", data, 2)[0]):
        at = 10 + 20 * row
        number, byte = fields(data, at)
        yield number, byte, fields(data, at + 10)[1], struct.unpack_from(">xxH", data, at)[0]


def is_good(data):
    """What the PLC may take: told once more, and simply."""
    rows = (len(data) - 10) // 20
    written, shown, counts = [set(), set()], set(), struct.unpack_from(">HH", data, 2)
    if sum(counts) != rows or not rows:
        return False
    for row in range(rows):
        is_rx = row >= counts[0]
        sides = [struct.unpack_from(">HHHI", data, 10 + 20 * row + 10 * s) for s in (0, 1)]
        ours, theirs = (sides if is_rx else sides[::-1])
        if not side_good(ours, 2 if is_rx else 1, 4 if is_rx else 16, 32 if is_rx else 48) or \
                ours[1] != theirs[1]:
            return False
        place = foreign(theirs, is_rx)
        if place is None:
            return False
        target = place if is_rx else {(1, b) for _, b in bytes_of(ours)}
        if target & written[is_rx] or is_rx and not place <= shown:
            return False
        written[is_rx] |= target
        if not is_rx:
            shown |= place
    return True


def bytes_of(side):
    start = (side[3] & 0xffffff) // 8
    return {(side[2], start + i) for i in range(side[1])}


def side_good(side, number, low, high):
    head, count, db, address = side
    start = (address & 0xffffff) // 8
    return (head == 0x1002 and 1 <= count <= 1024 and db == number and address >> 24 == 0x84
            and address % 8 == 0 and low <= start and start + count <= high)


def foreign(side, write):
    head, count, db, address = side
    start, area = (address & 0xffffff) // 8, address >> 24
    if head != 0x1002 or not 1 <= count <= 1024 or address % 8:
        return None
    if area == 0x83 and db == 0 and not write and 100 <= start and start + count <= 200:
        return bytes_of(side)
    if area != 0x84 or db not in (10, 11) or write and db != 10:
        return None
    return bytes_of(side) if start + count <= tables.PLANT[db] else None


def run(program, step, seeds, actions=40):
    for seed in seeds:
        Episode(program, step, seed).run(actions)


class Twin:
    """A program of the kind of plc-programming.md, and plcSim's: checks, puts, HMI, LOCAL,
    breaks and silence. The setpoints are shown where they come. dbs: the plant's, number ->
    bytes; every cycle compares what is sent, and all of them."""

    def __init__(self, program, step, sizes, layout, dbs, seed):
        self.chance = random.Random(seed)
        self.machine = Machine(program, {}, dbs)
        self.wire = self.machine.link = scenarios.Wire()
        self.step, self.layout, self.dbs = step, layout, dbs
        self.in_size, self.out_size = sizes
        self.remote, self.now, self.log = True, 1000, []
        step.order("restart")
        step.put(1, 0, bytes(self.in_size))
        step.put(2, 0, bytes(self.out_size))
        for number, size in dbs.items():
            self.machine.dbs[number][:] = self.chance.randbytes(size)
            step.put(number, 0, bytes(self.machine.dbs[number]))
        step.put(0, 0, bytes(256))

    def cycle(self, block=None, ms=tables.STEP):
        block = block if self.wire.connected else None
        if block:
            self.wire.coming.append(block)
        self.now += ms
        self.machine.ms = self.now
        count = len(self.wire.sent)
        self.machine.call_block("IE_COMMS", "IE_COMMS_DB", REMOTE=self.remote,
                                CONNECTED=self.wire.connected, LAYOUT=self.layout)
        sent = self.wire.sent[-1] if len(self.wire.sent) > count else None
        self.log.append((self.now, block and block.hex(), sent and sent.hex()))
        theirs = self.step.cycle(self.now, self.wire.connected, self.remote, True,
                                 sent is not None, block)
        assert sent == theirs, (theirs.hex(), self.log[-20:])
        for number in self.dbs if block else ():
            assert bytes(self.machine.dbs[number]) == self.step.memory(number), number

    def block(self, flags, body):
        layout = self.chance.choice([self.layout] * 6 + [0, 1])
        return struct.pack(">BBH", flags, 0, layout) + body

    def run(self, cycles=150):
        """Returns how often SYNC was there, and how often a block was taken."""
        self.wire.connected = False
        self.cycle()
        self.wire.connected = True
        synced = taken = 0
        for _ in range(cycles):
            before = {n: bytes(self.machine.dbs[n]) for n in self.dbs}
            was = self.machine.get("IE_COMMS_DB.SYNC")
            self.something()
            synced += self.machine.get("IE_COMMS_DB.SYNC")
            taken += was and before != {n: bytes(self.machine.dbs[n]) for n in self.dbs}
            for _ in range(self.chance.randrange(1, 15)):
                self.cycle()
        return synced, taken

    def something(self):
        what = self.chance.randrange(12)
        if what < 4 and self.wire.sent:
            for _ in range(13):
                self.cycle()        # a block that shows what the PLC holds
            shown = bytearray(self.wire.sent[-1][4:self.out_size])
            if self.chance.randrange(4) == 0:
                shown[self.chance.randrange(len(shown))] ^= 1 << self.chance.randrange(8)
            self.cycle(self.block(CHECK, bytes(shown)))
        if what < 6:
            self.cycle(self.block(self.chance.choice([DATA, DATA, DATA, 0, 3]),
                                  self.chance.randbytes(self.out_size - 4)))
        elif what < 8:
            number = self.chance.choice(list(self.dbs))
            byte = self.chance.randrange(self.dbs[number])
            self.machine.dbs[number][byte:byte + 1] = value = self.chance.randbytes(1)
            self.step.put(number, byte, value)
        elif what == 8:
            self.remote = self.chance.randrange(4) > 0
        elif what == 9:
            self.wire.connected = self.chance.randrange(5) > 0
        elif what == 10 and self.chance.randrange(4) == 0:
            self.cycle()
            self.cycle(ms=4000)
