"""Random sequences of puts from several clients into registers and coils of one Modbus device that delays,
refuses, closes and answers twice: what the device has got is what device support was given, in its order.

pymodbus's server is the judge: its log of requests, not plcSim. What device support was given is what the IOC
logs with log=io. A long run by hand, with a seed:
    PLCLINK_SEQUENCES=10000 PLCLINK_SEED=42 nice tests/run system -k random_sequences
"""
import os
import random
import re
import resource
import threading
import time
from itertools import groupby
from pathlib import Path

import pytest
from epics import ca

from ioc import SINCE_7_0_6, AnyMessage
from waiting import LIMIT, until

SEQUENCES = int(os.environ.get("PLCLINK_SEQUENCES", 60))
SEED = int(os.environ.get("PLCLINK_SEED", 1))
CLIENTS = 3
PUTS = 6                       # of a client in a sequence, at most
WORDS, COILS, BITS = 4, 3, 3   # of each owner: registers, coils, bits of a register

OWNERS = CLIENTS + 1           # the last one's records belong to all clients
OUTPUTS = f"holding 0 {OWNERS * (WORDS + 1)}, coils 50 {8 * OWNERS} at 100"
KINDS = (("w", WORDS), ("b", BITS), ("k", COILS))


def names_of(owner):
    return [f"{owner}{kind}{i}" for kind, count in KINDS for i in range(count)]


def place_of(name):
    """(table, address, bit) of a record."""
    owner, kind, n = int(name[0]), name[1], int(name[2:])
    base = owner * (WORDS + 1)
    return {"w": ("holding", base + n, None), "b": ("holding", base + WORDS, n),
            "k": ("coils", 50 + 8 * owner + n, None)}[kind]


def database():
    lines = []
    for owner in range(OWNERS):
        base = 2 * owner * (WORDS + 1)
        link = {"w": lambda i: ("longout", f"@PLC/{base + 2 * i} T=UINT16"),
                "b": lambda i: ("bo", f"@PLC/{base + 2 * WORDS} T=WORD B={i}"),
                "k": lambda i: ("bo", f"@PLC/{100 + owner} T=BYTE B={i}")}
        for name in names_of(owner):
            rtype, text = link[name[1]](int(name[2:]))
            lines.append(f'record({rtype}, "$(P){name}") {{ field(DTYP, "S7plc") field(OUT, "{text}") }}')
    lines.append('record(longin, "$(P)waiting") { field(DTYP, "S7plc stats") field(INP, "@PLC/putsWaiting") }')
    return "\n".join(lines)


def given_in(log):
    """What device support was given: (place, value) of each line of log=io, as it came."""
    found = []
    for offset, data, mask in re.findall(r"put +(\d+): ([0-9A-F ]+?)(?: mask ([0-9A-F ]+))?$", log, re.M):
        offset, value = int(offset), int.from_bytes(bytes.fromhex(data), "big")
        bits = int.from_bytes(bytes.fromhex(mask or ""), "big")
        bit = bits.bit_length() - 1
        if offset >= 100:
            where = ("coils", 50 + 8 * (offset - 100) + bit, None)
        else:
            where = ("holding", offset // 2, bit if bits else None)
        found.append((where, value >> bit & 1 if bits else value))
    return found


class Trouble:
    """What the device does wrong, at random; and what came of each write: `attempts` are (sequence, what it writes),
    `last` is the code of the exception (0: none) of the last attempt at a place."""

    def __init__(self, plc, chance):
        self.plc, self.chance = plc, chance
        self.sequence, self.attempts, self.last = 0, [], {}
        self.count = {what: 0 for what in ("delay", "refusal", "twice", "close behind", "close before")}
        self.closed = True  # what is closed before it has answered once is a loss
        plc.judge, plc.mangle = self.judge, self.mangle

    def happens(self, what, probability):
        happens = self.chance.random() < probability
        self.count[what] += happens
        return happens

    def holds(self, where, value):
        """The device has this value there, whatever it said of the last write."""
        table, address, bit = where
        now = int(getattr(self.plc, table)[address])
        return (now if bit is None else now >> bit & 1) == value

    def judge(self, request):
        code = 0
        if request.writes:
            if self.happens("refusal", 0.06):
                code = self.chance.choice([2, 3, 4])
            items = self.items(request)
            self.attempts.append((self.sequence, items))
            self.last.update({where: code for where, _ in items})
        return code

    def mangle(self, request, frame):
        """A close never comes twice in a row: then the connection is lost, and puts may be."""
        was, self.closed = self.closed, False
        if self.happens("delay", 0.05):
            time.sleep(self.chance.random() * 0.01)  # the fault: the answer comes so late
        if self.happens("twice", 0.05):
            return frame + frame
        handler = self.plc.handlers[-1]
        if not was and self.happens("close behind", 0.04):
            self.closed = True
            self.plc.loop.call_soon(lambda: (handler.send(frame), handler.drop(reset=False)))
            return b""
        if not was and self.happens("close before", 0.04):
            self.closed = True
            self.plc.loop.call_soon(lambda: handler.drop(reset=False))
            return b""
        return frame

    def items(self, request):
        if request.function == 22:
            kept, value = request.values
            return [(("holding", request.start, bit), value >> bit & 1) for bit in range(16) if not kept >> bit & 1]
        return [((request.table, a, None), int(v)) for a, v in zip(request.addresses(), request.values)]


class Client(threading.Thread):
    """A CA client of its own, with its own connection to the IOC. Its own records and those of all."""

    def __init__(self, number, ioc, trouble, seed, acknowledged, barrier):
        super().__init__(daemon=True)
        self.number, self.ioc, self.trouble = number, ioc, trouble
        self.chance, self.acknowledged, self.barrier = random.Random(seed), acknowledged, barrier
        self.made = {}      # sequence: (place, value) of its own records, where it knows their order
        self.touched, self.channels, self.pact = set(), {}, {}
        self.error = None

    def run(self):
        ca.create_context()
        try:
            self.channels = {name: ca.create_channel(self.ioc.P + name)
                             for name in names_of(self.number) + names_of(CLIENTS)}
            self.pact = {name: ca.create_channel(f"{self.ioc.P}{name}.PACT") for name in names_of(self.number)}
            for name, channel in [*self.channels.items(), *self.pact.items()]:
                assert ca.connect_channel(channel, timeout=LIMIT), name
            for sequence in range(SEQUENCES):
                self.barrier.wait(LIMIT)
                self.sequence(sequence)
                self.barrier.wait(LIMIT)
        except BaseException as error:  # told by the main thread
            self.error = error
            self.barrier.abort()
        finally:
            for channel in [*self.channels.values(), *self.pact.values()]:
                ca.clear_channel(channel)

    def sequence(self, sequence):
        waits = self.chance.random() < 0.6 or not self.acknowledged
        made = []
        if waits:
            self.made[sequence] = made
        for _ in range(self.chance.randint(1, PUTS)):
            owner = CLIENTS if self.chance.random() < 0.3 else self.number
            name = self.chance.choice(names_of(owner))
            value = self.chance.randrange(65536) if name[1] == "w" else self.chance.randrange(2)
            wait = self.acknowledged and (waits or self.chance.random() < 0.5)
            self.touched.add(name)
            ca.put(self.channels[name], value, wait=wait, timeout=LIMIT)
            if not self.acknowledged:
                ca.flush_io()
            if owner == self.number:
                made.append((place_of(name), value))
            if owner == self.number and wait:
                self.check(sequence, name, value)
        ca.get(self.channels[name], timeout=LIMIT)  # behind all puts: the IOC has them

    def check(self, sequence, name, value):
        """The put has ended: the alarm is that of the device's answer to it. A put that nobody waited for makes EPICS
        process the record once more: then that answer counts, when it is there."""
        pact = self.pact[name]
        for _ in range(1000):
            code, was_active = self.trouble.last.get(place_of(name)), ca.get(pact, timeout=LIMIT)
            channel = self.channels[name]
            now = ca.get_with_metadata(channel, ftype=ca.promote_type(channel, use_time=True), timeout=LIMIT)
            good = (now["severity"] != 0) == (code != 0 and not (
                now["severity"] == 0 and self.trouble.holds(place_of(name), value)))
            if good or not was_active and code == self.trouble.last.get(place_of(name)) and not ca.get(pact, timeout=LIMIT):
                break
        assert now["value"] == value, f"sequence {sequence}: {name} is {now['value']}, put was {value}"
        assert good, \
            f"sequence {sequence}: {name} has severity {now['severity']}; the device said {code}\n{self.ioc.log[-1500:]}"


class Operator:
    """Looks at many records at once."""

    def __init__(self, ioc, trouble):
        self.ioc, self.trouble = ioc, trouble
        self.fields = {(name, field): ca.create_channel(ioc.P + name + field) for name in
                       ["waiting"] + [name for o in range(OWNERS) for name in names_of(o)]
                       for field in ("", ".PROC", ".PACT", ".SEVR", ".AMSG") if SINCE_7_0_6 or field != ".AMSG"}
        for channel in self.fields.values():
            assert ca.connect_channel(channel, timeout=LIMIT)

    def get(self, names, field):
        channels = [self.fields[name, field] for name in names]
        for channel in channels:
            ca.get(channel, wait=False, as_string=field != ".PACT")
        return [ca.get_complete(channel, timeout=LIMIT, as_string=field != ".PACT") for channel in channels]

    def idle(self, names):
        ca.put(self.fields["waiting", ".PROC"], 1, wait=True, timeout=LIMIT)
        return self.get(["waiting"], "") == ["0"] and not any(self.get(names, ".PACT"))

    def alarms(self, names):
        said = self.get(names, ".AMSG") if SINCE_7_0_6 else [AnyMessage()] * len(names)
        return dict(zip(names, zip(self.get(names, ".SEVR"), said)))

    def wrong(self, names):
        """Records whose alarm is not that of the last answer to a write of them; where that was a refusal, and the device
        holds the value all the same, there may be none."""
        found = []
        for name, (severity, text) in self.alarms(names).items():
            code = self.trouble.last[place_of(name)]
            if code and severity == "NO_ALARM" and self.trouble.holds(
                    place_of(name), ca.get(self.fields[name, ""], timeout=LIMIT)):
                continue
            if severity != ("INVALID" if code else "NO_ALARM") or code and f"exception {code}" not in text:
                found.append((name, severity, text, code))
        return found

    def settle(self, names):
        until(lambda: self.idle(names), "no put that waits")
        until(lambda: not self.wrong(names), lambda: f"alarms: {self.wrong(names)}")


@pytest.mark.parametrize("complete,writes", [("acknowledged", "all"), ("sent", "all"), ("acknowledged", "newest")])
def test_random_sequences(new_modbus, new_ioc, complete, writes):
    """random sequences of puts of three clients, complete={complete} writes={writes}: the device gets what device support was given, in its order, and no other; the alarm is that of the last answer"""
    print(f"PLCLINK_SEQUENCES={SEQUENCES} PLCLINK_SEED={SEED}")
    plc = new_modbus()
    ioc = new_ioc("errlogInit 20000000\n" + plc.configure("", OUTPUTS, timeout=60000) + f"""
        s7plcSetOption PLC writes {writes}
        s7plcSetOption PLC complete {complete}
        s7plcSetOption PLC log io""", database())
    until(lambda: plc.answers >= 2, "the first reads")
    trouble = Trouble(plc, random.Random(SEED))
    operator = Operator(ioc, trouble)
    barrier = threading.Barrier(CLIENTS + 1)
    clients = [Client(c, ioc, trouble, SEED * 1000 + c, complete == "acknowledged", barrier) for c in range(CLIENTS)]
    for client in clients:
        client.start()
    try:
        for trouble.sequence in range(SEQUENCES):
            barrier.wait(LIMIT)
            barrier.wait(LIMIT)
            operator.settle(sorted(set().union(*(client.touched for client in clients))))
            for client in clients:
                client.touched.clear()
    except threading.BrokenBarrierError:
        pass
    for client in clients:
        client.join(LIMIT)
        if client.error and not isinstance(client.error, threading.BrokenBarrierError):
            raise client.error
    ioc.command("")
    given = given_in(ioc.log)
    judge_places(given, trouble, writes == "all")
    for client in clients:
        if writes == "all":
            judge_order(client, trouble)
    assert all(trouble.count.values()), trouble.count
    assert "disconnected" not in ioc.log and "discarded" not in ioc.log
    print(f"{len(given)} puts, {len(trouble.attempts)} requests, {trouble.count}")


def changes(values):
    return [value for value, _ in groupby(values)]


def judge_places(given, trouble, every):
    """Of each place: each value that was given was tried, in its order, and no other; it holds the last one that the
    device took. Of numbers, without writes=all, those that were tried are in their order, and the last one is there."""
    wanted, tried = {}, {}
    for where, value in given:
        wanted.setdefault(where, []).append(value)
    for _, items in trouble.attempts:
        for where, value in items:
            tried.setdefault(where, []).append(value)
    assert set(tried) == set(wanted)
    for where, values in wanted.items():
        if every or where[2] is not None or where[0] == "coils":
            assert changes(tried[where]) == changes(values), where
        else:
            rest = iter(values)
            assert all(value in rest for value in changes(tried[where])), where
            assert tried[where][-1] == values[-1], where


def judge_order(client, trouble):
    """A client's puts were tried in the order in which it made them, over all tables. What one request writes is
    written at once. What was tried may come again: after a close, or as a part of a request that was refused."""
    own = {place_of(name) for name in names_of(client.number)}
    tried, state = {}, {}
    for sequence, items in trouble.attempts:
        tried.setdefault(sequence, []).append([item for item in items if item[0] in own])
    for sequence in range(SEQUENCES):
        wanted, at = client.made.get(sequence), 0
        for items in tried.get(sequence, []):
            first = at
            while wanted and at < len(wanted) and wanted[at] in items:
                at += 1
            strange = [item for item in items if wanted is not None and item not in wanted[first:at] and
                       state.get(item[0]) != item[1]]
            assert not strange, \
                f"sequence {sequence}, client {client.number}: the device got {items}; put was {wanted[first:first + 4]}"
            state.update(items)
        assert wanted is None or at == len(wanted), \
            f"sequence {sequence}, client {client.number}: the device never got {wanted[at:at + 4]}"


def test_exit_with_puts(new_modbus, new_ioc):
    """1,000 puts that nobody answers, then exit: the IOC ends in two seconds"""
    plc = new_modbus()
    db = "\n".join(f'record(longout, "$(P)o{i}") {{ field(DTYP, "S7plc") field(OUT, "@PLC/{2 * i} T=UINT16") }}'
                   for i in range(1000))
    ioc = new_ioc(plc.configure("", "holding 0 1000", timeout=60000) +
                  "\ns7plcSetOption PLC complete acknowledged\ns7plcSetOption PLC readPeriod 0", db)
    ioc.connect([f"o{i}" for i in range(1000)])
    until(lambda: plc.answers >= 8, "the first reads")
    plc.answering.clear()
    for i in range(1000):
        ioc.put(f"o{i}", i + 1, wait=False)
    until(lambda: plc.writes(), "a put on its way")
    ioc.drop_clients()  # 1,000 of them take the client longer than the IOC
    start = time.monotonic()
    ioc.exit()
    assert time.monotonic() - start < 2 * max(1, os.getloadavg()[0])


def waits_at_exit(new_modbus, new_ioc, puts):
    """How often threads of an IOC wait between the word exit and its end; so many puts are not answered then."""
    plc = new_modbus()
    db = "\n".join(f'record(longout, "$(P)o{i}") {{ field(DTYP, "S7plc") field(OUT, "@PLC/{2 * i} T=UINT16") '
                   'field(SCAN, "Event") field(EVNT, "1") field(VAL, "7") }' for i in range(puts))
    ioc = new_ioc(plc.configure("", "holding 0 1000", timeout=60000) + "\ns7plcSetOption PLC readPeriod 0", db)
    until(lambda: plc.answers >= 8, "the first reads")
    plc.answering.clear()
    ioc.command("postEvent 1")
    until(lambda: ioc.get(f"o{puts - 1}.PACT") == 1 and plc.writes(), "all puts")
    ioc.drop_clients()
    reaped = resource.getrusage(resource.RUSAGE_CHILDREN).ru_nvcsw
    before = 0
    for status in Path(f"/proc/{ioc.process.pid}/task").glob("*/status"):
        before += int(re.search(r"^voluntary_ctxt_switches:\s+(\d+)", status.read_text(), re.M)[1])
    assert ioc.exit() == 0
    return resource.getrusage(resource.RUSAGE_CHILDREN).ru_nvcsw - reaped - before


def test_exit_waits(new_modbus, new_ioc, no_sanitizer):
    """at exit the IOC does not wait once for each put that is not answered"""
    few, many = waits_at_exit(new_modbus, new_ioc, 10), waits_at_exit(new_modbus, new_ioc, 1000)
    print(f"waits at exit: {few} with 10 puts, {many} with 1000")
    assert many < few + 200
