"""Tables of the documents, row by row, against what the programs say themselves."""
import re
import socket
import struct
import subprocess
import time

import pytest

from client import ARCH, TOP
from ioc import errors_in
from waiting import until

PLCSIM = TOP / "bin" / ARCH / "plcSim"


def table(page, *head):
    """The cells of each row of all tables of a page whose heads begin so; marks of code are left out."""
    rows, inside = [], False
    for line in (TOP / "docs" / page).read_text().splitlines():
        cells = [cell.strip().replace("`", "").replace("\\|", "|")
                 for cell in re.split(r"(?<!\\)\|", line)[1:-1]] if line.startswith("|") else None
        if not cells:
            inside = False
        elif cells[:len(head)] == list(head):
            inside = True
        elif inside and not set(line) <= set("|- "):
            rows.append(cells)
    assert rows, f"no table {head} in {page}"
    return rows


# --- Options -----------------------------------------------------------------------------------

def printed_options(text):
    """{option: (default, what is allowed)} of what s7plcSetOption prints"""
    return {name: (default, allowed) for name, default, allowed in
            re.findall(r"^  (\w+) +(\S+) .*\n +allowed: (.+)$", text, re.M)}


def same_range(documented, printed):
    """"0, 1 ... 10 ms" is "0, or 1 to 10 ms"; "a, b" is "a|b"; an offset has words of its own."""
    if "..." in documented:
        return documented.replace(" ... ", " to ").replace("0, ", "0, or ").replace("off, ", "off, or register ") == \
            re.sub(r" (registers|bits)$", "", printed)
    if documented.startswith("off, offset"):
        words = re.findall(r"[A-Z]{2,}", documented)
        return printed.startswith("off, or byte offset") and all(word in printed for word in words)
    return documented.replace(", ", "|") == printed


def test_options(new_ioc):
    """docs/options.md has each option that an IOC prints, with its range, its default and when it can be set"""
    texts = [new_ioc("", "", program=program).command("s7plcSetOption") for program in ("s7plcIoc", "phoenixIoc")]
    text = "".join(texts)
    assert ["pingPeriod" in part for part in texts] == [False, True]  # where the IOC has that library
    printed, wrong = printed_options(text), []
    rows = table("options.md", "option", "allowed", "default")
    assert {row[0].split()[0] for row in rows} == set(printed)
    for name, allowed, default, _ in rows:
        key = name.split()[0]
        shown = re.match(r"[^ ;]+", default)[0]
        early = re.search(rf"^  {key} .*\(before iocInit\)$", text, re.M)
        if default != "as configured" and shown != printed[key][0] or not same_range(allowed, printed[key][1]) \
                or bool(early) != ("†" in name):
            wrong.append((name, allowed, default, printed[key]))
    assert not wrong


def test_holdoff_of_wires(new_ioc):
    """options.md: holdoff is 0.2 ms by default, and 0 over Modbus and EtherNet/IP"""
    ioc = new_ioc('s7plcConfigure BLOCKS, "", 0, 4, 4\nmodbusplcConfigure MODBUS, "127.0.0.1", 1, 1, "", "holding 0 4"\n'
                  'drvEtherIP_define_PLC EIP, "127.0.0.1:1", 0', "")
    shown = {name: re.search(r"^  holdoff +(\S+) ", ioc.command(f"s7plcSetOption {name}"), re.M)[1]
             for name in ("BLOCKS", "MODBUS", "EIP")}
    assert shown == {"BLOCKS": "0.2", "MODBUS": "0", "EIP": "0"}


# --- s7plcConfigure --------------------------------------------------------------------------------

GOOD = {"PLCname": "{name}", "IPaddr": "127.0.0.1", "port": "1", "inSize": "8", "outSize": "8", "bigEndian": "1",
        "recvTimeout": "500", "sendInterval": "100"}
WORDS = {"PLCname": (["x" * 255], ["x" * 256, '""', '"a b"', "a/b"]),
         "IPaddr": (["localhost", "127.0.0.2"], ["192.168.1", '"a b"'])}


def test_arguments_of_configure(new_ioc):
    """iocsh.md: s7plcConfigure takes of each argument what the table says, and no more"""
    ioc, rows = new_ioc("", ""), {row[0]: row[1:] for row in table("iocsh.md", "argument", "allowed", "meaning")}
    assert list(rows) == list(GOOD)

    def takes(**words):
        name = f"P{len(ioc.lines)}"
        said = ioc.command("s7plcConfigure " + ", ".join({**GOOD, **words}.values()).format(name=name))
        assert ("sevr=major s7plcConfigure" in said) == ("allowed" in said or "once" in said), said
        return "sevr=major s7plcConfigure" not in said and name

    for argument, (allowed, _) in rows.items():
        good, bad = WORDS.get(argument, ((), ()))
        limits = re.match(r"(\d+) \.\.\. (\d+)(?! char)|(0), (1)$", allowed)
        if limits and argument not in WORDS:
            low, high = (int(n) for n in limits.groups() if n)
            good, bad = [low, high], [high + 1] + [low - 1] * ("0 = " not in allowed and argument != "port") + [-1]
        assert good and all(takes(**{argument: str(word)}) for word in good), argument
        assert not [word for word in bad if takes(**{argument: str(word)})], argument
        default = re.search(r", 0 = (\d+)$", allowed)
        if default:
            shown = ioc.command(f"s7plcSetOption {takes(**{argument: '0'})}")
            assert re.search(rf"^  {argument} +{default[1]} ", shown, re.M), shown
    assert takes(IPaddr='""', port="0") and not takes(port="0")
    assert not takes(PLCname="x" * 255)  # each once


MODBUS = {  # command: its arguments, and what is right for those of the table
    "s7plcModbusOutput": {"PLC": "{name}", "IPaddr": "127.0.0.1", "port": "1", "unit": "1", "startRegister": "0"},
    "modbusplcConfigure": {"PLC": "{name}", "IPaddr": "127.0.0.1", "port": "1", "unit": "1", "inputs": '"holding 0 4"',
                           "outputs": '""', "requestTimeout": "500"}}
MODBUS_WORDS = {"PLC": (["y" * 255], ["x" * 256, '"a b"', "a/b"]), "IPaddr": (["localhost", '""'], ['"a b"', "1.2.3"])}


@pytest.mark.parametrize("command", MODBUS)
def test_arguments_of_modbus(new_ioc, command):
    """modbus.md: {command} takes of each argument what the table says, and no more"""
    good, rows = MODBUS[command], table("modbus.md", "argument", "allowed", "meaning")
    rows = {row[0]: row[1] for row in (rows[5:] if "inputs" in good else rows[:5])}
    assert list(rows) == list(good)
    lines, wanted = [], {}
    for argument, allowed in rows.items():
        right, wrong = MODBUS_WORDS.get(argument, ((), ())) if "name of" not in allowed else ((), ["NOPLC"])
        limits = re.match(r"(\d+) \.\.\. (\d+)(?! char)", allowed)
        if limits and argument not in MODBUS_WORDS:
            low, high = int(limits[1]), int(limits[2])
            right, wrong = [low, high, *["0"] * (" 0 " in allowed)], [high + 1, -1] + [low - 1] * (low > 1)
        for is_right, word in [(True, w) for w in right] + [(False, w) for w in wrong]:
            name = f"{argument}{len(lines)}"
            given = {**good, argument: str(word)}
            lines.append(", ".join(given.values()).format(name=name))
            wanted[str(word) if argument == "PLC" else name] = is_right
            if "inputs" not in good:
                lines[-1] = f"s7plcConfigure {name}, 127.0.0.1, 1, 8, 2\n{command} {lines[-1]}"
            else:
                lines[-1] = f"{command} {lines[-1]}"
    ioc = new_ioc("\n".join(lines), "")
    refused = {name: f"sevr=major {command} {name.strip(chr(34))[:60]}" in ioc.log for name in wanted}
    assert len(wanted) > 10 and {name: not no for name, no in refused.items()} == wanted, ioc.log
    short = new_ioc("s7plcConfigure P, 127.0.0.1, 1, 8, 8\ns7plcModbusOutput P, 127.0.0.2, 0, 1, 0" if "inputs" not in good else
                    'modbusplcConfigure P, 127.0.0.2, 0, 1, "holding 0 4"', "")
    assert "Modbus 127.0.0.2:502 unit 1:" in short.command("s7plcReport P")
    assert re.search(r"^  requestTimeout +1000 ", short.command("s7plcSetOption P"), re.M)


def test_arguments_of_etherip(new_ioc):
    """etherip.md: drvEtherIP_define_PLC and etheripConfigure take of each argument and option what the tables say, and no more"""
    ioc, made = new_ioc("drvEtherIP_define_PLC Early, 127.0.0.1:1", ""), iter(range(1000))

    def takes(name="{name}", ip="127.0.0.1:1", slot="0", option=""):
        words = [name.format(name=f"E{next(made)}"), ip, slot, *[f'"{option}"'] * bool(option)]
        said = ioc.command(("etheripConfigure " if option else "drvEtherIP_define_PLC ") + ", ".join(words))
        return "allowed" not in said
    assert [row[1] for row in table("etherip.md", "drvEtherIP_define_PLC", "allowed", "meaning")] == [
        "1 ... 255 characters, no blank, no /", "name or dotted address, with or without :port", "0 ... 255, missing = 0; -1"]
    assert takes("x" * 255) and not [name for name in ("x" * 256, '""', '"a b"', "a/b") if takes(name)]
    assert all(takes(ip=ip) for ip in ("localhost", "localhost:1", "127.0.0.1")) and not takes(ip="1.2.3")
    assert all(takes(slot=slot) for slot in ("0", "255", "-1")) and not takes(slot="256") and not takes(slot="-2")
    assert "allowed" not in ioc.command("drvEtherIP_define_PLC Missing, 127.0.0.1:1")
    assert " Missing 127.0.0.1:1" in ioc.command("drvEtherIP_report 0")
    options = ioc.command("s7plcSetOption Early")
    for name, value in ("requestTimeout", "2000"), ("scan", "changed"), ("track", "on"):
        assert re.search(rf"^  {name} +{value} ", options, re.M), options
    for option, allowed, *_ in table("etherip.md", "option", "allowed", "default", "meaning"):
        limits = re.match(r"(\d+) \.\.\. (\d+) bytes", allowed)
        good = list(map(int, limits.groups())) if limits else allowed.split(", ")
        bad = [good[0] - 1, good[1] + 1] if limits else ["maybe", ""]
        assert all(takes(option=f"{option}={word}") for word in good), option
        assert not [word for word in bad if takes(option=f"{option}={word}")], option


# --- Types and links ------------------------------------------------------------------------------

def messages(ioc):
    """{record: what the log says of its link}"""
    return dict(re.findall(rf'"{ioc.P}(\w+)" INP: (.+)', ioc.log))


def record_for(kind, name, link):
    extra = ' field(FTVL, "UCHAR") field(NELM, "1")' if kind == "waveform" else ""
    return f'record({kind}, "$(P){name}") {{ field(DTYP, "S7plc") field(INP, "{link}"){extra} }}\n'


def fits(kind, size):
    return {"STRING": "stringin", "S7STRING": "stringin", "TIME": "waveform"}.get(kind) or \
        ("int64in" if size == "8" and "INT" in kind else "ai")


def test_types(new_ioc):
    """records.md: each type and each of its other names has its bytes, and the limits that the table says"""
    rows, db = table("records.md", "type", "also", "bytes", "values"), ""
    for kind, also, size, _, limits in rows:
        length = " L=5" if size.startswith("L") else ""
        for name in (kind, *also.split()):
            db += record_for(fits(kind, size), f"n{name}", f"@PLC/100 T={name}{length}")
            db += record_for("mbbi" if "STRING" in kind else "stringin", f"k{name}", f"@PLC/0 T={name}")
        if re.match(r"^[−\d]", limits):
            db += (f'record(ai, "$(P)r{kind}") {{ field(DTYP, "S7plc") field(INP, "@PLC/0 T={kind}") '
                   'field(LINR, "LINEAR") field(EGUL, "0") field(EGUF, "1") }\n')
    ioc = new_ioc('s7plcConfigure PLC, "", 0, 8, 0', db)
    said = messages(ioc)
    for kind, also, size, _, limits in rows:
        size = str(eval(size, {"L": 5}))  # a number, L, or L+2
        for name in (kind, *also.split()):
            assert f"100 + {size} bytes exceed the input block" in said[f"n{name}"], name
            assert f"T={kind} does not fit" in said[f"k{name}"], name
        if re.match(r"^[−\d]", limits):
            slope, offset = ioc.get(f"r{kind}.ESLO"), ioc.get(f"r{kind}.EOFF")
            low = round(-offset / slope)
            assert limits.replace("−", "-") == f"{low}, {round(low + 1 / slope)}", kind


def test_aliases(new_ioc):
    """cheatsheet.md: each alias is the type that the table says"""
    pairs = [(alias, cells[i + 1]) for cells in table("cheatsheet.md", "alias", "is", "alias", "is")
             for i in (0, 2) for alias in cells[i].split()]
    ioc = new_ioc('s7plcConfigure PLC, "", 0, 8, 0',
                  "".join(record_for("stringin", f"k{alias}", f"@PLC/0 T={alias}") for alias, _ in pairs))
    said = messages(ioc)
    assert len(pairs) > 10
    assert not [(alias, kind) for alias, kind in pairs if f"T={kind} does not fit" not in said[f"k{alias}"]]


OUTPUTS = {"ao", "bo", "longout", "int64out", "mbbo", "mbboDirect", "calcout", "stringout", "lso", "aao"}
VALUES = {"EGUL": "0", "EGUF": "100", "NELM": "4"}


def cheat_records():
    """A record of each kind for each link of the cheat sheet; what stands beside a link are fields of it."""
    number = 0
    for dtyp, head in ("S7plc", "S7"), ("EtherIP", "tag of a controller ([EtherNet/IP](etherip.md))"):
        for _, link, kinds in table("cheatsheet.md", head, "link", "record"):
            links = [part for part in link.split(", ") if part.startswith(("@", "T="))]
            links = [part if part.startswith("@") else f"@PLC/4 {part}" for part in links]
            fields = [part.split() for part in link.split(", ") if not part.startswith(("@", "T="))]
            words = "".join(f' field({f[0]}, "{f[1] if len(f) > 1 else VALUES[f[0]]}")' for f in fields)
            for place in links:
                for kind in re.findall(r"\w+", kinds):
                    size = ' field(SIZV, "100")' if kind in ("lsi", "lso") else ""
                    field = "OUT" if kind in OUTPUTS else "INP"
                    number += 1
                    yield (f'record({kind}, "$(P)c{number}") {{ field(DTYP, "{dtyp}") '
                           f'field({field}, "{place}"){words}{size} }}\n')


def test_cheat_sheet(new_ioc):
    """cheatsheet.md: each link is taken by each record that stands beside it, without a word"""
    records = list(cheat_records())
    assert len(records) > 50
    ioc = new_ioc('s7plcConfigure PLC, "", 0, 64, 64\ndrvEtherIP_define_PLC plc, "127.0.0.1:1", 0', "".join(records))
    assert not [line for line in errors_in(ioc.log) if f"{ioc.P}c" in line]
    assert not [n for n in range(1, len(records) + 1) if ioc.get(f"c{n}.STAT", as_string=True) == "LINK"]


# --- plcSim ---------------------------------------------------------------------------------------

def sim_help():
    return subprocess.run([PLCSIM, "--help"], capture_output=True, text=True, check=True).stdout


def documented_keys():
    """[(key, default, meaning)] of all tables of keys"""
    for names, default, meaning in table("plcsim.md", "key", "default", "meaning"):
        names = names.split(", ")
        defaults = default.split(", ") if len(names) > 1 and default else [default] * len(names)
        yield from ((name, value, meaning) for name, value in zip(names, defaults))


def test_keys():
    """plcsim.md has each key that `plcSim --help` prints, with its default"""
    printed = dict(re.findall(r"^  (\w+) = ?(\d+ m?s(?= )|\S*)", sim_help(), re.M))
    documented = {name: "" if value == "address + 1" else value for name, value, _ in documented_keys()}
    assert (printed.pop("tx_ptrs"), printed.pop("rx_ptrs")) == ("3", "4")  # which stand in the text
    assert documented == printed


RANGE = re.compile(r"(\d+) \.\.\. (\d+)(?! *[a-z])")


@pytest.mark.parametrize("key, low, high", [(key, *map(int, RANGE.search(meaning).groups()))
                                            for key, _, meaning in documented_keys() if RANGE.search(meaning)])
def test_range_of_key(tmp_path, key, low, high):
    """plcsim.md: {key} takes {low} to {high}, and no more"""
    def takes(value):
        (tmp_path / "x.plc").write_text(f"{key} = {value}\n")
        run = subprocess.run([PLCSIM, "--check", tmp_path / "x.plc"], capture_output=True, text=True, timeout=60)
        return run.returncode == 0, run.stdout + run.stderr

    for value in low, high:
        assert takes(value)[0], takes(value)
    for value in low - 1, high + 1:
        good, text = takes(value)
        assert not good and key in text, text


def first_words(cells):
    """The commands of a cell: "`a <x>`, `b [y]`" has a and b."""
    return {word.split()[0] for part in re.split(r", (?=[a-z])", cells) for word in [part] if word[0].islower()}


def test_commands(new_sim):
    """plcsim.md has each command of the console, and the console has each of those"""
    sim = new_sim("in = 4\nout = 4\nbyteorder = little\nmodbus_port = 0\netherip_port = 0")
    printed = {line.split()[0] for line in sim.command("help").splitlines()}
    documented = set()
    for head in ("command", "meaning"), ("command", "what happens"), ("statement, command", "meaning"):
        for cells in table("plcsim.md", *head):
            documented |= first_words(cells[0])
    assert printed - documented == set()
    assert documented - printed == {"allow", "first", "second"}  # a statement, and those of a pair
    assert [line for line in sim.command("help").splitlines() if line.split()[0] == "set"] == [sim.command("help set")]


@pytest.mark.parametrize("server", ["modbus", "etherip"])
def test_words(new_sim, server):
    """plcsim.md: what may stand behind `{server}` is what `{server} help` prints"""
    sim = new_sim("in = 4\nout = 4\nbyteorder = little\nmodbus_port = 0\netherip_port = 0")
    printed = sim.command(f"{server} help")
    documented = {word for cells in table("plcsim.md", "command", "meaning")
                  for word in re.findall(rf"\b{server} (\w+)", cells[0])} - {"help"}
    assert len(documented) > 4 and not [word for word in documented if not re.search(rf"\b{word}\b", printed)]
    words = set(re.findall(r"^  (\w+)", printed, re.M)) | set(re.findall(r"^  \w+, (\w+)", printed, re.M))
    assert not words - documented - {"and", "with"}


def test_arguments():
    """plcsim.md: each option of the command line stands in --help, and no other"""
    options = re.compile(r"(-\w), (--[\w-]+)")
    documented = {options.match(row[0]).groups() for row in table("plcsim.md", "option", "meaning")}
    assert documented == set(options.findall(sim_help()))


# --- Statistics -----------------------------------------------------------------------------------

STRINGS = ["ZRST", "ONST", "TWST", "THST", "FRST", "FVST", "SXST", "SVST", "EIST", "NIST"]


@pytest.mark.parametrize("statistic, file", [("state", "s7plcStation.db"), ("setpoints", "s7plcStation.db"),
                                             ("syncState", "s7plcSync.db"), ("mapState", "s7plcTables.db")])
def test_states(statistic, file):
    """statistics.md: the numbers of {statistic} mean what the texts of its record say"""
    meaning = next(row[2] for row in table("statistics.md", "name", "", "meaning") if row[0] == statistic)
    documented = {int(n): text.strip() for n, text in re.findall(r"(\d) ([a-zA-Z][^,:(]*)", meaning)}
    db = (TOP / "db" / file).read_text()
    record = next(text for text in db.split("record(") if re.search(rf'"@\$\(PLC\)/{statistic}"', text)
                  and text.startswith("mbbi"))
    texts = {STRINGS.index(name): text for name, text in re.findall(r'field\((\w\wST), +"(.*)"\)', record)}
    assert documented == texts


# --- plcSim as its page has it ----------------------------------------------------------------------

def test_command_line(tmp_path):
    """plcsim.md: -a, -p, -o, -e, -n, -s and -c do what the table says, whatever the file says"""
    (tmp_path / "x.plc").write_text("address = 127.0.0.1\nport = 1\nin = 2\nout = 4\n")
    began = time.monotonic()
    sim = subprocess.Popen([PLCSIM, "-n", "-a", "127.0.0.9", "-p", "0", "-o", "in=8", "-o", "period=20 ms",
                            "-e", "set in.0 UINT32 7", "-e", "set in.4 UINT32 8", "-c", tmp_path / "console", "-s", "3",
                            tmp_path / "x.plc"], stdout=subprocess.PIPE, stdin=subprocess.PIPE, text=True)
    sim.stdin.write("quit\n")  # which -n keeps away from it
    sim.stdin.flush()
    address, port = re.fullmatch(r"plcSim: PLC listening on (\S+):(\d+)\n", sim.stdout.readline()).groups()
    assert address == "127.0.0.9" and sim.stdout.readline() == f"plcSim: console on {tmp_path}/console\n"
    with socket.create_connection((address, int(port))) as plc:
        assert plc.recv(8, socket.MSG_WAITALL) == b"\0\0\0\7\0\0\0\x08"
    assert sim.wait(60) == 0 and time.monotonic() - began >= 3
    sim.stdout.close()
    sim.stdin.close()


def test_console(new_sim):
    """plcsim.md: dump, get by each form of address, period, signal, mirror, normal, first and second, quit"""
    sim = new_sim("in = 8\nout = 8\nperiod = 1 h\ndb 10 16 Motor\n# a comment\ninit DB10.DBX4.3 BOOL 1\nsignal 4 UINT16 constant 5\n")
    assert sim.command("dump DB10").endswith("00 00 00 00 08 00 00 00 00 00 00 00 00 00 00 00")
    for address in "DB10.DBB4", "Motor.4 UINT8", "DB10.4 UINT8":
        assert sim.command(f"get {address}").split()[-1] == "8", address
    sim.command("set DB10.DBD8 0x01020304")
    for address, value in (("DB10.DBW8", "258"), ("DB10.DBD8", "16909060"), ("Motor.8 UINT16[2]", "772")):
        assert sim.command(f"get {address}").split()[-1] == value, address
    for area in "MIQ":
        sim.command(f"set {area}B255 7")
        assert sim.command(f"get {area}255.2").split()[-1] == "1"
        assert sim.command(f"get {area}W254").split()[-1] == sim.command(f"get {area}D252").split()[-1] == "7"
        with pytest.raises(AssertionError, match="256"):
            sim.command(f"set {area}B256 1")
    sim.command("set out.6 UINT8 0x1f")
    assert sim.command("dump out").endswith("00 00 00 00 00 00 1f 00")
    sim.command("signal 0 UINT16 constant 77")
    sim.command("mirror 0 2 -> 2")
    with socket.create_connection(("127.0.0.1", sim.port)) as plc:
        plc.sendall(b"\x12\x34" + bytes(6))
        until(lambda: "received: 1 " in sim.command("status"))
        sim.command("period 20")
        until(lambda: plc.recv(8, socket.MSG_WAITALL) == b"\0\x4d\x12\x34\0\5\0\0")
        assert sim.command("dump in").endswith("00 4d 12 34 00 05 00 00")
        report = sim.command("status")
        assert f"client: 127.0.0.1:{plc.getsockname()[1]} for " in report and "received: 1 blocks, 8 bytes" in report
        assert int(re.search(r"^sent: (\d+) blocks", report, re.M)[1]) > 0
    sim.command("silence")
    assert "silence" in sim.command("status")
    sim.command("normal")
    assert "silence" not in sim.command("status")
    sim.console.sendall(b"quit\n")
    assert sim.process.wait(60) == 0


def test_arrays_of_signals(new_sim):
    """plcsim.md: of a sine in an array each element is shifted"""
    sim = new_sim("in = 12\nout = 0\nperiod = 10 ms\nsignal 0 REAL32[3] sine 0 10 1h\n")
    with socket.create_connection(("127.0.0.1", sim.port)) as plc:
        values = struct.unpack(">3f", plc.recv(12, socket.MSG_WAITALL))
    assert len({round(value, 3) for value in values}) == 3 and all(0 <= value <= 10 for value in values)


def test_sizes_of_nothing(new_sim):
    """plcsim.md: in = 0 sends nothing, out = 0 reads and forgets"""
    sim = new_sim("in = 0\nout = 8\nperiod = 10 ms\n")
    with socket.create_connection(("127.0.0.1", sim.port)) as plc:
        plc.sendall(bytes(24))
        until(lambda: "received: 3 " in sim.command("status"))
        plc.setblocking(False)
        with pytest.raises(BlockingIOError):
            plc.recv(1)
    sim = new_sim("in = 2\nout = 0\nperiod = 10 ms\n")
    with socket.create_connection(("127.0.0.1", sim.port)) as plc:
        plc.sendall(bytes(1 << 20))
        assert len(plc.recv(20, socket.MSG_WAITALL)) == 20


# --- Displays and packages ----------------------------------------------------------------------------

def test_lamps(monkeypatch):
    """displays.md: each lamp has the colour that the table says of what it shows"""
    monkeypatch.syspath_prepend(TOP / "s7plcApp/op")
    from plcdisplays import displays, layout
    colours = {layout.GREEN: "green", layout.RED: "red", layout.ORANGE: "orange", layout.BLUE: "blue",
               layout.GREY: "grey"}
    lamps = {}
    for states in (value for value in vars(displays).values() if isinstance(value, (list, tuple))):
        for state in states:
            if isinstance(state, tuple) and len(state) == 3 and state[2] in colours and isinstance(state[1], str):
                lamps.setdefault(state[1], set()).add(colours[state[2]])
    expected = {"DATA OK": "green", "SYNCED": "green", "LOCAL": "blue", "HMI controls": "blue", "PLC REFUSES": "orange",
                "MISMATCH": "red", "LAYOUT MISMATCH": "red", "EPICS controls": "grey"}
    assert {word: lamps.get(word) for word in expected} == {word: {colour} for word, colour in expected.items()}
    assert {row[0] for row in table("displays.md", "colour", "")} >= set(colours.values())


def test_for_packagers():
    """howto/deployment.md: the files and flags that a Makefile of somebody else needs are there"""
    rows = dict(row[:2] for row in table("howto/deployment.md", "", ""))
    assert all((TOP / "dbd" / name).exists() for name in rows["DBDS"].split(", "))
    assert all((TOP / "include" / name).exists() for name in rows["HEADERS"].split(", "))
    assert all(list((TOP / name).glob("*.db")) for name in rows["TEMPLATES"].split(", "))
    folders = (TOP / "s7plcApp/src/FOLDERS").read_text()
    makefile = (TOP / "s7plcApp/src/Makefile").read_text()
    for folder in (entry.name for entry in (TOP / "s7plcApp/src").iterdir() if entry.is_dir() and entry.name[:2] != "O."):
        assert folder in folders
        assert all(file.name in makefile for file in (TOP / "s7plcApp/src" / folder).glob("*.c")), folder
    flags = "".join(file.read_text() for file in (TOP / "configure").glob("CONFIG*") if file.is_file()) + makefile
    for flag in re.findall(r"-[a-zA-Z]+=?[\w_]+", rows["USR_CFLAGS"])[:3]:
        assert flag in flags, flag


def test_hosts_only():
    """howto/cross-build.md: plcSim, plcTag and unit tests are made for the host alone"""
    for file, program in ("plcSim/Makefile", "plcSim"), ("s7plcApp/etherip/Makefile", "plcTag"):
        assert re.findall(rf"^(\w+) \+= {program}$", (TOP / file).read_text(), re.M)[0].startswith("PROD_HOST")
    made = re.findall(r"^(TESTPROD\w*) \+= ", (TOP / "tests/unit/Makefile").read_text(), re.M)
    assert len(made) > 40 and all(word.startswith("TESTPROD_HOST") for word in made)
