"""Writes that a Modbus device never answers, or answers wrongly: they end with their alarm after one repetition, and the
station goes on."""
import threading

import pytest

from ioc import errors_in
from waiting import until, until_equal

BASE = 200   # the first output register
COILS = 400  # and coil
BAD = 5      # offset of the register that gets no good answer

DB = "\n".join(
    [f'record(longout, "$(P)o{i}") {{ field(DTYP, "S7plc") field(OUT, "@PLC/{2 * i} T=UINT16") field(FLNK, "$(P)n{i}") }}\n'
     f'record(calc, "$(P)n{i}") {{ field(CALC, "VAL+1") }}' for i in range(20)] +
    [f'record(bo, "$(P)k{i}") {{ field(DTYP, "S7plc") field(OUT, "@PLC/100 T=UINT8 B={i}") }}' for i in range(8)] +
    ['record(bo, "$(P)pulse") { field(DTYP, "S7plc") field(OUT, "@PLC/100 T=UINT8 B=0") field(HIGH, "0.05") }',
     'record(bo, "$(P)bit") { field(DTYP, "S7plc") field(OUT, "@PLC/10 T=UINT16 B=3") }',
     'record(longin, "$(P)in") { field(DTYP, "S7plc") field(INP, "@PLC/0 T=INT16") field(SCAN, "I/O Intr") }',
     'record(longin, "$(P)losses") { field(DTYP, "S7plc stats") field(INP, "@PLC/reconnects") field(SCAN, ".1 second") }',
     'record(longin, "$(P)timeouts") { field(DTYP, "S7plc stats") field(INP, "@PLC/requestTimeouts") field(SCAN, ".1 second") }',
     'record(longin, "$(P)waiting") { field(DTYP, "S7plc stats") field(INP, "@PLC/putsWaiting") }'])


class Device:
    """Has a register or coil whose writes it does not carry out, and answers as `how` says."""

    def __init__(self, new_modbus, new_ioc, *options, how="mute", bad=lambda r: BASE + BAD in r.addresses(), inputs=True, off=False):
        self.plc, self.how, self.bad = new_modbus(), how, bad
        if off:
            self.plc.power_off()
        self.plc.judge = lambda request: 4 if self.meets(request) else 0
        self.plc.mangle = self.answer
        self.ioc = new_ioc(self.plc.configure("holding 0 10 every 20" if inputs else "",
                                              f"holding {BASE} 20, coils {COILS} 8 at 100", timeout=200) +
                           "".join(f"\ns7plcSetOption PLC {option}" for option in options), DB)
        self.ioc.wait_log("cannot connect" if off else "connected")
        if not off:
            until(lambda: self.plc.answers >= 3, "the first reads")

    def meets(self, request):
        return request.function in (5, 6, 15, 16, 22) and self.bad(request)

    def answer(self, request, frame):
        if not self.meets(request):
            return frame
        handler = self.plc.handlers[-1]
        if self.how == "echo":  # of another address
            return frame[:4] + b"\0\6" + frame[6:7] + bytes([request.function]) + (request.start + 1).to_bytes(2, "big") + b"\0\1"
        if self.how in ("close", "reset"):
            self.plc.loop.call_soon(lambda: handler.drop(reset=self.how == "reset"))
        return b""

    def tries(self, value=None):
        return [r for r in self.plc.writes() if self.meets(r) and (value is None or value in r.values)]

    def reads_on(self, value):
        self.plc.holding[0] = value
        self.ioc.wait_value("in", value)

    def nothing_waits(self):
        self.ioc.process_record("waiting")
        return self.ioc.get("waiting") == 0

    def ended(self, name, reason):
        """The put is through: its record has its alarm, is not active, and stays so."""
        self.ioc.wait_alarm(name, "INVALID", "WRITE", reason)
        assert self.ioc.get(name + ".PACT") == 0
        until(self.nothing_waits, "no put that waits")

    def put_together(self, count):
        """100 and up into so many records, while a request waits for its answer: they leave together."""
        self.ioc.connect([f"o{i}" for i in range(count)])
        self.plc.answering.clear()
        until(lambda: self.plc.held, "a request on its way")
        for i in range(count):
            self.ioc.put(f"o{i}", 100 + i)
        self.plc.answering.set()

    def link_changes_while_away(self):
        """The one of o1, whose put of 7 waits."""
        self.plc.power_off()
        self.ioc.wait_log("disconnected")
        self.ioc.put("o1", 7)
        self.ioc.wait_alarm("o1", "INVALID", "COMM")
        self.ioc.put("o1.OUT", "@PLC/20 T=UINT16")
        self.ioc.wait_alarm("o1", "INVALID", "WRITE", "link changed: value not written")

    def good(self, name, value, at):
        self.ioc.put(name, value)
        until_equal(lambda: self.plc.holding[BASE + at], value)
        self.ioc.wait_alarm(name, "NO_ALARM")


REASONS = {"mute": "no answer for 200 ms", "echo": "bad answer", "close": "closed by PLC", "reset": "reset by PLC"}


@pytest.mark.parametrize("how", REASONS)
@pytest.mark.parametrize("complete", ["acknowledged", "sent"])
def test_one_register(new_modbus, new_ioc, how, complete):
    """{how} in place of the answer to one write, complete={complete}: it is made once more after the reconnect, then it ends with its alarm; the station goes on"""
    d = Device(new_modbus, new_ioc, f"complete {complete}", "readPeriod 50", how=how)
    plc, ioc = d.plc, d.ioc
    ioc.connect(["o5.PACT", "losses"])
    done = ioc.put_callback("o5", 7)
    until(done.is_set, "the end of the put")
    ioc.put("o6", 8)
    ioc.put("k1", 1)
    until_equal(lambda: (plc.holding[BASE + 6], plc.coils[COILS + 1]), (8, True))
    d.ended("o5", REASONS[how])
    assert ioc.get("n5") == 1  # its forward link ran, once
    tries, losses = len(d.tries()), ioc.get("losses")
    # a request that is answered by a close is made twice
    assert 2 <= tries <= (4 if how in ("close", "reset") else 2) and losses <= 2, (tries, losses)
    for value in 1, 2, 3:
        d.reads_on(value)
    d.good("o6", 9, 6)
    assert len(d.tries()) == tries and ioc.get("losses") == losses
    d.ended("o5", REASONS[how])
    assert ioc.log_count("write of holding 205: ") == 1 and ioc.log_count("not tried again") == 1, ioc.log
    assert [line for line in errors_in(ioc.log) if REASONS[how] in line], ioc.log
    # the device loses power: what it did not take is not put again
    plc.power_off()
    ioc.wait_alarm("in", "INVALID")
    plc.holding[BASE + 6] = 0
    plc.power_on()
    until_equal(lambda: plc.holding[BASE + 6], 9)
    assert len(d.tries()) == tries
    # it answers again
    d.bad = lambda request: False
    d.good("o5", 10, 5)


@pytest.mark.parametrize("how", REASONS)
def test_put_again_and_again(new_modbus, new_ioc, how):
    """{how} for a register that is put again: each put is tried once, and ends with its alarm"""
    d = Device(new_modbus, new_ioc, "readPeriod 50", how=how)
    d.ioc.put("o5", 1)
    d.ended("o5", REASONS[how])
    before = len(d.tries())
    for value in range(2, 5):
        d.ioc.put("o5", value)
        d.ended("o5", REASONS[how])
        assert d.ioc.get("n5") == value
    assert len(d.tries()) - before == 3 * (2 if how in ("close", "reset") else 1)
    if how == "mute":  # that is known by now: the connection stays
        assert d.ioc.get("losses") == 1
    assert d.ioc.log_count("write of holding 205: ") == 1, d.ioc.log


@pytest.mark.parametrize("how", REASONS)
def test_one_of_two(new_modbus, new_ioc, how):
    """{how} for one register of two that leave in one request: the other one is written"""
    d = Device(new_modbus, new_ioc, "readPeriod 50", "holdoff 100", how=how)
    d.ioc.connect(["o5", "o6"])
    for name, value in ("o5", 7), ("o6", 8):
        d.ioc.put(name, value, wait=False)
    until_equal(lambda: d.plc.holding[BASE + 6], 8)
    d.ended("o5", REASONS[how])
    d.ioc.wait_alarm("o6", "NO_ALARM")


def test_neighbours(new_modbus, new_ioc):
    """20 neighbours in one request, of which one register is never answered: the 19 others are written"""
    d = Device(new_modbus, new_ioc, "readPeriod 50", "complete sent", inputs=False)
    plc, ioc = d.plc, d.ioc
    d.put_together(20)
    d.ended("o5", "no answer for 200 ms")
    assert [plc.holding[BASE + i] for i in range(20)] == [0 if i == BAD else 100 + i for i in range(20)]
    assert [i for i in range(20) if ioc.severity(f"o{i}") != "NO_ALARM"] == [BAD]
    assert ioc.get("losses") == 1


@pytest.mark.parametrize("option,how", [("check loose", "mute"), ("check anyTransaction", "echo"), ("check strict", "echo")])
def test_many_bad_places(new_modbus, new_ioc, option, how):
    """{how} for ten registers of twenty that leave together, {option}: the ten others are written without a loss of the connection for each, and go on while the bad ones are put again"""
    d = Device(new_modbus, new_ioc, "readPeriod 50", "complete sent", option, how=how,
               bad=lambda r: any((a - BASE) % 2 for a in r.addresses()))
    d.put_together(20)
    until_equal(lambda: [d.plc.holding[BASE + i] for i in range(20)], [0 if i % 2 else 100 + i for i in range(20)])
    for i in range(1, 20, 2):
        d.ended(f"o{i}", REASONS[how])
    assert [i for i in range(20) if d.ioc.severity(f"o{i}") != "NO_ALARM"] == list(range(1, 20, 2))
    for value in 1, 2:
        for i in range(20):
            d.ioc.put(f"o{i}", 1000 * value + i)
        until_equal(lambda: [d.plc.holding[BASE + i] for i in range(0, 20, 2)], [1000 * value + i for i in range(0, 20, 2)])
    d.reads_on(5)
    until(d.nothing_waits, "no put that waits")
    assert d.ioc.get("losses") <= 3, d.ioc.log  # a busy machine may answer a read too late; each bad one was lost twice


def test_no_write_at_all(new_modbus, new_ioc):
    """a device that answers reads and no write: all puts end, reads go on, requests are bounded"""
    d = Device(new_modbus, new_ioc, "readPeriod 50", "complete sent", bad=lambda request: True)
    plc, ioc = d.plc, d.ioc
    d.put_together(20)
    for i in range(20):
        d.ended(f"o{i}", "no answer for 200 ms")
    d.reads_on(7)
    tries = len(d.tries())
    assert tries < 20 and ioc.get("losses") == 1, tries
    d.reads_on(8)
    assert len(d.tries()) == tries
    assert not any(r.writes for r in plc.since(plc.mark() - 5)) and not any(plc.holding[BASE:BASE + 20])


@pytest.mark.parametrize("single", ["on", "off"])
@pytest.mark.parametrize("name,bad", [("pulse", "coil"), ("bit", "register")])
def test_bits(new_modbus, new_ioc, single, name, bad):
    """a {bad}'s bit that is never answered, singleWrite={single}: it ends, others go on"""
    meets = {"coil": lambda r: r.table == "coils" and COILS in r.addresses(),
             "register": lambda r: r.table == "holding" and BASE + BAD in r.addresses()}[bad]
    d = Device(new_modbus, new_ioc, "readPeriod 50", f"singleWrite {single}", bad=meets)
    d.ioc.put(name, 1)
    d.ioc.wait_alarm(name, "INVALID", "WRITE", "no answer for 200 ms")
    d.good("o7", 3, 7)
    d.ioc.put("k3", 1)
    until_equal(lambda: d.plc.coils[COILS + 3], True)
    until(d.nothing_waits, "no put that waits")
    d.reads_on(5)
    functions = {"coil": (5 if single == "on" else 15), "register": 22}[bad]
    assert {r.function for r in d.tries()} == {functions} and len(d.tries()) <= 3  # ON, and OFF of the pulse
    d.ended(name, "no answer for 200 ms")  # also behind the OFF
    assert d.ioc.get("losses") == 1


def test_order_behind(new_modbus, new_ioc):
    """puts behind one that is never answered leave in their order, with writes=all each of them"""
    d = Device(new_modbus, new_ioc, "readPeriod 50", "writes all", "complete sent", "requestTimeout 2000")
    ioc = d.ioc
    ioc.connect(["o1", "o5", "o9", "k2"])
    ioc.put("o5", 1)
    d.ended("o5", "no answer")
    mark = d.plc.mark()
    d.plc.answering.clear()
    until(lambda: d.plc.held, "a request on its way")
    for name, value in ("o9", 1), ("o5", 2), ("o9", 2), ("k2", 1), ("o1", 3), ("o5", 3), ("o9", 3), ("k2", 0):
        ioc.put(name, value)
    d.plc.answering.set()
    until(d.nothing_waits, "no put that waits")
    found = [(r.table, r.start, int(r.values[0])) for r in d.plc.writes(mark)]
    assert found == [("holding", 209, 1), ("holding", 205, 2), ("holding", 209, 2), ("coils", 402, 1),
                     ("holding", 201, 3), ("holding", 205, 3), ("holding", 209, 3), ("coils", 402, 0)]
    assert ioc.get("losses") == 1


def test_with_track(new_modbus, new_ioc):
    """with track=on the record goes back to what the device holds"""
    d = Device(new_modbus, new_ioc, "readPeriod 50", "track on")
    d.plc.holding[BASE + BAD] = 33
    d.ioc.wait_value("o5", 33)
    d.ioc.put("o5", 7)
    d.ioc.wait_value("o5", 33)
    d.good("o6", 8, 6)
    d.ioc.put("o5", 8)  # now it is known: no reconnect
    d.ended("o5", "no answer")
    d.ioc.wait_value("o5", 33)
    assert d.ioc.get("losses") == 1 and len(d.tries()) <= 3


def test_waiting_with_track(new_modbus, new_ioc):
    """with track=on a put that waited behind an unanswered one is not written, and says so until the next put"""
    d = Device(new_modbus, new_ioc, "track on", "complete sent", "requestTimeout 4000")
    plc, ioc = d.plc, d.ioc
    ioc.connect(["o5", "o8", "losses"])
    ioc.put("o5", 7)
    until(d.tries, "the write that has no answer")
    ioc.put("o8", 8)
    ioc.wait_alarm("o8", "INVALID", "WRITE", "not written: PLC was away")
    ioc.wait_value("o8", 0)
    until_equal(lambda: ioc.get("losses"), 1)
    assert {a for r in plc.writes() for a in r.addresses()} == {BASE + 5}
    plc.holding[BASE + 8] = 3
    ioc.wait_value("o8", 3)
    assert ioc.alarm("o8") == ("INVALID", "WRITE", "not written: PLC was away")
    d.good("o8", 9, 8)


@pytest.mark.parametrize("how", ["mute", "echo"])
def test_heartbeat(new_modbus, new_ioc, how):
    """{how} for the heartbeat register: it is counted once more after the reconnect, then once a minute; the station goes on"""
    d = Device(new_modbus, new_ioc, "requestTimeout 1000", "readPeriod 50", "heartbeat 50", f"heartbeatRegister {BASE + BAD}", how=how)
    d.ioc.wait_log("heartbeat register 205: ")
    d.good("o6", 8, 6)
    tries, losses = len(d.tries()), d.ioc.get("losses")
    assert tries == 2 and losses <= 2
    for value in range(1, 6):
        d.reads_on(value)
    d.plc.wait_requests(100)
    assert len(d.tries()) == tries and d.ioc.get("losses") == losses
    assert d.ioc.log_count("heartbeat register") == 1 and "tried once a minute" in d.ioc.log


@pytest.mark.parametrize("how", ["mute", "echo"])
def test_carried_out(new_modbus, new_ioc, how):
    """{how}, but the device has carried it out: the alarm ends when that is seen"""
    d = Device(new_modbus, new_ioc, "readPeriod 50", how=how)
    d.plc.judge = lambda request: 0
    d.ioc.put("o5", 7)
    until(d.nothing_waits, "no put that waits")
    d.ioc.wait_alarm("o5", "NO_ALARM")
    assert d.plc.holding[BASE + BAD] == 7 and len(d.tries()) == 2


def test_second_try(new_modbus, new_ioc):
    """a write that is answered at its repetition, after the reconnect: the alarm ends by itself"""
    d = Device(new_modbus, new_ioc, "readPeriod 0")
    d.bad = lambda request: request.connection == 1 and BASE + BAD in request.addresses()
    d.ioc.put("o5", 7)
    until_equal(lambda: d.plc.holding[BASE + BAD], 7)
    d.ioc.wait_alarm("o5", "NO_ALARM")
    assert len(d.tries()) == 1 and len(d.plc.writes()) == 2 and "not tried again" not in d.ioc.log


@pytest.mark.parametrize("off", [False, True], ids=["after a loss", "from the start of the IOC"])
def test_turn_after_reconnect(new_modbus, new_ioc, off):
    """what was put while the device was away keeps its alarm until it is written, one after the other ({off})"""
    d = Device(new_modbus, new_ioc, "readPeriod 0", off=off)
    plc, ioc = d.plc, d.ioc
    names = [f"o{i}" for i in range(0, 20, 4)]
    if not off:
        plc.power_off()
        ioc.wait_log("disconnected")
    for name in names:
        ioc.put(name, 7)
        ioc.wait_alarm(name, "INVALID", "COMM")
    gate = threading.Event()
    plc.judge = lambda request: 6 if request.function in (6, 16) and not gate.is_set() and BASE + 8 in request.addresses() else 0  # busy
    plc.power_on()
    until(lambda: plc.holding[BASE + 4] == 7, "a first put in the device")
    ioc.wait_alarm("o4", "NO_ALARM")
    ioc.wait_alarm("o8", "INVALID", "COMM", "waits for its turn")
    assert plc.holding[BASE + 8] == 0
    gate.set()
    for name in names:
        ioc.wait_alarm(name, "NO_ALARM")
    assert [plc.holding[BASE + int(name[1:])] for name in names] == [7] * 5


@pytest.mark.parametrize("complete", ["acknowledged", "sent"])
def test_link_changes_while_away(new_modbus, new_ioc, complete):
    """what was put while the device was away does not leave for the old place of a link that has changed, and has its alarm until the next put (complete={complete})"""
    d = Device(new_modbus, new_ioc, f"complete {complete}", "readPeriod 0")
    plc, ioc = d.plc, d.ioc
    d.link_changes_while_away()
    ioc.put("o2", 8)
    plc.power_on()
    ioc.wait_alarm("o2", "NO_ALARM")
    assert plc.holding[BASE + 1] == 0 and plc.holding[BASE + 10] == 0 and plc.holding[BASE + 2] == 8
    assert ioc.alarm("o1") == ("INVALID", "WRITE", ioc.message("o1")) and "the old place was not written" in ioc.log
    d.good("o1", 9, 10)


def test_link_changes_where_it_follows(new_modbus, new_ioc):
    """track=on: the alarm of a put whose link has changed ends when the value of the new place is shown"""
    d = Device(new_modbus, new_ioc, "track on", "readPeriod 50")
    plc, ioc = d.plc, d.ioc
    plc.holding[BASE + 10] = 33
    d.link_changes_while_away()
    plc.power_on()
    ioc.wait_value("o1", 33)
    ioc.wait_alarm("o1", "NO_ALARM")
    assert plc.holding[BASE + 1] == 0 and plc.holding[BASE + 10] == 33


def test_link_ends_refusal(new_modbus, new_ioc):
    """the alarm of a refused put ends when the link changes"""
    d = Device(new_modbus, new_ioc, "readPeriod 0")
    d.plc.judge, d.plc.mangle = (lambda request: 2 if d.meets(request) else 0), None
    d.ioc.put("o5", 7)
    d.ioc.wait_alarm("o5", "INVALID", "WRITE", "exception 2")
    d.ioc.put("o5.OUT", "@PLC/20 T=UINT16")
    d.ioc.wait_alarm("o5", "NO_ALARM")
    d.good("o5", 9, 10)


@pytest.mark.parametrize("complete", ["acknowledged", "sent"])
def test_link_changes_behind_lost_values(new_modbus, new_ioc, complete):
    """a link changes while the device gets back what it has lost: what waits behind that does not leave for the old place, the rest does (complete={complete})"""
    d = Device(new_modbus, new_ioc, f"complete {complete}", "readPeriod 0", "requestTimeout 30000")
    plc, ioc = d.plc, d.ioc
    d.good("o2", 20, 2)
    d.good("o4", 40, 4)
    plc.power_off()
    ioc.wait_log("disconnected")
    plc.holding[BASE + 2] = plc.holding[BASE + 4] = 0
    ioc.put("o1", 7)
    ioc.wait_alarm("o1", "INVALID", "COMM")
    plc.reads_go_on = True
    plc.answering.clear()
    plc.power_on()
    until(lambda: plc.held, "the first of the lost values on its way")
    ioc.put("o1.OUT", "@PLC/20 T=UINT16")
    ioc.wait_alarm("o1", "INVALID", "WRITE", "link changed: value not written")
    plc.answering.set()
    d.good("o6", 8, 6)
    assert [plc.holding[BASE + i] for i in (1, 2, 4, 10)] == [0, 20, 40, 0]
    d.good("o1", 9, 10)


def test_link_changes_after_refusal(new_modbus, new_ioc):
    """a value that was refused is not tried again at its old place, after a reconnect either, when the link has changed"""
    d = Device(new_modbus, new_ioc, "readPeriod 0")
    plc, ioc = d.plc, d.ioc
    d.good("o4", 40, 4)
    plc.judge, plc.mangle = (lambda request: 2 if d.meets(request) else 0), None
    ioc.put("o5", 7)
    ioc.wait_alarm("o5", "INVALID", "WRITE", "exception 2")
    ioc.put("o5.OUT", "@PLC/20 T=UINT16")
    ioc.wait_alarm("o5", "NO_ALARM")
    plc.judge = lambda request: 0
    plc.power_off()
    ioc.wait_log("disconnected")
    plc.holding[BASE + 4] = 0
    ioc.put("o6", 8)
    plc.power_on()
    until_equal(lambda: plc.holding[BASE + 6], 8)
    assert [plc.holding[BASE + i] for i in (4, 5, 10)] == [40, 0, 0]


def test_link_changes_before_second_put(new_modbus, new_ioc):
    """a put to a record that waits for the answer to another one, then another link: it is written nowhere, and the record says so"""
    d = Device(new_modbus, new_ioc, "readPeriod 0", "requestTimeout 30000")
    plc, ioc = d.plc, d.ioc
    ioc.connect(["o1", "o1.PACT"])
    plc.answering.clear()
    done = ioc.put_callback("o1", 7)
    until(lambda: plc.held, "the put on its way")
    ioc.put("o1", 8, wait=False)
    until_equal(lambda: ioc.get("o1.RPRO"), 1)
    ioc.put("o1.OUT", "@PLC/20 T=UINT16", wait=False)
    until(done.is_set, "the end of the put")
    plc.answering.set()
    d.good("o6", 9, 6)
    ioc.wait_alarm("o1", "INVALID", "WRITE", "link changed: value maybe written")
    assert [plc.holding[BASE + i] for i in (1, 10)] == [7, 0] and ioc.get("o1.RPRO") == 0
    d.good("o1", 9, 10)


@pytest.mark.parametrize("complete", ["acknowledged", "sent"])
def test_link_changes_in_pulse(new_modbus, new_ioc, complete):
    """the link of a bo with HIGH changes during its pulse (complete={complete}): the pulse ends at its old place, and nothing is written to the new one"""
    d = Device(new_modbus, new_ioc, f"complete {complete}", "readPeriod 0")
    plc, ioc = d.plc, d.ioc
    plc.coils[COILS + 3] = True
    ioc.put("pulse.HIGH", 1)
    ioc.put("pulse", 1)
    ioc.put("pulse.OUT", "@PLC/100 T=UINT8 B=3")
    until(lambda: any(COILS in r.addresses() and not r.values[0] for r in plc.writes()), "the end of the pulse")
    until_equal(lambda: ioc.get("pulse"), 0)
    d.good("o6", 8, 6)
    assert (plc.coils[COILS], plc.coils[COILS + 3]) == (False, True)
    assert ioc.alarm("pulse") == ("NO_ALARM", "NO_ALARM", "")
    plc.coils[COILS + 3] = False
    mark = plc.mark()
    ioc.put("pulse", 1)
    until(lambda: [bool(r.values[0]) for r in plc.writes(mark) if COILS + 3 in r.addresses()] == [True, False],
          "a pulse at the new place")


def test_link_changes_in_pulse_while_away(new_modbus, new_ioc):
    """the same while the device is away: WRITE, and a line with the place that stays 1; the 1 is not put again"""
    d = Device(new_modbus, new_ioc, "readPeriod 0")
    plc, ioc = d.plc, d.ioc
    ioc.put("pulse.HIGH", 300)
    ioc.put("pulse", 1)
    until(lambda: plc.coils[COILS], "the pulse")
    plc.power_off()
    ioc.wait_log("disconnected")
    ioc.put("pulse.OUT", "@PLC/100 T=UINT8 B=3")
    ioc.wait_alarm("pulse", "INVALID", "WRITE", "link changed: the old place stays 1")
    ioc.wait_log("the link has changed during its pulse, and 0 was not written (connection refused by PLC): "
                 "@PLC/100 T=UINT8 B=0 stays 1")
    plc.coils[COILS] = False
    ioc.put("o6", 8)
    plc.power_on()
    until_equal(lambda: plc.holding[BASE + 6], 8)
    assert (plc.coils[COILS], plc.coils[COILS + 3]) == (False, False)
    assert ioc.alarm("pulse")[:2] == ("INVALID", "WRITE")
