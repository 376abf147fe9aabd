"""The templates of s7plcApp/Db: each loads with few macros and does what it says."""
import datetime
import re
import struct

import pytest

from client import TOP
from waiting import until

# template: (macros, byte offset it reads or writes, bytes, the record's value)
INPUTS = {
    "s7plcAnalogIn": ("OFFS=4,ASLO=2,AOFF=1", struct.pack(">f", 1.5), 4.0),
    "s7plcBitIn": ("OFFS=4,BIT=3", b"\x08\0\0\0", 1),
    "s7plcIntIn": ("OFFS=4", struct.pack(">h", -5), -5),
    "s7plcStringIn": ("OFFS=4,LEN=8", b"hello\0\0\0", "hello"),
}
OUTPUTS = {
    "s7plcAnalogOut": ("OFFS=4", 2.5, struct.pack(">f", 2.5)),
    "s7plcAnalogOutReadback": ("OFFS=4,RBOFFS=4", 2.5, struct.pack(">f", 2.5)),
    "s7plcBitOut": ("OFFS=4,BIT=3", 1, b"\x08"),
    "s7plcBitOutReadback": ("OFFS=4,BIT=3,RBOFFS=4", 1, b"\x08"),
    "s7plcIntOut": ("OFFS=4", -5, struct.pack(">h", -5)),
    "s7plcIntOutReadback": ("OFFS=4,RBOFFS=4", -5, struct.pack(">h", -5)),
    "s7plcStringOut": ("OFFS=4,LEN=8", "hello", b"hello\0\0\0"),
}


@pytest.fixture
def load(new_peer, new_ioc):
    """load(template, macros) -> PLC and IOC with one record N, which is quiet at start."""
    def make(name, macros):
        peer = new_peer(64, 64)
        ioc = new_ioc(peer.configure(recv_timeout=20000), "", templates=[(name, macros)])
        peer.wait_connected()
        for word in ("error", "warning", "macro", "sevr=m"):
            assert word not in ioc.log.lower(), ioc.log
        return peer, ioc
    return make


@pytest.mark.parametrize("name", INPUTS)
def test_input(load, name):
    """{name}.template shows what the PLC sends"""
    macros, data, value = INPUTS[name]
    peer, ioc = load(f"{name}.template", f"NAME=$(P)N,PLC=PLC,{macros}")
    peer.send((bytes(4) + data).ljust(64, b"\0"))
    ioc.wait_value("N", value)
    assert ioc.severity("N") == "NO_ALARM"


def test_dead_bands(load):
    """s7plcAnalogIn.template has the dead bands of its macros MDEL and ADEL"""
    _, ioc = load("s7plcAnalogIn.template", "NAME=$(P)N,PLC=PLC,OFFS=4,MDEL=0.5,ADEL=2.5")
    assert (ioc.get("N.MDEL"), ioc.get("N.ADEL")) == (0.5, 2.5)


@pytest.mark.parametrize("name", OUTPUTS)
def test_output(load, name):
    """{name}.template sends what is put"""
    macros, value, data = OUTPUTS[name]
    peer, ioc = load(f"{name}.template", f"NAME=$(P)N,PLC=PLC,{macros}")
    if "Readback" in name:  # R= in the link: the PLC's value comes first
        peer.send(bytes(64))
        ioc.wait_alarm("N:RBV", "NO_ALARM")
    ioc.put("N", value)
    block = peer.wait_block((bytes(4) + data).ljust(64, b"\0"))
    if "Readback" in name:
        peer.send(block)
        ioc.wait_value("N:RBV", value)


@pytest.mark.parametrize("name", [name for name in OUTPUTS if "Readback" in name])
def test_names(load, name):
    """{name}.template with S=-S and RB=-RB: a setpoint N-S and what is read back of it, N-RB"""
    macros, value, data = OUTPUTS[name]
    peer, ioc = load(f"{name}.template", f"NAME=$(P)N,S=-S,RB=-RB,PLC=PLC,{macros}")
    peer.send(bytes(64))
    ioc.wait_alarm("N-RB", "NO_ALARM")
    ioc.put("N-S", value)
    peer.send(peer.wait_block((bytes(4) + data).ljust(64, b"\0")))
    ioc.wait_value("N-RB", value)


def test_status(load):
    """s7plcStatus.template counts the losses of the connection"""
    peer, ioc = load("s7plcStatus.template", "P=$(P),PLC=PLC")
    ioc.wait_value("Connected", 1)
    before = ioc.get("Losses")
    peer.hang_up()
    ioc.wait_value("Losses", before + 1)
    ioc.wait_value("Connected", 1)
    assert ioc.get("AddressSet") == f"127.0.0.1:{peer.port}"


def test_station(load):
    """s7plcStation.db shows state, counters and the last error of a station"""
    peer, ioc = load("s7plcStation.db", "P=$(P),PLC=PLC")
    peer.send(bytes(64))
    until(lambda: ioc.text("State") == "ok", lambda: ioc.text("State"))
    peer.power_off()
    until(lambda: ioc.text("State") == "connecting", lambda: ioc.text("State"))
    assert ioc.severity("State") == "MAJOR"


def test_time(load):
    """s7plcTime.template sends the time as six BCD bytes, once a second"""
    peer, ioc = load("s7plcTime.template", "DEVICE=$(P)T,PLC=PLC,OFFS=4")
    blocks = peer.wait_blocks(3)

    def numbers(block):
        return [int(f"{b:x}") for b in block[4:10]]
    year, *rest = numbers(blocks[-1])
    assert abs(datetime.datetime(2000 + year, *rest) - datetime.datetime.now()) < datetime.timedelta(hours=1)
    assert numbers(blocks[-1]) > numbers(blocks[-2])


@pytest.mark.parametrize("name", sorted(file.name for file in (TOP / "s7plcApp/Db").glob("*.template")))
def test_macros_are_explained(name):
    """{name} explains each of its macros at its head, or names the template that does"""
    head, text = "", (TOP / "db" / name).read_text()
    for line in text.splitlines():
        if not line.startswith("#"):
            break
        head += line + "\n"
    for other in re.findall(r"as in (\w+\.template)", head):
        head += (TOP / "db" / other).read_text().split("\nrecord")[0]
    used = set(re.findall(r"\$\((\w+)", re.sub(r"^#.*$", "", text, flags=re.M)))
    assert used and not [macro for macro in used if not re.search(rf"^#.*\b{macro}\b", head, re.M)]
