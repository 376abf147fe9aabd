"""The Modbus PLC of the tests itself: does it follow the standard? mbpoll and raw bytes ask."""
import shutil
import socket
import struct
import subprocess

import pytest


@pytest.fixture
def peer(new_modbus):
    return new_modbus(size=2000)


def mbpoll(peer, *words):
    """Values that mbpoll reads, or the end of what it says."""
    if not shutil.which("mbpoll"):
        pytest.skip("mbpoll is not installed")
    run = subprocess.run(["mbpoll", "-0", "-1", "-q", "-p", str(peer.port), *words, "127.0.0.1"],
                         capture_output=True, text=True, timeout=30)
    values = [line.split()[1] for line in run.stdout.splitlines() if line.startswith("[")]
    return values or run.stdout + run.stderr


@pytest.mark.parametrize("table, kind", [("coils", "0"), ("discrete", "1"), ("input", "3"),
                                         ("holding", "4")])
def test_mbpoll_reads(peer, table, kind):
    """mbpoll reads the test PLC's table {table}"""
    values = [1, 0, 1, 1] if kind in "01" else [258, 3, 65535, 0]
    for i, value in enumerate(values):
        getattr(peer, table)[30 + i] = value
    assert mbpoll(peer, "-t", kind, "-r", "30", "-c", "4") == [str(v) for v in values]
    assert peer.requests[-1].key == ({"0": 1, "1": 2, "3": 4, "4": 3}[kind], 30, 4)


def test_mbpoll_refused(peer):
    """mbpoll gets the exception that the script of the test PLC names"""
    peer.refuse(3, 10, code=6)
    assert "busy" in mbpoll(peer, "-t", "4", "-r", "8", "-c", "4")
    peer.refuse_no_more()
    assert mbpoll(peer, "-t", "4", "-r", "8", "-c", "2") == ["0", "0"]
    assert "Illegal data address" in mbpoll(peer, "-t", "4", "-r", "1999", "-c", "2")


def ask(peer, *bodies, unit=1):
    """Answers (function and the rest) to requests given as function and the rest."""
    with socket.create_connection(("127.0.0.1", peer.port), timeout=30) as sock:
        answers = []
        for number, body in enumerate(bodies, 1):
            sock.sendall(struct.pack(">HHHB", number, 0, len(body) + 1, unit) + body)
            head = sock.recv(7, socket.MSG_WAITALL)
            transaction, protocol, length, answered = struct.unpack(">HHHB", head)
            assert (transaction, protocol, answered) == (number, 0, unit)
            answers.append(sock.recv(length - 1, socket.MSG_WAITALL))
        return answers


WRITES = {
    "FC5": (b"\5\0\x07\xff\0", b"\5\0\x07\xff\0"),
    "FC6": (b"\6\0\x07\x12\x34", b"\6\0\x07\x12\x34"),
    "FC15": (b"\x0f\0\x07\0\x0a\2\x4d\2", b"\x0f\0\x07\0\x0a"),
    "FC16": (b"\x10\0\x07\0\2\4\x12\x34\x56\x78", b"\x10\0\x07\0\2"),
    "FC22": (b"\x16\0\x07\0\xf2\0\x25", b"\x16\0\x07\0\xf2\0\x25"),
}


@pytest.mark.parametrize("request_, answer", WRITES.values(), ids=WRITES.keys())
def test_writes(peer, request_, answer):
    """the test PLC takes {id} as in the standard"""
    peer.holding[7] = 0x12
    assert ask(peer, request_) == [answer]
    function = request_[0]
    if function == 5:
        assert peer.coils[7] and not peer.coils[6]
    elif function == 15:
        assert [peer.coils[7 + i] for i in range(10)] == [1, 0, 1, 1, 0, 0, 1, 0, 0, 1]
    elif function == 22:
        assert peer.holding[7] == 0x17  # the example of the standard
    else:
        assert peer.holding.unpack(7, "H")[0] == 0x1234
    assert len(peer.writes()) == 1 and not peer.errors


def test_breaches(peer):
    """the test PLC notes each request that breaks the standard"""
    wrong = [b"\3\0\0\0\x7e", b"\4\0\0\0\0", b"\1\0\0\x07\xd1", b"\5\0\0\1\0",
             b"\x10\0\0\0\x7c" + bytes([248]) + bytes(248 - 6),
             b"\x0f\0\0\0\2\1\x04", b"\3\xff\xff\0\2", b"\x10\0\0\0\2\2\0\1"]
    for body in wrong:
        with socket.create_connection(("127.0.0.1", peer.port), timeout=30) as sock:
            before = len(peer.errors)
            sock.sendall(struct.pack(">HHHB", 1, 0, len(body) + 1, 1) + body)
            sock.recv(100)
            assert len(peer.errors) > before, body.hex(" ")
    peer.errors.clear()
