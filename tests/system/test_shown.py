"""What the documents show as printed is what is printed: messages letter by letter, reports and
demonstrations with any numbers."""
import re
import socket
import subprocess

import pytest
from pymodbus.client import ModbusTcpClient

from client import ARCH, TOP
from docblocks import blocks
from ioc import SINCE_7_0_6
from waiting import until


def shown(page, begins):
    """The block of a page whose first line begins so."""
    return next(b.text for b in blocks() if b.page == page and b.first.startswith(begins))


def plain(text):
    """Its lines, with N for each number and one blank for several."""
    return [re.sub(r"\s+", " ", re.sub(r"-?\d+(\.\d+)*", "N", line)).strip()
            for line in text.splitlines()]


def same(wanted, printed, missing=()):
    """Each line of `wanted` is in `printed` but for its numbers; "..." stands for anything."""
    have = plain(printed)
    for line in plain(wanted):
        pattern = ".*".join(map(re.escape, line.split("...")))
        assert line in missing or any(re.fullmatch(pattern, h) for h in have), \
            f"{line}\nis not in:\n{printed}"


# --- Messages of links -------------------------------------------------------------------------------

@pytest.mark.parametrize("page", ["alarms.md", "records.md"])
def test_message(page, new_ioc):
    """the message of a wrong link is as {id} shows it, with its mark at the same place"""
    text = shown(page, "S7plc ai")
    name = re.search(r'"(.*?)"', text).group(1)
    link = text.splitlines()[1].strip()
    ioc = new_ioc("s7plcConfigure PLC, 127.0.0.1, 1, 96, 96",
                  f'record(ai, "{name}") {{ field(DTYP, "S7plc") field(INP, "{link}") }}')
    start, printed = text.split("\n", 1)
    assert start.removesuffix("...") in ioc.log and "\n" + printed.rstrip() in ioc.log, ioc.log


# --- Commands --------------------------------------------------------------------------------------------

USAGE = [b for b in blocks() if b.page in ("iocsh.md", "asyn.md") and re.match(r"\w+ (PLC\w*|port),", b.text)]


@pytest.mark.parametrize("text", [b.text for b in USAGE], ids=[b.place for b in USAGE])
def test_usage(text, new_ioc):
    """{id} has the arguments that `help` shows"""
    program = "s7plcAsynIoc" if "Asyn" in text else "s7plcIoc"
    if not (TOP / "bin" / ARCH / program).exists():
        pytest.skip("s7plcAsyn is not built: ASYN is not set in configure/RELEASE.local")
    ioc = new_ioc("", "", program=program)
    for line in text.splitlines():
        name, rest = line.split(" ", 1)
        usage = next(u for u in ioc.command(f"help {name}").splitlines() if name in u)
        arguments = re.findall(r"'[^']*'|\S+", re.sub(r"\x1b\[\w*", "", usage))[1:]
        arguments = [re.sub(r" \[.*\]", "", a.strip("'")) for a in arguments]
        assert [a.strip('" ') for a in rest.split(",")] == arguments, usage


PROGRAMS = {"s7plcIoc": "s7plc|modbusplc|drvEtherIP|etherip", "phoenixIoc": "phoenixplc", "s7plcAsynIoc": "drvAsyn"}


@pytest.mark.parametrize("program", PROGRAMS)
def test_help(program, new_ioc):
    """iocsh.md: `help` shows each command of the page that {program} has"""
    if not (TOP / "bin" / ARCH / program).exists():
        pytest.skip("s7plcAsyn is not built: ASYN is not set in configure/RELEASE.local")
    heads = " ".join(re.findall(r"^## (.*)", (TOP / "docs/iocsh.md").read_text(), re.MULTILINE))
    names = [name for name in re.findall(r"\w+", heads) if re.match(PROGRAMS[program], name) and name != "s7plcDebug"]
    ioc = new_ioc("", "", program=program)
    assert names and not [name for name in names if f"{name}\x1b" not in ioc.command(f"help {name}")
                          and not re.search(rf"^{name}( |$)", ioc.command(f"help {name}"), re.MULTILINE)]


def test_log(new_peer, new_ioc):
    """options.md: what log=io shows of these blocks and puts"""
    peer = new_peer(8, 6)
    ioc = new_ioc(peer.configure("PRESS", send_interval=60000, recv_timeout=60000) +
                  "\ns7plcSetOption PRESS holdoff 500\ns7plcSetOption PRESS log io\n",
                  'record(longout, "$(P)out") { field(DTYP, "S7plc") field(OUT, "@PRESS/4") }\n'
                  'record(bo, "$(P)bit") { field(DTYP, "S7plc") field(OUT, "@PRESS/2 T=WORD B=2") }\n')
    peer.wait_connected()
    peer.send(bytes.fromhex("002A000000000001"))
    ioc.wait_log("PRESS: in ")
    ioc.put("out", 500)
    ioc.put("bit", 1)
    ioc.wait_log("PRESS: out ")
    for line in shown("options.md", "s7plc PRESS: in").splitlines():
        assert line in ioc.log, ioc.log


def test_report(new_peer, new_ioc):
    """iocsh.md: the report of a PLC"""
    peer = new_peer(96, 112)
    ioc = new_ioc(peer.configure("PRESS", recv_timeout=2000) +
                  "\ns7plcSetOption PRESS heartbeat 500\ns7plcSetOption PRESS scan changed\n", "")
    peer.wait_connected()
    peer.send(bytes(96))
    ioc.wait_log("no block for 2.0 s")
    peer.every(0.02, bytes(96))
    until(lambda: "period [ms]" in ioc.command("s7plcReport PRESS"), "good blocks")
    same(shown("iocsh.md", "PRESS 192"), ioc.command("s7plcReport PRESS"))


def test_modbus_report(new_sim, new_ioc):
    """iocsh.md: the lines of a PLC over Modbus, and of a range that it refuses"""
    sim = new_sim("port = off\nmodbus_port = 0\ndb 10 500\nmodbus holding 0 250 -> DB10.0\n")
    ioc = new_ioc(f'modbusplcConfigure PRESS, 127.0.0.1, {sim.modbus_port}, 1, '
                  '"holding 0 100, input 0 20 every 500", "holding 200 50"', "")
    wanted = shown("iocsh.md", "Modbus 192")
    until(lambda: "exception 2" in ioc.command("s7plcReport PRESS"), "a range that is refused")
    same(wanted, ioc.command("s7plcReport PRESS"))


def test_show(new_peer, new_ioc):
    """iocsh.md: s7plcShow of these bytes, letter by letter"""
    peer = new_peer(32, 0)
    ioc = new_ioc(peer.configure("PRESS", recv_timeout=60000), "".join(
        f'record({kind}, "PRESS:{name}") {{ field(DTYP, "S7plc") field(INP, "@PRESS/{link}")'
        ' field(SCAN, "I/O Intr") }\n'
        for kind, name, link in (("longin", "Count", "0"), ("stringin", "Recipe", "2 L=6"),
                                 ("ai", "Force", "8 T=REAL32"), ("bi", "Closed", "12"))))
    peer.wait_connected()
    peer.send(bytes.fromhex("1234414200000000" "4120000000030000") + bytes(16))
    ioc.wait_log("connected")
    wanted = shown("iocsh.md", "PRESS in, PLC -> IOC").rstrip()
    until(lambda: wanted in ioc.command("s7plcShow PRESS in"),
          lambda: wanted + "\nis not in:\n" + ioc.command("s7plcShow PRESS in"))


# --- Demonstrations ----------------------------------------------------------------------------------------

@pytest.mark.parametrize("page, begins, demo", [
    ("etherip.md", "352 bi", "iocEtherIP"), ("modbus.md", "Force", "iocModbus"),
    ("redundancy.md", "Step 1", "iocPhoenix")])
def test_demo(page, begins, demo, need_root):
    """{page} shows what its demonstration prints"""
    if "PLC: " in shown(page, begins) and not SINCE_7_0_6:
        pytest.skip("shows AMSG, which this Base has not")
    ended = subprocess.run([TOP / "iocBoot" / demo / "demo"], stdin=subprocess.DEVNULL,
                           capture_output=True, text=True, timeout=240)
    assert ended.returncode == 0, ended.stdout + ended.stderr
    same(shown(page, begins), ended.stdout)


# --- plcSim ------------------------------------------------------------------------------------------------

def section(head):
    return (TOP / "docs/plcsim.md").read_text().split(f"## {head}\n")[1]


def file_in(head, word):
    return next(part for part in section(head).split("```") if word in part)


def test_lines_at_start(new_sim):
    """plcsim.md: the lines for programs to read"""
    sim = new_sim(file_in("Modbus", "modbus_port = 1502"), "-o", "modbus_port=0")
    sim2 = new_sim(file_in("EtherNet/IP", "etherip_port = 44818"), "-o", "etherip_port=0")
    printed = "\n".join(sim.lines + sim2.lines)
    assert " listening on " in sim.lines[0] and " Modbus listening on " in sim.lines[1]
    for begins in ("plcSim: PLC listening", "plcSim: PLC Modbus", "plcSim: PLC EtherNet/IP"):
        same(re.sub(r"console on .*", "console on ...", shown("plcsim.md", begins)), printed)


def test_console(new_sim):
    """plcsim.md: the two commands of --connect, and the fault that it names"""
    sim = new_sim("in = 64\nout = 64\nmodbus_port = 0\nmodbus holding 0 32 -> in.0\n")
    for line in shown("plcsim.md", "plcSim --connect").splitlines():
        words = line.split("#")[0].replace("/run/plc1.sock", str(sim.path)).split()
        ended = subprocess.run([TOP / "bin" / ARCH / words[0], *words[1:]], input="status\n", text=True,
                               capture_output=True, timeout=60)
        assert ended.returncode == 0, ended.stdout + ended.stderr
    assert sim.command("get in.4 INT16").endswith("= 5")
    sim.command(shown("plcsim.md", "modbus exception").strip())
    assert "exception=2" in sim.command("status")


def test_mbpoll(new_sim):
    """plcsim.md: mbpoll reads and writes as it is shown"""
    sim = new_sim(file_in("Modbus", "modbus_port = 1502"), "-o", "modbus_port=0")
    for line in shown("plcsim.md", "mbpoll").splitlines():
        words = line.split("#")[0].replace("1502", str(sim.modbus_port)).split()
        ended = subprocess.run(words, capture_output=True, text=True, timeout=60)
        assert ended.returncode == 0, ended.stdout + ended.stderr
    assert sim.command("get DB10.6 UINT16[2]").endswith("= 77 78")
    assert sim.command("get DB20.1 UINT8").endswith("= 5")


def test_pair_in_two(new_sim, tmp_path):
    """plcsim.md: both halves of a pair, each a process, find each other"""
    text = (TOP / "iocBoot/iocPhoenix/plc-a.plc").read_text()
    halves = []
    for line in shown("plcsim.md", "plcSim -o role=first").splitlines():
        options = line.replace("/run/fibre", str(tmp_path / "fibre")).split()[1:-1]
        halves.append(new_sim(text, *options))
    until(lambda: {"PRIMARY", "BACKUP"} <= set(re.findall(r"\b(?:PRIMARY|BACKUP)\b", " ".join(
        half.command("status") for half in halves))), "a PRIMARY and a BACKUP")


def test_status_lines(new_sim, closing):
    """plcsim.md: the lines of `status` and `modbus received`"""
    sim = new_sim("in = 64\nmodbus_port = 0\ndb 10 400\nmodbus holding 0 200 -> DB10.0\n"
                  "modbus input 0 32 -> in.0\nmodbus without 22 23\n")
    master = ModbusTcpClient("127.0.0.1", port=sim.modbus_port)
    closing(master)
    assert master.connect()
    master.write_registers(3, [77, 78])
    master.read_holding_registers(198, count=5)
    master.read_holding_registers(0, count=1)
    sim.command("modbus exception 2 holding 17 write")
    same(shown("plcsim.md", "modbus: address="), sim.command("status"))
    received = sim.command("modbus received 10")
    for line in shown("plcsim.md", "2 time=").splitlines():
        assert re.search(re.escape(line.split(" unit=")[1]), received), received


def test_etherip_lines(new_sim):
    """plcsim.md: those of EtherNet/IP"""
    sim = new_sim("port = off\netherip_port = 0\nbyteorder = little\ntag Speed REAL\ntag Levels REAL[4]\n")
    for words in (["read", "Speed", "Levels"], ["read", "Nothing"]):
        subprocess.run([TOP / "bin" / ARCH / "plcTag", f"127.0.0.1:{sim.etherip_port}", *words],
                       capture_output=True, timeout=60)
    sim.command("etherip status 05 tag Speed write next 3")
    # the client and its connection are gone by now
    text = "\n".join(line for line in shown("plcsim.md", "etherip: address=").splitlines()
                     if " client: " not in line and " connection: " not in line)
    keys = re.compile(r"=[^ ,]*")
    have = {keys.sub("=", line) for line in sim.command("status").splitlines()}
    for line in text.splitlines():
        head = " ".join(line.split()[:2])
        if head in ("etherip services:", "etherip statuses:"):
            assert any(h.startswith(head) for h in have), have
        else:
            assert keys.sub("=", line) in have, (line, have)
    wanted = shown("plcsim.md", "118 time=").split(" 4c:")[0]
    got = sim.command("etherip received 5")
    assert keys.sub("=", wanted).split(" ", 1)[1] in keys.sub("=", got), got


# --- plcTag ------------------------------------------------------------------------------------------------

def test_plc_tag(new_sim):
    """etherip.md: each command of plcTag"""
    sim = new_sim("port = off\netherip_port = 0\nbyteorder = little\nudt Axis Speed:REAL On:BOOL\ntag Motor1 Axis\n"
                  "tag REALs REAL[40]\ntag Program:Main.x REAL\ntag Flags BOOL[32]\ntag Setpoint REAL\n")
    for line in shown("etherip.md", "plcTag").splitlines():
        words = re.sub(r"192\.168\.0\.30|10\.0\.0\.4 ", f"127.0.0.1:{sim.etherip_port} ", line)
        words = words.replace(" watch", " -c 3 watch").replace("-s 3", "-s 0").replace('"', "").split()
        words.insert(1, "-t1000")
        route = "-r" in words
        if "-c" in words:  # options stand in front of the address
            at = words.index("-c")
            words[1:1] = words[at:at + 2]
            del words[at + 2:at + 4]
        ended = subprocess.run([TOP / "bin" / ARCH / words[0], *words[1:]], capture_output=True,
                               text=True, timeout=60)
        assert ended.returncode == 0 or route, (words, ended.stdout, ended.stderr)
    assert sim.command("etherip get Setpoint").endswith("12.5")


# --- The log -----------------------------------------------------------------------------------------------

def formats():
    """A pattern for each text with words in the sources, as printf would fill it."""
    for file in (TOP / "s7plcApp/src").rglob("*.c"):
        for many in re.findall(r'(?:"(?:[^"\\\n]|\\.)*"\s*)+', file.read_text()):
            text = "".join(re.findall(r'"((?:[^"\\\n]|\\.)*)"', many)).replace("\\n", "").strip()
            words = re.sub(r"%[-0-9.*zl]*[a-zA-Z]", "\0", text)
            if len(re.findall(r"[a-z]", words)) >= 10:
                yield ".*".join(map(re.escape, words.split("\0")))


def test_log_lines():
    """alarms.md: each line of the log is one that the sources print"""
    known = list(formats())
    for line in shown("alarms.md", "s7plc PRESS: connected").splitlines():
        text = line.removeprefix("s7plc PRESS: ")
        assert any(re.fullmatch(k, text) or re.fullmatch(k, line) for k in known), text


def test_handshake_of_sync(new_sim, closing):
    """plc-programming.md: the blocks of the example are those of iocBoot/iocSync, and what they say is so"""
    sim = new_sim((TOP / "iocBoot/iocSync/sync.plc").read_text())
    blocks = [(line.startswith("PLC"), bytes.fromhex(re.match(r".*?-> \w+ +((?:[0-9A-F]{2} +)+)", line + " ")[1]))
              for line in shown("plc-programming.md", "PLC -> IOC   02 2A").splitlines()]
    plc = socket.create_connection(("127.0.0.1", sim.port))
    closing(plc)
    for of_plc, block in blocks:
        if not of_plc:
            plc.sendall(block)
            continue
        seen = []

        def comes():
            seen[:] = [plc.recv(32, socket.MSG_WAITALL)[:len(block)]]  # noqa: B023
            return seen[0][:1] + seen[0][2:] == block[:1] + block[2:]  # noqa: B023
        until(comes, lambda: seen[0].hex(" "))  # noqa: B023
    assert sim.command("get DB10.0 REAL32").endswith("= 30")


def test_console_of_sync(new_sim):
    """plc-programming.md: the commands for the PLC of the handshake"""
    sim = new_sim((TOP / "iocBoot/iocSync/sync.plc").read_text())
    commands = re.findall(r"> (\S.*?)(?:  |$)", shown("plc-programming.md", "plcSim sync.plc"), re.MULTILINE)
    assert len(commands) == 6
    for command in commands:
        sim.command(command)
