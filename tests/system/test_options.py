"""The options of plcOptions: what each does, seen by the PLC and by the operator."""
import re
import struct
import time

import pytest

from waiting import until

IN = """
record(longin, "$(P)in") { field(DTYP, "S7plc") field(INP, "@PLC/0 T=INT32") field(SCAN, "I/O Intr") field(FLNK, "$(P)n") }
record(calc, "$(P)n") { field(INPA, "$(P)n") field(CALC, "A+1") }
"""
OUT = """
record(longout, "$(P)out") { field(DTYP, "S7plc") field(OUT, "@PLC/0 T=INT32") }
"""
STAT = """
record(bi, "$(P)stat") { field(DTYP, "S7plc stat") field(INP, "@PLC") field(SCAN, "I/O Intr") }
"""


def option(name, value):
    return f"\ns7plcSetOption PLC, {name}, {value}"


def send(peer, *numbers, size=None):
    size = size or peer.in_size
    for number in numbers:
        peer.send(struct.pack(">i", number).ljust(size, b"\0"))


def test_heartbeat(new_peer, new_ioc):
    """heartbeat: an unchanged block is sent again after that time"""
    peer = new_peer(0, 4)
    ioc = new_ioc(peer.configure(send_interval=10) + option("heartbeat", 50), OUT)
    peer.wait_connected()
    ioc.put("out", 5)
    peer.wait_block(b"\0\0\0\x05")
    peer.wait_blocks(10)
    assert peer.last() == b"\0\0\0\x05"


def test_no_heartbeat(new_peer, new_ioc):
    """without heartbeat a block leaves once, while input goes on"""
    peer = new_peer(4, 4)
    ioc = new_ioc(peer.configure(send_interval=10, recv_timeout=20000), OUT + IN)
    peer.wait_connected()
    ioc.put("out", 5)
    peer.wait_blocks(1)
    for number in range(1, 30):
        send(peer, number)
        ioc.wait_value("in", number)
    assert len(peer.blocks()) == 1


def test_holdoff(new_peer, new_ioc):
    """holdoff: puts that follow each other in this time leave in one block"""
    peer = new_peer(0, 4)
    ioc = new_ioc(peer.configure(send_interval=1) + option("holdoff", 5000), OUT)
    peer.wait_connected()
    for number in range(1, 20):
        ioc.put("out", number)
    assert peer.wait_blocks(1) == [b"\0\0\0\x13"]


def test_offline_reject(new_peer, new_ioc):
    """offlineWrites=reject: a put while the PLC is away is refused and never leaves"""
    peer = new_peer(0, 4)
    ioc = new_ioc(peer.configure() + option("offlineWrites", "reject"), OUT + STAT)
    peer.wait_connected()
    ioc.put("out", 5)
    peer.wait_block(b"\0\0\0\x05")
    peer.power_off()
    ioc.wait_value("stat", 0)
    ioc.put("out", 6)
    assert ioc.alarm("out")[:2] == ("INVALID", "WRITE")
    peer.power_on()
    peer.wait_connected(2)
    assert peer.wait_blocks(1)[0] == b"\0\0\0\x05"
    ioc.wait_value("stat", 1)
    ioc.put("out", 7)
    peer.wait_block(b"\0\0\0\x07")
    assert b"\0\0\0\x06" not in peer.blocks()


def test_min_update(new_peer, new_ioc):
    """minUpdate: records take fewer blocks, and the newest in the end"""
    peer = new_peer(4, 0)
    ioc = new_ioc(peer.configure(recv_timeout=20000) + option("minUpdate", 1000), IN)
    peer.wait_connected()
    send(peer, 1)
    ioc.wait_value("in", 1)
    before = ioc.get("n")
    tick = iter(range(2, 10 ** 6))
    start = time.monotonic()
    peer.every(0.01, lambda: struct.pack(">i", min(next(tick), 200)))
    ioc.wait_value("in", 200)
    passes, seconds = ioc.get("n") - before, time.monotonic() - start
    assert passes <= seconds + 2


def test_scan_changed(new_peer, new_ioc):
    """scan=changed: only records whose bytes changed are processed"""
    peer = new_peer(400, 0)
    db = "".join(f"""
        record(longin, "$(P)i{i}") {{ field(DTYP, "S7plc") field(INP, "@PLC/{4 * i} T=INT32") field(SCAN, "I/O Intr") field(FLNK, "$(P)n{i}") }}
        record(calc, "$(P)n{i}") {{ field(INPA, "$(P)n{i}") field(CALC, "A+1") }}
        """ for i in range(100))
    ioc = new_ioc(peer.configure(recv_timeout=20000) + option("scan", "changed"), db)
    peer.wait_connected()
    block = bytearray(400)
    peer.send(block)
    ioc.wait_alarm("i99", "NO_ALARM")
    before = [ioc.get(f"n{i}") for i in range(100)]
    for number in range(1, 21):
        struct.pack_into(">i", block, 4 * 50, number)
        peer.send(block)
        ioc.wait_value("i50", number)
    after = [ioc.get(f"n{i}") for i in range(100)]
    assert after[50] >= before[50] + 20
    # the first block may have had its pass late
    assert all(a <= b + 1 for i, (a, b) in enumerate(zip(after, before)) if i != 50)
    peer.power_off()
    for i in (0, 50, 99):
        ioc.wait_alarm(f"i{i}", "INVALID", "COMM")
    until(lambda: all(ioc.get(f"n{i}") > after[i] for i in range(100)), "a pass of all when the PLC is lost")
    lost = [ioc.get(f"n{i}") for i in range(100)]
    peer.power_on()
    peer.wait_connected(2)
    peer.send(block)
    until(lambda: all(ioc.get(f"n{i}") > lost[i] for i in range(100)), "a pass of all with the first block")


def test_scan_changed_and_disabled(new_peer, new_ioc):
    """scan=changed: a record that was disabled while its bytes changed shows them with the next change, or by hand"""
    peer = new_peer(8, 0)
    ioc = new_ioc(peer.configure(recv_timeout=60000) + option("scan", "changed"), """
        record(longin, "$(P)off") { field(DTYP, "S7plc") field(INP, "@PLC/0 T=INT32") field(SCAN, "I/O Intr") }
        record(longin, "$(P)on") { field(DTYP, "S7plc") field(INP, "@PLC/4 T=INT32") field(SCAN, "I/O Intr") }
        """)
    peer.wait_connected()

    def send_both(off, on):
        peer.send(struct.pack(">ii", off, on))
        ioc.wait_value("on", on)
    send_both(1, 1)
    ioc.wait_value("off", 1)
    ioc.put("off.DISA", 1)
    send_both(2, 2)
    ioc.put("off.DISA", 0)
    send_both(2, 3)
    send_both(2, 4)  # the pass of the block before is over
    assert ioc.get("off") == 1
    send_both(5, 5)
    ioc.wait_value("off", 5)
    ioc.put("off.DISA", 1)
    send_both(6, 6)
    ioc.put("off.DISA", 0)
    ioc.process_record("off")
    ioc.wait_value("off", 6)


def test_whole_block(new_peer, new_ioc):
    """wholeBlock: all records of one I/O Intr pass show the same block"""
    peer = new_peer(4, 0)
    count = 300
    db = "".join(f"""
        record(longin, "$(P)i{i}") {{ field(DTYP, "S7plc") field(INP, "@PLC/0 T=INT32") field(SCAN, "I/O Intr")
            field(FLNK, "$(P)c{i}") }}
        record(calc, "$(P)c{i}") {{ field(INPA, "$(P)i{i}") field(INPB, "$(P)i0") field(INPC, "$(P)c{i}")
            field(CALC, "C+(A!=B)") }}
        """ for i in range(count))
    ioc = new_ioc(peer.configure(recv_timeout=20000) + option("wholeBlock", "on"), db)
    peer.wait_connected()
    tick = iter(range(1, 10 ** 8))
    peer.every(0.0005, lambda: struct.pack(">i", next(tick)))
    until(lambda: ioc.get("i0") > 2000, "2000 blocks")
    peer.stop_sending()
    assert sum(ioc.get(f"c{i}") for i in range(count)) == 0


def test_alive(new_peer, new_ioc):
    """alive: a PLC whose alive word stands still is INVALID, and valid when it moves again"""
    peer = new_peer(6, 0)
    ioc = new_ioc(peer.configure() + option("alive", "4,UINT16") + option("aliveTimeout", 300), IN)
    peer.wait_connected()
    peer.every(0.02, struct.pack(">iH", 7, 1))
    ioc.wait_value("in", 7)
    ioc.wait_alarm("in", "INVALID", "COMM", "frozen")
    assert len(peer.connections) == 1
    tick = iter(range(10 ** 6))
    peer.every(0.02, lambda: struct.pack(">iH", 8, next(tick) % 65536))
    ioc.wait_alarm("in", "NO_ALARM")
    ioc.wait_value("in", 8)
    assert ioc.log_count("alive again") == 1


def bcd(*numbers):
    return bytes(n // 10 * 16 + n % 10 for n in numbers)


# 2026-03-04 05:06:07.890, a Wednesday (4 in Siemens' counting)
CLOCKS = {
    "DT": bcd(26, 3, 4, 5, 6, 7, 89) + bytes([0x04]),
    "DTL": struct.pack(">HBBBBBBI", 2026, 3, 4, 4, 5, 6, 7, 890000000),
}


@pytest.mark.parametrize("words", ["bytes", "low"])
@pytest.mark.parametrize("kind", CLOCKS)
def test_timestamp(new_peer, new_ioc, kind, words):
    """timestamp: records with TSE=-2 carry the PLC's own time ({kind}), whatever wordOrder is ({words})"""
    peer = new_peer(16, 0)
    ioc = new_ioc(peer.configure(recv_timeout=20000) + option("timestamp", f"4,{kind}") + option("wordOrder", words), """
        record(longin, "$(P)in") { field(DTYP, "S7plc") field(INP, "@PLC/0 T=INT32 W=high") field(SCAN, "I/O Intr") field(TSE, "-2") }
        """)
    peer.wait_connected()
    peer.send((b"\0\0\0\x05" + CLOCKS[kind]).ljust(16, b"\0"))
    ioc.wait_value("in", 5)
    stamp = ioc.pv("in").get_with_metadata(form="time", use_monitor=False)["timestamp"]
    assert time.strftime("%Y-%m-%d %H:%M:%S", time.gmtime(stamp)) == "2026-03-04 05:06:07"
    assert stamp % 1 == pytest.approx(0.89, abs=0.001)


def test_nonsense_clock(new_peer, new_ioc):
    """a PLC clock that is nonsense leaves the time of arrival"""
    peer = new_peer(16, 0)
    ioc = new_ioc(peer.configure(recv_timeout=20000) + option("timestamp", "4,DT"), """
        record(longin, "$(P)in") { field(DTYP, "S7plc") field(INP, "@PLC/0 T=INT32") field(SCAN, "I/O Intr") field(TSE, "-2") }
        """)
    peer.wait_connected()
    peer.send(b"\0\0\0\x05" + b"\xff" * 12)
    ioc.wait_value("in", 5)
    stamp = ioc.pv("in").get_with_metadata(form="time", use_monitor=False)["timestamp"]
    assert abs(stamp - time.time()) < 3600


def test_arrival_time(new_peer, new_ioc):
    """without timestamp TSE=-2 is the arrival of the block"""
    peer = new_peer(4, 0)
    ioc = new_ioc(peer.configure(recv_timeout=20000), """
        record(longin, "$(P)in") { field(DTYP, "S7plc") field(INP, "@PLC/0 T=INT32") field(TSE, "-2") }
        """)
    peer.wait_connected()
    before = time.time()
    peer.send(b"\0\0\0\x05")
    until(lambda: ioc.process_record("in") or ioc.get("in") == 5, "the block")
    after = time.time()
    ioc.process_record("in")
    stamp = ioc.pv("in").get_with_metadata(form="time", use_monitor=False)["timestamp"]
    assert before - 1 < stamp < after + 1


@pytest.mark.parametrize("ms, attempts", [(100, 5), (2000, 3)])
def test_connect_timeout(new_ioc, black_hole, ms, attempts):
    """connectTimeout={ms}: an attempt that gets no answer is given up after that time, not before, and said once"""
    begin = time.monotonic()
    ioc = new_ioc(f's7plcConfigure("PLC", "127.0.0.1", {black_hole.port}, 4, 0, 1, 2000, 100)'
                  + option("connectTimeout", ms), IN)
    ioc.wait_log("does not answer")
    ioc.wait_alarm("in", "INVALID", "COMM", "does not answer", ask=True)
    until(lambda: int(ioc.command("s7plcReport PLC").split(" failed")[0].split()[-1]) >= attempts,
          f"{attempts} attempts")
    assert time.monotonic() - begin >= attempts * ms / 1000
    assert ioc.log_count("cannot connect") == 1


def test_listed(new_ioc):
    """s7plcSetOption alone lists every option; with a PLC, its values"""
    ioc = new_ioc('s7plcConfigure("PLC", "", 0, 4, 4, 1, 1234, 100)', "")
    keys = ioc.command("s7plcSetOption")
    for key in ("recvTimeout", "sendInterval", "holdoff", "heartbeat", "offlineWrites",
                "minUpdate", "scan", "wholeBlock", "scanThread", "alive", "aliveTimeout", "timestamp",
                "connectTimeout"):
        assert key in keys
    assert "1234" in ioc.command("s7plcSetOption PLC")


@pytest.mark.parametrize("line, message", {
    "an unknown key": ("PLC, sped, 5", "there is no option"),
    "an unknown PLC": ("NOPLC, heartbeat, 5", "NOPLC"),
    "no value": ("PLC, heartbeat", "allowed"),
    "a word for a number": ("PLC, heartbeat, soon", "allowed"),
    "a number out of range": ("PLC, heartbeat, -1", "allowed"),
    "an unknown word": ("PLC, offlineWrites, maybe", "keep|reject"),
    "an offset outside the block": ("PLC, alive, 3", "input block of 4"),
    "a wrong type": ("PLC, alive, 0,FLOAT", "allowed"),
    "scan after iocInit": ("PLC, scan, changed", "before iocInit"),
}.values(), ids=lambda value: "")
def test_wrong_option(new_ioc, line, message):
    """s7plcSetOption {line}: an error that says \"{message}\" """
    ioc = new_ioc('s7plcConfigure("PLC", "", 0, 4, 4, 1, 2000, 100)', "")
    assert message in ioc.command(f"s7plcSetOption {line}")


def test_no_effect(new_ioc):
    """an option that does nothing on a PLC is said once, with for what it is, before and after iocInit"""
    ioc = new_ioc('s7plcConfigure("PLC", "", 0, 4, 4, 1, 2000, 100)\n'
                  "s7plcSetOption PLC requestTimeout 50\ns7plcSetOption PLC heartbeat 500\n"
                  'modbusplcConfigure("DEV", "127.0.0.1", 1, 1, "holding 0 1", "holding 0 1")\n'
                  "s7plcSetOption DEV heartbeat 500\n"
                  "s7plcSetOption DEV recvTimeout 500", "")
    only = "has no effect on this PLC: only for"
    ioc.wait_log(f"s7plc PLC: option requestTimeout=50 {only} PLCs that are asked by requests")
    ioc.wait_log(f"s7plc DEV: option recvTimeout=500 {only} PLCs that send blocks")
    ioc.wait_log("s7plc DEV: option heartbeat=500 has no effect on this PLC: it needs option heartbeatRegister")
    ioc.command("s7plcSetOption PLC maxRegisters 7")
    ioc.wait_log(f"s7plc PLC: option maxRegisters=7 {only}: Modbus")
    assert ioc.log_count("has no effect") == 4


def test_change_while_running(new_peer, new_ioc):
    """options change while the IOC runs"""
    peer = new_peer(0, 4)
    ioc = new_ioc(peer.configure(send_interval=10), OUT)
    peer.wait_connected()
    ioc.put("out", 5)
    peer.wait_blocks(1)
    ioc.command("s7plcSetOption PLC, heartbeat, 20")
    peer.wait_blocks(5)


def test_report(new_peer, new_ioc):
    """s7plcReport and dbior show address, state, sizes and counters"""
    peer = new_peer(4, 4)
    ioc = new_ioc(peer.configure(recv_timeout=20000), IN + OUT)
    peer.wait_connected()
    send(peer, 1, 2, 3)
    ioc.wait_value("in", 3)
    report = ioc.command("s7plcReport PLC 1")
    assert f"127.0.0.1:{peer.port}" in report and "ok" in report
    assert "in 4 bytes, out 4 bytes, big endian" in report
    assert "in:  3 blocks, 12 bytes" in report
    assert "no PLC" in ioc.command("s7plcReport NOPLC")


def test_report_levels(new_peer, new_ioc):
    """s7plcReport PLC 0 is one line, 1 adds options and counters, 2 histograms, 3 the blocks; dbior prints the same"""
    peer = new_peer(4, 4)
    ioc = new_ioc(peer.configure(recv_timeout=3600000), IN + OUT)
    peer.wait_connected()
    send(peer, 1, 2, 3)
    ioc.wait_value("in", 3)
    shown = ioc.command("s7plcShow PLC")
    assert "PLC in, PLC -> IOC" in shown and "PLC out, IOC -> PLC" in shown
    reports = []
    for level in range(4):
        reports.append(ioc.command(f"s7plcReport PLC {level}"))
        assert ioc.command(f"dbior s7plc {level}").split("\n", 2)[2] == reports[level]
    assert reports[1] == ioc.command("s7plcReport PLC") and len(reports[0].splitlines()) == 1
    for level, part in (1, "options:"), (1, "in:  3 blocks"), (2, "time from block to end of scan"), (3, shown):
        assert [part in report for report in reports] == [n >= level for n in range(4)], part


def test_stats_reset(new_peer, new_ioc):
    """s7plcStatsReset sets counters and times of one PLC to zero, without a name those of all"""
    peers = {name: new_peer(4, 0) for name in "AB"}
    ioc = new_ioc("\n".join(peer.configure(name, recv_timeout=3600000) for name, peer in peers.items()),
                  "".join(IN.replace("in\"", f"{name}\"").replace("@PLC", f"@{name}").replace("(P)n", f"(P)n{name}")
                          for name in peers))

    def blocks():
        return re.findall(r"in:  (\d) blocks.*?\n(?:.*\n){2}(?:.*(period))?", ioc.command("s7plcReport") + "\n")
    for name, peer in peers.items():
        peer.wait_connected()
        send(peer, 1, 2, 3)
        ioc.wait_value(name, 3)
    assert blocks() == [("3", "period")] * 2
    assert re.findall(r"^  (\w)", ioc.command("s7plcReport B"), re.M) == ["B"]
    ioc.command("s7plcStatsReset A")
    assert blocks() == [("0", ""), ("3", "period")]
    ioc.command("s7plcStatsReset")
    assert blocks() == [("0", "")] * 2


LOG = OUT.replace("/0 T=INT32", "/4 T=INT16") + """
record(bo, "$(P)bit") { field(DTYP, "S7plc") field(OUT, "@PLC/2 T=WORD B=2") }
"""


def test_log_io(new_peer, new_ioc):
    """log=io shows blocks and puts of one PLC in hex, with the time on request; info ends it"""
    peer = new_peer(20, 8)
    ioc = new_ioc(peer.configure(send_interval=10, recv_timeout=60000), LOG + IN)
    peer.wait_connected()
    send(peer, 7)
    ioc.wait_value("in", 7)
    ioc.put("out", 499)
    peer.wait_block(b"\0\0\0\0\x01\xf3\0\0")
    assert ": in " not in ioc.log and ": put " not in ioc.log
    ioc.command("s7plcSetOption PLC log io")
    peer.send(bytes([0, 0, 0, 42]) + bytes(12) + bytes([1, 2, 3, 4]))
    ioc.wait_log("s7plc PLC: in    0: 00 00 00 2A" + " 00" * 12 + "")
    ioc.wait_log("s7plc PLC: in   16: 01 02 03 04")
    ioc.put("out", 500)
    ioc.wait_log("s7plc PLC: put    4: 01 F4")
    ioc.wait_log("s7plc PLC: out    0: 00 00 00 00 01 F4 00 00")
    ioc.put("bit", 1)
    ioc.wait_log("s7plc PLC: put    2: 00 04 mask 00 04")
    ioc.command("s7plcSetOption PLC logTime on")
    ioc.put("out", 501)
    ioc.wait_log("put    4: 01 F5")
    assert re.search(r"s7plc PLC \d\d:\d\d:\d\d\.\d{3}: put    4: 01 F5", ioc.log)
    ioc.command("s7plcSetOption PLC log info")
    ioc.put("out", 502)
    send(peer, 43)
    ioc.wait_value("in", 43)
    assert "01 F6" not in ioc.log and "00 2B" not in ioc.log


def test_log_refused(new_peer, new_ioc):
    """log=io says why a put was refused"""
    peer = new_peer(4, 8)
    peer.close()
    ioc = new_ioc(peer.configure() + option("offlineWrites", "reject") + option("log", "io"), LOG)
    ioc.wait_log("cannot connect")
    ioc.put("out", 500)
    ioc.wait_log("s7plc PLC: put    4: 01 F4 refused: connection refused by PLC")


@pytest.mark.parametrize("level", ["error", "warning", "info"])
def test_log_levels(new_peer, new_ioc, level):
    """log={level}: a loss is told; that a connection was made only with info"""
    peer = new_peer(4, 0)
    ioc = new_ioc(peer.configure(recv_timeout=60000) + option("log", level), IN)
    peer.wait_connected()
    send(peer, 1)
    ioc.wait_value("in", 1)
    peer.hang_up()
    ioc.wait_log("s7plc PLC: disconnected: connection closed by PLC")
    if level == "info":
        ioc.wait_log("s7plc PLC: connected to 127.0.0.1")
    assert (ioc.log_count("connected to 127.0.0.1") > 0) == (level == "info")


def test_log_of_a_large_block(new_peer, new_ioc):
    """log=io: of a large block the first 1024 bytes, of each block, however many lines that are"""
    peer = new_peer(2000, 0)
    ioc = new_ioc(peer.configure(recv_timeout=60000) + option("log", "io"), IN)
    peer.wait_connected()
    for number in range(1, 4):
        send(peer, number)
        ioc.wait_value("in", number)
    until(lambda: ioc.log_count("s7plc PLC: in 1024: ... 976 bytes more") == 3, "the last line of three blocks")
    assert len(re.findall(r"s7plc PLC: in +\d+:(?: [0-9A-F]{2}){16}$", ioc.log, re.M)) == 3 * 64
    assert "more messages" not in ioc.log


def test_debug_variable(new_peer, new_ioc):
    """var s7plcDebug 1 hints at a longin on a UINT32, 2 shows the puts of all PLCs, 5 their blocks"""
    peers = {name: new_peer(4, 4) for name in "AB"}
    ioc = new_ioc("\n".join(peer.configure(name) for name, peer in peers.items()) + "\nvar s7plcDebug 1",
                  "".join(f"""
        record(longin, "$(P)in{name}") {{ field(DTYP, "S7plc") field(INP, "@{name}/0 T=UINT32") field(SCAN, "I/O Intr") }}
        record(longout, "$(P)out{name}") {{ field(DTYP, "S7plc") field(OUT, "@{name}/0 T=INT32") }}
        """ for name in peers))
    assert ioc.log_count("longin shows a UINT32 above 2147483647 as negative") == 2
    for level in 1, 2, 4, 5:
        ioc.command(f"var s7plcDebug {level}")
        for name, peer in peers.items():
            peer.wait_connected()
            peer.send(bytes([9, 8, 7, level]))
            ioc.wait_value(f"in{name}", 0x09080700 + level)
            ioc.put(f"out{name}", level)
            peer.wait_block(bytes([0, 0, 0, level]))
            ioc.command("")
            assert (f"s7plc {name}: put    0: 00 00 00 0{level}" in ioc.log) == (level >= 2)
            assert (f"s7plc {name}: in    0: 09 08 07 0{level}" in ioc.log) == (level >= 5)
            assert (f"s7plc {name}: out    0: 00 00 00 0{level}" in ioc.log) == (level >= 5)
