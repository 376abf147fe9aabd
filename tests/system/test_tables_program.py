"""Tables of pointers in the PLC: the SCL of plc-tables.scl and plcSim's program, side by side,
one cycle at a time and without a network. Both must send the same bytes."""
import os
import re
import subprocess

import pytest

from client import TOP
from scl import episodes, lives, mutate, scenarios, tables, texts
from scl.compile import Program
from scl.parse import SclError
from scl.step import Step
from scl.lives import load
from scl.scenarios import INSTANCE
from scl.tables import ACTIVE, CHECKING, GOOD, LOADING, NONE, OTHER, REFUSED, pointer, rx, tx

TEXT = tables.document()


@pytest.fixture(scope="module")
def program():
    return Program(TEXT, texts.symbols(TEXT))


@pytest.fixture(scope="module")
def step():
    """One process for all: each test begins with a restart."""
    step = Step()
    yield step
    step.close()


@pytest.fixture
def both(program, step):
    """A PLC that works with GOOD, in both programs."""
    return fresh(program, step)


def synced(both):
    both.cycle(tables.block(tables.CHECK, 0x1201, bytes(both.plc.memory(10)[:12])))
    assert both.plc.sync
    return both


def test_a_table(both):
    """a table is taken whole: values move where its rows say, and nowhere else"""
    assert both.plc.status() == (ACTIVE, 0, 0, tables.crc_of(GOOD), 70, 1, 4)
    synced(both)
    both.cycle(tables.block(tables.DATA, 0x1201, bytes(range(40, 52))))
    assert bytes(both.plc.memory(10)) == bytes(range(40, 52)) + bytes(range(13, 25))
    assert load(both, OTHER, 2)[:4] == (ACTIVE, 0, 0, tables.crc_of(OTHER))
    assert not both.plc.sync
    assert load(both, GOOD, 3)[3] == tables.crc_of(GOOD)


def T(tx_rows=(tx(10, 0, 12, 16),), rx_rows=()):
    return tables.table(0x1299, tx_rows, rx_rows)


def test_what_it_needs(program):
    """plc-tables.md: four functions and three data blocks more than without tables, all under the numbers of step 3"""
    page = (texts.DOCS / "plc-tables.md").read_text()
    plain = scenarios.document()
    functions = [set(re.findall(r"^FUNCTION (\w+)", text, re.M)) for text in (plain, TEXT)]
    blocks = [texts.symbols(text) for text in (plain, TEXT)]
    assert functions[1] - functions[0] == {"MAP_ALLOWED", "MAP_CRC", "MAP_ROW", "MAP_LOAD"}
    assert set(blocks[1]) - set(blocks[0]) == {"MAP_A", "MAP_B", "MAP"}
    said = {name: int(number) for name, number in re.findall(r"(\w+) DB(\d+)", page.split("**Symbols.**")[1].split("4. **")[0])}
    assert said == blocks[1] == {name: number for name, (number, _) in program.dbs.items()}
    numbers = dict(re.findall(r"(\w+) (F[BC]\d+)", page.split("**Symbols.**")[1].split("4. **")[0]))
    have = dict(re.findall(r"^FUNCTION(?:_BLOCK)? (\w+)[^/\n]*// (F[BC]\d+)", TEXT, re.M))
    assert len(have) == 8 and {name: numbers.get(name) for name in have} == have


def test_marks():
    """plc-tables.md: what must be fitted to other sizes is marked TX 48, RX 32, ROWS 32"""
    fitted = texts.fitted_tables(TEXT, 64, 40, 16, [(10, 0, 24, True)], tx=["IE_TX.DD44 := DB11.DD12"])
    open_ = TEXT[TEXT.index("FUNCTION MAP_ALLOWED"):].split("END_FUNCTION")[0].splitlines()
    changed = [line for line in TEXT.splitlines() if line not in fitted.splitlines() + open_ and "DD44" not in line]
    assert len(changed) > 15 and all(re.search("// .*(TX 48|RX 32|ROWS 32)", line) for line in changed), changed


BAD = {
    "no ANY pointer": (T([tx(10, 0, 4, 16, head=0x0002)]), 1, 0),
    "words, not bytes": (T([tx(10, 0, 4, 16, head=0x1004)]), 1, 0),
    "no byte": (T([tx(10, 0, 0, 16)]), 1, 0),
    "more than 1024 bytes": (T([tx(10, 0, 1025, 16)]), 1, 0),
    "a negative number of bytes": (T([tx(10, 0, -1, 16)]), 1, 0),
    "inputs": (T([tx(0, 0, 4, 16, area=0x81)]), 2, 0),
    "outputs": (T(rx_rows=[rx(4, 0, 0, 4, area=0x82)]), 2, 1),
    "local data": (T([tx(0, 0, 4, 16, area=0x86)]), 2, 0),
    "flags with a number of a block": (T([tx(3, 100, 4, 16, area=0x83)]), 2, 0),
    "flags in place of IE_TX": (T([pointer(10, 0, 4) + pointer(0, 16, 4, area=0x83)]), 2, 0),
    "a bit": (T([tx(10, 0, 4, 16, bit=7)]), 3, 0),
    "another bit": (T([tx(10, 0, 4, 16, bit=1)]), 3, 0),
    "1024 bytes": (T([tx(10, 0, 1024, 16)]), 6, 0),
    "two faults, the first counts": (T([tx(99, 0, 4, 12)]), 4, 0),
    "a block that is not there": (T([tx(99, 0, 4, 16)]), 4, 0),
    "DB 0": (T([tx(0, 0, 4, 16)]), 4, 0),
    "DB 65535": (T([tx(-1, 0, 4, 16)]), 4, 0),
    "a forbidden block": (T([tx(10, 0, 4, 16), tx(12, 0, 4, 20)]), 5, 1),
    "a block that may only be read": (T([tx(11, 0, 4, 16)], [rx(4, 11, 0, 4)]), 5, 1),
    "flags outside of the list": (T([tx(0, 98, 4, 16, area=0x83)]), 5, 0),
    "flags beyond the list": (T([tx(0, 197, 4, 16, area=0x83)]), 5, 0),
    "flags that may only be read": (T([tx(0, 100, 4, 16, area=0x83)],
                                      [rx(4, 0, 100, 4, area=0x83)]), 5, 1),
    "IE_TX as a source": (T([tx(1, 16, 4, 16)]), 5, 0),
    "IE_ACC": (T([tx(5, 4, 4, 16)]), 5, 0), "IE_HELD": (T([tx(6, 4, 4, 16)]), 5, 0),
    "the table in use": (T([tx(20, 0, 4, 16)]), 5, 0),
    "the other table": (T([tx(21, 0, 4, 16)]), 5, 0),
    "the loader": (T([tx(22, 0, 4, 16)]), 5, 0), "the instance": (T([tx(23, 0, 4, 16)]), 5, 0),
    "one byte beyond the end": (T([tx(10, 20, 5, 16)]), 6, 0),
    "an address beyond 32767": (T([tx(10, 65536, 4, 16)]), 6, 0),
    "an address beyond 65535": (T([tx(10, 2097148, 4, 16)]), 6, 0),
    "flags at the end of the world": (T([tx(0, 32767, 1, 16, area=0x83)]), 6, 0),
    "two lengths": (T([pointer(10, 0, 4) + pointer(1, 16, 5)]), 7, 0),
    "into the status": (T([tx(10, 0, 4, 15)]), 8, 0),
    "beyond IE_TX": (T([tx(10, 0, 4, 45)]), 8, 0),
    "another block than IE_TX": (T([pointer(10, 0, 4) + pointer(11, 16, 4)]), 8, 0),
    "out of the header": (T(rx_rows=[rx(3, 10, 0, 4)]), 8, 1),
    "beyond IE_RX": (T(rx_rows=[rx(29, 10, 0, 4)]), 8, 1),
    "another block than IE_RX": (T(rx_rows=[pointer(10, 4, 4) + pointer(10, 0, 4)]), 8, 1),
    "two rows, one byte out": (T([tx(10, 0, 4, 16), tx(10, 8, 4, 19)]), 9, 1),
    "two rows, one byte in": (T([tx(10, 0, 12, 16)], [rx(4, 10, 0, 4), rx(8, 10, 3, 4)]), 9, 2),
    "a row in a row": (T([tx(10, 0, 12, 16)], [rx(4, 10, 0, 8), rx(12, 10, 2, 2)]), 9, 2),
    "a setpoint that is not shown": (T([tx(10, 0, 4, 16)], [rx(4, 10, 0, 5)]), 10, 1),
    "a setpoint that other flags show": (T([tx(11, 0, 4, 16)], [rx(4, 10, 0, 4)]), 10, 1),
    "no row": (T([], []), 23, 0),
    "33 rows": (T([tx(10, 0, 1, 16 + i % 32) for i in range(33)]), 28, 0),
    "wrong CRC": (GOOD[:6] + b"\1\2\3\4" + GOOD[10:], 24, 0),
    "fewer rows than it says": (GOOD[:3] + b"\3" + GOOD[4:], 23, 0),
    "more rows than it says": (GOOD[:3] + b"\1" + GOOD[4:], 23, 0),
    "a negative number of rows": (GOOD[:2] + b"\xff\xff" + GOOD[4:], 23, 0),
    "33 rows out, it says": (GOOD[:3] + b"\x21" + GOOD[4:], 28, 0),
    "33 rows in, it says": (GOOD[:2] + b"\0\0\0\x21" + GOOD[6:], 28, 0),
    "33 rows in all, it says": (GOOD[:2] + b"\0\x10\0\x11" + GOOD[6:], 28, 0),
    "a negative number of rows in": (GOOD[:4] + b"\xff\xff" + GOOD[6:], 23, 0),
    "32767 rows": (GOOD[:2] + b"\x7f\xff" + GOOD[4:], 28, 0),
    "half a head": (GOOD[:5], 23, 0),
}


@pytest.mark.parametrize("title", BAD, ids=range(len(BAD)))
def test_refused(both, title):
    """a table is refused with error and row, and the one in use stays: {title}"""
    data, error, row = BAD[title]
    synced(both)
    crc = 0x12345678 if error == 24 else None
    memory = {n: bytes(both.plc.memory(n)) for n in (0, 10, 11, 12, 20)}
    status = load(both, data, 9, crc=crc)
    assert status[:4] == (REFUSED, error, row, tables.crc_of(GOOD))
    assert memory == {n: bytes(both.plc.memory(n)) for n in memory}
    assert not both.plc.sync
    synced(both)        # it goes on with what it had
    assert load(both, OTHER, 10)[3] == tables.crc_of(OTHER)


def test_own_blocks():
    """the program's own blocks, and protected ones, are refused whatever MAP_ALLOWED says"""
    text = lives.permissive(TEXT)
    lives.own_blocks(Program(text, texts.symbols(text)))


@pytest.mark.parametrize("life", lives.ALL, ids=lambda life: life.__name__)
def test_life(both, life):
    """the tables, cycle by cycle: {id}"""
    life(both)


def test_tsend(step):
    """with TSEND and TRCV in place of AG_SEND and AG_RECV the program does the same"""
    text = texts.with_tsend(TEXT)
    assert "AG_" not in text.split("FUNCTION_BLOCK IE_COMMS")[1]
    program = Program(text, texts.symbols(text))
    for life in (lives.both_tables, lives.commands, lives.restarts, lives.layouts):
        life(fresh(program, step))
    episodes.run(program, step, range(2000, 2010))


# --- All pairs of a fault and a moment ----------------------------------------------------------

def connection_lost(both):
    both.cut()


def plc_restarted(both):
    both.restart()


def ioc_killed(both):
    """Nothing comes any more, and the connection is found dead later."""
    for _ in range(20):
        both.cycle()
    both.cut()


def second_ioc(both):
    both.cut()
    for block in tables.download(GOOD, 77)[:3]:
        both.cycle(block)
    both.cut()


def second_ioc_same_connection(both):
    for block in tables.download(GOOD, 77)[:2]:
        both.cycle(block)


def abort(both):
    both.cycle(tables.command(tables.ABORT, 2))


def lost_part(both):
    both.cycle(tables.command(tables.PART, 2, 640, 4, bytes(4)))


def silence(both):
    both.cycle()
    both.cycle(ms=6000)
    both.cycle()


def local(both):
    both.plc.remote = False
    both.cycle()
    both.plc.remote = True
    both.cycle()


def key_switch(both):
    both.plc.allow = False
    both.cycle()
    both.plc.allow = True
    both.cycle()


def bad_table(title):
    def fault(both):
        data, error, _ = BAD[title]
        load(both, data, 55, crc=0x12345678 if error == 24 else None)
    fault.__name__ = title
    return fault


FAULTS = [connection_lost, plc_restarted, ioc_killed, second_ioc, second_ioc_same_connection,
          abort, lost_part, silence, local, key_switch, bad_table("wrong CRC"),
          bad_table("one byte beyond the end"), bad_table("a forbidden block"),
          bad_table("33 rows")]
MOMENTS = 7 + 1 + 2 + 5 + 2     # BEGIN and parts, COMMIT, CRC, rows, in use


@pytest.mark.parametrize("fault", FAULTS, ids=lambda f: f.__name__)
def test_fault_at_each_moment(program, step, fault):
    """a fault at each moment of a download leaves a whole table in force: {fault}"""
    blocks = tables.download(OTHER, 2)
    assert len(blocks) == 8
    seen = set()
    for moment in range(MOMENTS + 1):
        both = fresh(program, step)
        memory = {n: bytes(both.plc.memory(n)) for n in (0, 10, 11, 12)}
        for number in range(moment):
            both.cycle(blocks[number] if number < len(blocks) else None)
        taken = both.plc.status()[3] == tables.crc_of(OTHER)
        seen.add((both.plc.status()[0], taken))
        fault(both)
        for _ in range(30):
            both.cycle()
        in_force = both.in_force()
        assert in_force in (GOOD, OTHER) and (in_force == OTHER or not taken)
        assert memory == {n: bytes(both.plc.memory(n)) for n in memory}
        assert load(both, OTHER, 88)[3] == tables.crc_of(OTHER)
    assert seen == {(ACTIVE, False), (LOADING, False), (CHECKING, False), (ACTIVE, True)}


def test_without_a_table(program, step):
    """a PLC without a table takes nothing and says so; a table ends that"""
    both = episodes.Episode(program, step, 0)
    both.plc.machine.cold()
    both.restart(quiet=True)
    both.tables.add(tables.crc_of(GOOD))
    before = {n: bytes(both.plc.memory(n)) for n in (0, 10, 11, 12)}
    for flags in (tables.CHECK, tables.DATA, tables.CHECK | tables.DATA, 0):
        both.cycle(tables.block(flags, 0, bytes(28)))
    assert both.plc.status() == (NONE, 0, 0, 0, 0, 0, 4) and not both.plc.sync
    assert before == {n: bytes(both.plc.memory(n)) for n in before}
    assert load(both, GOOD)[0] == ACTIVE


def test_keeps_its_table(both):
    """a restart keeps a good table, and drops one that has changed meanwhile"""
    both.restart()
    for _ in range(3):
        both.cycle()
    assert both.plc.status()[:4] == (ACTIVE, 0, 0, tables.crc_of(GOOD))
    both.plc.memory(20)[33] ^= 1
    both.step.put(20, 33, bytes(both.plc.memory(20)[33:34]))
    both.spoilt = True
    both.restart()
    both.spoilt = False
    assert both.plc.status()[:4] == (NONE, 0, 0, 0)
    both.cycle()


def test_spoilt_in_time(program, step):
    """a bit that flips in the table in use is found after its bytes / 4 cycles, twice that at most"""
    longest = 0
    for wait in range(len(GOOD) // 4 + 2):
        for byte in (14, len(GOOD) - 1):
            both = fresh(program, step)
            for _ in range(wait):
                both.cycle()
            both.plc.memory(20)[byte] ^= 1
            both.step.put(20, byte, bytes(both.plc.memory(20)[byte:byte + 1]))
            both.spoilt = True
            cycles = 0
            while both.plc.status()[0] == ACTIVE:
                both.cycle()
                cycles += 1
                assert cycles < 1000
            longest = max(longest, cycles)
    assert len(GOOD) / 4 < longest <= 2 * len(GOOD) / 4 + 2, longest


def test_random_lives(program, step):
    """random downloads, faults, restarts, HMI and IOCs: same bytes out, memory as rows allow

    PLCLINK_EPISODES: so many, 60 by default; 10000 take six minutes.
    """
    count = int(os.environ.get("PLCLINK_EPISODES", "60"))
    episodes.run(program, step, range(count))


# Changes that nobody can see, by a part of their line, and why.
HARMLESS = {
    "ARRAY [4..": "names of bytes: the block is as long, rounded up to even",
    "ARRAY [16..47]": "the same",
    "Flags : BYTE;  Counter : BYTE;  Layout : WORD;": "IE_ACC and IE_HELD are compared as bytes",
    "CRC : DWORD;": "it is written as bytes, and read nowhere by name",
    "Status.Version := B#16#01;": "OB100 sets it too",
    "MAP.Status.Version := B#16#1;": "it is there from the beginning",
    "COUNT0 := 0;  COUNT := 0;": "so that each is written before it is read; the loop sets them",
    "AREA := DW#16#0;": "the same",
    "AND DW#16#0003FFFF": "the lowest bit of a bit address is shifted out",
    "AND DW#16#00FC0000": "a bit within a byte was refused before",
    "IF ISRX THEN FIRST := ROWSTX": "an RX row and a TX row never write the same block",
    "FOR OTHER := 0 TO ROWSTX - 1": "the source of an RX row is IE_RX, which no setpoint is in",
    "FAULT := 1": "any number but 0 is a fault here",
    "IF ROWSTX >= 0 AND ROWSRX >= 0 AND": "of numbers that are not sane the CRC is wrong, too",
    "MAP.TailPos := 0;": "the check of the table in use begins a little later or earlier",
    "IF MAP.Status.Expected < 10": "the third of these lines refuses it with the same error",
    "ELSIF ROWSTX > 32 OR ROWSRX > 32": "PART has refused a table of so many rows",
    "MAP.NextRow := -1": "any negative number",
    "IF COUNT > 64": "how much is checked in a cycle",
    "IF COUNT > 4": "the same",
    "IF SIZE < 10 OR SIZE > 650": "the CRC finds it as well, later",
    "MAP.Status.InUse := DW#16#0": "the next cycle does it",
    "ROWS := 0; END_IF;": "MAP_LOAD finds a number of rows that is spoilt in the same cycle",
    "IF ERR <> 0 THEN LAST := ERR": "errors of BLKMOV are negative",
    "FIRST := 0;  ROWS := 0;": "one of two tables is in use when this is called",
    "TO FROM + SRC.Count - 1": "both counts of a row are equal",
    "PERIOD    : TIME": "shorter than a cycle",
    "WAS_CONNECTED : BOOL;": "a BYTE holds a BOOL, and compares as one",
    "IE_RX.Block.Flags AND B#16#02": "CHECK was asked for before, and LOCAL has no SYNC",
    "AG_SEND(ACT := FALSE": "without ACT it only asks how far it is",
    "LEN := 48, DONE := DONE": "the same",
    "INFO : ARRAY": "what the CPU says at a start is not read",
    "RESTART := TRUE, REMOTE := FALSE": "RESTART alone decides what is done",
    "LATE := FALSE);": "the same",
}


def test_mutants(step):
    """slips of the keyboard in the loader do not compile, or its bytes differ from plcSim's

    PLCLINK_MUTANTS: each how-manieth is tried, 101 by default here; 1 takes ten minutes.
    """
    number = int(os.environ.get("PLCLINK_MUTANTS", "101"))
    refused, failed, left = mutate.tried(TEXT, number,
                                         lambda text, program: survives(text, program, step))
    shown = len(left)
    left = [(what, TEXT.splitlines()[pos[0] - 1].strip()) for what, pos in left]
    assert [spot for spot in left if not any(part in spot[1] for part in HARMLESS)] == []
    assert refused + failed >= 4 * len(left)
    assert mutate.agrees((texts.DOCS / "plc-tables.md").read_text(),
                         r"([\d,]+): (\d+) do not compile, (\d+) are noticed, (\d+) have no effect",
                         TEXT, number, (refused, failed, shown))


def survives(text, program, step):
    """True when neither fixed steps, nor tables that are refused, nor some lives differ."""
    try:
        for life in lives.ALL:
            life(fresh(program, step))
        for title in BAD:
            data, error, row = BAD[title]
            crc = 0x12345678 if error == 24 else None
            assert load(fresh(program, step), data, 9, crc=crc)[:3] == (REFUSED, error, row)
        open_ = lives.permissive(text)
        lives.own_blocks(Program(open_, texts.symbols(open_)))
        episodes.run(program, step, range(1000, 1010))
    except (AssertionError, SclError, KeyError, IndexError):
        return False
    return True


def fresh(program, step):
    both = episodes.Episode(program, step, 0)
    both.restart(quiet=True)
    both.tables.update(tables.crc_of(data) for data in (GOOD, OTHER))
    load(both, GOOD)
    assert both.plc.status()[0] == ACTIVE
    return both


# --- The program of plc-programming.md against plcSim's ------------------------------------------

def twins(text, orders, sizes, layout, dbs, seeds=4):
    """Both programs through some lives; SYNC and puts must have been among them."""
    program, step = Program(text, texts.symbols(text)), Step(orders)
    try:
        counts = [episodes.Twin(program, step, sizes, layout, dbs, seed).run()
                  for seed in range(seeds)]
    finally:
        step.close()
    assert sum(synced for synced, _ in counts) > 10 and sum(taken for _, taken in counts) > 2


def test_guide():
    """the program of plc-programming.md and plcSim's send the same bytes, block by block"""
    twins(scenarios.document(),
          [f"blocks {scenarios.IN} {scenarios.OUT}", "db 10 24", "db 11 24",
           f"layout {scenarios.LAYOUT}", "tx P#DB10.DBX0.0 BYTE 8 -> 4",
           "rx 4 -> P#DB10.DBX0.0 BYTE 8", f"begin 0 {scenarios.WATCHDOG}"],
          (scenarios.IN, scenarios.OUT), scenarios.LAYOUT, {10: 24, 11: 24})


# Three maps: by pointers, one value at a time, and blocks longer than AG_SEND takes
HEAD = "symbol,plc,type,dir,tx,rx,via,pv\n"
MAPS = {
    "pointers": HEAD + """T.Temp,DB10.DBD0,REAL,out,4,4,ptr,Temp
T.Speed,DB10.DBW4,INT,out,8,8,ptr,Speed
T.Ramp,DB10.DBD6,ARRAY[1..3] OF REAL,out,12,12,ptr,Ramp
T.Level,DB11.DBD0,REAL,in,24,,ptr,Level
T.Name,DB11.DBB10,STRING[20],in,28,,ptr,Name
""",
    "one by one": HEAD + """T.Temp,DB10.DBD0,REAL,out,4,4,explicit,Temp
T.Pump,DB10.DBX6.1,BOOL,out,8.0,8.0,explicit,Pump
T.Heater,DB10.DBX7.5,BOOL,out,8.3,8.3,explicit,Heater
T.Mode,DB10.DBB9,BYTE,out,9,9,explicit,Mode
T.Speed,DB10.DBW10,INT,out,10,10,explicit,Speed
T.Count,DB11.DBD6,DINT,in,12,,explicit,Count
T.Door,DB11.DBX0.7,BOOL,in,16.2,,explicit,Door
T.Level,DB11.DBW2,INT,in,18,,explicit,Level
""",
    "long blocks": HEAD + """T.Set,DB10.DBW0,ARRAY[1..140] OF INT,out,4,4,ptr,Set
T.On,DB10.DBX290.3,BOOL,out,284.0,284.0,explicit,On
T.Is,DB11.DBD0,ARRAY[1..60] OF REAL,in,290,,ptr,Is
""",
}
KEYS = "key,value\nname,PLC\nsync,on\nreadback,0\nprefix,t:\n"


def plcmap():
    return next((TOP / "bin").glob("*/plcmap"))


@pytest.mark.parametrize("name", MAPS)
def test_generated(tmp_path, name):
    """what plcmap generates for a map ({id}): the SCL and the .plc file send the same bytes"""
    folder = tmp_path / "map"
    folder.mkdir()
    (folder / "plc.csv").write_text(KEYS)
    (folder / "map.csv").write_text(MAPS[name])
    subprocess.run([str(plcmap()), "generate", str(folder), "-o", str(tmp_path)], check=True,
                   capture_output=True)
    text = (tmp_path / "map-step7.scl").read_text()
    assert ("AG_LSEND" in text and "AG_LRECV" in text) == (name == "long blocks")
    lines = [line.split() for line in (tmp_path / "map.plc").read_text().splitlines()]
    keys = {words[0]: words[2] for words in lines if words[1:2] == ["="]}
    dbs = {10: 300, 11: 300}
    twins(text + INSTANCE, [f"blocks {keys['in']} {keys['out']}", f"layout {keys['layout']}"]
          + [f"db {number} {size}" for number, size in dbs.items()]
          + [" ".join(words) for words in lines if words[:1] in (["tx"], ["rx"])]
          + ["begin 0 3000"], (int(keys["in"]), int(keys["out"])), int(keys["layout"]), dbs)


def test_map_of_tables(tmp_path):
    """plcmap check, download=on: what no row can move is an error; else .ptr, .cmd and .plc fit"""
    folder = tmp_path / "map"
    folder.mkdir()
    (folder / "plc.csv").write_text(KEYS.replace("readback,0", "download,on\nreadback,12"))
    rows = MAPS["pointers"].replace("out,4,4", "out,16,4").replace("out,8,8", "out,20,8").replace(
        "out,12,12", "out,24,12").replace("in,24", "in,40").replace("in,28", "in,44")
    run = [str(plcmap()), "generate", str(folder), "-o", str(tmp_path)]
    (folder / "map.csv").write_text(
        rows + "T.Door,DB11.DBX0.7,BOOL,in,70.2,,,Door\nT.Raw,I4.0,BYTE,in,71,,,Raw\n")
    refused = subprocess.run(run, capture_output=True, text=True)
    for symbol in ("T.Door", "T.Raw"):
        assert f"{symbol} would need a line in the PLC's program" in refused.stdout + refused.stderr
    (folder / "map.csv").write_text(rows)
    subprocess.run(run, check=True, capture_output=True)
    assert "rx 4 -> P#DB10.DBX0.0 BYTE 6  T.Temp T.Speed" in (
        tmp_path / "map.ptr").read_text()
    assert 's7plcTables("PLC", "$(MAPDIR=.)/map.ptr")' in (tmp_path / "map.cmd").read_text()
    plc = (tmp_path / "map.plc").read_text()
    assert "map       = on" in plc and "allow write DB10\nallow read DB11\n" in plc
