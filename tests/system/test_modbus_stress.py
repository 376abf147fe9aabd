"""Random puts from several clients into one Modbus device that delays, refuses, closes and answers twice:
what the device has got is what was put, in its order.

pymodbus's server is the judge: its log of requests, not plcSim. A long run by hand, with a seed:
    PLCLINK_PUTS=10000 PLCLINK_SEED=42 nice tests/run system -k modbus_stress
"""
import os
import random
import threading
import time

import pytest

from waiting import until

PUTS = int(os.environ.get("PLCLINK_PUTS", 600))
SEED = int(os.environ.get("PLCLINK_SEED", 1))
CLIENTS = 3
WORDS, COILS, BITS = 6, 6, 4  # of each client: registers, coils, bits of a register

OUTPUTS = (f"holding 0 {CLIENTS * (WORDS + 1)}, coils 50 {8 * CLIENTS} at 100")


def records():
    lines = []
    for client in range(CLIENTS):
        base = client * (WORDS + 1)
        lines += [f'record(longout, "$(P)c{client}w{i}") {{ field(DTYP, "S7plc") field(OUT, "@PLC/{2 * (base + i)} T=UINT16") }}'
                  for i in range(WORDS)]
        lines += [f'record(bo, "$(P)c{client}b{i}") {{ field(DTYP, "S7plc") field(OUT, "@PLC/{2 * (base + WORDS)} T=WORD B={i}") }}'
                  for i in range(BITS)]
        lines += [f'record(bo, "$(P)c{client}k{i}") {{ field(DTYP, "S7plc") field(OUT, "@PLC/{100 + client} T=BYTE B={i}") }}'
                  for i in range(COILS)]
    lines += ['record(longin, "$(P)waiting") { field(DTYP, "S7plc stats") field(INP, "@PLC/putsWaiting") field(SCAN, ".1 second") }']
    return "\n".join(lines)


def place(client, name):
    """(table, address, bit) of a record's name without its client."""
    base, n = client * (WORDS + 1), int(name[1:])
    return {"w": ("holding", base + n, None), "b": ("holding", base + WORDS, n),
            "k": ("coils", 50 + 8 * client + n, None)}[name[0]]


class Trouble:
    """What the device does wrong, at random: a delay, a refusal, a close, an answer twice."""

    def __init__(self, plc, chance, refusals):
        self.plc, self.chance, self.refusals, self.on, self.lock = plc, chance, refusals, True, threading.Lock()
        self.taken = []  # of each write that was answered well: (place, value) of what it wrote
        self.plc.mangle = self.mangle
        self.judge, self.plc.judge = self.plc.judge, self.refuse
        self.refused = 0

    def refuse(self, request):
        if self.on and self.refusals and request.writes and self.chance.random() < 0.05:
            self.refused += 1
            return self.chance.choice([2, 3, 4])
        return 0

    def mangle(self, request, frame):
        if frame[7] < 0x80 and request.writes:
            self.take(request)
        if not self.on:
            return frame
        dice = self.chance.random()
        if dice < 0.05:
            time.sleep(self.chance.random() * 0.01)  # a late answer
        elif dice < 0.10:
            return frame + frame
        elif dice < 0.14:
            handler = self.plc.handlers[-1]
            self.plc.loop.call_soon(lambda: (handler.send(frame), handler.drop(reset=False)))
            return b""
        return frame

    def take(self, request):
        if request.function == 22:
            kept, value = request.values
            what = [(("holding", request.start, bit), value >> bit & 1) for bit in range(16) if not kept >> bit & 1]
        else:
            what = [((request.table, a, None), int(v)) for a, v in zip(request.addresses(), request.values)]
        self.taken.append(what)


def client_puts(ioc, client, seed, puts, made, wait):
    """One client: puts, each with completion or none; notes what was put and what became of it."""
    chance = random.Random(seed)
    names = ([f"w{i}" for i in range(WORDS)] + [f"b{i}" for i in range(BITS)] + [f"k{i}" for i in range(COILS)])
    for _ in range(puts):
        name = chance.choice(names)
        value = chance.randrange(65536) if name[0] == "w" else chance.randrange(2)
        ioc.put(f"c{client}{name}", value, wait=wait)
        alarm = ioc.alarm(f"c{client}{name}") if wait else ("NO_ALARM", "", "")
        made.append((place(client, name), value, alarm))


@pytest.mark.parametrize("complete", ["acknowledged", "sent"])
def test_random_puts(new_modbus, new_ioc, complete):
    """random puts of three clients, complete={complete}: the device gets each value that it did not refuse, in its order, and no other"""
    print(f"PLCLINK_PUTS={PUTS} PLCLINK_SEED={SEED}")
    chance = random.Random(SEED)
    plc = new_modbus()
    wait = complete == "acknowledged"
    trouble = Trouble(plc, chance, refusals=wait)
    ioc = new_ioc(plc.configure("", OUTPUTS) + "\ns7plcSetOption PLC writes all\ns7plcSetOption PLC complete " + complete,
                  records())
    until(lambda: plc.answers >= 2, "the first reads")
    made = [[] for _ in range(CLIENTS)]
    for c in range(CLIENTS):
        ioc.connect([f"c{c}{n}{i}{f}" for n, k in (("w", WORDS), ("b", BITS), ("k", COILS)) for i in range(k)
                     for f in ("", ".SEVR", ".STAT", ".AMSG")])
    from epics import ca  # each client is a thread with the one context

    def run(client):
        ca.use_initial_context()
        client_puts(ioc, client, SEED * 1000 + client, PUTS // CLIENTS, made[client], wait)
    threads = [threading.Thread(target=run, args=(c,)) for c in range(CLIENTS)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    waiting = ioc.pv("waiting")
    until(lambda: waiting.get() == 0, "no put that waits")
    trouble.on = False
    judge(trouble, made)
    assert trouble.refused or not wait
    assert "disconnected" not in ioc.log


def judge(trouble, made):
    """Each client's puts that were not refused are in the device's log in their order; nothing else is there."""
    for client, puts in enumerate(made):
        own = {place(client, f"{kind}{i}") for kind, count in (("w", WORDS), ("b", BITS), ("k", COILS))
               for i in range(count)}
        wanted = []
        for where, value, alarm in puts:
            assert alarm[0] in ("NO_ALARM", "INVALID"), alarm
            if alarm[0] == "NO_ALARM":
                wanted.append((where, value))
            else:
                assert alarm[1] == "WRITE" and "exception" in alarm[2], alarm
        requests = [[item for item in request if item[0] in own] for request in trouble.taken]
        compare(client, wanted, [request for request in requests if request])


def compare(client, wanted, requests):
    """What one request has written is written at once: its puts have no order in it. A value that is there already
    may come again: it is no edge."""
    state, at = {}, 0
    for request in requests:
        first = at
        while at < len(wanted) and wanted[at] in request:
            at += 1
        strange = [item for item in request if item not in wanted[first:at] and state.get(item[0]) != item[1]]
        assert not strange, f"client {client}: the device got {request}; put was {wanted[first:first + 4]}"
        state.update(request)
    assert at == len(wanted), f"client {client}: the device never got {wanted[at:at + 4]}"


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
