"""plcSim's EtherNet/IP seen by clients that know real controllers: pycomm3 and pylogix."""
import contextlib
import logging
import socket
import subprocess
import threading

import pytest
from pycomm3 import CIPDriver, CommError, LogixDriver, ResponseError
from pylogix import PLC

from client import TOP
from sim import PROGRAM
from waiting import LIMIT, until, until_equal

logging.getLogger("pycomm3").setLevel(logging.CRITICAL)  # its refusals are ours to judge

TAGS = """
byteorder = little
period = 20 ms
etherip_port = 0
udt Point X:REAL Y:REAL
udt Valve Open:BOOL Closed:BOOL Position:REAL Counts:INT[5] Name:STRING Where:Point Flags:BOOL[64] Spots:Point[3] Big:LINT Last:BOOL
udt STR20 string 20
tag BOOL   BOOL
tag SINT   SINT
tag INT    INT
tag DINT   DINT
tag LINT   LINT
tag USINT  USINT
tag UINT   UINT
tag UDINT  UDINT
tag ULINT  ULINT
tag REAL   REAL
tag LREAL  LREAL
tag STRING STRING
tag Short  STR20
tag BOOLs  BOOL[352]
tag INTs   INT[3000]
tag REALs  REAL[1200]
tag Cube   DINT[2,3,4]
tag Texts  STRING[60]
tag Inlet  Valve
tag Valves Valve[40]
tag Wait   TIMER
tag Count  COUNTER
tag Fixed  DINT readonly = 7
tag Secret DINT hidden
tag Moving REAL sine -5 5 2s
tag Program:Main.Speed REAL = 1.5
tag Program:Main.Point Point
tag Program:Other.X INT = 3
"""

VALUES = {
    "BOOL": [True, False], "SINT": [-128, 127], "INT": [-32768, 32767],
    "DINT": [-2**31, 2**31 - 1], "LINT": [-2**63, 2**63 - 1], "USINT": [255], "UINT": [65535],
    "UDINT": [2**32 - 1], "ULINT": [2**64 - 1], "REAL": [-1.5, 3.25e38 / 2**20],
    "LREAL": [1e-300, -2.5], "STRING": ["", "x" * 82], "Program:Main.Speed": [2.25],
    "INTs[2999]": [-5], "Cube[1,2,3]": [77], "Texts[59]": ["last"], "Inlet.Position": [0.5],
    "Inlet.Where.Y": [8.0], "Inlet.Spots[2].X": [9.5], "Inlet.Counts[4]": [-9],
    "Program:Main.Point.Y": [4.0], "Wait.PRE": [5000], "Count.DN": [True],
}
PROFILES = ["l8x", "enet"]


@pytest.fixture
def new_tags(new_sim):
    """new_tags(profile) is a simulator with all the tags."""
    return lambda profile="l8x", *options: new_sim(
        TAGS, "-o", f"etherip_profile={profile}", *options)


@pytest.fixture
def new_comm(closing):
    def make(sim, driver=LogixDriver, **kw):
        plc = driver(f"127.0.0.1:{sim.etherip_port}/0", **kw)

        class Closer:
            @staticmethod
            def close():
                with contextlib.suppress(CommError):  # where the test has broken it
                    plc.close()
        closing(Closer)
        plc.open()
        return plc
    return make


@pytest.fixture
def new_logix(closing):
    def make(sim, **kw):
        plc = PLC("127.0.0.1", port=sim.etherip_port, timeout=LIMIT, **kw)

        class Closer:
            close = plc.Close
        closing(Closer)
        return plc
    return make


def numbers(sim, word):
    """The values of the status line that begins with a word."""
    line = next(line for line in sim.command("etherip").splitlines() if line.startswith(word))
    return dict(pair.split("=", 1) for pair in line[len(word):].split())


def shown(sim, tag):
    return sim.command(f"etherip get {tag}").split(" = ", 1)[1]


def like(a, b):
    return a == pytest.approx(b, rel=1e-6) if isinstance(b, float) else a == b


# ---- every type --------------------------------------------------------------------------------

@pytest.mark.parametrize("profile", PROFILES)
def test_pycomm3_types(new_tags, new_comm, profile):
    """pycomm3 writes and reads every type, member and element ({profile})"""
    sim = new_tags(profile)
    plc = new_comm(sim)
    for tag, values in VALUES.items():
        for value in values:
            assert plc.write(tag, value).error is None, (tag, value)
            assert like(plc.read(tag).value, value), (tag, value)
    assert all(result.error is None for result in
               plc.write(*[(tag, values[-1]) for tag, values in VALUES.items()]))
    results = plc.read(*VALUES)
    assert all(like(result.value, values[-1])
               for result, values in zip(results, VALUES.values()))
    assert shown(sim, "ULINT") == str(2**64 - 1) and shown(sim, "Inlet.Spots[2].X") == "9.5"


@pytest.mark.parametrize("profile", PROFILES)
def test_pylogix_types(new_tags, new_logix, profile):
    """pylogix writes and reads every type, member and element ({profile})"""
    sim = new_tags(profile)
    plc = new_logix(sim)
    for tag, values in VALUES.items():
        for value in values:
            assert plc.Write(tag, value).Status == "Success", (tag, value)
            assert like(plc.Read(tag).Value, value), (tag, value)
    assert plc.ConnectionSize == (4002 if profile == "l8x" else 504)
    results = plc.Read(list(VALUES))
    assert [result.Status for result in results] == len(VALUES) * ["Success"]
    assert shown(sim, "SINT") == "127" and shown(sim, "Texts[59]") == '"last"'


@pytest.mark.parametrize("profile", PROFILES)
def test_pycomm3_long(new_tags, new_comm, profile):
    """pycomm3: arrays longer than a packet, BOOL arrays, structures ({profile})"""
    sim = new_tags(profile)
    plc = new_comm(sim)
    ints = [(7 * i) % 30000 - 9000 for i in range(3000)]
    reals = [i / 4 for i in range(1200)]
    bools = [i % 3 == 0 for i in range(352)]
    texts = [f"text {i}" for i in range(60)]
    for tag, values in (("INTs", ints), ("REALs", reals), ("BOOLs", bools), ("Texts", texts)):
        assert plc.write(f"{tag}{{{len(values)}}}", values).error is None, tag
        assert plc.read(f"{tag}{{{len(values)}}}").value == values, tag
    assert plc.write("BOOLs[301]", True).error is None
    assert plc.write("DINT.5", True).error is None and plc.read("DINT").value == 32
    assert plc.read("BOOLs[301]").value is True
    valve = plc.read("Inlet").value
    valve.update(Open=True, Counts=[1, 2, 3, 4, 5], Name="inlet", Last=True)
    valve["Flags"][63] = valve["Where"]["X"] = True
    assert plc.write("Inlet", valve).error is None
    assert plc.read("Inlet").value == valve
    assert plc.write("Valves{40}", 40 * [valve]).error is None
    assert plc.read("Valves{40}").value == 40 * [valve]
    assert shown(sim, "Valves[39].Flags[1]") == str(2**31)
    assert int(numbers(sim, "etherip largest:")["answer"]) <= (4000 if profile == "l8x" else 504)


def test_pylogix_long(new_tags, new_logix):
    """pylogix: arrays longer than a packet, bits, several writes in one packet"""
    sim = new_tags("enet")
    plc = new_logix(sim)
    ints = [(11 * i) % 30000 - 9000 for i in range(3000)]
    assert plc.Write("INTs", ints).Status == "Success"
    assert plc.Read("INTs", 3000).Value == ints
    bools = [i % 5 == 0 for i in range(352)]
    assert plc.Write("BOOLs[0]", bools).Status == "Success"
    assert plc.Read("BOOLs[0]", 352).Value == bools
    assert plc.Write("DINT.31", 1).Status == "Success"
    assert plc.Read("DINT").Value == -2**31
    results = plc.Write([("SINT", 1), ("INT", 2), ("REAL", 3.5), ("STRING", "multi"),
                         ("DINT.0", 1)])
    assert [result.Status for result in results] == 5 * ["Success"]
    assert [plc.Read(tag).Value for tag in ("SINT", "INT", "REAL", "STRING", "DINT")] == \
        [1, 2, 3.5, "multi", 1 - 2**31]


# ---- browsing ----------------------------------------------------------------------------------

def test_pycomm3_browse(new_tags, new_comm):
    """pycomm3 lists tags, programs, tasks, structures, access and the identity"""
    plc = new_comm(new_tags("l8x", "-o", "etherip_program=Pump"))
    names = [line.split()[1] for line in TAGS.splitlines() if line.startswith("tag ")]
    assert sorted(plc.tags) == sorted(names)
    assert plc.tags["Cube"]["dimensions"] == [2, 3, 4]
    assert plc.tags["Fixed"]["external_access"] == "Read Only"
    assert plc.tags["Secret"]["external_access"] == "None"
    assert sorted(plc.info["programs"]) == ["Main", "Other"]
    assert list(plc.info["tasks"]) == ["MainTask"]
    assert plc.info["name"] == "Pump" and plc.info["keyswitch"] == "REMOTE RUN"
    assert plc.info["product_name"] == "1756-L83E/B"
    assert plc.data_types["Valve"]["attributes"] == [
        "Open", "Closed", "Position", "Counts", "Name", "Where", "Flags", "Spots", "Big", "Last"]
    assert plc.data_types["Valve"]["internal_tags"]["Spots"]["array"] == 3
    assert plc.data_types["STR20"]["string"] == 20
    assert plc.data_types["TIMER"]["attributes"] == ["PRE", "ACC", "EN", "TT", "DN"]
    assert plc.write("Count.OV", True).error is None and plc.read("Count").value == {
        "PRE": 0, "ACC": 0, "CU": False, "CD": False, "DN": False, "OV": True, "UN": False}
    assert plc.get_plc_time().value is not None
    assert plc.get_module_info(0)["product_name"] == "1756-L83E/B"


def test_pylogix_browse(new_tags, new_logix):
    """pylogix lists tags and structures; an ENET module and the CPU behind it differ"""
    plc = new_logix(new_tags("enet"))
    found = {tag.TagName: tag.DataType for tag in plc.GetTagList().Value}
    assert found["Inlet"] == "Valve" and found["Short"] == "STR20" and found["LREAL"] == "LREAL"
    assert "Program:Main.Speed" in found
    assert [field.TagName for field in plc.UDTByName["Point"].Fields] == ["X", "Y"]
    assert plc.GetProgramsList().Value == ["Program:Main", "Program:Other"]
    assert plc.GetDeviceProperties().Value.ProductName == "1756-ENET/A"
    assert plc.GetModuleProperties(0).Value.ProductName == "1756-L55/A LOGIX5555"
    assert plc.GetModuleProperties(3).Status == "Connection failure"


def test_micro800(new_sim, new_logix):
    """pylogix on a Micro800: no route, no packets, strings as long as their text"""
    sim = new_sim("byteorder = little\netherip_port = 0\netherip_profile = micro800\n"
                  "tag REAL REAL = 1.5\ntag Text STRING = \"two words\"\ntag L LREAL\n")
    plc = new_logix(sim, Micro800=True)
    assert plc.Read("REAL").Value == 1.5 and plc.Read("Text").Value == "two words"
    assert plc.Write("Text", "x").Status == "Success" and shown(sim, "Text") == '"x"'
    assert plc.Write("L", 2.5).Status == "Success" and plc.Read("L").Value == 2.5


# ---- refusals ----------------------------------------------------------------------------------

def test_refused(new_tags, new_comm, new_logix):
    """Access rights, the key, unknown tags: refused one by one, the rest of a packet goes on"""
    sim = new_tags()
    plc, logix = new_comm(sim), new_logix(sim)
    assert plc.read("Fixed").value == 7
    assert plc.write("Fixed", 1).error == plc.read("Secret").error == "Permission denied"
    results = logix.Read(["INT", "Nothing", "Secret", "DINT"])
    assert [result.Status for result in results] == \
        ["Success", "Path segment error", "Privilege violation", "Success"]
    assert numbers(sim, "etherip statuses:")["1e"] == "1"
    assert sim.command("etherip received").endswith("4c:INT=00 4c:Nothing=04 4c:Secret=0f 4c:DINT=00")
    sim.command("etherip key run")
    assert plc.write("INT", 5).error and plc.read("INT").value == 0
    sim.command("etherip key remote")
    assert plc.write("INT", 5).error is None


@pytest.mark.parametrize("key, shown, writes", [("remote", "REMOTE RUN", True), ("run", "RUN", False),
                                                ("prog", "PROG", True)])
def test_key(new_tags, new_comm, key, shown, writes):
    """etherip_key={key} in the file, or by the console: clients see {shown}; a write is taken: {writes}"""
    turned = new_tags()
    turned.command(f"etherip key {key}")
    for sim in new_tags("l8x", "-o", f"etherip_key={key}"), turned:
        plc = new_comm(sim)
        assert plc.info["keyswitch"] == shown
        assert (plc.write("INT", 5).error is None) is writes
        assert plc.read("INT").value == (5 if writes else 0)


def test_slot(new_tags, new_comm):
    """The CPU is in its slot and in no other"""
    sim = new_tags("l8x", "-o", "etherip_slot=2")
    with pytest.raises(ResponseError):
        new_comm(sim)
    plc = LogixDriver(f"127.0.0.1:{sim.etherip_port}/2")
    with plc:
        assert plc.read("Fixed").value == 7


def test_smaller(new_tags, new_comm):
    """A controller that has less than 4002 bytes says how many it has"""
    sim = new_tags("l8x", "-o", "etherip_size=2000")
    plc = new_comm(sim)
    assert plc.connection_size == 500 and plc.read("REALs{1200}").error is None
    assert numbers(sim, "etherip opens:")["refused"] == "1"


# ---- changes -----------------------------------------------------------------------------------

def change_counter(plc):
    """What class AC tells, by which clients know a download."""
    answer = plc.generic_message(service=0x03, class_code=0xAC, instance=1, request_data=b"\2\0\1\0\3\0", connected=False)
    assert answer.error is None
    return answer.value


def test_download(new_tags, new_comm):
    """After a download the old instance ids lead nowhere, or to other tags"""
    sim = new_tags()
    plc = new_comm(sim)
    sim.command("etherip set DINT 11")
    sim.command("etherip set LINT 22")
    assert plc.read("DINT").value == 11
    before = change_counter(plc)
    sim.command("etherip download")
    assert plc.read("DINT").error.startswith("Destination unknown")
    assert change_counter(plc) != before and numbers(sim, "etherip:")["clients"] == "1"
    plc.get_tag_list(program="*")
    assert plc.read("DINT").value == 11 and plc.read("Inlet").error is None
    sim.command("etherip download shift")
    assert plc.read("DINT").value != 11  # what stands there now is LINT
    plc.get_tag_list(program="*")
    assert plc.read("DINT").value == 11


def test_edits(new_tags, new_logix, new_comm):
    """Tags come, go and change their type while clients read; class AC tells each time"""
    sim = new_tags()
    plc = new_logix(sim)
    told = [change_counter(comm := new_comm(sim))]
    for command in "udt Late2 X:INT", "tag Other DINT", "tag Other REAL", "remove Other":
        sim.command(f"etherip {command}")
        told.append(change_counter(comm))
    assert len(set(told)) == 5, told
    assert plc.Read("Late").Status == "Path segment error"
    sim.command("etherip tag Late DINT[2] = 5 6")
    assert plc.Read("Late", 2).Value == [5, 6]
    sim.command("etherip tag Late DINT counter")
    until(lambda: plc.Read("Late").Value > 2, "the counter moves")
    sim.command("etherip remove Late")
    assert plc.Read("Late").Status == "Path segment error"
    sim.command("etherip tag Moving DINT = 1")
    assert shown(sim, "Moving") == "1"


def test_restart(new_tags, new_comm):
    """A restart ends sessions and connections; cold, tags have the values of the file"""
    sim = new_tags()
    plc = new_comm(sim)
    plc.write(("Program:Main.Speed", 9.0), ("INT", 9))
    sim.command("restart 1 cold")
    with pytest.raises(CommError):
        plc.read("INT")
    until(lambda: "state: on" in sim.command("status"), "the PLC is on")
    plc = new_comm(sim)
    assert [result.value for result in plc.read("Program:Main.Speed", "INT")] == [1.5, 0]


def test_signals(new_tags, new_comm):
    """Signals move tags"""
    plc = new_comm(new_tags())
    first = plc.read("Moving").value
    until(lambda: plc.read("Moving").value != first, "the signal moves")


# ---- several clients ---------------------------------------------------------------------------

def test_clients(new_tags, new_comm):
    """Eight clients write and read at a time, each on its own connection"""
    sim = new_tags()
    plcs = [new_comm(sim) for _ in range(8)]
    failures = []

    def work(number, plc):
        for i in range(80):
            plc.write(f"INTs[{number}]", i)
            if plc.read(f"INTs[{number}]").value != i:
                failures.append((number, i))
    threads = [threading.Thread(target=work, args=args) for args in enumerate(plcs)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert not failures
    assert numbers(sim, "etherip:")["clients"] == "8"
    assert numbers(sim, "etherip opens:")["opened"] == "8"
    total = int(numbers(sim, "etherip requests:")["total"])
    kept = sim.command("etherip received 5000").splitlines()
    assert total > 1000 and len(kept) == 1000 and kept[-1].startswith(f"{total} ")
    assert len(sim.command("etherip received").splitlines()) == 1
    sim.command("etherip timeout")
    report = sim.command("etherip")
    assert "clients=8" in report and "etherip connection:" not in report and "timed_out=8" in report
    sim.command("etherip clear")
    assert numbers(sim, "etherip requests:")["total"] == "0"


def test_connection_outlives_tcp(new_tags, new_comm):
    """A CIP connection outlives its TCP connection, and ends by its time-out"""
    sim = new_tags()
    plc = new_comm(sim)
    assert plc.read("INT").error is None
    plc._sock.close()
    until_equal(lambda: numbers(sim, "etherip:")["clients"], "0")
    assert numbers(sim, "etherip connection:")["client"] == "0"
    sim.command("etherip timeout")
    assert numbers(sim, "etherip opens:")["timed_out"] == "1"


# ---- faults ------------------------------------------------------------------------------------

def test_faults(new_tags, new_comm):
    """A status for one tag, three times; a client whose connection a fault ends opens another"""
    sim = new_tags()
    plc = new_comm(sim)
    sim.command("etherip status 05 tag INT write next 3")
    assert [plc.write("INT", 1).error is None for _ in range(4)] == [False, False, False, True]
    assert plc.write("INTs[3]", 1).error is None
    sim.command("etherip drop read tag INT next 1")
    with pytest.raises(CommError):
        plc.read("INT")
    assert new_comm(sim).read("INT").value == 1
    sim.command("etherip slow 5000")
    assert "slow=5000" in sim.command("status")
    sim.command("normal")
    assert "etherip faults: none" in sim.command("status")


def test_list_identity(new_tags, new_comm):
    """pycomm3 finds the identity without a session; by UDP nobody answers"""
    sim = new_tags("enet")
    assert CIPDriver.list_identity(f"127.0.0.1:{sim.etherip_port}")["product_name"] == "1756-ENET/A"
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as udp:
        udp.settimeout(LIMIT)
        udp.connect(("127.0.0.1", sim.etherip_port))
        udp.send(bytes.fromhex("63") + bytes(23))
        with pytest.raises(ConnectionRefusedError):
            udp.recv(100)


# ---- beside the other servers ------------------------------------------------------------------

def test_memory(new_sim, new_logix):
    """A tag in PLC memory is what blocks show and Modbus writes"""
    sim = new_sim("byteorder = little\netherip_port = 0\nmodbus_port = 0\nin = 8\ndb 10 8\n"
                  "tx P#DB10.DBX0.0 BYTE 8 -> 0\nmodbus holding 0 4 -> DB10.0\n"
                  "tag Word INT -> DB10.4\n")
    plc = new_logix(sim)
    assert plc.Write("Word", -2).Status == "Success"
    assert sim.command("get DB10.4 INT16").endswith("= -2")
    sim.command("set DB10.4 INT16 99")
    assert plc.Read("Word").Value == 99


# ---- the documents -----------------------------------------------------------------------------

@pytest.fixture
def manual():
    return (TOP / "docs" / "plcsim.md").read_text().split("## EtherNet/IP")[1].split("\n## ")[0]


def test_example(new_sim, new_comm, manual):
    """The example of docs/plcsim.md works, and each of its commands"""
    text = next(part for part in manual.split("```") if "etherip_port = 44818" in part)
    sim = new_sim(text, "-o", "etherip_port=0")
    plc = new_comm(sim)
    assert plc.read("Speed").value == 2.5 and plc.read("Text").value == "ready"
    assert plc.read("Recipe{24}").value == 24 * [7]
    assert plc.write("Word", 0x1234).error is None
    assert sim.command("get DB10.DBW4") == "DB10.DBW4 = 4660"
    for command in ("etherip status 05 tag Speed write next 3", "etherip set Inlet.Position 5",
                    "etherip get Inlet", "etherip download", "etherip key prog", "etherip clear",
                    "etherip received 5", "etherip help", "etherip timeout", "etherip normal"):
        assert command.split()[1] in manual
        sim.command(command)
    assert shown(sim, "Inlet.Position") == "5"


@pytest.mark.parametrize("name", ["port", "profile", "slot", "program", "key", "size",
                                  "connections", "lostid", "extra"])
def test_keys(manual, name):
    """The key etherip_{name} is in the document and in the help"""
    done = subprocess.run([str(PROGRAM), "--help"], capture_output=True, text=True, timeout=LIMIT)
    assert f"etherip_{name} = " in done.stdout
    assert f"`etherip_{name}`" in manual


def test_connect(new_sim, tmp_path):
    """plcSim --connect sends a command, or lines of stdin, and tells of errors by its status"""
    sim = new_sim("in = 8\n")

    def dial(*words, text=""):
        return subprocess.run([str(PROGRAM), "--connect", str(sim.path), *words], input=text,
                              capture_output=True, text=True, timeout=LIMIT)
    done = dial("set", "in.4", "INT16", "-5")
    assert done.returncode == 0 and not done.stdout
    done = dial("get in.4 INT16")
    assert done.returncode == 0 and done.stdout == "in.4 INT16 = -5\n"
    done = dial("nonsense")
    assert done.returncode == 1 and done.stderr.startswith('error: "nonsense" is no command')
    done = dial(text="get in.4 INT16\n\n# nothing\nperiod 20\nstatus\n")
    assert done.returncode == 0 and done.stdout.startswith("in.4 INT16 = -5\n")
    assert "every 20 ms" in done.stdout
    done = subprocess.run([str(PROGRAM), "--connect", str(tmp_path / "none")], input="",
                          capture_output=True, text=True, timeout=LIMIT)
    assert done.returncode == 1 and "no console at" in done.stderr
    assert sim.command("get in.4 INT16") == "in.4 INT16 = -5", "the first console, beside which the others were"


def test_file(tmp_path):
    """What the file says wrong is told with its line, and nothing starts"""
    file = tmp_path / "bad.plc"
    file.write_text("etherip_port = 0\nudt U x:FOO\ntag A INT = 40000\n")
    done = subprocess.run([str(PROGRAM), str(file)], capture_output=True, text=True, timeout=LIMIT)
    assert done.returncode != 0 and not done.stdout
    assert 'bad.plc:2: "FOO" is no type' in done.stderr
    assert "bad.plc:3: 40000 does not fit into INT16" in done.stderr
    assert "etherip_port needs byteorder = little" in done.stderr


def test_many(new_sim, new_logix):
    """10,000 tags: the list comes in parts, and each tag is found"""
    lines = "\n".join(f"tag Tag_{i:05d} REAL = {i}" for i in range(10000))
    sim = new_sim("byteorder = little\netherip_port = 0\n" + lines)
    plc = new_logix(sim)
    names = [tag.TagName for tag in plc.GetTagList().Value if tag.TagName.startswith("Tag_")]
    assert names == [f"Tag_{i:05d}" for i in range(10000)]
    assert plc.Read(["Tag_00000", "Tag_05000", "Tag_09999"])[2].Value == 9999.0
