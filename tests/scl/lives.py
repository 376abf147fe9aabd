"""What the program of docs/plc-tables.scl must do, in fixed steps: each function of ALL gets
an Episode that works with tables.GOOD, beside plcSim's program, and asserts.
"""
import struct

from . import episodes, tables
from .tables import (ACTIVE, CHECK, DATA, GOOD, OTHER, REFUSED, TABLE, crc_of, rx, table, tx)

# Tables at the edge of what is allowed
EDGE = {
    "to the last byte of a block": table(1, [tx(10, 20, 4, 16)], []),
    "to the last byte of IE_TX": table(1, [tx(10, 0, 4, 44)], []),
    "all of IE_TX": table(1, [tx(11, 32, 32, 16)], []),
    "to the last byte of IE_RX": table(1, [tx(10, 0, 4, 16)], [rx(28, 10, 0, 4)]),
    "flags, from the first to the last": table(
        1, [tx(0, 100, 2, 16, area=0x83), tx(0, 198, 2, 18, area=0x83)], []),
    "neighbours": table(1, [tx(10, 4, 4, 20), tx(10, 0, 4, 16), tx(10, 8, 4, 24)],
                        [rx(8, 10, 4, 4), rx(4, 10, 0, 4), rx(12, 10, 8, 4)]),
    "one setpoint shown by a longer row": table(1, [tx(10, 0, 24, 16)], [rx(4, 10, 23, 1),
                                                                       rx(5, 10, 0, 1)]),
    "shown by the last row": table(1, [tx(11, 0, 4, 16), tx(10, 0, 4, 20)], [rx(4, 10, 0, 4)]),
    "32 rows": table(1, [tx(10, 0, 1, 16 + i) for i in range(32)], []),
    "32 rows, 16 of them in": table(1, [tx(10, i, 1, 16 + i) for i in range(16)],
                                    [rx(4 + i, 10, i, 1) for i in range(16)]),
    "rows for values in alone": table(1, [tx(10, 0, 1, 16)], [rx(4, 10, 0, 1)]),
    "layout 0": table(0, [tx(10, 0, 1, 16)], []),
}
OWN = (1, 2, 5, 6, 20, 21, 22, 23)


def load(both, data, session=1, **kw):
    for block in tables.download(data, session, **kw):
        both.cycle(block)
    while both.plc.status()[0] == tables.CHECKING:
        both.cycle()
    for _ in range(12):
        both.cycle()
    return both.plc.status()


def agree(both):
    """A CHECK with what the PLC holds, by the table in use."""
    shown = bytearray(28)
    for of, number, byte, count in episodes.rx_rows(both.in_force()):
        shown[of - 4:of - 4 + count] = both.plc.memory(number)[byte:byte + count]
    layout = int.from_bytes(both.in_force()[:2], "big")
    both.cycle(tables.block(CHECK, layout, bytes(shown)))
    return bytes(shown), layout


def edges(both):
    """Every table at the edge is taken, packs, is compared, and survives a restart."""
    for data in EDGE.values():
        both.tables.add(crc_of(data))
        assert load(both, data)[:4] == (ACTIVE, 0, 0, crc_of(data)), both.told("refused")
        agree(both)
        assert both.plc.sync
        both.restart()
        assert both.plc.status()[:4] == (ACTIVE, 0, 0, crc_of(data)), both.told("lost")


def both_tables(both):
    """In either data block: SYNC, puts, HMI, and a difference in each compared byte."""
    for session, data in enumerate((OTHER, GOOD, OTHER), 2):
        both.tables.add(crc_of(data))
        assert load(both, data, session)[3] == crc_of(data)
        shown, layout = agree(both)
        assert both.plc.sync
        both.cycle(tables.block(DATA, layout, bytes(range(200, 228))))
        assert both.plc.sync
        for _ in range(13):
            both.cycle()
        for of, number, byte, count in list(episodes.rx_rows(data)):
            assert bytes(both.plc.memory(number)[byte:byte + count]) == bytes(
                range(196 + of, 196 + of + count))
            for at in (0, count - 1):
                both.plc.memory(number)[byte + at] ^= 8
                both.step.put(number, byte + at, bytes(both.plc.memory(number)[byte + at:][:1]))
                both.cycle()
                assert not both.plc.sync, both.told("the HMI's value is not seen")
                agree(both)
                assert both.plc.sync
                wrong = bytearray(agree(both)[0])
                wrong[of - 4 + at] ^= 1
                both.cycle(tables.block(CHECK, layout, bytes(wrong)))
                assert not both.plc.sync
                agree(both)


def sizes(both):
    """The blocks are as long as both sides expect."""
    assert {n: len(both.plc.memory(n)) for n in (1, 2, 5, 6, 20, 21, 22)} == {
        1: 48, 2: 32, 5: 32, 6: 32, 20: 650, 21: 650, 22: 32}


def pieces(both):
    """Parts of any length make a table; one that ends a byte too late is too long."""
    both.tables.add(crc_of(OTHER))
    for session, piece in enumerate((1, 19, 20), 2):
        assert load(both, OTHER, session, piece=piece)[3] == crc_of(OTHER)
        load(both, GOOD, session + 10)
    long = table(1, [tx(10, 0, 1, 16)] * 33, [])
    assert load(both, long, 99, piece=7)[:2] == (REFUSED, 28)
    assert both.plc.status()[4] == 644


def layouts(both):
    """Two layout ids that differ end SYNC and nothing is taken; 0 on either side is any."""
    for layout in (0x1201, 1, 0):
        data = table(layout, [tx(10, 0, 12, 16)], [rx(4, 10, 0, 12)])
        both.tables.add(crc_of(data))
        load(both, data, 3)
        before = bytes(both.plc.memory(10))
        for theirs in (0x1202, 1, 2, 0x1201, 0):
            agree(both)
            both.cycle(tables.block(CHECK, theirs, before))
            fits = not layout or not theirs or theirs == layout
            assert both.plc.sync == fits, both.told(f"{layout} {theirs}")
            both.cycle(tables.block(DATA, theirs, before[::-1]))
            assert (bytes(both.plc.memory(10)) != before) == fits
            both.plc.memory(10)[:] = before
            both.step.put(10, 0, before)
            both.cycle()


def commands(both):
    """Each command that comes at the wrong time, and with wrong numbers, has its error."""
    head = GOOD[:20]
    for blocks, error in [
            ([tables.command(tables.PART, 9, 0, 20, head)], 20),
            ([tables.command(tables.BEGIN, 9), tables.command(tables.PART, 8, 0, 20, head)], 20),
            ([tables.command(tables.BEGIN, 9), tables.command(tables.PART, 9, 1, 20, head)], 21),
            ([tables.command(tables.BEGIN, 9), tables.command(tables.PART, 9, 0, 0)], 22),
            ([tables.command(tables.BEGIN, 9), tables.command(tables.PART, 9, 0, 21)], 22),
            ([tables.command(tables.BEGIN, 9), tables.command(tables.PART, 9, 0, -1)], 22),
            ([tables.command(tables.BEGIN, 9), tables.command(tables.COMMIT, 9)], 23),
            ([tables.command(tables.BEGIN, 9), tables.command(7, 9)], 25)]:
        for block in blocks:
            both.cycle(block)
        both.cycle()
        assert both.plc.status()[:2] == (REFUSED, error), both.told(f"not {error}")
        both.cycle(tables.command(tables.PART, 9, 0, 0))
        assert both.plc.status()[:2] == (REFUSED, error), "the first error stays"
        both.cut()
        assert both.plc.status()[:2] == (ACTIVE, 0)


def aborts(both):
    """ABORT of the session ends loading and checking, that of another one does nothing."""
    both.cycle(tables.command(tables.BEGIN, 9))
    both.cycle(tables.command(tables.ABORT, 8))
    assert both.plc.status()[0] == tables.LOADING
    both.cycle(tables.command(tables.ABORT, 9))
    assert both.plc.status()[:2] == (ACTIVE, 0)
    for block in tables.download(OTHER, 10):
        both.cycle(block)
    both.cycle(tables.command(tables.ABORT, 10))
    assert both.plc.status()[:2] == (ACTIVE, 0)
    for _ in range(20):
        both.cycle()
    assert both.plc.status()[3] == crc_of(GOOD)


def quiet(both):
    """A download rests for 5 s, not for less and not for more."""
    both.cycle(tables.command(tables.BEGIN, 9))
    both.cycle()
    both.cycle(ms=4980)
    assert both.plc.status()[0] == tables.LOADING
    both.cycle(ms=30)
    assert both.plc.status()[:2] == (ACTIVE, 29)


def times(both):
    """The period, the watchdog, a SEND that does not end, the counter."""
    sent = both.plc.wire.sent
    stamps = []
    while len(stamps) < 4:
        count = len(sent)
        both.cycle()
        if len(sent) > count:
            stamps.append(both.now)
    assert all(100 <= b - a <= 130 for a, b in zip(stamps, stamps[1:]))
    agree(both)
    both.cycle()
    both.cycle(ms=2980)
    assert both.plc.sync
    both.cycle(ms=30)
    assert not both.plc.sync
    both.plc.machine.put("IE_COMMS_DB.COUNTER", 254)
    both.step.put(1, 1, b"\xfe")
    get, put = both.plc.machine.get, both.plc.machine.put
    both.plc.wire.stuck, both.plc.wire.pending = True, False
    counts = len(sent)
    for _ in range(40):
        both.plc.machine.ms += 10
        both.plc.cycle()
    assert len(sent) == counts + 1 and get("IE_COMMS_DB.SENDING")
    assert sent[-1][1] == 255
    both.plc.machine.ms += 9000
    both.plc.cycle()
    assert get("IE_COMMS_DB.SENDING")
    both.plc.machine.ms += 1000
    both.plc.cycle()
    assert not get("IE_COMMS_DB.SENDING")
    both.plc.wire.stuck = False
    count = len(sent)
    for _ in range(40):
        both.plc.cycle()
    assert [block[1] for block in sent[count:]][:3] == [0, 1, 2]
    put("IE_COMMS_DB.SENDING", True)
    both.plc.wire.stuck = both.plc.wire.pending = True
    both.plc.wire.connected = False
    both.plc.cycle()
    assert not get("IE_COMMS_DB.SENDING")


def anew(both):
    """BEGIN, and a new connection, wipe out error and row of the table that was refused."""
    bad = table(1, [tx(10, 0, 12, 16), tx(11, 0, 1, 28), tx(12, 0, 1, 29)], [])
    for again in (lambda: both.cycle(tables.command(tables.BEGIN, 10)), both.cut):
        assert load(both, bad, 9)[:3] == (REFUSED, 5, 2)
        again()
        assert both.plc.status()[1:3] == (0, 0)
        for _ in range(13):
            both.cycle()


def slow(both):
    """A download may last as long as it likes while parts come."""
    both.tables.add(crc_of(OTHER))
    for block in tables.download(OTHER, 9):
        both.cycle(block)
        both.cycle()
        both.cycle(ms=2500)
    for _ in range(30):
        both.cycle()
    assert both.plc.status()[3] == crc_of(OTHER)


def local(both):
    """LOCAL ends SYNC at once; nothing is taken, no check is answered, no table begun."""
    shown, layout = agree(both)
    before = bytes(both.plc.memory(10))
    both.plc.remote = False
    both.cycle(tables.block(DATA, layout, bytes(28)))
    assert not both.plc.sync and bytes(both.plc.memory(10)) == before
    agree(both)
    assert not both.plc.sync
    both.cycle(tables.command(tables.BEGIN, 9))
    assert both.plc.status()[:2] == (REFUSED, 27)
    both.plc.remote = True
    both.cycle(tables.command(tables.BEGIN, 10))
    both.plc.remote = False
    both.cycle()
    assert both.plc.status()[:2] == (ACTIVE, 27)
    both.plc.remote = True
    agree(both)
    assert both.plc.sync


def watchdog(both):
    """TIMEOUT shows after the watchdog, and until the next SYNC."""
    agree(both)
    both.cycle()
    both.cycle(ms=3010)
    for _ in range(13):
        both.cycle()
    assert both.plc.wire.sent[-1][0] == tables.MAP | tables.REMOTE | tables.TIMEOUT
    agree(both)
    for _ in range(13):
        both.cycle()
    assert both.plc.wire.sent[-1][0] == tables.MAP | tables.REMOTE | tables.SYNC


def hmi_while_sending(both):
    """A setpoint moved in the cycle that sends: the block does not say SYNC."""
    agree(both)
    sent, stamps = both.plc.wire.sent, []
    while len(stamps) < 2:
        count = len(sent)
        both.cycle()
        if len(sent) > count:
            stamps.append(both.now)
    for _ in range((stamps[1] - stamps[0]) // 10 - 1):
        both.cycle()
    plc, space = both.plc, both.plc.machine.namespace

    def moves(number, plain=space["f_CHECKSYNC"]):
        value = plain(number)
        plc.memory(10)[2] ^= 1          # behind the comparison of step 3
        return value
    space["f_CHECKSYNC"] = moves
    block = plc.cycle()
    assert block and block[0] & tables.SYNC == 0


def connection(both):
    """The end of a connection ends SYNC and a SEND under way; so does a new one."""
    agree(both)
    both.plc.wire.connected = False
    both.cycle()
    assert not both.plc.sync
    put, get = both.plc.machine.put, both.plc.machine.get
    put("IE_COMMS_DB.SYNC", True)
    put("IE_COMMS_DB.SENDING", True)
    put("IE_COMMS_DB.TX_PAUSE.STATE", 0)
    both.plc.wire.connected = both.plc.wire.stuck = both.plc.wire.pending = True
    both.plc.cycle()
    assert not both.plc.sync and not get("IE_COMMS_DB.SENDING")


def spoilt_head(both):
    """Numbers of rows that change in the table in use: there is none, and nothing moves."""
    both.tables.update((crc_of(GOOD), 0))
    for byte in (2, 3, 4, 5):
        for value in (0x7f, 0xff, 0x21):
            if byte in (3, 5) and value == 0x21:
                continue
            both.plc.machine.cold()
            both.restart(quiet=True)
            load(both, GOOD)
            saved = {n: bytes(both.plc.memory(n)) for n in (0, 10, 11, 12)}
            agree(both)
            active = int.from_bytes(both.plc.memory(22)[12:14], "big")
            both.plc.memory(active)[byte] = value
            both.plc.cycle()
            both.plc.cycle()
            assert both.plc.status()[0] == tables.NONE, (byte, value)
            assert saved == {n: bytes(both.plc.memory(n)) for n in saved}


def restarts(both):
    """OB100: no SYNC, no TIMEOUT, the loader at rest, the table as it was."""
    agree(both)
    both.cycle(tables.command(tables.BEGIN, 9))
    both.plc.machine.put("IE_COMMS_DB.SYNC", True)
    both.plc.machine.put("IE_COMMS_DB.TIMEOUT", True)
    both.plc.machine.call("OB100")
    assert not both.plc.sync and not both.plc.machine.get("IE_COMMS_DB.TIMEOUT")
    assert both.plc.status()[:3] == (ACTIVE, 0, 0)
    assert both.plc.status()[4:6] == (0, 0) and both.plc.memory(22)[0] == 1
    both.plc.memory(22)[12:14] = struct.pack(">H", 22)      # no table
    both.plc.machine.call("OB100")
    assert both.plc.status()[0] == tables.NONE and both.plc.status()[3] == 0


def errors_of_pointers(both):
    """PTR_ERR tells when a row cannot be moved, and is 0 else."""
    for _ in range(13):
        both.cycle()
    assert both.plc.machine.get("IE_COMMS_DB.PTR_ERR") == 0
    shown, layout = agree(both)
    both.cycle(tables.block(DATA, layout, shown))
    assert both.plc.machine.get("IE_COMMS_DB.PTR_ERR") == 0
    assert both.plc.machine.call("PACK_TX_DB") == both.plc.machine.call("UNPACK_RX_DB") == 0
    active = int.from_bytes(both.plc.memory(22)[12:14], "big")
    for row in range(3):
        both.plc.memory(active)[10 + 20 * row] = 0
    assert both.plc.machine.call("PACK_TX_DB") & 0xffff == 0x8101
    assert both.plc.machine.call("UNPACK_RX_DB") & 0xffff == 0x8101


def table_and_data(both):
    """A block with TABLE moves nothing, whatever other flags it has; while a table is loaded
    nothing is checked or taken."""
    shown, layout = agree(both)
    before = bytes(both.plc.memory(10))
    for flags in (TABLE | CHECK, TABLE | DATA, TABLE | CHECK | DATA):
        both.cycle(tables.block(flags, layout, bytes(28)))
        assert bytes(both.plc.memory(10)) == before
    both.cut()
    both.cycle(tables.command(tables.BEGIN, 9))
    agree(both)
    both.cycle(tables.block(DATA, layout, bytes(28)))
    assert not both.plc.sync and bytes(both.plc.memory(10)) == before


ALL = (sizes, pieces, layouts, anew, slow, local, watchdog, hmi_while_sending, connection, spoilt_head,
       edges, both_tables, commands, aborts, quiet, times, restarts, errors_of_pointers,
       table_and_data)


def permissive(text):
    """The program with a MAP_ALLOWED that allows everything."""
    begin = text.index("    CASE NUMBER OF\n        10 :")
    end = text.index("END_FUNCTION", begin)
    return text[:begin] + "    MAP_ALLOWED := TRUE;\n" + text[end:]


def own_blocks(program):
    """No table reaches the program's own blocks, even if the list says so."""
    plc = tables.Plc(program)
    for number in OWN:
        assert plc.load(table(1, [tx(number, 0, 1, 16)], []))[:2] == (REFUSED, 5), number
        assert plc.load(table(1, [tx(10, 0, 1, 16)], [rx(4, number, 0, 1)]))[:2] == (REFUSED, 5)
    plc.machine.dbs.update({n: bytearray(8) for n in (3, 4, 7, 19, 24)})
    for number in (3, 4, 7, 19, 24, 10, 12):
        assert plc.load(table(1, [tx(number, 0, 1, 16)], []))[0] == ACTIVE, number
    for start, error in ((16380, 0), (16381, 6)):
        status = plc.load(table(1, [tx(0, start, 4, 16, area=0x83)], []))
        assert status[:2] == ((ACTIVE, 0) if not error else (REFUSED, error))
    plc.machine.protected.add(10)
    assert plc.load(table(1, [tx(10, 0, 4, 16)], [rx(4, 10, 0, 4)]))[:3] == (REFUSED, 5, 1)
