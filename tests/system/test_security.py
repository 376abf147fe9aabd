"""What docs/security.md says of sockets, of a network that sends anything, of compiled files, and
of limits."""
import os
import random
import re
import socket
import struct
import subprocess
import threading

import pytest

from client import ARCH, TOP
from ports import free_port
from waiting import until

DB = 'record(ai, "$(P)v") { field(DTYP, "S7plc") field(INP, "@PLC/0 T=INT16") field(SCAN, "I/O Intr") }\n'
EIP_DB = 'record(ai, "$(P)v") { field(DTYP, "EtherIP") field(INP, "@PLC v S .1") field(SCAN, "I/O Intr") }\n'


# --- What listens ---------------------------------------------------------------------------------
def listeners(pid):
    """Addresses at which a process listens (TCP) or takes datagrams (UDP), as they stand in /proc."""
    inodes = set()
    for name in os.listdir(f"/proc/{pid}/fd"):
        try:
            inodes.update(re.findall(r"socket:\[(\d+)\]", os.readlink(f"/proc/{pid}/fd/{name}")))
        except FileNotFoundError:
            pass
    found = []
    for table, state in (("tcp", "0A"), ("tcp6", "0A"), ("udp", "07"), ("udp6", "07")):
        for line in open(f"/proc/net/{table}").read().splitlines()[1:]:
            words = line.split()
            if words[9] in inodes and words[3] == state:
                found.append((table, words[1].partition(":")[0]))
    return sorted(found)


def interfaces():
    """The addresses of this machine, as the kernel has them."""
    return open("/proc/net/fib_trie").read()


def address(text):
    """127.0.0.1 of 0100007F"""
    return socket.inet_ntoa(struct.pack("<I", int(text, 16)))


STATIONS = {
    "s7plcIoc": "s7plcConfigure PLC, 127.0.0.1, {port}, 8, 8\n"
                "modbusplcConfigure M, 127.0.0.1, {port}, 1, \"holding 0 4\", \"holding 10 4\"\n",
    "phoenixIoc": "phoenixplcConfigure PLC, \"127.0.0.1,127.0.0.2\", {port}, 8, 8, 1, 1000, 100, 1\n",
    "eipIoc": "drvEtherIP_init\ndrvEtherIP_define_PLC PLC, 127.0.0.1:{port}, 0\n",
}


@pytest.mark.parametrize("program", STATIONS)
def test_driver_listens_on_nothing(new_ioc, new_peer, program):
    """the driver of {program} opens no port: what listens is that of an IOC without PLCs"""
    if not (TOP / "bin" / ARCH / program).exists():
        pytest.skip(f"there is no {program}")
    peer = new_peer(8, 8)
    addresses = None
    while addresses != interfaces():  # PVA takes datagrams at each of them, and other tests make some
        addresses = interfaces()
        bare = new_ioc("", "", program=program)
        until(lambda: listeners(bare.process.pid), "CA")
        count = len(peer.connections)
        ioc = new_ioc(STATIONS[program].format(port=peer.port), "", program=program)
        until(lambda: len(peer.connections) > count, "a connection to the PLC")
    until(lambda: listeners(ioc.process.pid) == listeners(bare.process.pid),
          lambda: f"{listeners(ioc.process.pid)} is not {listeners(bare.process.pid)}")


def test_plctag_listens_on_nothing(new_sim):
    """plcTag opens no port"""
    sim = new_sim(SERVERS)
    with subprocess.Popen([TOP / "bin" / ARCH / "plcTag", "-w", "0.1", f"127.0.0.1:{sim.etherip_port}", "watch", "T"],
                          stdout=subprocess.PIPE, text=True) as watch:
        assert watch.stdout.readline()
        assert listeners(watch.pid) == []
        watch.terminate()


SERVERS = "in = 8\nout = 8\nbyteorder = little\nmodbus_port = 0\netherip_port = 0\ntag T INT\nmodbus holding 0 4 -> in.0\n"


@pytest.mark.parametrize("line, words, where", [("", (), "127.0.0.1"), ("", ("-a", "0.0.0.0"), "0.0.0.0"),
                                                ("address = 0.0.0.0\n", (), "0.0.0.0")],
                         ids=["by itself", "-a 0.0.0.0", "address = 0.0.0.0"])
def test_plcsim_listens_on_loopback(new_sim, line, words, where):
    """plcSim ({id}) listens with blocks, Modbus and EtherNet/IP there, and nowhere else"""
    sim = new_sim(line + SERVERS, *words)
    found = listeners(sim.process.pid)
    assert [table for table, _ in found] == ["tcp"] * 3
    assert {address(text) for _, text in found} == {where}


# --- What the network can do ------------------------------------------------------------------------
class RandomSender:
    """Sends random bytes as fast as they are taken, on each connection up to `most` of them; then
    the connection ends, and the next one is taken."""

    def __init__(self, most, seed=1):
        self.random, self.most = random.Random(seed), most
        self.sent = self.connections = 0
        self.listener = socket.socket()
        self.listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        self.port = free_port()
        self.listener.bind(("127.0.0.1", self.port))
        self.listener.listen(5)
        self.ends = False
        self.thread = threading.Thread(target=self.run, daemon=True)
        self.thread.start()

    def run(self):
        while not self.ends:
            try:
                connection, _ = self.listener.accept()
            except OSError:
                return
            self.connections += 1
            connection.settimeout(0.5)
            left = self.most
            try:
                while left > 0 and not self.ends:
                    n = connection.send(self.random.randbytes(min(left, 65536)))
                    left -= n
                    self.sent += n
            except OSError:
                pass
            connection.close()

    def close(self):
        self.ends = True
        self.listener.shutdown(socket.SHUT_RDWR)
        self.listener.close()
        self.thread.join()


@pytest.mark.parametrize("seed", range(4))
def test_plctag_random_bytes(closing, seed):
    """random bytes without end (seed {seed}): plcTag ends with status 1 and one line"""
    sender = RandomSender(1 << 20, seed)
    closing(sender)
    ended = subprocess.run([TOP / "bin" / ARCH / "plcTag", "-w", "0.2", f"127.0.0.1:{sender.port}", "list"],
                           capture_output=True, text=True, timeout=60)
    assert sender.connections and (ended.returncode, ended.stdout, ended.stderr.count("\n")) == (1, "", 1), ended
    assert ended.stderr.startswith("plcTag: "), ended


FLOODS = {
    "blocks": ("s7plcIoc", "s7plcConfigure PLC, 127.0.0.1, {port}, 64, 8\n", DB),
    "Modbus": ("s7plcIoc", "modbusplcConfigure PLC, 127.0.0.1, {port}, 1, \"holding 0 100\", \"coils 0 8\"\n", DB),
    "EtherNet-IP": ("eipIoc", "drvEtherIP_init\ndrvEtherIP_define_PLC PLC, 127.0.0.1:{port}, 0\n", EIP_DB),
}


@pytest.mark.parametrize("wire", FLOODS)
def test_random_bytes(new_ioc, closing, wire):
    """random bytes without end, over {wire}: the IOC answers, memory and log do not grow with them"""
    program, configure, db = FLOODS[wire]
    if not (TOP / "bin" / ARCH / program).exists():
        pytest.skip(f"there is no {program}")
    sender = RandomSender(4 << 20)
    closing(sender)
    ioc = new_ioc(configure.format(port=sender.port), db, program=program)
    until(lambda: sender.connections >= 8, lambda: f"8 connections, not {sender.connections}", 120)
    memory, lines = ioc.memory(), len(ioc.lines)
    until(lambda: sender.connections >= 16, lambda: f"16 connections, not {sender.connections}", 120)
    ioc.severity("v")  # it answers
    assert ioc.memory() < memory + 4e6
    # one line for the beginning and the end of a connection; repeats are not told
    assert len(ioc.lines) - lines <= 2 * 8


def test_no_privilege(new_ioc, new_peer):
    """an IOC without any privilege reads and writes its PLC"""
    peer = new_peer(2, 2)
    drop = ("--bounding-set=-all", "--inh-caps=-all") if os.geteuid() == 0 else ()
    ioc = new_ioc(peer.configure(), DB + 'record(longout, "$(P)o") { field(DTYP, "S7plc") field(OUT, "@PLC/0") }\n',
                  wrapper=("setpriv", *drop))
    assert re.search(r"^CapEff:\t0+$", open(f"/proc/{ioc.process.pid}/status").read(), re.M)
    peer.wait_connected()
    peer.send(b"\0\7")
    ioc.wait_value("v", 7)
    ioc.put("o", 8)
    peer.wait_block(b"\0\x08")


# --- How it is compiled -------------------------------------------------------------------------------
@pytest.mark.parametrize("product", ["bin/*/s7plcIoc", "bin/*/plcSim", "bin/*/plcTag", "lib/*/libs7plc.so", "lib/*/libether_ip.so"])
def test_hardened(product):
    """{product} has read-only tables of the loader, guarded stacks and checked copies, and may lie anywhere"""
    found = list(TOP.glob(product))
    if not found:
        pytest.skip("built without it")
    kind, dynamic, headers, symbols = (
        subprocess.run(["readelf", "-W", words, found[0]], capture_output=True, text=True, check=True).stdout
        for words in ("-h", "-d", "-l", "--dyn-syms"))
    if "san.so" in dynamic:
        pytest.skip("built with a sanitizer")
    assert re.search(r"Type: +DYN", kind)
    assert "GNU_RELRO" in headers
    assert "BIND_NOW" in dynamic or re.search(r"FLAGS_1.*NOW", dynamic)
    if product.endswith("Ioc"):
        return  # its few lines have nothing on a stack that could be guarded
    assert "__stack_chk_fail" in symbols
    assert re.search(r"__\w+_chk@", symbols)


@pytest.mark.parametrize("harden, cross, wanted", [("", "", True), ("NO", "", False), ("", "CROSS", False),
                                                   ("YES", "CROSS", True)])
def test_harden(tmp_path, harden, cross, wanted):
    """HARDEN={harden}, for the host or another machine ({cross}): compiled with these flags: {wanted}"""
    (tmp_path / "Makefile").write_text(
        f"OS_CLASS = Linux\nBUILD_CLASS = {cross or 'HOST'}\n"
        f"include {TOP}/configure/CONFIG_SITE\n" + f"HARDEN = {harden}\n" * bool(harden) +
        "all:\n\t@echo $(USR_CPPFLAGS_Linux) $(USR_CFLAGS_Linux) $(USR_CXXFLAGS_Linux) $(USR_LDFLAGS_Linux)\n")
    said = subprocess.run(["make", "-s", "-C", tmp_path], capture_output=True, text=True, check=True,
                          env={"PATH": os.environ["PATH"]}).stdout
    for flag in "-D_FORTIFY_SOURCE=2", "-fstack-protector", "-Wl,-z,relro", "-Wl,-z,now":
        assert (flag in said.split()) is wanted, said


# --- Limits -----------------------------------------------------------------------------------------
def numbers_of(name, text):
    """What the sources say of a name: the value of a constant, or all numbers in a function or struct."""
    constant = re.search(rf"\b{name}\b(?: =)? (\(?[^;{{]*?)(?:,|/\*|$)", re.sub(r"(?m)^ \*.*$", "", text), re.M)
    if constant and re.search(r"\d", constant[1]) and "\n" not in constant[1]:
        known = re.sub(r"eipHeaderSize", lambda m: str(max(numbers_of(m[0], text))), constant[1])
        return {eval(re.sub(r"\(size_t\)|(?<=\d)u", "", known))}
    body = re.search(rf"^[^\n]*\b{name}\b[^;\n]*\n?{{.*?^}}", text, re.M | re.S)
    return {int(n) for n in re.findall(r"\b\d+\b", body[0])}


def numbers_in(cell):
    """The numbers in a cell of the table, with KiB and MiB; a text of 4,095 characters has 4,096 bytes."""
    units = {"KiB": 1 << 10, "MiB": 1 << 20}
    found = {int(n.replace(",", "")) * units.get(unit, 1) for n, unit in re.findall(r"([\d,]*\d) ?(KiB|MiB|)", cell)}
    return found | {4096} if 4095 in found else found


def test_limits():
    """each constant in the table of docs/security.md stands where the table says, and has that value"""
    folders = [TOP / "s7plcApp/src", TOP / "s7plcApp", TOP / "plcSim", TOP]
    rows = re.findall(r"^\|[^|]*\|([^|]*)\| (`.*) \|$", (TOP / "docs/security.md").read_text(), re.M)
    checked = 0
    for cell, row in rows:
        said, limits = set(), numbers_in(cell)
        names, last = [], None
        for word in re.findall(r"`([^`]+)`", row):
            if "." not in word:
                names.append(word)
                continue
            file = next((f / word for f in folders if (f / word).exists()), last and last.parent / word)
            assert file and file.exists(), (row, word)
            assert all(name in file.read_text() for name in names), (row, word)
            for name in names:
                values = numbers_of(name, file.read_text())
                assert values & limits, (row, name, values, limits)
                said |= values
            checked += len(names)
            names, last = [], file
        assert not names, row
        missing = limits - said - {2, 4095}  # "two blocks"
        assert not missing, (row, missing)
    assert checked > 15
