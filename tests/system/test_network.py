"""Name servers that fail, firewalls that drop: in namespaces of our own where needed."""
import shutil
import socket
import subprocess
import threading
import time

import pytest

from waiting import until

IN = """
record(longin, "$(P)in") { field(DTYP, "S7plc") field(INP, "@PLC/0 T=INT32") field(SCAN, "I/O Intr") }
record(longin, "$(P)poll") { field(DTYP, "S7plc") field(INP, "@PLC/0 T=INT32") }
record(stringout, "$(P)addr") { field(DTYP, "S7plc addr") field(OUT, "@PLC") }
"""
INSTANT = 3.0  # s; a driver that waits for a name server does so for 5 s or more


def check_instant(ioc):
    ioc.get("poll")
    ioc.pv("poll.PROC")
    for _ in range(10):
        for action in (lambda: ioc.get("poll"), lambda: ioc.process_record("poll"),
                       lambda: ioc.command("dbior s7plc 1")):
            begin = time.monotonic()
            action()
            assert time.monotonic() - begin < INSTANT


def test_unknown_host(new_ioc, new_peer):
    """a host name that does not exist: said once, nothing waits, and "S7plc addr" helps"""
    peer = new_peer(4, 0)
    ioc = new_ioc(f's7plcConfigure("PLC", "no-such-host.invalid", {peer.port}, 4, 0, 1, 2000, 100)', IN)
    check_instant(ioc)
    ioc.wait_log("no-such-host.invalid")
    ioc.wait_alarm("in", "INVALID", "COMM", ask=True)
    assert ioc.log_count("cannot connect") <= 1
    ioc.put("addr", "127.0.0.1")
    peer.wait_connected()
    peer.send(b"\0\0\0\x05")
    ioc.wait_value("in", 5)


def test_late_name(need_root, new_ioc, new_peer, tmp_path):
    """a host name that is known later only is asked for again: the IOC connects by itself"""
    peer, hosts, resolv = new_peer(4, 0), tmp_path / "hosts", tmp_path / "resolv.conf"
    hosts.write_text("127.0.0.1 localhost\n")
    resolv.write_text("nameserver 127.0.0.1\noptions timeout:1 attempts:1\n")
    ioc = new_ioc(f's7plcConfigure("PLC", "late-plc.invalid", {peer.port}, 4, 0, 1, 20000, 100)', IN,
                  wrapper=["unshare", "-m", "sh", "-c", f'mount --bind {hosts} /etc/hosts && mount --bind {resolv} '
                           '"$(readlink -f /etc/resolv.conf)" && exec "$@"', "sh"])
    ioc.wait_alarm("in", "INVALID", "COMM", 'no address for host "late-plc.invalid"', ask=True)
    with open(hosts, "a", encoding="ascii") as file:
        file.write("127.0.0.1 late-plc.invalid\n")
    peer.wait_connected()
    peer.send(b"\0\0\0\x05")
    ioc.wait_value("in", 5)


@pytest.mark.parametrize("route, reason", [("", "network unreachable"),
                                           ("ip route add unreachable 10.9.0.0/16 && ", "no route to PLC")])
def test_unreachable(need_root, new_ioc, route, reason):
    """a PLC in a network to which there is no way: the log and AMSG say "{reason}\""""
    ioc = new_ioc('s7plcConfigure("PLC", "10.9.0.1", 2000, 4, 0, 1, 2000, 100)', IN,
                  wrapper=["unshare", "-n", "sh", "-c", f'ip link set lo up && {route}exec "$@"', "sh"])
    ioc.wait_log(f"cannot connect to 10.9.0.1 port 2000: {reason}")
    # it has a network of its own: no Channel Access reaches it
    until(lambda: reason in ioc.command(f"dbgf {ioc.P}in.AMSG"), lambda: ioc.command(f"dbpr {ioc.P}in 4"))


class DeafNameServer:
    """Takes questions on 127.0.0.77, the address of no machine, and never answers."""

    def __init__(self):
        self.socket = socket.socket(type=socket.SOCK_DGRAM)
        self.socket.bind(("127.0.0.77", 53))
        self.asked = threading.Event()
        threading.Thread(target=self.run, daemon=True).start()

    def run(self):
        try:
            self.socket.recv(1000)
            self.asked.set()
        except OSError:
            pass

    def close(self):
        self.socket.close()


@pytest.fixture
def deaf_name_server(closing):
    try:
        server = DeafNameServer()
    except OSError as error:
        pytest.skip(f"cannot listen on port 53: {error}")
    closing(server)
    return server


def test_deaf_name_server(need_root, deaf_name_server, new_ioc, new_peer, tmp_path):
    """a name server that does not answer: the IOC starts, nothing waits, other PLCs work, exit is clean"""
    peer = new_peer(4, 0)
    (tmp_path / "resolv.conf").write_text("nameserver 127.0.0.77\n")
    begin = time.monotonic()
    ioc = new_ioc(
        's7plcConfigure("PLC", "plc.example.com", 2000, 4, 0, 1, 2000, 100)\n'
        + peer.configure(name="OTHER", recv_timeout=20000),
        IN + """
        record(longin, "$(P)other") { field(DTYP, "S7plc") field(INP, "@OTHER/0 T=INT32") field(SCAN, "I/O Intr") }
        """,
        wrapper=["unshare", "-m", "sh", "-c",
                 f'mount --bind {tmp_path}/resolv.conf "$(readlink -f /etc/resolv.conf)" && exec "$@"',
                 "sh"])
    assert time.monotonic() - begin < 10
    until(deaf_name_server.asked.is_set, "a question to the name server")
    check_instant(ioc)
    peer.wait_connected()
    peer.send(b"\0\0\0\x06")
    ioc.wait_value("other", 6)
    ioc.wait_alarm("in", "INVALID", "COMM", ask=True)
    assert ioc.exit(limit=20) == 0


def test_firewall(need_root, new_ioc, new_peer):
    """a firewall begins to drop all packets of the PLC: INVALID after recvTimeout, nothing waits, and back when it ends"""
    if not shutil.which("iptables"):
        pytest.skip("needs iptables")
    peer = new_peer(4, 4)
    ioc = new_ioc(peer.configure(recv_timeout=500), IN + """
        record(longout, "$(P)out") { field(DTYP, "S7plc") field(OUT, "@PLC/0 T=INT32") }
        """)
    peer.wait_connected()
    peer.every(0.05, b"\0\0\0\x07")
    ioc.wait_value("in", 7)
    rule = ["-p", "tcp", "-i", "lo", "--match", "multiport", "--ports", str(peer.port), "-j", "DROP"]
    added = subprocess.run(["iptables", "-I", "INPUT", *rule], capture_output=True, text=True)
    if added.returncode:
        pytest.skip(f"iptables: {added.stderr.strip().splitlines()[0]}")
    try:
        ioc.wait_alarm("in", "INVALID", "COMM")
        ioc.wait_alarm("in", "INVALID", "COMM", "does not answer", ask=True)
        check_instant(ioc)
        ioc.put("out", 5)
        begin = time.monotonic()
        ioc.put("out", 6)
        assert time.monotonic() - begin < INSTANT
    finally:
        subprocess.run(["iptables", "-D", "INPUT", *rule], check=True)
    ioc.wait_alarm("in", "NO_ALARM")
    peer.wait_block(b"\0\0\0\x06")
