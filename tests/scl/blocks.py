"""Blocks that the system brings along: BLKMOV, TEST_DB, communication, timers.

Each is a function of the machine. RET_VAL and STATUS are the codes of the CPU.
"""
from dataclasses import dataclass

from .types import ANY, BOOL, INT, TIMERS, WORD, Instance, make_struct

AREAS = {0x81: "I", 0x82: "Q", 0x83: "M"}
WIDTHS = {2: 1, 3: 1, 4: 2, 5: 2, 6: 4, 7: 4, 8: 4}


@dataclass
class System:
    """An FC or SFC. run(machine, *inputs) returns (result, *outputs)."""
    name: str
    inputs: list
    outputs: list
    result: object
    run: object


def int16(code):
    return code - 0x10000 if code > 0x7fff else code


def area(machine, pointer, side):
    """(memory, byte, size) of an ANY pointer, or an error code; side: 1 source, 3 target."""
    width = WIDTHS.get(pointer[1])
    size = width and width * int.from_bytes(pointer[2:4], "big")
    number = int.from_bytes(pointer[4:6], "big")
    address = int.from_bytes(pointer[7:10], "big")
    if pointer[0] != 0x10 or not size:
        return 0x8001 | side << 8
    if address % 8:
        return 0x8028 | side << 8
    if pointer[6] == 0x84:
        memory = machine.dbs.get(number)
        if memory is None:
            return 0x803a | side << 8
    elif pointer[6] in AREAS:
        memory = machine.areas[AREAS[pointer[6]]]
    else:
        return 0x8024 | side << 8
    if address // 8 + size > len(memory):
        return 0x8022 | side << 8
    return memory, address // 8, size


def blkmov(machine, source, target):
    """SFC 20. As many bytes as both have."""
    first, second = area(machine, source, 1), area(machine, target, 3)
    for found in (first, second):
        if isinstance(found, int):
            return (int16(found),)
    size = min(first[2], second[2])
    second[0][second[1]:second[1] + size] = first[0][first[1]:first[1] + size]
    machine.moved(second[0], second[1], size)
    return (0,)


def test_db(machine, number):
    """SFC 24: RET_VAL, DB_LENGTH, WRITE_PROT."""
    if number == 0:
        return int16(0x80a1), 0, False
    memory = machine.dbs.get(number)
    if memory is None:
        return int16(0x80b1), 0, False
    return 0, len(memory), number in machine.protected


def ag_send(machine, act, id_, laddr, source, length):
    """DONE, ERROR, STATUS. ACT begins; without ACT it tells how far it is."""
    link = machine.link
    if not link or not link.connected:
        return None, False, True, 0x8183
    if act:
        found = area(machine, source, 1)
        if isinstance(found, int) or length > found[2]:
            return None, False, True, 0x8185
        if link.busy():
            return None, False, True, 0x8186
        memory, byte, _ = found
        link.send(bytes(memory[byte:byte + length]))
    busy = link.busy()
    return None, not busy, False, 0x8181 if busy else 0


def ag_recv(machine, id_, laddr, target):
    """NDR, ERROR, STATUS, LEN."""
    found, link = area(machine, target, 3), machine.link
    if isinstance(found, int):
        return None, False, True, 0x8185, 0
    if not link or not link.connected:
        return None, False, True, 0x8183, 0
    memory, byte, size = found
    data = link.receive(size)
    if data is None:
        return None, False, False, 0x8180, 0
    memory[byte:byte + size] = data
    machine.received()
    return None, True, False, 0, size


SEND = ([("ACT", BOOL), ("ID", INT), ("LADDR", WORD), ("SEND", ANY), ("LEN", INT)],
        [("DONE", BOOL), ("ERROR", BOOL), ("STATUS", WORD)])
RECV = ([("ID", INT), ("LADDR", WORD), ("RECV", ANY)],
        [("NDR", BOOL), ("ERROR", BOOL), ("STATUS", WORD), ("LEN", INT)])

SYSTEM = {system.name: system for system in [
    System("BLKMOV", [("SRCBLK", ANY), ("DSTBLK", ANY)], [], INT, blkmov),
    System("TEST_DB", [("DB_NUMBER", WORD)], [("DB_LENGTH", WORD), ("WRITE_PROT", BOOL)], INT,
           test_db),
    System("AG_SEND", *SEND, None, ag_send), System("AG_LSEND", *SEND, None, ag_send),
    System("AG_RECV", *RECV, None, ag_recv), System("AG_LRECV", *RECV, None, ag_recv)]}
SYSTEM.update({"SFC20": SYSTEM["BLKMOV"], "SFC24": SYSTEM["TEST_DB"]})


def tsend(machine, get, put):
    """FB 63: a block begins with the rising edge of REQ."""
    edge = get("REQ") and not get("WAS")
    put("WAS", get("REQ"))
    if not (edge or get("BUSY")):
        return put("DONE", False)
    _, done, error, status = ag_send(machine, edge, 0, 0, get("DATA"), get("LEN"))
    put("DONE", done)
    put("ERROR", error)
    put("BUSY", not done and not error)
    return put("STATUS", status)


def trcv(machine, get, put):
    """FB 64."""
    new = error = False
    status = length = 0
    if get("EN_R"):
        _, new, error, status, length = ag_recv(machine, 0, 0, get("DATA"))
    put("NDR", new)
    put("ERROR", error)
    put("BUSY", get("EN_R") and not new and not error)
    put("STATUS", status)
    return put("RCVD_LEN", length)


def timer(machine, get, put, name):
    """SFB 3 to 5: a time that runs while, or after, IN says so. STATE: 0 rest, 1 runs."""
    on, now = get("IN"), machine.ms
    starts = {"TON": on, "TOF": not on and get("Q"), "TP": on and not get("STATE")}[name]
    if name == "TON" and not on or name == "TOF" and on:
        put("STATE", 0)
        put("ET", 0)
        return put("Q", on)
    if name == "TP" and not get("STATE") and not (on and not get("ATIME")):
        put("ATIME", int(on))
        return put("Q", False)
    if not get("STATE"):
        if not starts:
            return None
        put("STATE", 1)
        put("STIME", now)
    past = min(now - get("STIME"), get("PT"))
    over = past >= get("PT")
    put("ET", past)
    put("Q", over if name == "TON" else not over)
    if name == "TP":
        put("ATIME", int(on))
    if over and name != "TON":
        put("STATE", 0)
    return None


def instance(name, fields):
    return Instance(name, make_struct(name, [(n, t, None, None) for n, t in fields]))


# Function blocks of the system: their instances, how many fields are inputs, and what they do
STANDARD = {name: (kind, 2, lambda m, get, put, name=name: timer(m, get, put, name))
            for name, kind in TIMERS.items()}
STANDARD["TSEND"] = (instance("TSEND", [
    ("REQ", BOOL), ("ID", WORD), ("LEN", INT), ("DATA", ANY), ("DONE", BOOL), ("BUSY", BOOL),
    ("ERROR", BOOL), ("STATUS", WORD), ("WAS", BOOL)]), 4, tsend)
STANDARD["TRCV"] = (instance("TRCV", [
    ("EN_R", BOOL), ("ID", WORD), ("LEN", INT), ("DATA", ANY), ("NDR", BOOL), ("BUSY", BOOL),
    ("ERROR", BOOL), ("STATUS", WORD), ("RCVD_LEN", INT)]), 4, trcv)
