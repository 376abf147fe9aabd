"""DTYP "EtherIP": what is said of bad links, routes, values and options. One line that names what is wrong and what is
allowed; AMSG has its beginning in whole words, at most 39 characters; and nothing is said that is not so."""
import re
import socket
import struct
import subprocess
import threading

import pytest

from client import ARCH, TOP
from eipplant import Plant, rec
from ioc import errors_in
from waiting import until, until_equal

# kind, link, more fields, AMSG, the line of the log behind it
BAD_LINKS = [
    ("ai", "", (), "no link to a PLC", "allowed: @PLC tag [flags]"),
    ("ai", "@", (), "no link to a PLC", "allowed: @PLC tag [flags]"),
    ("ai", "@P", (), "no tag", "allowed: @PLC tag [flags]"),
    ("ai", "@Q D", (), 'no PLC "Q"', "configured: P"),
    ("longin", "@P A[x]", (), "x is no index", "allowed: [0] to [4294967295]"),
    ("longin", "@P A[", (), "an index is missing", "allowed: [0] to [4294967295]"),
    ("longin", "@P A[1,]", (), "an index is missing", "allowed: [0] to [4294967295]"),
    ("longin", "@P D S", (), "S has no number", "allowed: S, a blank, 0 to 86400"),
    ("longin", "@P D S abc", (), "S abc is no period", "allowed: S, a blank, 0 to 86400"),
    ("longin", "@P D B", (), "B has no number", "allowed: B, a blank, 0 to 63"),
    ("longin", "@P D B x", (), "B x is no bit", "allowed: B, a blank, 0 to 63"),
    ("longin", "@P D PLC_ERRORS", (), "PLC_ERRORS is for ai only", "allowed here: E, S seconds, B bit, FORCE"),
    ("bo", "@P D LIST_TIME", (), "LIST_TIME is for ai only", "allowed here: E, S seconds, B bit, FORCE"),
    ("waveform", "@P A S 1", ("NELM=70000", "FTVL=LONG"), "NELM 70000 is too large", "allowed: 1 to 65535"),
    ("waveform", "@P A E S 1", ("NELM=3", "FTVL=LONG"), "E is not for a waveform", "allowed: a tag without E"),
    ("waveform", "@P A B 3 S 1", ("NELM=3", "FTVL=LONG"), "waveform has no bit 3", "allowed: a tag without .bit and B"),
    ("aai", "@P A.3 S 1", ("NELM=3", "FTVL=LONG"), "aai has no bit 3", "allowed: a tag without .bit and B"),
]


def test_bad_links(plant):
    """bad links: each has its own words in AMSG, and one line with its link and what is allowed"""
    plant.tags("tag D DINT", "tag A DINT[10]")
    records = [rec(kind, f"b{n}", "LINK", *fields).replace("@P LINK", link) for n, (kind, link, fields, _, _) in
               enumerate(BAD_LINKS)]
    plant.records(*records)
    for n, (kind, link, _, words, allowed) in enumerate(BAD_LINKS):
        plant.ioc.process_record(f"b{n}")
        assert plant.ioc.alarm(f"b{n}") == ("INVALID", "LINK", words), link
        lines = plant.ioc.log.splitlines()
        found = [i for i, line in enumerate(lines) if f':b{n}"' in line]
        assert len(found) == 1 and f'{kind} "' in lines[found[0]], found
        assert lines[found[0]].endswith(f": {words}; {allowed}"), lines[found[0]]
        assert lines[found[0] + 1].strip() == (link or "@")


DOUBTS = [("longin", "D S 0.05 S 0.1", "S stands there twice; the last one counts"),
          ("longin", "D E E S 0.05", "E stands there twice; the last one counts"),
          ("bi", "D B 0 B 1 S 0.05", "B stands there twice; the last one counts"),
          ("longout", "D FORCE S 0.05 FORCE", "FORCE stands there twice; the last one counts"),
          ("ai", "D FORCE S 0.05", "FORCE means nothing to an input")]


def test_doubtful_links(plant):
    """what is odd in a link but taken by ether_ip is taken here too, with one line that is no error"""
    plant.tags("tag D DINT = 3")
    plant.records(*(rec(kind, f"d{n}", link) for n, (kind, link, _) in enumerate(DOUBTS)),
                  rec("longin", "good", "D E S 0.05"))
    for n, (kind, link, words) in enumerate(DOUBTS):
        plant.ioc.wait_value(f"d{n}", 1 if kind == "bi" else 3)
        lines = [line for line in plant.ioc.log.splitlines() if f':d{n}"' in line]
        assert lines == [f'EtherIP {kind} "{plant.ioc.P}d{n}" warning: {words}: @P {link}']
    assert "warning" not in "".join(line for line in plant.ioc.log.splitlines() if ':good"' in line)
    assert not errors_in(plant.ioc.log)
    assert "every 0.05 s" in plant.ioc.command("drvEtherIP_dump")


SLOTS = [("micro800", 0, "no backplane: slot -1 (01 0311)"), ("l8x", 5, "no module in that slot (01 0312)"),
         ("enet", 3, "no module in that slot (01 0312)"), ("enet", -1, "no controller, slot needed (01 0315)")]


@pytest.mark.parametrize("profile,slot,words", SLOTS)
def test_wrong_slot(plant, profile, slot, words):
    """{profile} with slot {slot}: it says what is wrong with the slot, and nothing says that it is connected"""
    plant.tags("tag D DINT = 3", profile=profile)
    plant.ioc = plant.new_ioc(f'drvEtherIP_define_PLC("P", "127.0.0.1:{plant.port}", {slot})',
                              rec("longin", "d", "D S 0.05") + rec("longout", "o", "D S 0.05"),
                              templates=[("s7plcStation.db", "P=$(P),PLC=P")])
    plant.ioc.wait_alarm("d", "INVALID", "COMM", words)
    plant.ioc.put("o", 5)
    plant.ioc.wait_alarm("o", "INVALID", "COMM", words)
    until(lambda: plant.total() > 20, "several attempts")
    lines = [line for line in plant.ioc.log.splitlines() if "s7plc P:" in line]
    assert lines == [f"sevr=major s7plc P: cannot connect to EtherNet/IP 127.0.0.1 port {plant.port}: {words}; "
                     "the driver keeps trying"]
    report = plant.ioc.command("s7plcReport P 1")
    assert "connects: 0 made, 0 lost" in report and f"not connected ({words})" in report
    assert plant.ioc.get("TcpConnected") == 0
    assert plant.tag("D") == "3"


def test_other_slot(plant):
    """the right slot by a second command: connected is said then, once"""
    plant.tags("tag D DINT = 3")
    plant.records(rec("longin", "d", "D S 0.05"), slot=5)
    plant.ioc.wait_alarm("d", "INVALID", "COMM", "no module in that slot (01 0312)")
    assert "connected to" not in plant.ioc.log
    plant.ioc.command(f'drvEtherIP_define_PLC("P", "127.0.0.1:{plant.port}", 0)')
    plant.ioc.wait_value("d", 3)
    assert plant.ioc.log_count(f"EtherNet/IP connected to 127.0.0.1 port {plant.port}") == 1
    assert "connected, connected" not in plant.ioc.command("s7plcReport P 1")


def test_reset_by_plc(new_ioc, closing):
    """a PLC that resets each connection is named in the words of docs/alarms.md, and never as connected"""
    server = socket.create_server(("127.0.0.1", 0))
    closing(server)

    def reset():
        while True:
            try:
                peer, _ = server.accept()
            except OSError:
                return
            peer.recv(4)
            peer.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
            peer.close()

    threading.Thread(target=reset, daemon=True).start()
    plant = Plant(None, new_ioc)
    plant.port = server.getsockname()[1]
    plant.records(rec("longin", "d", "D S 0.05"))
    plant.ioc.wait_alarm("d", "INVALID", "COMM", "connection reset by PLC")
    server.shutdown(socket.SHUT_RDWR)
    assert not re.search("connected to .*port|reset by peer", plant.ioc.log)


def test_reset_later(plant):
    """a reset of a connection that was good: the same words"""
    plant.tags("tag D DINT = 3")
    plant.records(rec("longin", "d", "D S 0.05"))
    plant.ioc.wait_value("d", 3)
    plant.sim.command("etherip refuse on")
    plant.sim.command("etherip reset")
    plant.ioc.wait_log("disconnected: connection reset by PLC")
    plant.sim.command("etherip refuse off")
    plant.ioc.wait_alarm("d", "NO_ALARM")
    assert "reset by peer" not in plant.ioc.log


def test_names_of_elements(plant):
    """an element is named in the log as in its link, also where the tag has fewer dimensions"""
    plant.tags("tag A DINT[10]", "tag T DINT[3,4]", "tag Str STRING = abc", "tag C SINT[82]")
    plant.records(rec("longin", "one", "A[1,2] S 0.05"), rec("longin", "end", "A[9] S 0.05"),
                  rec("waveform", "text", "C S 0.05", "FTVL=CHAR", "NELM=82"))
    plant.ioc.wait_alarm("one", "INVALID", "READ", "PLC: no such tag or dimension (05)", ask=True)
    plant.ioc.wait_log("tag A[1,2]: PLC: no such tag or dimension (05)")
    plant.ioc.put("end.INP", "@P A[99] S 0.05")  # one after the other: each has a line of its own
    plant.ioc.wait_alarm("end", "INVALID", "READ", "PLC: no such element (05)", ask=True)
    plant.ioc.wait_log(f"record {plant.ioc.P}end, tag A[99]: PLC: no such element (05)")
    plant.ioc.put("text.INP", "@P Str S 0.05")
    plant.ioc.wait_alarm("text", "INVALID", "READ", "the tag is no array of numbers", ask=True)
    plant.ioc.put("one.INP", "@P T[1,9] S 0.05")
    plant.ioc.wait_log("tag T[1,9]: PLC: no such element (05)")
    plant.ioc.wait_log("tag Str: the tag is no array of numbers")


def test_whole_numbers(plant):
    """a REAL that a record has not is named whole where it is whole, and never rounded to its limit"""
    plant.tags("tag R REAL = 1", "tag L LREAL = 1")
    plant.records(rec("longin", "r", "R S 0.05"), rec("longin", "l", "L S 0.05"), rec("int64in", "q", "L S 0.05"),
                  rec("waveform", "c", "R S 0.05", "FTVL=CHAR", "NELM=1"))
    plant.ioc.wait_value("r", 1)
    plant.set("R", 2147483648)
    plant.ioc.wait_alarm("r", "INVALID", "READ", "2147483648 is above 2147483647")
    plant.ioc.wait_alarm("c", "INVALID", "READ", "2147483648 is above 255")
    plant.set("R", 200)
    plant.ioc.wait_value("c", 200)
    plant.set("L", -2147483649)
    plant.ioc.wait_alarm("l", "INVALID", "READ", "-2147483649 is below -2147483648")
    plant.set("L", 9223372036854775808)
    plant.ioc.wait_alarm("q", "INVALID", "READ", "9223372036854775808 is above 2^63-1")


def test_not_a_number(plant):
    """a REAL that is NaN is an alarm for bi, bo, mbbi, longin and longout; their values stay"""
    kinds = ("bi", "bo", "longin", "longout", "mbbi")
    plant.tags("tag R REAL = 1")
    plant.records(*(rec(kind, kind, "R S 0.05") for kind in kinds))
    for kind in kinds:
        plant.ioc.wait_value(kind, 1)
    plant.set("R", "nan")
    for kind in kinds:
        plant.ioc.wait_alarm(kind, "INVALID", "READ", "NaN is no whole number")
        assert plant.ioc.get(kind) == 1 or kind == "longout"
    plant.set("R", 0)
    for kind in kinds:
        plant.ioc.wait_value(kind, 0)
        plant.ioc.wait_alarm(kind, "NO_ALARM")
    plant.ioc.put("bo", 1)
    plant.wait_tag("R", "1")


def test_length_of_text(plant):
    """a STRING whose LEN is beyond its 82 characters, a STRING_n beyond its n: an alarm, no text of other bytes"""
    plant.tags("udt Name string 10", "tag S STRING = abc", "tag N Name = abc")
    plant.records(*(rec(kind, f"{tag}{kind}", f"{tag} S 0.05", "SIZV=100") for tag in "SN" for kind in ("lsi", "lso")))
    names = [tag + kind for tag in "SN" for kind in ("lsi", "lso")]
    for name in names:
        plant.ioc.wait_alarm(name, "NO_ALARM")
    for tag, length in (("S", 83), ("S", 84), ("N", 11), ("N", 12)):
        plant.set(f"{tag}.LEN", length)
        for kind in ("lsi", "lso"):
            plant.ioc.wait_alarm(tag + kind, "INVALID", "READ", "its length is more than the string has")
        plant.set(f"{tag}.LEN", 2)
        for kind in ("lsi", "lso"):
            plant.ioc.wait_alarm(tag + kind, "NO_ALARM")
            until_equal(lambda: plant.ioc.get(tag + kind, as_string=True), "ab")


def test_show_has_types(plant):
    """s7plcShow has the tag of each record, its type, and a REAL as the number that it is"""
    plant.tags("tag R REAL = 1.5", "tag D DINT[4] = -3", "tag U ULINT = 18446744073709551615")
    plant.records(rec("ai", "r", "R S 0.05"), rec("longin", "d", "D[2] S 0.05"), rec("ai", "u", "U S 0.05"),
                  rec("bi", "b", "D[2] S 0.05 B 1"), rec("waveform", "w", "D S 0.05", "FTVL=LONG", "NELM=4"))
    plant.ioc.wait_value("r", 1.5)
    plant.ioc.wait_value("d", -3)
    shown = plant.ioc.command("s7plcShow P records")
    for text in ("r (ai R REAL) = 1.5", "d (longin D[2] DINT) = -3", "u (ai U ULINT) = 18446744073709551615",
                 "b (bi D[2] DINT bit 1) = 0", "w (waveform D DINT)"):
        assert plant.ioc.P + text in shown, shown


def test_minus_one(plant):
    """-1 is all ones of what a record of whole numbers writes to a tag of bits, 1 to a BOOL; other unsigned types refuse it"""
    kinds = ("BOOL", "BYTE", "WORD", "DWORD", "LWORD", "USINT", "UINT", "UDINT", "ULINT")
    plant.tags(*(f"tag {kind} {kind}" for kind in kinds))
    plant.records(*(rec("longout", f"l{kind}", f"{kind} S 0.05") + rec("int64out", f"q{kind}", f"{kind} S 0.05") +
                    rec("ao", f"a{kind}", f"{kind} S 0.05") for kind in kinds))
    written = {"lBOOL": 1, "qBOOL": 1, "aBOOL": 1, "lDWORD": 2**32 - 1, "lLWORD": 2**32 - 1, "qLWORD": 2**64 - 1}
    for kind in kinds:
        for letter in "lqa":
            name = letter + kind
            plant.set(kind, 0)
            plant.ioc.wait_value(name, 0)
            plant.ioc.put(name, -1)
            if name in written:
                plant.wait_tag(kind, str(written[name]))
                plant.ioc.wait_alarm(name, "NO_ALARM")
            else:
                assert plant.ioc.alarm(name) == ("INVALID", "WRITE", f"the value does not fit {kind}"), name
                assert plant.tag(kind) == "0"


def test_beyond_nobt(plant):
    """an mbbo whose state has more bits than NOBT is refused, and writes nothing"""
    plant.tags("tag D DINT = 16")
    plant.records(rec("mbbo", "m", "D S 0.05", "NOBT=2", "ZRVL=0", "ONVL=3", "TWVL=4"))
    plant.ioc.wait_value("m", 0)
    plant.ioc.put("m", 2)
    plant.ioc.wait_alarm("m", "INVALID", "WRITE", "the value does not fit its bits")
    assert plant.tag("D") == "16"
    plant.ioc.put("m", 1)
    plant.wait_tag("D", "19")
    plant.ioc.wait_alarm("m", "NO_ALARM")


def test_bools_of_structures(plant):
    """a BOOL of a structure: bo writes it; more bits than it has, and the structure as a whole, are refused"""
    plant.tags("udt Motor Speed:DINT On:BOOL Fault:BOOL", "tag M Motor", "tag D DINT = 1")
    plant.records(rec("bo", "on", "M.On S 0.05"), rec("bi", "oni", "M.On S 0.05"), rec("bo", "fault", "M.Fault S 0.05"),
                  rec("bo", "bit", "M.On S 0.05 B 1"), rec("bi", "biti", "M.On S 0.05 B 1"),
                  rec("mbbo", "two", "M.On S 0.05", "NOBT=2"), rec("bo", "whole", "M S 0.05"),
                  rec("bi", "wholei", "M S 0.05"), rec("longin", "d", "D S 0.05"))
    plant.ioc.wait_value("d", 1)
    plant.ioc.wait_alarm("on", "NO_ALARM")
    for name in ("bit", "biti"):
        plant.ioc.wait_alarm(name, "INVALID", "READ", "BOOL has bit 0 only")
    for name in ("whole", "wholei"):
        plant.ioc.wait_alarm(name, "INVALID", "READ", "the tag is a structure, no number")
    plant.ioc.put("on", 1)
    plant.wait_tag("M.On", "1")
    plant.ioc.wait_value("oni", 1)
    plant.ioc.put("fault", 1)
    plant.wait_tag("M.Fault", "1")
    writes = plant.sim.command("etherip received 1000").count("4d:")
    plant.ioc.put("bit", 1)
    plant.ioc.wait_alarm("bit", "INVALID", "WRITE", "BOOL has bit 0 only")
    plant.ioc.put("two", 3)
    plant.ioc.wait_alarm("two", "INVALID", "WRITE", "the value does not fit BOOL")
    plant.ioc.put("whole", 1)
    plant.ioc.wait_alarm("whole", "INVALID", "WRITE", "the tag is no number")
    assert (plant.tag("M.On"), plant.tag("M.Fault")) == ("1", "1")
    assert plant.sim.command("etherip received 1000").count("4d:") == writes


@pytest.mark.parametrize("name,link", [("o", "@P New S 0.05"), ("b", "@P New.3 S 0.05")])
@pytest.mark.parametrize("sent", [False, True])
def test_link_change_ends_put(plant, name, link, sent):
    """a link changes while a put waits (on its way: {sent}): the put ends with an alarm and a line, FLNK runs, nothing of it leaves later"""
    plant.tags("tag Old DINT = 3", "tag New DINT = 3", "tag Other DINT")
    chain = 'record(calc, "$(P)n") { field(CALC, "VAL+1") }\n'
    plant.records(rec("longout", "o", "Old S 0.05", "FLNK=$(P)n"), rec("bo", "b", "Old.4 S 0.05", "FLNK=$(P)n"),
                  rec("longin", "other", "Other S 0.05"), chain, before="EIP_timeout 60000")
    plant.ioc.wait_value("o", 3)
    plant.ioc.connect([name, name + ".PACT", name + ".UDF", "n"])
    plant.sim.command("etherip slow 60000 " + ("write" if sent else "next 1"))
    if not sent:
        until(lambda: "slow" not in plant.sim.command("etherip"), "a read on its way")
    before = plant.ioc.get("n")
    done = plant.ioc.put_callback(name, 1)
    until_equal(lambda: plant.ioc.get(name + ".PACT"), 1)
    if sent:
        until(lambda: re.search("4[de]:Old", plant.sim.command("etherip received 1000")), "the put on its way")
    plant.ioc.put(name + ".OUT", link, wait=False)
    until(done.is_set, "the end of the put")
    plant.ioc.wait_alarm(name, "INVALID", "WRITE", "link changed: value " + ("maybe written" if sent else "not written"))
    assert (plant.ioc.get(name + ".PACT"), plant.ioc.get("n")) == (0, before + 1)
    plant.ioc.wait_log("the link has changed while its put waited for the PLC: the old place " +
                       ("may have been written" if sent else "was not written"))
    plant.sim.command("etherip normal")
    plant.sim.command("etherip close")
    plant.set("Old", 3)
    plant.ioc.wait_alarm(name, "NO_ALARM", ask=True)
    plant.ioc.put(name, 1)
    plant.wait_tag("New", "1" if name == "o" else "11")
    assert plant.tag("Old") == "3"


ROUTES = ["999.1.1.1", "1,999.1.1.1", "2,10.0.0,1,0", "1,256", "1,0,", "1", "1,,0", "x,0"]


@pytest.mark.parametrize("route", ROUTES)
def test_bad_routes(new_ioc, route):
    """a route that leads nowhere, {route}, is refused in one line that says what is allowed"""
    ioc = new_ioc("", "", program="eipIoc")
    said = ioc.command(f'etheripConfigure p, 127.0.0.1, "{route}"')
    lines = [line for line in said.splitlines() if "etheripConfigure" in line and "epics>" not in line]
    if route == "1":  # a slot
        assert not lines
    else:
        assert len(lines) == 1 and f'"{route}"; allowed: 0 to 255, -1' in lines[0], said


EIP_IOC = [(["-p", "q"], 1, 'eipIoc: -p "q"; allowed: -p plc=ip[:port][,slot]'),
           (["-p", "=1.2.3.4"], 1, 'eipIoc: -p "=1.2.3.4"; allowed'),
           (["-p", "P=1.2.3.4,999"], 1, 'slot "999"; allowed: 0 to 255, -1'),
           (["-p", "P=1.2.3.4,x"], 1, 'slot "x"; allowed: 0 to 255, -1'),
           (["-p", "P="], 1, 'IPaddr ""; allowed: '),
           (["-v"], 2, 'eipIoc: nothing stands behind "-v"'),
           (["-v", "x"], 1, 'EIP_verbosity "x"; allowed: 0 to 10'),
           (["-v", "3", "st.cmd", "x"], 1, 'eipIoc: "st.cmd" is no option'),
           (["-x", "y"], 1, 'eipIoc: "-x" is no option'),
           (["-p", "P=1.2.3.4", "-d", "/no/such.db"], 1, "/no/such.db")]


@pytest.mark.parametrize("options,status,words", EIP_IOC)
def test_options_of_program(options, status, words):
    """eipIoc with options that are not possible ends with a status, and a line that says why: {words}"""
    program = f"bin/{ARCH}/eipIoc"
    run = subprocess.run([program, *options], cwd=TOP, stdin=subprocess.DEVNULL, capture_output=True, text=True,
                         timeout=60)
    assert run.returncode == status and words in run.stdout + run.stderr, run


def test_relative_program():
    """eipIoc runs by a relative path, too"""
    run = subprocess.run([f"bin/{ARCH}/eipIoc", "-p", "P=127.0.0.1:1,-1"], cwd=TOP, input="drvEtherIP_report 0\nexit\n",
                         capture_output=True, text=True, timeout=60)
    assert run.returncode == 0 and "  P 127.0.0.1:1: " in run.stdout, run


def test_options_of_ether_ip(tmp_path):
    """eipIoc takes the options of ether_ip's program in place of st.cmd: -v, -p, -m, -d"""
    (tmp_path / "a.db").write_text('record(ai, "$(X)$(Y)") {}\n')
    run = subprocess.run([f"bin/{ARCH}/eipIoc", "-v", "4", "-p", "P=127.0.0.1:1,3", "-m", "X=one,Y=two", "-d", tmp_path / "a.db"],
                         cwd=TOP, input="dbl\ndrvEtherIP_report 0\nexit\n", capture_output=True, text=True,
                         timeout=60)
    assert run.returncode == 0 and "\nonetwo\n" in run.stdout and "  P 127.0.0.1:1: " in run.stdout, run


@pytest.mark.parametrize("option", ["alive 4", "timestamp 4,DT", "readback 4", "layoutAt 0"])
def test_options_with_offsets(plant, option):
    """{option}: options that name a place of a block are refused, since a PLC with tags has none"""
    plant.tags("tag A DINT = 5")
    plant.records(rec("longin", "a", "A S 0.05"), configure=f"s7plcSetOption P {option}")
    plant.ioc.wait_log(f"option {option.split()[0]}: a PLC by EtherNet/IP has tags, no offsets")
    plant.ioc.wait_alarm("a", "NO_ALARM")
