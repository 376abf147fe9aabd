"""The plan and the judge of the soak (docs/soak.md): pure logic, each verdict both ways."""
import contextlib
import importlib
import json
import re
import struct
import subprocess
import time
import types

import pytest
from epics.ca import ChannelAccessException

from soak import judge, origin, plan, programs, recorder, report, wire
from soak.__main__ import PROGRAMS, TRANSPORTS, forget, outcome, results, tell
from soak.blocks import Edges, Frames
from soak.etherip import EtherIp
from soak.modbus import Modbus
from soak.pair import Pair
from soak.sync import Sync
from soak.world import WRITE, World

FAULTS = [plan.Fault("a", 5, 0.5, 1.0), plan.Fault("b", 1), plan.Fault("c", 0)]


def test_plan():
    """the same seed gives the same episodes, another one others; weights and times are kept to"""
    first = [plan.episode(1, "blocks", n, FAULTS) for n in range(200)]
    assert first == [plan.episode(1, "blocks", n, FAULTS) for n in range(200)]
    assert first != [plan.episode(2, "blocks", n, FAULTS) for n in range(200)]
    assert first != [plan.episode(1, "pair", n, FAULTS) for n in range(200)]
    steps = [s for e in first for s in e.steps]
    assert {s.fault for s in steps} == {"a", "b"}
    assert all(0.5 <= s.seconds <= 1.0 for s in steps if s.fault == "a")
    assert sum(s.fault == "a" for s in steps) > sum(s.fault == "b" for s in steps)
    assert any(len(e.steps) == 2 for e in first) and all(
        len({s.fault for s in e.steps}) == len(e.steps) for e in first)


def test_five_seconds():
    """no fault of any scenario lasts longer than five seconds"""
    for name in TRANSPORTS.values():
        module, kind = name.split(".")
        faults = getattr(importlib.import_module(f"soak.{module}"), kind).FAULTS
        assert faults and all(0 <= fault.shortest <= fault.longest <= 5 for fault in faults), name


def test_apart():
    """what must not come together does not; all else does"""
    faults = [plan.Fault(name, 1) for name in "abcd"]
    episodes = [plan.episode(1, "blocks", n, faults, [({"a"}, {"b"}), ({"c"}, {"c"})]) for n in range(300)]
    together = {frozenset(s.fault for s in e.steps) for e in episodes}
    assert not any({"a", "b"} <= t for t in together)
    assert {len(episode.steps) for episode in (plan.episode(1, "blocks", n, faults) for n in range(300))} == {1, 2, 3}
    assert {"a", "c"} in together and {"b", "d"} in together and {"a", "c", "d"} in together


# --- Values ----------------------------------------------------------------------------------

@pytest.mark.parametrize("order", "<>")
def test_probe(order):
    """a probe is found wherever it begins, in whatever pieces it comes; a torn one is none"""
    stream = b"xy" + judge.probe(7, order) + b"z" * 32 + judge.probe(8, order)
    finder = judge.ProbeFinder(order)
    assert [n for i in range(len(stream)) for n in finder.feed(stream[i:i + 1])] == [7, 8]
    torn = judge.probe(7, order)[:32] + judge.probe(8, order)[32:]
    assert judge.ProbeFinder(order).feed(torn + judge.probe(9, order)) == [9]


def test_signals():
    """the lines for plcSim make just the bytes of a probe"""
    lines = [line.split() for line in judge.signals(4, "DB11.").splitlines()]
    assert lines[0][1:] == ["DB11.4", "UINT32", "constant", str(judge.MAGIC)]
    assert [int(line[1].split(".")[1]) - 4 for line in lines] == [0, 4, 8, 16, 48, 60]
    assert judge.number_of(struct.pack(">IIQ8IdII", judge.MAGIC, 5, 5, *[5] * 8, 5.0, 0, 5)) == 5


@pytest.mark.parametrize("order", "<>")
def test_setpoint(order):
    """a setpoint shows its record and number, also in a stream; a torn one is told"""
    value = judge.setpoint(3, 70001)
    assert judge.put_of(value) == (3, 70001) and judge.put_of(0) is None and float(value) == value
    data = struct.pack(order + "hqhq", 5, value, 0, judge.setpoint(31, 70002))
    finder = judge.PutFinder(order)
    assert [p for i in range(len(data)) for p in finder.feed(data[i:i + 1])] == [(3, 70001), (31, 70002)]
    with pytest.raises(judge.Wrong, match="torn"):
        judge.put_of(value ^ 1)


# --- Inputs: blocks 1 ... 9 come at 0.1, 0.2 ... s -------------------------------------------

def inputs():
    known = judge.Inputs(2.0)
    for n in range(1, 10):
        known.delivered(n / 10, n)
    return known


@pytest.mark.parametrize("what, number, at, invalid, kind", [
    ("the newest", 9, 1.0, False, None),
    ("one of just now", 8, 1.0, False, None),
    ("one that is too old", 2, 1.5, False, "stale"),
    ("nobody's", 77, 1.0, False, "wrong"),
    ("the newest, within the timeout", 9, 2.8, False, None),
    ("the newest, beyond it", 9, 3.5, False, "stale"),
    ("the same, with an alarm", 9, 3.5, True, None),
])
def test_inputs(what, number, at, invalid, kind):
    """a record that shows {what}"""
    known = inputs()
    if kind is None:
        known.got("n", at, at + 0.01, number, invalid, slack=0.3)
    else:
        with pytest.raises(judge.Wrong, match=kind):
            known.got("n", at, at + 0.01, number, invalid, slack=0.3)


def test_inputs_connection():
    """after the end of the connection no alarm is wrong, until a block has come again; a record may need a moment"""
    known = inputs()
    known.ended(1.0)
    known.got("n", 1.1, 1.1, 9, False, slack=0.3)
    with pytest.raises(judge.Wrong, match="stale"):
        known.got("n", 1.5, 1.5, 9, False, slack=0.3)
    known.delivered(1.6, 10)
    known.got("n", 1.9, 1.9, 10, False, slack=0.2)


def test_inputs_blind():
    """of an IOC that stands still nothing is expected; afterwards it is"""
    known = inputs()
    known.begins("blind", 1.0)
    known.got("n", 5.0, 5.0, 9, False, slack=0.3)
    known.over("blind", 5.0)
    with pytest.raises(judge.Wrong, match="stale"):
        known.got("n", 6.0, 6.0, 9, False, slack=0.3)


def test_inputs_loose():
    """while blocks may not be usable an older one is right, but not one beyond the timeout"""
    known = inputs()
    known.begins("loose", 0.3)
    known.got("n", 1.5, 1.5, 2, False, slack=0.3)
    for n in range(10, 90):
        known.delivered(n / 10, n)
    with pytest.raises(judge.Wrong, match="stale"):
        known.got("n", 9.0, 9.0, 2, False, slack=0.3)


@pytest.mark.parametrize("numbers, kind", [
    ([1, 2, 2, 5, 9], None), ([1, 5, 4], "doubled"), ([1, 77], "wrong")])
def test_events(numbers, kind):
    """what a monitor tells comes in the order of blocks: {numbers}"""
    known = inputs()
    if kind is None:
        for n in numbers:
            known.event("n", n)
    else:
        with pytest.raises(judge.Wrong, match=kind):
            for n in numbers:
                known.event("n", n)


def test_whole():
    """an array of two blocks is torn"""
    assert judge.whole("a", [4, 4, 4]) == 4
    with pytest.raises(judge.Wrong, match="torn"):
        judge.whole("a", [4, 4, 5])


# --- Outputs ---------------------------------------------------------------------------------

def outputs(puts, **kw):
    """Outputs with so many puts to each record; their numbers are 70001 ..."""
    known = judge.Outputs(**kw)
    for record in puts:
        known.put(record)
    return known


@pytest.mark.parametrize("got, kind", [
    ([(1, 70001), (1, 70003)], None),              # the newest counts
    ([(1, 70003), (1, 70001)], "doubled"),
    ([(1, 70009)], "wrong"),
    ([(1, 70002)], "wrong"),                       # that was record 2
])
def test_outputs(got, kind):
    """the PLC gets puts 1 and 3 of record 1: {got}"""
    known = outputs([1, 2, 1])
    if kind is None:
        for record, number in got:
            known.got(record, number)
        known.quiet(1)
    else:
        with pytest.raises(judge.Wrong, match=kind):
            for record, number in got:
                known.got(record, number)


def test_outputs_last():
    """when it is quiet the last put is there"""
    known = outputs([1, 1])
    known.got(1, 70001)
    with pytest.raises(judge.Wrong, match="lost"):
        known.quiet(1)


def test_outputs_acknowledged():
    """over a wire with answers: once a connection, and what was acknowledged is there"""
    known = outputs([1], acknowledged=True)
    with pytest.raises(judge.Wrong, match="lost"):
        known.acknowledged_put(1, 70001)
    known.got(1, 70001, line=1)
    known.acknowledged_put(1, 70001)
    known.got(1, 70001, line=2)
    with pytest.raises(judge.Wrong, match="doubled"):
        known.got(1, 70001, line=2)


def test_outputs_block():
    """a block of the IOC: each place has its own record's value; one that was written is not 0 again"""
    known = outputs([1, 2])
    known.got_block([judge.setpoint(1, 70001), 0])
    known.got_block([judge.setpoint(1, 70001), judge.setpoint(2, 70002)])
    with pytest.raises(judge.Wrong, match="lost"):
        known.got_block([0, judge.setpoint(2, 70002)])
    with pytest.raises(judge.Wrong, match="wrong"):
        known.got_block([judge.setpoint(2, 70002), judge.setpoint(2, 70002)])
    known.new_ioc()
    known.got_block([0, 0])


def test_edges():
    """each edge of a bit is seen while the connection holds; a loss excuses"""
    edges = Edges()
    edges.quiet(0)
    for bit in (edges.next(), edges.next()):
        edges.got(bit)
    edges.quiet(0)
    edges.next(), edges.next()  # there and back, unseen
    with pytest.raises(judge.Wrong, match="lost"):
        edges.quiet(0)
    edges.next(), edges.next()
    edges.quiet(1)


def test_held():
    """with the handshake: what the PLC holds only rises, and a refused put never gets there"""
    held = judge.Held()
    put, hmi, refused = held.new(1, "put"), held.new(1, "HMI"), held.new(1, "put")
    held.shows(1, 0)
    held.shows(1, hmi)
    with pytest.raises(judge.Wrong, match="doubled"):
        held.shows(1, put)
    held.refuse(refused & 0xFFFFFF)
    with pytest.raises(judge.Wrong, match="refused"):
        held.shows(1, refused)
    with pytest.raises(judge.Wrong, match="lost"):
        held.shows(1, 0)
    held.memory_lost()
    held.shows(1, 0)
    with pytest.raises(judge.Wrong, match="doubled"):
        held.shows(1, hmi)


# --- The rest --------------------------------------------------------------------------------

def test_frames():
    """blocks of fixed size from a stream in pieces"""
    frames = Frames(4)
    assert frames.feed(b"abc") == [] and frames.feed(b"defghij") == [b"abcd", b"efgh"]


def test_lies():
    """lies concern one way and one size, now and then"""
    blocks = [bytes([n]) * 8 for n in range(100)]
    for kind, expected in (("tear", b"\x27" * 4 + b"\x26" * 4), ("repeat", b"\x22" * 8), ("drop", b"\x26" * 8)):
        lie, state = wire.lie_of(kind, wire.TO_IOC, 8), {}
        told = [lie(wire.TO_IOC, block, state) for block in blocks]
        assert told[:39] == blocks[:39] and told[39] == expected
        assert lie(wire.TO_PLC, b"12345678", {}) == b"12345678" and lie(wire.TO_IOC, b"1", {}) == b"1"


def run_of(folder, *names):
    """Arguments of a run of these scenarios, two of each."""
    return types.SimpleNamespace(seed=5, duration=60.0, transports=list(names), instances=2, out=folder)


def result_of(name, instance, **more):
    return {**recorder.empty({"name": name, "instance": instance, "seed": 5, "duration": 60}), "episodes": 3,
            "faults": {"reset": 2}, "counts": {"values judged": 7}, "seconds": 60.0, "ended": True,
            "figures": {"gap": {"reset": {"n": 2, "max": 0.5, "values": [0.1, 0.5]}}},
            "series": [[0.0, 1e6, 10, 1], [5.0, 2e6, 11, 1]], **more}


def write(folder, result):
    file = folder / f"{result['about']['name']}-{result['about']['instance']}" / "result.json"
    file.parent.mkdir(exist_ok=True)
    file.write_text(json.dumps(result))


def test_report(tmp_path):
    """the page says what was wrong, escapes it, and needs nothing else"""
    options = run_of(tmp_path, "blocks")
    page = report.page(options, [result_of("blocks", 0)], "Started <now>")
    assert "Nothing lost" in page and "make soak SEED=5" in page and page.count("<svg") >= 4
    assert "<td>right</td>" in page and "Started &lt;now&gt;" in page
    assert "<script" not in page and "http-equiv" not in page
    page = report.page(options, [result_of("blocks", 0, failure="stale: <n>")], "")
    assert "Nothing lost" not in page and "stale: &lt;n&gt;" in page and "<td>WRONG</td>" in page


@pytest.mark.parametrize("second, bad, failures, state", [
    ({}, [], [None, None], "right"),
    ({"ended": False}, ["blocks-1"], [None, "did not end"], "WRONG"),
    ({"ended": False}, ["blocks-0"], ["did not end", None], "WRONG"),
    ({"ended": False}, [], [None, "did not end"], "WRONG"),
    ({"failure": "torn: n"}, ["blocks-1"], [None, "torn: n"], "WRONG"),
    ({"failure": "torn: n"}, ["blocks-0"], ["did not end", "torn: n"], "WRONG"),
    (None, ["blocks-1"], [None, "it wrote no result"], "WRONG")],
    ids=["right", "killed", "stopped", "not told", "wrong", "both", "no result"])
def test_outcome(tmp_path, capsys, second, bad, failures, state):
    """report and console say the same: a scenario that was killed, overran or wrote nothing is wrong ({id})"""
    options = run_of(tmp_path, "blocks")
    write(tmp_path, result_of("blocks", 0))
    if second is not None:
        write(tmp_path, result_of("blocks", 1, **second))
    found = outcome(options, bad)
    assert [r["failure"] for r in found] == failures
    tell(options, [r for r in found if r["failure"]])
    page, console = report.page(options, found, ""), capsys.readouterr().out
    assert ("Nothing lost" in page) == (not console) and f"<td>{state}</td>" in page
    for instance, failure in enumerate(failures):
        for text in (page, console):
            assert (f"blocks-{instance}, episode " in text) == bool(failure)
            assert not failure or failure in text


def test_stopped_scenario(tmp_path):
    """a scenario that was ended because another was wrong is neither wrong nor right"""
    options = run_of(tmp_path, "blocks", "pair")
    for name in options.transports:
        for instance in (0, 1):
            write(tmp_path, result_of(name, instance, ended=False))
    page = report.page(options, outcome(options, ["pair-1"]), "")
    assert "<td>stopped</td>" in page and "<td>WRONG</td>" in page and "<td>right</td>" not in page


def test_only_this_run(tmp_path):
    """what an earlier run has left in the folder does not count"""
    for name in ("blocks", "pair"):
        for instance in range(3):
            write(tmp_path, result_of(name, instance, failure="stale: of yesterday"))
    (tmp_path / "report.html").write_text("Nothing lost")
    options = run_of(tmp_path, "blocks")
    forget(options)
    assert results(options) == [] and not (tmp_path / "report.html").exists()
    for instance in (0, 1):
        write(tmp_path, result_of("blocks", instance))
    assert [r["about"]["instance"] for r in results(options)] == [0, 1]
    assert [r["failure"] for r in outcome(options, [])] == [None, None]


def test_origin(monkeypatch, tmp_path):
    """one line says start, commit, Base and cores; sources without a checkout of their own have no commit"""
    assert re.fullmatch(r"Started 20\d\d-\d\d-\d\d \d\d:\d\d:\d\d [+-]\d{4}; plclink \d+\.\d+\.\d+, commit \S+; "
                        r"EPICS 7\.\S+; \d+ cores", origin.line())
    monkeypatch.setattr(origin, "TOP", tmp_path)
    assert origin.commit() is None
    for words in (["init", "-q"], ["-c", "user.name=a", "-c", "user.email=a", "commit", "-qm", "a", "--allow-empty"]):
        subprocess.run(["git", *words], cwd=tmp_path, check=True)
    assert re.fullmatch(r"[0-9a-f]{7,}", origin.commit())
    (tmp_path / "a").touch()
    subprocess.run(["git", "add", "a"], cwd=tmp_path, check=True)
    assert origin.commit().endswith("-dirty")


@pytest.mark.parametrize("name", PROGRAMS)
def test_program(monkeypatch, tmp_path, name):
    """the episodes that {name} says are counted"""
    monkeypatch.setattr(programs, "COUNT", {key: 1 for key in programs.COUNT})
    of = recorder.Recorder(tmp_path / "result.json", {"name": name, "instance": 0})
    assert programs.run(name, 0, 1, 0.5, of, print) is None
    assert of.data["ended"] and of.data["episodes"] > 0


# --- Waiting ---------------------------------------------------------------------------------

def test_patience():
    """what must come has its time, in which a machine that is late does not count; an end there is in any case"""
    steady = judge.Patience(90, 1000)
    assert not any(steady.over(1000 + t, 0.1) for t in range(91)) and steady.over(1091, 0.0)
    assert steady.words() == "91 s"
    busy = judge.Patience(90, 0)
    assert not any(busy.over(t, 0.5) for t in range(500)) and not any(busy.over(t, 0.0) for t in range(500, 589))
    assert busy.over(591, 0.0) and busy.words() == "591 s (threads were late by up to 0.5 s)"
    never = judge.Patience(90, 0)
    assert not any(never.over(t, 9.0) for t in range(901)) and never.over(901, 9.0)


def sync_world(shows, lines=(), gets=None, refused=()):
    """A put of 70001 to record 1 whose record shows put `shows` afterwards; gets: what the PLC has got."""
    held = judge.Held()
    held.refused.update(refused)
    held.last.update({1: gets} if gets else {})
    world = types.SimpleNamespace(held=held, pending={}, sim=types.SimpleNamespace(lines=[]))
    world.recorder = types.SimpleNamespace(count=lambda name: None)
    world.put = lambda record: world.pending.update({record: (70001,)})
    world.check = world.look_at_memory = lambda: None
    world.ask = lambda name: (judge.setpoint(1, shows), 0, 0, 0, 0)

    def completions():
        world.pending.clear()
        world.sim.lines += lines
    world.completions = completions
    return world


def patience(count):
    def over():
        over.left -= 1
        return over.left < 0
    over.left, over.words = count, lambda: "90 s"
    return over


def test_put_with_sync():
    """a put that was accepted is with the PLC; unless SYNC fell meanwhile and the record says that it is not"""
    falls = ["2026 PLC: SYNC falls: the connection is gone"]
    assert Sync.arrives(sync_world(70001, gets=70001), 1, patience(3))
    assert Sync.arrives(sync_world(70000, refused=[70001]), 1, patience(3))
    assert not Sync.arrives(sync_world(70000, falls), 1, patience(3))
    for world in (sync_world(70001, falls), sync_world(70000), sync_world(70001)):
        with pytest.raises(judge.Wrong, match="^lost: setpoint 1: put 70001 was accepted"):
            Sync.arrives(world, 1, patience(3))


def resting_world(valid, losses=(0, 0)):
    """All is well, with so many connections lost before, and at the end of, the rest."""
    world = types.SimpleNamespace(INPUTS=["n"], TIMEOUT=2.0, whole_at=losses[0], losses=losses[1])
    world.look = lambda name: valid
    world.inputs = types.SimpleNamespace(times=[time.monotonic() + 10])
    world.pulse = types.SimpleNamespace(slack=lambda: 0.6)
    return world


def test_rest():
    """no alarm while all is well; a connection that ends just then makes all begin anew"""
    dice = plan.chance(1)
    assert World.rests(resting_world(True), dice)
    assert not World.rests(resting_world(True, (0, 1)), dice) and not World.rests(resting_world(False, (0, 1)), dice)
    with pytest.raises(judge.Wrong, match="^wrong: n is INVALID although all is well"):
        World.rests(resting_world(False), dice)


def test_stale_while_waiting():
    """a value that stays old is told as stale, and not as something that does not come well"""
    world = types.SimpleNamespace(INPUTS=["n"], OUTPUTS=0, pending={}, lock=contextlib.nullcontext(), inputs=judge.Inputs(2.0))
    world.pulse = types.SimpleNamespace(slack=lambda: 0.6)
    world.leading = world.outputs_settled = lambda: ()
    world.inputs_of_client = lambda: ["n"]
    world.number = World.number.__get__(world)
    world.judged = World.judged.__get__(world)
    now = time.monotonic()
    world.inputs.begins("loose", now - 60)
    for i in range(300):
        world.inputs.delivered(now - 15 + i * 0.05, i)
    world.ask = lambda name: (250, 0, 0, now, now)  # of 2.5 s ago
    assert World.settled(world) == "n shows block 250"
    world.ask = lambda name: (100, 0, 0, now, now)  # of 10 s ago
    with pytest.raises(judge.Wrong, match="^stale: n shows block 100 of 10.00 s ago"):
        World.settled(world)


def test_slow_server():
    """a PLC beside whose server its memory is read may take its time with a put; one that never has it is told"""
    outputs = judge.Outputs()
    values = [judge.setpoint(1, 70000), judge.setpoint(1, 70000), outputs.put(1)]
    world = types.SimpleNamespace(outputs=outputs, held=lambda record: values.pop(0), patience=lambda: patience(3))
    world.losses = world.whole_at = 1
    assert World.held_in_the_end(world, 1) == judge.setpoint(1, 70001) and not values
    world.held = lambda record: judge.setpoint(1, 70000)
    assert World.held_in_the_end(world, 1) == judge.setpoint(1, 70000)
    world.losses = 2  # a put that was not answered has gone with its connection
    assert World.held_in_the_end(world, 1) is None


def test_put_while_away():
    """what was put while there was no connection, or on another one, is void over EtherNet/IP; else it is not"""
    world = types.SimpleNamespace(losses=1, lives=1, proxies=[types.SimpleNamespace(count=1)], put_at={}, pending={})
    outputs = judge.Outputs()
    outputs.put(1)
    world.outputs, puts = outputs, []
    world.connection = EtherIp.connection.__get__(world)
    world.ask = lambda name: (judge.setpoint(1, 70000), 0, 0, 0, 0)
    world.held, world.put = lambda record: 0, puts.append
    world.put_at[1] = world.connection()
    assert "put 70001 was the last" in EtherIp.outputs_settled(world) and not puts
    world.proxies[0].count = 2  # it was put while the IOC had none
    assert "was the last" not in EtherIp.outputs_settled(world) and puts == [1]


@pytest.mark.parametrize("answers, since", [
    ([None, None, 7], 0), ([7], 0), ([ChannelAccessException("lost"), None, 7], 1)], ids=["late", "at once", "lost first"])
def test_late_answer(monkeypatch, answers, since):
    """an answer that is late is of when it was asked for, and not of when it came; after a failure it is asked for anew"""
    times, asked = iter(range(100)), []

    def get(form=None, **_):
        assert form == "time"  # else pyepics asks for the type that there was when the channel came
        asked.append(next(times))
        answer = answers[len(asked) - 1]
        if isinstance(answer, Exception):
            raise answer
        return answer and {"value": answer, "severity": 0, "status": 0}
    world = types.SimpleNamespace(patience=lambda: patience(9), ended_well=lambda: None)
    world.pvs = {"n": types.SimpleNamespace(get_with_metadata=get, wait_for_connection=lambda limit: True)}
    monkeypatch.setattr("soak.world.time.monotonic", lambda: next(times))
    value, _, _, begin, end = World.ask(world, "n")
    monkeypatch.undo()
    assert value == 7 and end > asked[-1] and asked[since] - begin == 1


def test_faults_overlap():
    """with several faults by which records of a pair may go INVALID, that is judged again when the last has ended"""
    world = types.SimpleNamespace(unjudged=0, blind_until=0.0, TIMEOUT=2.0)
    long, short = (Pair._unjudged(world, iter([None])) for _ in "12")
    next(long), next(short)
    assert world.blind_until == float("inf")
    next(short, None)
    assert world.blind_until == float("inf")
    next(long, None)
    assert time.monotonic() < world.blind_until <= time.monotonic() + world.TIMEOUT


@pytest.mark.parametrize("holds, status, again", [(0, WRITE, [1]), (0, WRITE + 1, []), (1, WRITE, [])],
                         ids=["given up", "another alarm", "the PLC has it"])
def test_given_up(holds, status, again):
    """over Modbus a write that was given up is put again, once; nothing else is ({holds}, {status})"""
    outputs, puts = judge.Outputs(), []
    value = outputs.put(1)
    world = Modbus.__new__(Modbus)
    world.outputs, world.OUTPUTS, world.given_up, world.put_once_more = outputs, 1, set(), puts.append
    world.ask = lambda name: (value, 3, status, 0, 0)
    world.held = lambda record: holds * value
    for _ in range(2):
        assert world.outputs_settled() == "o1 has severity 3"
    assert puts == again
