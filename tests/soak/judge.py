"""Says whether what was seen may be. Knows neither sockets nor clocks: it is told what happened, and when.

Values are made such that they show what is wrong with them:

- The PLC's block has a magic word and the number of the block in many places. A record must show a number that
  the PLC has sent, and all its bytes must be of one block.
- A setpoint is a number that was never put before, twice in one value, with the number of its record. So the PLC's
  log shows what is torn, out of order, old or nobody's.
"""
import bisect
import collections
import re
import struct

MAGIC = 0x5AA5C33C
PROBE = 64       # bytes
KEPT = 4000      # blocks that are remembered
ELEMENTS = 8


class Wrong(Exception):
    """kind: lost, doubled, torn, stale, wrong, grown, stuck."""

    def __init__(self, kind, text):
        super().__init__(f"{kind}: {text}")
        self.kind = kind


class Patience:
    """How long to wait for what must come: `limit` s of a machine that keeps up. Time in which its threads are late by
    more than LATE is no time in which anything has to come; but MOST limits are the end of it in any case."""

    LATE = 0.2  # s: four threads on the way, and the shortest time-out is above four of it
    MOST = 10

    def __init__(self, limit, now):
        self.limit, self.begin, self.at = limit, now, now
        self.spent = self.latest = 0.0

    def over(self, now, late):
        """To be asked once a second or more often. late: by how much the machine is late now, in s."""
        if late <= self.LATE:
            self.spent += now - self.at
        self.at = now
        self.latest = max(self.latest, late)
        return self.spent > self.limit or now - self.begin > self.MOST * self.limit

    def words(self):
        return f"{self.at - self.begin:.0f} s" + (
            f" (threads were late by up to {self.latest:.1f} s)" if self.latest > self.LATE else "")


# --- Values ----------------------------------------------------------------------------------

def probe(number, order=">"):
    """The 64 bytes that a PLC shows as block `number`."""
    return struct.pack(order + "IIQ8IdII", MAGIC, number, number, *[number] * ELEMENTS,
                       float(number), 0, number)


def signals(at=0, block=""):
    """The lines of plcSim for it, from byte `at` of the block to the IOC, or of a data block ("DB11.")."""
    kinds = ((0, f"UINT32 constant {MAGIC}"), (4, "UINT32 counter"), (8, "UINT64 counter"),
             (16, f"UINT32[{ELEMENTS}] counter"), (48, "REAL64 counter"), (60, "UINT32 counter"))
    return "".join(f"signal {block}{at + offset} {kind}\n" for offset, kind in kinds)


def number_of(data, order=">"):
    """The number of the block in `data`, None where that is no whole block."""
    number = struct.unpack_from(order + "I", data, 4)[0]
    return number if bytes(data[:PROBE]) == probe(number, order) else None


class ProbeFinder:
    """Finds whole probes in a stream, wherever they begin."""

    def __init__(self, order=">", size=PROBE):
        self.order, self.size = order, size
        self.magic = struct.pack(order + "I", MAGIC)
        self.held = b""

    def feed(self, data):
        """The numbers of the probes that end in `data`."""
        found = []
        self.held += data
        while True:
            at = self.held.find(self.magic)
            if at < 0:
                self.held = self.held[-3:]
                return found
            if len(self.held) - at < self.size:
                self.held = self.held[at:]
                return found
            number = number_of(self.held[at:at + PROBE], self.order)
            if number is None:
                self.held = self.held[at + 1:]
            else:
                found.append(self.what(number, self.held[at:at + self.size]))
                self.held = self.held[at + self.size:]

    def what(self, number, data):
        """What is told of a probe; data: it, and what stands behind it up to `size`."""
        return number


def setpoint(record, number):
    """The value of put `number` to output `record` (1 ... 31): exact in a double."""
    return record << 48 | number << 24 | number


def put_of(value):
    """(record, number) of a value; None: never written, which is 0. Wrong: torn, or nobody's."""
    if value == 0:
        return None
    record, high, low = value >> 48, value >> 24 & 0xFFFFFF, value & 0xFFFFFF
    if high != low or not 0 < record < 32:
        raise Wrong("torn", f"setpoint {value:#018x}: the number is {high} in one half, {low} in the other")
    return record, low


class PutFinder:
    """Finds setpoints in a stream of requests."""

    PATTERN = {">": re.compile(rb"\x00([\x01-\x1f])(...)\2", re.S),
               "<": re.compile(rb"(...)\1([\x01-\x1f])\x00", re.S)}

    def __init__(self, order=">"):
        self.order = order
        self.held = b""

    def feed(self, data):
        """The (record, number) whose last byte is in `data`; number 0 is none."""
        self.held += data
        found, end = [], 0
        for match in self.PATTERN[self.order].finditer(self.held):
            value = int.from_bytes(match.group(0), "big" if self.order == ">" else "little")
            if value & 0xFFFFFF:
                found.append((value >> 48, value & 0xFFFFFF))
                end = match.end()
        self.held = self.held[max(end, len(self.held) - 7):]
        return found


# --- Inputs ----------------------------------------------------------------------------------

class Inputs:
    """What inputs may show. Times in seconds, any clock that never goes back.

    timeout: a value older than this has an alarm.
    """

    def __init__(self, timeout):
        self.timeout = timeout
        self.times, self.numbers = collections.deque(maxlen=KEPT), collections.deque(maxlen=KEPT)
        self.ends = collections.deque(maxlen=100)
        self.loose = []   # (from, to): what came may not be usable; to None: still
        self.blind = []   # (from, to): the IOC stands still
        self.closed = None  # since when there is no connection by which blocks come
        self.last_seen = {}
        self.judged = 0

    # What happened on the wire

    def delivered(self, now, number):
        self.times.append(now)
        self.numbers.append(number)
        self.closed = None

    def ended(self, now):
        """The IOC was told that its only connection has ended."""
        self.closed = self.closed or now

    @staticmethod
    def _begin(spans, now):
        spans.append([now, None])
        del spans[:-50]

    def begins(self, what, now):
        """what: "loose" or "blind"."""
        self._begin(getattr(self, what), now)

    def over(self, what, now):
        for span in getattr(self, what):
            if span[1] is None:
                span[1] = now

    def _within(self, spans, begin, end):
        return any(a <= end and (b is None or b >= begin) for a, b in spans)

    def forget(self):
        """Another IOC: what the clients saw of the one before means nothing."""
        self.last_seen.clear()

    # What was seen

    def read_at(self, time):
        """When the IOC has read what came at that time: one that stood still did so afterwards."""
        return next((end for begin, end in reversed(self.blind) if end is not None and begin <= time <= end), time)

    def got(self, name, t0, t1, number, invalid, slack):
        """A client asked from t0 to t1 and got block `number`. slack: for the machine, in s."""
        if self._within(self.blind, t0 - slack, t1) or invalid:
            return
        self.judged += 1
        times, numbers = list(self.times), list(self.numbers)
        if number not in numbers:
            raise Wrong("wrong", f"{name} shows block {number}, which the PLC has not sent; "
                                 f"the last ones: {numbers[-5:]}")
        known = bisect.bisect_right(times, t0 - slack) - 1  # that one the IOC must have
        newest = self.read_at(times[known]) if known >= 0 else 0.0
        if known >= 0 and known == len(times) - 1 and t0 - newest > self.timeout + slack:
            raise Wrong("stale", f"{name} has no alarm with block {number}, {t0 - newest:.2f} s after the last block")
        if self.closed and t0 - self.closed > slack and (known < 0 or newest < self.closed):
            raise Wrong("stale", f"{name} has no alarm {t0 - self.closed:.2f} s after the connection's end")
        first = max(known, 0)
        if self._within(self.loose, t0 - slack - self.timeout, t1):
            first = max(bisect.bisect_left(times, t0 - slack - 2 * self.timeout), 0)
        if number not in numbers[first:]:
            age = t0 - times[len(numbers) - 1 - numbers[::-1].index(number)]
            raise Wrong("stale", f"{name} shows block {number} of {age:.2f} s ago, not {numbers[first:][:5]} ...")

    def event(self, client, number):
        """A monitor: events come in the order of blocks."""
        self.judged += 1
        numbers = list(self.numbers)
        if number not in numbers:
            raise Wrong("wrong", f"{client} was told block {number}, which the PLC has not sent; "
                                 f"the last ones: {numbers[-5:]}")
        before = self.last_seen.get(client)
        self.last_seen[client] = number
        if before is None or before == number or before not in numbers:
            return
        if number not in numbers[numbers.index(before):]:
            raise Wrong("doubled", f"{client} was told block {number} after block {before}")


def whole(name, elements):
    """All elements of an array are of one block; returns its number."""
    if len(set(elements)) != 1:
        raise Wrong("torn", f"{name} has parts of several blocks: {list(elements)}")
    return int(elements[0])


# --- Outputs ---------------------------------------------------------------------------------

class Outputs:
    """What the PLC may get. acknowledged: over a wire with answers each put is written once a connection."""

    def __init__(self, acknowledged=False):
        self.acknowledged = acknowledged
        self.refusing = False  # the PLC says no to some: those may come again
        self.number = 70000  # small numbers are in any stream
        self.puts = {}    # record -> numbers put to this IOC, in their order
        self.last = {}    # record -> number that the PLC has got last
        self.line = {}    # record -> by which connection
        self.sent_at = {}
        self.latencies = []
        self.judged = 0

    def new_ioc(self):
        """Another IOC holds nothing."""
        self.puts = {}

    def put(self, record, now=0.0):
        """The value of the next put to this record."""
        self.number += 1
        self.puts.setdefault(record, []).append(self.number)
        self.sent_at[record, self.number] = now
        return setpoint(record, self.number)

    def got(self, record, number, line=0, now=0.0):
        """The PLC got put `number` by connection `line`."""
        self.judged += 1
        last = self.last.get(record, 0)
        if number > self.number:
            raise Wrong("wrong", f"output {record}: the PLC got put {number}, which nobody made")
        if number < last:
            raise Wrong("doubled", f"output {record}: the PLC got put {number} after {last}")
        if number == last and self.acknowledged and not self.refusing and self.line.get(record) == line:
            raise Wrong("doubled", f"output {record}: the PLC got put {number} twice by one connection")
        if number != last and (record, number) not in self.sent_at:
            raise Wrong("wrong", f"output {record}: the PLC got put {number}, which was another record's")
        self.last[record], self.line[record] = number, line
        if (record, number) in self.sent_at and now and number != last:
            self.latencies.append(now - self.sent_at[record, number])
        for key in [k for k in self.sent_at if k[0] == record and k[1] < number]:
            del self.sent_at[key]

    def got_block(self, values, line=0, now=0.0):
        """The PLC got a block with these values in it, one for each record 1, 2 ..."""
        for record, value in enumerate(values, 1):
            put = put_of(value)
            if put is None:
                if self.puts.get(record) and self.last.get(record, 0) >= self.puts[record][0]:
                    raise Wrong("lost", f"output {record}: the PLC got 0 after put {self.last[record]}")
            elif put[0] != record:
                raise Wrong("wrong", f"output {record}: the PLC got a value of output {put[0]}")
            elif put[1] != self.last.get(record):
                self.got(record, put[1], line, now)

    def acknowledged_put(self, record, number):
        """A put ended without alarm over a wire with answers."""
        if self.last.get(record, 0) < number:
            raise Wrong("lost", f"output {record}: put {number} was acknowledged, the PLC has "
                                f"{self.last.get(record)}")

    def quiet(self, record, held=None):
        """All is well for a while: the last put is there."""
        wanted = self.puts.get(record, [None])[-1]
        has = self.last.get(record) if held is None else held
        if wanted is not None and has != wanted:
            raise Wrong("lost", f"output {record}: put {wanted} was the last, the PLC has {has}")


class Held:
    """Setpoints of a PLC with the handshake: who puts and who moves them at the HMI share one row of numbers, so
    what the PLC holds only rises. A put that was refused never gets there."""

    def __init__(self):
        self.number = self.floor = 70000  # small numbers are in any stream
        self.last = {}
        self.refused = set()
        self.made = {}  # number -> (record, who)
        self.judged = 0

    def new(self, record, who):
        self.number += 1
        self.made[self.number] = (record, who)
        for old in [n for n in self.made if n < self.number - 5000]:
            del self.made[old]
        return setpoint(record, self.number)

    def memory_lost(self):
        """The PLC has zeros: nothing of before may come back."""
        self.last.clear()
        self.floor = self.number

    def refuse(self, number):
        """The IOC said no to this put."""
        if number in (self.last.get(r) for r in self.last):
            raise Wrong("wrong", f"put {number} was refused, and the PLC holds it")
        self.refused.add(number)

    def shows(self, record, value):
        """The PLC shows this setpoint as held."""
        self.judged += 1
        put = put_of(value)
        last = self.last.get(record, 0)
        if put is None:
            if last:
                raise Wrong("lost", f"setpoint {record}: 0 after {last}")
            return
        if put[0] != record:
            raise Wrong("wrong", f"setpoint {record}: the PLC holds a value of {put[0]}")
        number = put[1]
        if number == last:
            return
        if number < max(last, self.floor):
            raise Wrong("doubled", f"setpoint {record}: {number} ({self.who(number)}) after {last} ({self.who(last)})")
        if number in self.refused:
            raise Wrong("wrong", f"setpoint {record}: put {number} was refused, and the PLC holds it")
        if self.made.get(number, (None,))[0] != record:
            raise Wrong("wrong", f"setpoint {record}: nobody made {number}")
        self.last[record] = number

    def who(self, number):
        return self.made.get(number, (0, "of long ago"))[1]
