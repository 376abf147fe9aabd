"""plcTag, the command-line tool: refusals that say what is allowed, and the longest list of tags."""
import signal
import socket
import struct
import subprocess
import threading

import pytest

from client import ARCH, TOP
from waiting import until

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
# Names that are there, but not so, and values that the type has not
MISFITS = [("read A[10]", "A is DINT[10]; allowed: A[0] to A[9]"), ("read D[0]", "D is DINT, no array"),
           ("read Grid[2,0]", "Grid is INT[2,5]; allowed: Grid[0,0] to Grid[1,4]"),
           ("read Grid[1]", "allowed: Grid[0,0] to Grid[1,4]"),
           ("read Flags[45]", "Flags is DWORD[2]; allowed: Flags[0] to Flags[1]; BOOL 45 is Flags[1].13"),
           ("read Nix", "no such tag or member (04); those there are: list"),
           ("read Program:Main.y", "those there are: list"), ("watch Nix", "those there are: list"),
           ("read M.Speed", "M is Motor[3]; allowed: M[0] to M[2]"), ("read M[3].Speed", "allowed: M[0] to M[2]"),
           ("read M[0].Foo", "no such member or element; those there are: describe M"),
           ("read M[1].axis[2].Pos", "no such member or element"), ("read D.x", "D is no structure, it has no members"),
           ("describe M[7]", "M is Motor[3]; allowed: M[0] to M[2]"), ("describe Nix", "those there are: list"),
           ("describe 5", "the PLC lists no such tag; those there are: list"),
           ("write A[8] 1 2 3", "3 elements are more than there are: A is DINT[10]; allowed: A[0] to A[9]"),
           ("write D 1 2", "2 elements are more than there are: D is DINT, no array"),
           ("write D 1.5", '"1.5" does not fit DINT; allowed: whole numbers, -2147483648 to 2147483647'),
           ("write D 1e3", "allowed: whole numbers"), ("write D = 5", '"=" does not fit DINT'),
           ("write D 99999999999", "does not fit DINT; allowed: -2147483648 to 2147483647"),
           ("write B 2", '"2" does not fit BOOL; allowed: 0, 1, false, true'),
           ("write D.3 yes", "does not fit a bit; allowed: 0 or 1, false or true"),
           ("write Speed 1e40", "does not fit REAL: it is too large"), ("write Speed 1,5", "allowed: a number"),
           (f"write Text {'x' * 90}", "it has 90 characters, allowed: 82"),
           ("write M 1", "does not fit a structure; its members can be written"),
           ("write Ro 1", "no right to access it (0F)"), ("write M[0] 1", "its members")]
# Command lines that are none: status 2
WRONG = [("reed A", 'unknown command "reed"; allowed: host, then identify, list, describe, read, write or watch'),
         ("READ A", 'unknown command "READ"'), ("", "no command behind the host; allowed: identify, list"),
         ("read", "0 words behind read; allowed: read tag ..."), ("list a b", '2 words behind list; allowed: list ["pattern"]'),
         ("write D=5", "1 word behind write; allowed: write tag value ..."), ("identify x", "1 word behind identify"),
         ("describe", "allowed: describe tag"), ("read -n 5 A", '"-n" is behind the command; allowed: options before the host')]
OPTIONS = [("-c", "0", "1 to 4000000000"), ("-c", "1.5", "1 to 4000000000"), ("-n", "1.5", "1 to 65535"),
           ("-t", "x", "10 to 600000"), ("-w", "0", "0.001 to 86400"), ("-s", "256", "-1 to 255")]


def test_refusals(plant):
    """What plcTag refuses is one line that says what is allowed, and the status is 1; of an option, 2"""
    plant.tags("tag Speed REAL", "tag S SINT = -1", "tag D DINT", "tag B BOOL", "tag U ULINT", "tag Text STRING")
    here = f"127.0.0.1:{plant.port}"
    for command, words in REFUSED:
        status, out, error = run(here, *command.split())
        assert (status, out) == (1, "") and words in error and error.count("\n") == 1, (command, error)
    for letter, value, words in OPTIONS:
        whole = ", a whole number" if value in ("1.5", "x") else ""
        assert run(letter, value, here, "read", "D") == (2, "", f"plcTag: {letter} {value}; allowed: {words}{whole}\n")
    assert run("-s", "1.5", here, "read", "D")[::2] == (2, "plcTag: -s 1.5; allowed: -1 to 255, a whole number\n")
    assert run("-r", "1,", here, "read", "D")[0] == 2
    for route in "", " ":
        assert run("-r", route, here, "read", "D")[::2] == (2, "plcTag: -r is blank; allowed: port,link,port,link ... as 1,0, or -1\n")
    for slot in "0x0", "1e1":
        assert run("-s", slot, here, "read", "D")[::2] == (2, f"plcTag: -s {slot}; allowed: -1 to 255, a whole number\n")
    assert run(here, "read", "S.7", "D.31") == (0, "S.7=1\nD.31=0\n", "")


def test_one_of_an_array(plant):
    """read of an array without -n says that there are more than the element it shows"""
    plant.tags("tag I INT[10] = 5", "tag D DINT = 3", "tag Text STRING = abc")
    here = f"127.0.0.1:{plant.port}"
    assert run(here, "read", "I", "D", "Text") == (
        0, 'I=5\nD=3\nText="abc"\n',
        "plcTag: I is an array, this is its first element; more: -n count before the host\n")
    assert run(here, "read", "I[0]", "I[9]") == (0, "I[0]=5\nI[9]=5\n", "")
    assert run("-n", 1, here, "read", "I") == (0, "I=5\n", "")
    assert run("-n", 3, here, "read", "I") == (0, "I=5 5 5\n", "")


def test_misfits(plant):
    """plcTag says of a tag that is refused what there is, and of a value what its type takes"""
    plant.tags("udt Axis Pos:DINT", "udt Motor axis:Axis[2] Speed:REAL", "tag A DINT[10] = 5", "tag D DINT = 7",
               "tag B BOOL", "tag Speed REAL", "tag Text STRING", "tag M Motor[3]", "tag Grid INT[2,5]",
               "tag Flags BOOL[64]", "tag Ro DINT readonly", "tag Program:Main.x DINT")
    here = f"127.0.0.1:{plant.port}"
    for command, words in MISFITS:
        status, out, error = run(here, *command.split())
        assert (status, out) == (1, "") and words in error and error.count("\n") == 1, (command, error)
    assert run("-n", 3, here, "read", "A[8]")[2].endswith("3 elements are more than there are: A is DINT[10]; "
                                                          "allowed: A[0] to A[9]\n")
    assert plant.tag("D") == "7" and plant.tag("B") in ("0", "false") and plant.tag("A[8]") == "5"
    for value, got in ("010", "10"), ("0x10", "16"), ("-0x10", "-16"):
        assert run(here, "write", "D", value)[0] == 0 and plant.tag("D") == got
    assert run(here, "write", "D.3", "true")[0] == 0 and run(here, "write", "B.0", "1")[0] == 0
    assert run(here, "read", "D.3", "B") == (0, "D.3=1\nB=1\n", "")


def test_wrong_command_lines(plant):
    """A command line that is none is one line that says what is wrong, and the status is 2"""
    plant.tags("tag D DINT")
    here = f"127.0.0.1:{plant.port}"
    for line, words in WRONG:
        status, out, error = run(here, *line.split())
        assert (status, out) == (2, "") and words in error and error.count("\n") == 1, (line, error)
    for options, words in [(("-x", here), 'unknown option "-x"; allowed: -s -r -n -t -w -c with a value, -u -v -h'),
                           (("-uv", here), 'unknown option "-uv"'), (("-n",), "-n wants a value behind it"),
                           (("-u",), "no host"), (("",), "no host"), (("-s", 0, "-r", "1,0", here), "-s and -r")]:
        tail = () if options == ("-n",) or options == ("-u",) else ("read", "D")
        status, out, error = run(*options, *tail)
        assert (status, out) == (2, "") and words in error and error.count("\n") == 1, (options, error)
    assert run()[0] == 2 and run()[2].startswith("usage: plcTag") and run("--help")[1].startswith("usage: plcTag")
    for host in "::1", f"http://{here}", ":44818", "127.1", "1.2.3:44818", "x" * 256:
        assert run(host, "read", "D") == (2, "", f'plcTag: host "{host[:60]}"; allowed: a name or an address as 10.0.0.5, '
                                                 "with or without :port\n")
    for port in "0", "70000", "abc", "":
        assert run("127.0.0.1:" + port, "read", "D") == (2, "", f"plcTag: port {port}; allowed: 1 to 65535\n")


def test_list_ignores_case(plant):
    """A pattern of list is the same in upper and lower case, as names are"""
    plant.tags("tag MotorOne DINT", "tag motortwo DINT", "tag Other DINT")
    for pattern in "motor*", "MOTOR*", "mOtOr???":
        assert run(f"127.0.0.1:{plant.port}", "list", pattern)[1].split()[::2] == ["MotorOne", "motortwo"]


def test_refused_list(new_sim):
    """Where there is no list, what is refused is said as the controller has it, and the rest is read"""
    sim = new_sim("port = off\nbyteorder = little\netherip_port = 0\netherip_profile = micro800\ntag D DINT = 3\n")
    assert run("-s", -1, f"127.0.0.1:{sim.etherip_port}", "read", "Nix", "D[4]", "D") == (
        1, "D=3\n", "plcTag: Nix: no such tag or member (04)\nplcTag: D[4]: no such tag (05)\n")


def test_watch_goes_on(plant):
    """watch says that the connection is lost, connects again, goes on, and ends well by ctrl-C"""
    plant.tags("tag D DINT = 3")
    watch = subprocess.Popen([PLC_TAG, "-w", "0.05", f"127.0.0.1:{plant.port}", "watch", "D"], stdout=subprocess.PIPE,
                             stderr=subprocess.PIPE, text=True)
    try:
        assert watch.stdout.readline().endswith(" D=3\n")
        plant.sim.command("etherip refuse on")
        plant.sim.command("etherip close")
        assert "plcTag: connection lost, trying again: " in watch.stderr.readline()
        plant.set("D", 4)
        plant.sim.command("etherip refuse off")
        assert watch.stderr.readline().endswith("plcTag: connected again\n")
        assert watch.stdout.readline().endswith(" D=4\n")
        plant.sim.command("etherip timeout")  # the connection in the controller
        assert "connection lost" in watch.stderr.readline() and "connected again" in watch.stderr.readline()
        plant.set("D", 5)
        assert watch.stdout.readline().endswith(" D=5\n")
        assert "etherip connection:" in plant.sim.command("etherip")
        watch.send_signal(signal.SIGINT)
        assert watch.wait(20) == 0 and watch.stderr.read() == ""
        until(lambda: "etherip connection:" not in plant.sim.command("etherip"), "the connection closed in the controller")
    finally:
        watch.kill()
        watch.communicate()


def test_watch_ends_lost(plant):
    """watch -c that ends while the connection is lost has status 1"""
    plant.tags("tag D DINT = 3")
    watch = subprocess.Popen([PLC_TAG, "-w", "0.5", "-c", "4", f"127.0.0.1:{plant.port}", "watch", "D"],
                             stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    assert watch.stdout.readline().endswith(" D=3\n")
    plant.sim.close()
    assert watch.communicate(timeout=60)[1].count("connection lost") == 1 and watch.returncode == 1


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
