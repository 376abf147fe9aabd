"""plcTag, the command-line tool: refusals that say what is allowed, and the longest list of tags."""
import socket
import struct
import subprocess
import threading

import pytest

from client import ARCH, TOP

PLC_TAG = TOP / "bin" / ARCH / "plcTag"


def run(*words):
    done = subprocess.run([PLC_TAG, *map(str, words)], capture_output=True, text=True, timeout=60)
    return done.returncode, done.stdout, done.stderr


REFUSED = [("read Speed.3", "bit 3; REAL has no bits"), ("read S.9", "bit 9; SINT has bits 0 to 7"),
           ("read D.32", "bit 32; DINT has bits 0 to 31"), ("read B.1", "bit 1; BOOL has bit 0 only"),
           ("write D.40 1", "bit 40; DINT has bits 0 to 31"), ("write Speed.2 1", "REAL has no bits"),
           ("write D.3 2", "allowed: 0 or 1"), ("write D.3 1 0", "several values for a bit; allowed: one"),
           ("write Text a b", "several values for a string; allowed: one"),
           ("write Speed abc", '"abc" does not fit REAL; allowed: a number'),
           ("write S 200", '"200" does not fit SINT; allowed: -128 to 127'),
           ("write U -1", '"-1" does not fit ULINT; allowed: 0 to 18446744073709551615'),
           ("write B x", "allowed: 0, 1, false, true"),
           ("read D[1", "allowed: [i], [i,j], [i,j,k]"), ("read D[0x1]", "allowed: decimal numbers"),
           ("read Program:Main.", "allowed: name, name.member, Program:name.tag"),
           ("list [", 'no tag matches "["; allowed: a name, with * and ?')]
OPTIONS = [("-c", "0", "1 to 4000000000"), ("-c", "1.5", "1 to 4000000000"), ("-n", "1.5", "1 to 65535"),
           ("-t", "x", "10 to 600000"), ("-w", "0", "0.001 to 86400"), ("-s", "256", "-1 to 255")]


def test_refusals(plant):
    """What plcTag refuses is one line that says what is allowed, and the status is 1"""
    plant.tags("tag Speed REAL", "tag S SINT = -1", "tag D DINT", "tag B BOOL", "tag U ULINT", "tag Text STRING")
    here = f"127.0.0.1:{plant.port}"
    for command, words in REFUSED:
        status, out, error = run(here, *command.split())
        assert (status, out) == (1, "") and words in error and error.count("\n") == 1, (command, error)
    for letter, value, words in OPTIONS:
        assert run(letter, value, here, "read", "D") == (1, "", f"plcTag: {letter} {value}; allowed: {words}\n")
    assert run(here, "read", "S.7", "D.31") == (0, "S.7=1\nD.31=0\n", "")


class Lister:
    """A controller that has nothing but `count` tags."""

    def __init__(self, count):
        self.count, self.told = count, 0
        self.listening = socket.create_server(("127.0.0.1", 0))
        self.port = self.listening.getsockname()[1]
        threading.Thread(target=self.serve, daemon=True).start()

    def serve(self):
        client, _ = self.listening.accept()
        with client, client.makefile("rb") as stream:
            while len(head := stream.read(24)) == 24:
                command, length = struct.unpack_from("<HH", head)
                data = self.answer(command, stream.read(length))
                client.sendall(struct.pack("<HHI", command, len(data), 1) + head[8:] + data)

    def answer(self, command, data):
        if command == 0x04:
            return bytes(2)
        if command == 0x65:
            return data
        service = data[16]
        message = bytes([service | 0x80, 0, 8, 0]) if service != 0x55 else self.list()
        return data[:14] + struct.pack("<H", len(message)) + message

    def list(self):
        first, self.told = self.told, min(self.told + 2000, self.count)
        names = ((i, f"T{i}".encode()) for i in range(first, self.told))
        more = 6 if self.told < self.count else 0
        return bytes([0xD5, 0, more, 0]) + b"".join(
            struct.pack("<IH", i, len(name)) + name + struct.pack("<HIII", 0xC4, 0, 0, 0) for i, name in names)

    def close(self):
        self.listening.close()


@pytest.mark.parametrize("count", [100000, 100001])
def test_longest_list(closing, count):
    """A list of 100,000 tags is printed whole; {count} tags"""
    lister = Lister(count)
    closing(lister)
    status, out, error = run("-u", "-s", "-1", f"127.0.0.1:{lister.port}", "list")
    if count == 100000:
        assert (status, error) == (0, "") and out.count("\n") == count and out.split()[-2:] == ["T99999", "DINT"]
    else:
        assert (status, out, error) == (1, "", "plcTag: list: the list has more than 100000 tags\n")
