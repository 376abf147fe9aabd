"""PLCs that flood, stutter, babble, vanish or cut the line, and an IOC that stays calm.

Each case is a short run. With PLCLINK_LONG=1 in the environment it lasts a minute, or goes
through all there is. Figures measured on the way are printed (pytest -rP).
"""
import os
import random
import re
import selectors
import socket
import struct
import sys
import threading
import time

import epics
import pytest

from waiting import LIMIT, until

LONG = bool(os.environ.get("PLCLINK_LONG"))
SECONDS = 60 if LONG else 3

# Memory may grow by so much, MiB: buffers that fill once. A leak at these rates shows more.
FLAT_MIB = 24
# Answers to caget and dbior; generous, they take milliseconds.
INSTANT = 3.0
# "A handful" of lines about one PLC.
HANDFUL = 10

# Processed by the 0.1 s scan thread, with records of the PLC around it: stands still when
# anyone makes that thread wait.
TICKS = """
record(longin, "$(P)scanned")  { field(DTYP, "S7plc") field(INP, "@PLC/0 T=INT32") field(SCAN, ".1 second") }
record(ao, "$(P)written")      { field(DTYP, "S7plc") field(OUT, "@PLC/4 T=REAL32") field(SCAN, ".1 second")
    field(OMSL, "closed_loop") field(DOL, "$(P)ticks NPP") }
record(calc, "$(P)ticks")      { field(CALC, "VAL+1") field(SCAN, ".1 second") }
record(bi, "$(P)stat")         { field(DTYP, "S7plc stat") field(INP, "@PLC") field(SCAN, "I/O Intr") field(ZNAM, "off") field(ONAM, "on") }
"""
BASICS = TICKS + """
record(longin, "$(P)in")       { field(DTYP, "S7plc") field(INP, "@PLC/0 T=INT32") field(SCAN, "I/O Intr") }
record(longout, "$(P)out")     { field(DTYP, "S7plc") field(OUT, "@PLC/0 T=INT32") }
"""


# --- what the tests look at -------------------------------------------------------------------

def resident(ioc):
    """Memory that the IOC occupies, MiB."""
    with open(f"/proc/{ioc.process.pid}/status") as status:
        return next(int(line.split()[1]) for line in status if line.startswith("VmRSS")) / 1024


def driver_lines(ioc):
    """What the driver said at run time: lines "s7plc PLC: ..." ."""
    return [line for line in ioc.log.splitlines() if re.search(r"s7plc PLC\w*: ", line)]


def assert_calm(ioc, lines=HANDFUL):
    """No message of an overflow, and few lines about the PLC."""
    # lines of a report begin with a blank
    text = [line for line in ioc.log.lower().splitlines() if not line.startswith(" ")]
    for word in ("callbackrequest", "ring buffer", "overflow", "queue", "discarded", "lost"):
        found = [line for line in text if word in line]
        assert not found, found[:5]
    assert len(driver_lines(ioc)) <= lines, "\n".join(driver_lines(ioc))


def counter(ioc, name, plc="PLC"):
    """A number of s7plcReport: counter(ioc, "skipped")."""
    report = ioc.command(f"s7plcReport {plc} 1")
    if name == "blocks in":
        return int(re.search(r"in: +(\d+) blocks", report)[1])
    return int(re.search(rf"(\d+) {name}", report)[1])


class Watch:
    """Looks again and again whether the IOC is alive: answers, ticks, memory."""

    def __init__(self, ioc):
        self.ioc = ioc
        self.slowest_get = self.slowest_report = 0.0
        self.ticks = ioc.get("ticks")
        self.begin = time.monotonic()
        self.memory = None

    def look(self):
        begin = time.monotonic()
        self.ioc.get("ticks")
        middle = time.monotonic()
        self.ioc.command("dbior")
        self.slowest_get = max(self.slowest_get, middle - begin)
        self.slowest_report = max(self.slowest_report, time.monotonic() - middle)
        self.memory = self.memory or resident(self.ioc)

    def during(self, seconds, what=lambda: None):
        """Looks for so long; what() is done each time."""
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            self.look()
            what()
            time.sleep(0.05)  # the pace of the looks

    def check(self):
        """Nobody waited, nothing grew. Prints the figures."""
        self.look()
        ticks = self.ioc.get("ticks") - self.ticks
        expected = 10 * (time.monotonic() - self.begin)
        growth = resident(self.ioc) - self.memory
        print(f"caget {self.slowest_get * 1e3:.1f} ms, dbior {self.slowest_report * 1e3:.1f} ms "
              f"at most; {ticks:.0f} of {expected:.0f} ticks; memory {growth:+.1f} MiB")
        assert self.slowest_get < INSTANT and self.slowest_report < INSTANT
        assert ticks > 0.5 * expected - 5
        assert growth < FLAT_MIB


class Monitor:
    """Every value that a CA client sees of a record, with its severity."""

    def __init__(self, ioc, name):
        self.seen = []
        self.pv = epics.PV(ioc.P + name, form="time", callback=self.take)
        assert self.pv.wait_for_connection(LIMIT)

    def take(self, value=None, severity=None, **_):
        self.seen.append((value, severity))

    def good(self):
        """The values that were not INVALID."""
        return [value for value, severity in self.seen if severity < 3]

    def close(self):
        self.pv.disconnect()


@pytest.fixture
def monitor(closing):
    def make(ioc, name):
        it = Monitor(ioc, name)
        closing(it)
        return it
    return make


# --- flood --------------------------------------------------------------------------------------

def thousand():
    """1,000 I/O Intr records in a block of 64 bytes."""
    kinds = [("ai", "INT16"), ("longin", "UINT32"), ("ai", "REAL32"), ("bi", "UINT8"),
             ("mbbi", "UINT16"), ("longin", "INT8"), ("ai", "REAL64")]
    return "".join(
        f'record({kind}, "$(P)r{n}") {{ field(DTYP, "S7plc") field(SCAN, "I/O Intr") '
        f'field(INP, "@PLC/{n % 57} T={data}{" B=0" if kind == "bi" else ""}") }}\n'
        for n, (kind, data) in ((n, kinds[n % len(kinds)]) for n in range(1000)))


FLOOD_SIM = """
in = 64
out = 64
period = 10 ms
signal 0 INT32 counter
signal 4 REAL32[15] noise -100 100
"""


@pytest.mark.parametrize("option", ["", "scan=changed", "wholeBlock=on"])
def test_flood(new_sim, new_ioc, option):
    """a PLC that floods 1,000 I/O Intr records ({option}) leaves the IOC calm and up to date"""
    sim = new_sim(FLOOD_SIM)
    key, _, value = option.partition("=")
    ioc = new_ioc(f's7plcConfigure("PLC", "127.0.0.1", {sim.port}, 64, 64, 1, 2000, 20)\n'
                  + (f's7plcSetOption("PLC", "{key}", "{value}")' if key else ""),
                  BASICS + thousand())
    ioc.wait_alarm("in", "NO_ALARM")
    sim.command("flood")
    begin, blocks = time.monotonic(), counter(ioc, "blocks in")
    watch = Watch(ioc)
    puts = iter(range(1, 1000000))

    def put():
        number = next(puts)
        ioc.put("out", number)
        until(lambda: int(sim.command("get out 0 INT32").split()[-1], 0) == number,
              lambda: f"put {number} in the PLC; it has {sim.command('get out 0 INT32')}")
    watch.during(SECONDS, put)
    blocks = counter(ioc, "blocks in") - blocks
    rate = blocks / (time.monotonic() - begin)
    watch.check()
    sim.command("flood off")
    sim.command("silence")
    newest = int(sim.command("get in 0 INT32").split()[-1], 0)
    ioc.wait_value("in", newest)
    skipped, coalesced = counter(ioc, "skipped"), counter(ioc, "coalesced")
    print(f"{blocks} blocks, {rate:.0f} per second, {skipped} skipped, {coalesced} coalesced, "
          f"{next(puts) - 1} puts")
    assert skipped + coalesced > 0.2 * blocks
    assert_calm(ioc)


# --- what is no block -----------------------------------------------------------------------------

def test_trickle(new_peer, new_ioc, monitor):
    """a PLC that sends a byte now and then is INVALID, and said so in few words"""
    period, timeout = (1.0, 2000) if LONG else (0.1, 200)
    peer = new_peer(64, 64)
    ioc = new_ioc(peer.configure(recv_timeout=timeout), BASICS)
    values = monitor(ioc, "in")
    peer.wait_connected()
    peer.every(period, b"\x55")
    watch = Watch(ioc)
    watch.during(SECONDS)
    ioc.wait_alarm("scanned", "INVALID", "COMM")
    reason = ioc.command("s7plcReport PLC 1")
    assert f"last error: no block for {timeout / 1000:.1f} s" in reason, reason
    watch.check()
    assert not values.good()
    assert_calm(ioc)
    peer.every(0.02, struct.pack(">i", 7) + bytes(60))
    ioc.wait_value("in", 7)
    ioc.wait_alarm("in", "NO_ALARM")


def test_short_blocks(new_peer, new_ioc, monitor):
    """60 bytes where 64 are configured: AMSG names both, and no sliding value is shown"""
    peer = new_peer(64, 64)
    ioc = new_ioc(peer.configure(), BASICS)
    values = monitor(ioc, "in")
    peer.wait_connected()
    peer.every(0.02, struct.pack(">i", 7) + bytes([0xEE] * 56))
    ioc.wait_alarm("scanned", "INVALID", "COMM", "PLC sends 60 bytes, inSize is 64")
    watch = Watch(ioc)
    watch.during(SECONDS)
    assert ioc.alarm("scanned") == ("INVALID", "COMM", "PLC sends 60 bytes, inSize is 64")
    watch.check()
    assert set(values.good()) <= {7}, values.good()
    assert_calm(ioc)
    peer.every(0.02, struct.pack(">i", 8) + bytes(60))
    ioc.wait_value("in", 8)
    ioc.wait_alarm("in", "NO_ALARM")


def test_size_changes(new_peer, new_ioc, monitor):
    """a PLC whose blocks shrink from 64 to 60 bytes is found out within a few of them"""
    peer = new_peer(64, 64)
    ioc = new_ioc(peer.configure(), BASICS)
    values = monitor(ioc, "in")
    peer.wait_connected()
    peer.every(0.02, struct.pack(">i", 7) + bytes([0xEE] * 60))
    ioc.wait_value("in", 7)
    peer.every(0.02, struct.pack(">i", 7) + bytes([0xEE] * 56))
    ioc.wait_alarm("scanned", "INVALID", "COMM", "PLC sends 60 bytes, inSize is 64")
    sliding = [value for value in values.good() if value != 7]
    print(f"{len(sliding)} sliding values before the size was known")
    assert len(sliding) <= 3, sliding
    assert_calm(ioc)


def babble(seed):
    dice = random.Random(seed)
    return lambda: dice.randbytes(dice.choice([1, 2, 3, 7, 30, 63, 65, 100, 200, 1000]))


def test_babble(new_peer, new_ioc):
    """random bytes in random pieces are told to be no blocks of the configured size"""
    peer = new_peer(64, 64)
    ioc = new_ioc(peer.configure(), BASICS)
    peer.wait_connected()
    peer.every(0.005, babble(1))
    ioc.wait_alarm("scanned", "INVALID", "COMM", "PLC sends ", limit=max(LIMIT, SECONDS))
    watch = Watch(ioc)
    watch.during(SECONDS)
    watch.check()
    assert_calm(ioc)
    peer.every(0.02, struct.pack(">i", 8) + bytes(60))
    ioc.wait_value("in", 8)
    ioc.wait_alarm("in", "NO_ALARM")


EVERYTHING = BASICS + "".join(
    f'record({kind}, "$(P)x{n}") {{ field(DTYP, "S7plc") field(SCAN, "I/O Intr") '
    f'field(INP, "@PLC/{where}") {more} field(TSE, "-2") }}\n'
    for n, (kind, where, more) in enumerate([
        ("ai", "0 T=REAL32", 'field(ADEL, "1") field(SMOO, "0.5")'),
        ("ai", "0 T=REAL64", 'field(LINR, "LINEAR") field(EGUF, "10") field(EGUL, "-1")'),
        ("ai", "0 T=INT16 L=0 H=100", 'field(LINR, "typeKdegF")'),
        ("ai", "0 T=UINT64", ""), ("longin", "0 T=INT8", ""), ("int64in", "0 T=INT64", ""),
        ("bi", "0 T=UINT32 B=31", ""), ("mbbi", "0 T=UINT16", 'field(NOBT, "5") field(SHFT, "2")'),
        ("mbbiDirect", "0 T=UINT16", ""), ("stringin", "0 L=40", ""), ("lsi", "0 L=64", 'field(SIZV, "100")'),
        ("waveform", "0 T=TIME", 'field(FTVL, "CHAR") field(NELM, "8")'),
        ("waveform", "0 T=STRING", 'field(FTVL, "CHAR") field(NELM, "64")'),
        ("waveform", "0", 'field(FTVL, "DOUBLE") field(NELM, "8")'),
        ("aai", "0 T=INT16", 'field(FTVL, "FLOAT") field(NELM, "32")'),
        ("calcout", "0 T=UINT8", ""),
    ]) if kind != "calcout")


def test_random_content(new_peer, new_ioc):
    """blocks of the right size with random content do no harm to any record type"""
    peer = new_peer(64, 64)
    dice = random.Random(3)
    ioc = new_ioc(peer.configure() + '\ns7plcSetOption("PLC", "timestamp", "40")\n'
                  's7plcSetOption("PLC", "alive", "60")', EVERYTHING)
    peer.wait_connected()
    peer.every(0.001, lambda: dice.randbytes(64))
    ioc.wait_alarm("in", "NO_ALARM")
    watch = Watch(ioc)
    watch.during(SECONDS)
    watch.check()
    assert counter(ioc, "blocks in") > 100
    assert_calm(ioc)
    peer.every(0.02, lambda: struct.pack(">i", 8) + bytes(56) + dice.randbytes(4))
    ioc.wait_value("in", 8)
    ioc.wait_alarm("in", "NO_ALARM")


# --- nobody there ---------------------------------------------------------------------------------

def test_black_hole(black_hole, new_ioc):
    """with a PLC address that swallows packets no thread of the IOC waits for it"""
    ioc = new_ioc(f's7plcConfigure("PLC", "127.0.0.1", {black_hole.port}, 64, 64, 1, 2000, 100)',
                  BASICS)
    watch = Watch(ioc)
    numbers = iter(range(1, 1000000))
    watch.during(SECONDS, lambda: ioc.put("out", next(numbers)))
    ioc.wait_alarm("scanned", "INVALID", "COMM", "PLC does not answer")
    watch.check()
    assert_calm(ioc)


@pytest.fixture
def silent_dns(need_root, tmp_path):
    """A command prefix under which no name server answers; it takes 4 s to find that out."""
    server = socket.socket(type=socket.SOCK_DGRAM)
    try:
        server.bind(("127.0.0.99", 53))
    except OSError as error:
        pytest.skip(f"port 53 of 127.0.0.99: {error}")
    conf = tmp_path / "resolv.conf"
    conf.write_text("nameserver 127.0.0.99\noptions timeout:2 attempts:2\n")
    yield ["unshare", "-m", "sh", "-c", f'mount --bind {conf} /etc/resolv.conf && exec "$@"', "sh"]
    server.close()


def no_name(new_ioc, prefix):
    return new_ioc('s7plcConfigure("PLC", "plc.example.org", 2000, 64, 64, 1, 2000, 100)', BASICS,
                   wrapper=prefix)


def test_dns(silent_dns, new_ioc):
    """with a name server that does not answer no thread of the IOC waits for it"""
    ioc = no_name(new_ioc, silent_dns)
    watch = Watch(ioc)
    numbers = iter(range(1, 1000000))
    watch.during(SECONDS, lambda: ioc.put("out", next(numbers)))
    watch.check()
    ioc.wait_alarm("scanned", "INVALID", "COMM", 'no address for host "plc.example.org"')
    assert_calm(ioc)


def test_power_cycles(new_peer, new_ioc):
    """a PLC that is power-cycled again and again is back at once each time"""
    cycles = 50 if LONG else 10
    dice = random.Random(5)
    peer = new_peer(64, 64)
    ioc = new_ioc(peer.configure(), BASICS)
    peer.wait_connected()
    watch = Watch(ioc)
    back = []
    for number in range(1, cycles + 1):
        peer.power_off()
        ioc.wait_value("stat", 0)
        watch.during(dice.uniform(0, 1.4 if LONG else 0.4))
        count = len(peer.connections)
        begin = time.monotonic()
        peer.power_on()
        peer.wait_connected(count + 1)
        back.append(time.monotonic() - begin)
        peer.send(struct.pack(">i", number) + bytes(60))
        ioc.wait_value("in", number)
        ioc.wait_alarm("in", "NO_ALARM")
    watch.check()
    print(f"back after {sorted(back)[len(back) // 2] * 1e3:.0f} ms (median), "
          f"{max(back) * 1e3:.0f} ms (longest) of {cycles}")
    assert max(back) < 5
    # Cycles are real events; each has its line or is counted.
    assert_calm(ioc, lines=25)


# --- many --------------------------------------------------------------------------------------

class Many:
    """PLCs that each send `count` blocks of 400 bytes at 10 per second. One thread."""

    def __init__(self, number, count):
        self.listeners = [socket.create_server(("127.0.0.1", 0)) for _ in range(number)]
        self.ports = [listener.getsockname()[1] for listener in self.listeners]
        self.sockets, self.count, self.sent = {}, count, 0
        self.go, self.stop = threading.Event(), threading.Event()
        self.thread = threading.Thread(target=self.run, daemon=True)
        self.thread.start()

    def run(self):
        selector = selectors.DefaultSelector()
        for n, listener in enumerate(self.listeners):
            selector.register(listener, selectors.EVENT_READ, n)
        while not self.stop.is_set() and not self.go.is_set():
            for key, _ in selector.select(0.1):
                self.sockets[key.data] = key.fileobj.accept()[0]
        begin = time.monotonic()
        while self.sent < self.count and not self.stop.wait(
                max(0, begin + self.sent / 10 - time.monotonic())):
            for n, sock in self.sockets.items():
                sock.sendall(struct.pack(">ii", self.sent + 1, n) + bytes(392))
            self.sent += 1

    def close(self):
        self.stop.set()
        self.thread.join()
        for sock in [*self.listeners, *self.sockets.values()]:
            sock.close()


def test_many(new_ioc, closing):
    """100 stations of 100 records at 10 blocks/s each: every block is seen"""
    blocks = 10 * SECONDS
    many = Many(100, blocks)
    closing(many)
    configure = "\n".join(
        f's7plcConfigure("PLC{n}", "127.0.0.1", {port}, 400, 4, 1, 60000, 100)'
        for n, port in enumerate(many.ports))
    db = "".join(
        f'record(longin, "$(P)s{n}r{r}") {{ field(DTYP, "S7plc") field(SCAN, "I/O Intr") '
        f'field(INP, "@PLC{n}/{4 * r} T=INT32") }}\n' for n in range(100) for r in range(100))
    ioc = new_ioc(configure, db)
    until(lambda: len(many.sockets) == 100, lambda: f"{len(many.sockets)} of 100 connections")
    begin = ioc.cpu_seconds()
    many.go.set()
    many.thread.join(SECONDS + LIMIT)
    cpu = (ioc.cpu_seconds() - begin) / (SECONDS or 1)

    def seen():
        return re.findall(r"in: +(\d+) blocks", ioc.command("s7plcReport"))
    counts = until(lambda: [c for c in [seen()] if set(c) == {str(blocks)}],
                   lambda: f"{blocks} blocks each; seen {sorted(set(seen()))}")[0]
    assert len(counts) == 100
    assert [ioc.get(f"s{n}r0") for n in (0, 50, 99)] == [blocks] * 3
    assert [ioc.get(f"s{n}r1") for n in (0, 50, 99)] == [0, 50, 99]
    print(f"{100 * blocks} blocks seen, {100 * cpu:.1f} % of a core")
    assert_calm(ioc, lines=HANDFUL + 100)  # one each: connected


MANY_FILES = """
import os, resource, sys
soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
resource.setrlimit(resource.RLIMIT_NOFILE, (min(hard, 4096), hard))
for _ in range(1100):
    os.set_inheritable(os.open("/dev/null", os.O_RDONLY), True)
os.execv(sys.argv[1], sys.argv[1:])
"""


def test_descriptors(new_peer, new_ioc):
    """with 1,100 open descriptors before the first connect all works"""
    import resource
    if resource.getrlimit(resource.RLIMIT_NOFILE)[1] < 1500:
        pytest.skip("the limit of open files is too low")
    peer = new_peer(64, 64)
    ioc = new_ioc(peer.configure(), BASICS, wrapper=[sys.executable, "-c", MANY_FILES])
    peer.wait_connected()
    files = os.listdir(f"/proc/{ioc.process.pid}/fd")
    assert max(map(int, files)) > 1100
    peer.send(struct.pack(">i", 5) + bytes(60))
    ioc.wait_value("in", 5)
    ioc.put("out", 6)
    peer.wait_block(lambda block: block[:4] == b"\0\0\0\x06")
    peer.hang_up()
    peer.wait_connected(2)
    peer.send(struct.pack(">i", 7) + bytes(60))
    ioc.wait_value("in", 7)


# --- cut while sending ------------------------------------------------------------------------------

def uniform(size):
    """One record that sets all bytes of a block: a spliced one has two values in it."""
    return f"""
record(aao, "$(P)all") {{ field(DTYP, "S7plc") field(OUT, "@PLC/0 T=UINT8") field(FTVL, "UCHAR") field(NELM, "{size}") }}
"""


def whole(peer):
    """The value of each whole block of each connection; fails when two are in one."""
    values = []
    for number, connection in enumerate(peer.connections):
        for block in connection.blocks():
            assert len(set(block)) == 1, f"connection {number}: spliced {sorted(set(block))}"
            values.append(block[0])
    return values


def cut(ioc, peer, size, value, at):
    """Puts `value`; the connection breaks when `at` bytes of the next block have come. The
    value must be there in the end, in a whole block."""
    connection, count = peer.connection, len(peer.connections)
    peer.cut_after = len(connection.received) + at
    ioc.put("all", [value] * size)
    until(lambda: connection.ended, "the cut")
    assert len(connection.received) % size == at % size
    peer.wait_connected(count + 1)
    peer.wait_block(bytes([value]) * size)


def test_cut(new_peer, new_ioc):
    """cut at any byte of a send of 64, the PLC gets the last value and no spliced block"""
    peer = new_peer(0, 64)
    ioc = new_ioc(peer.configure(send_interval=1), uniform(64))
    peer.wait_connected()
    places = range(1, 65) if LONG else (1, 2, 31, 33, 63, 64)
    for at in places:
        cut(ioc, peer, 64, at, at)
    assert set(whole(peer)) == set(places)
    assert_calm(ioc, lines=25)


def test_cut_partial(new_peer, new_ioc):
    """cut while half of a 64 KiB block waits in the IOC, too"""
    size = 65536
    dice = random.Random(9)
    peer = new_peer(0, size, receive_buffer=2048)
    ioc = new_ioc(peer.configure(send_interval=1), uniform(size))
    peer.wait_connected()
    for value in range(1, 41 if LONG else 7):
        cut(ioc, peer, size, value, dice.choice([1, 2048, 2049, 8192, 65535,
                                                 dice.randrange(1, size)]))
    whole(peer)
    assert_calm(ioc, lines=25)


def break_off(connection, hard):
    """FIN or RST, unless the last one is still in force."""
    if not connection.ended:
        connection.reset() if hard else connection.close()


def test_puts_while_cut(new_peer, new_ioc):
    """puts without pause while the line breaks again and again: the last one arrives"""
    peer = new_peer(0, 64)
    ioc = new_ioc(peer.configure(send_interval=1), uniform(64))
    peer.wait_connected()
    dice = random.Random(11)
    end = time.monotonic() + SECONDS
    value = 0
    while time.monotonic() < end:
        value = value % 250 + 1
        ioc.put("all", [value] * 64)
        if dice.random() < 0.05:
            break_off(peer.connection, dice.random() < 0.5)
    ioc.put("all", [255] * 64)
    peer.wait_block(b"\xff" * 64)
    print(f"{len(peer.connections)} connections, {len(whole(peer))} blocks")


# --- exit -----------------------------------------------------------------------------------------

def exits(ioc):
    """Exit status 0, within seconds."""
    begin = time.monotonic()
    status = ioc.exit()
    seconds = time.monotonic() - begin
    print(f"exit took {seconds:.2f} s")
    assert status == 0, ioc.log
    assert seconds < 10


def test_exit_black_hole(black_hole, new_ioc):
    """exit while the connect is not answered"""
    ioc = new_ioc(f's7plcConfigure("PLC", "127.0.0.1", {black_hole.port}, 64, 64, 1, 2000, 100)',
                  BASICS)
    ioc.wait_alarm("scanned", "INVALID", "COMM")
    exits(ioc)


def test_exit_refused(new_peer, new_ioc):
    """exit while the PLC refuses"""
    peer = new_peer(64, 64)
    peer.power_off()
    ioc = new_ioc(peer.configure(), BASICS)
    ioc.wait_alarm("scanned", "INVALID", "COMM", "refused")
    exits(ioc)


@pytest.mark.parametrize("option", ["", "wholeBlock", "track"])
def test_exit_flood(new_sim, new_ioc, option):
    """exit while the PLC floods 1,000 records ({option})"""
    sim = new_sim(FLOOD_SIM)
    ioc = new_ioc(f's7plcConfigure("PLC", "127.0.0.1", {sim.port}, 64, 64, 1, 2000, 20)\n'
                  + (f's7plcSetOption("PLC", "{option}", "on")' if option else ""),
                  BASICS + thousand())
    ioc.wait_alarm("in", "NO_ALARM")
    sim.command("flood")
    blocks = counter(ioc, "blocks in")
    until(lambda: counter(ioc, "blocks in") > blocks + 1000, "the flood")
    exits(ioc)


def test_exit_half_sent(new_peer, new_ioc):
    """exit while half of a block is with a PLC that reads no more"""
    size = 65536
    peer = new_peer(0, size, receive_buffer=2048)
    ioc = new_ioc(peer.configure(send_interval=1), uniform(size))
    peer.wait_connected()
    peer.reading.clear()
    value, stuck = 0, 0
    while stuck < 50:
        value = value % 250 + 1
        ioc.put("all", [value] * size)
        sent = re.search(r"out: (\d+) blocks", ioc.command("s7plcReport PLC 1"))[1]
        stuck = stuck + 1 if value > 1 and sent == before else 0
        before = sent
    exits(ioc)


def test_exit_waiting(new_peer, new_ioc):
    """exit while the first block is awaited"""
    peer = new_peer(64, 64)
    ioc = new_ioc(peer.configure(), BASICS)
    peer.wait_connected()
    exits(ioc)


def test_exit_dns(silent_dns, new_ioc):
    """exit while the name server does not answer"""
    ioc = no_name(new_ioc, silent_dns)
    exits(ioc)


# --- links ----------------------------------------------------------------------------------------

GOOD_LINKS = ["@PLC/0 T=INT32", "@PLC/4 T=REAL32", "@PLC/0+4*2 T=INT16 L=0 H=0x6c00", "@PLC/8 L=10",
              "@PLC/2 T=UINT16 B=3", "@PLC/10", "@PLC/4+'8' T=UINT8"]
BROKEN_LINKS = ["@", "@PLC/-1", "@PLC/64", "@PLC/999999999999999999999", "@NOPLC/0",
                "@PLC/0 T=", "@PLC/0 T=INT3", "@PLC/0 T=REAL64 T", "@PLC/0 B=99", "@PLC/0 L=", "@PLC/1+x",
                "@PLC/0x", "@PLC/0 H=0x", "@/0", "@ ", "@PLC 0", "@PLC/0 ='", "@PLC/'0", "@PLC/0 " + "T=INT16 " * 40,
                "@PLC/" + "1+" * 500 + "1", "@" + "P" * 1000 + "/0", "@PLC/0 L=2147483648 H=1e999"]


def bad_links(count):
    """Link texts: hand-made ones, then mutations of good ones and noise. Some may be valid."""
    dice = random.Random(7)
    noise = "@/+-*='  TLHBRPxX0123456789INT16UREALSTRG.,;:!#%&()[]{}<>?|~^_"
    texts = list(BROKEN_LINKS)
    while len(texts) < count:
        text = list(dice.choice(GOOD_LINKS))
        for _ in range(dice.randrange(1, 6)):
            what, at = dice.randrange(4), dice.randrange(len(text) or 1)
            if what == 0:
                text[at:at + 1] = []
            elif what == 1:
                text[at:at] = [dice.choice(noise)]
            elif what == 2:
                text[at:at + 1] = [dice.choice(noise)]
            else:
                text[at:at] = text[at:at + dice.randrange(20)] * dice.randrange(1, 4)
        texts.append("".join(text) if dice.random() < 0.8 else
                     "@" + "".join(dice.choices(noise, k=dice.randrange(80))))
    return texts


LINK_TYPES = [("ai", "INP", ""), ("longin", "INP", ""), ("bi", "INP", ""), ("mbbi", "INP", ""),
              ("stringin", "INP", ""), ("ao", "OUT", ""), ("longout", "OUT", ""), ("bo", "OUT", ""),
              ("stringout", "OUT", ""), ("lsi", "INP", ""), ("calcout", "OUT", ""),
              ("waveform", "INP", 'field(FTVL, "SHORT") field(NELM, "4")'),
              ("aao", "OUT", 'field(FTVL, "DOUBLE") field(NELM, "4")'),
              ("mbboDirect", "OUT", ""), ("int64in", "INP", "")]


def test_bad_links(new_peer, new_ioc):
    """1,000 malformed and random links: a message each, and the good records beside work"""
    peer = new_peer(64, 64)
    links = bad_links(1000)
    db = BASICS
    for n, text in enumerate(links):
        kind, field, more = LINK_TYPES[n % len(LINK_TYPES)]
        db += (f'record({kind}, "$(P)bad{n}.") {{ field(DTYP, "S7plc") {more} '
               f'field({field}, "{text}") }}\n')
    db = re.sub(r'(bad\d+)\.', r"\1_", db)
    ioc = new_ioc(peer.configure(), db)
    peer.wait_connected()
    peer.every(0.02, struct.pack(">i", 8) + bytes(60))
    ioc.wait_value("in", 8)
    ioc.put("out", 9)
    peer.wait_block(lambda block: block[:4] == b"\0\0\0\x09")
    log = ioc.log
    refused = [n for n in range(len(links)) if re.search(rf"{ioc.P}bad{n}_\b", log)]
    print(f"{len(refused)} of {len(links)} links refused")
    assert set(range(len(BROKEN_LINKS))) <= set(refused), \
        [BROKEN_LINKS[n] for n in set(range(len(BROKEN_LINKS))) - set(refused)]
    shown = ioc.command("\n".join(f"dbgf {ioc.P}bad{n}_.SEVR" for n in refused))
    severities = re.findall(r'"(NO_ALARM|MINOR|MAJOR|INVALID)"', shown)
    assert severities == ["INVALID"] * len(refused)
    assert "discarded" not in log and "lost" not in log
