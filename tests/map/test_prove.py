"""plcmap prove: plcSim and the IOC, both from what a map makes, agree in every value; and it sees
when they do not. Larger maps by hand: PLCMAP_PROVE=5000."""
import argparse
import os
import re

import pytest

import controller
import maps
import tank as example
from conftest import TOP, plcmap

BIN = next((p.parent for p in TOP.glob("bin/*/s7plcIoc")), None)
pytestmark = pytest.mark.skipif(BIN is None, reason="the tree is not built")
LARGE = int(os.environ.get("PLCMAP_PROVE", "0"))


def proved(folder):
    """(values, comparisons, differences) of a run."""
    result = plcmap("prove", folder, "--bin", BIN)
    m = re.search(r"(\d+) values in \d+ rounds: (\d+) comparisons, (\d+) differ", result.out)
    assert m, result.out + result.err
    assert (result.status == 0) == (m.group(3) == "0")
    return [int(g) for g in m.groups()] + [result.out]


def test_example(tank):
    """The worked example"""
    values, comparisons, differ, out = proved(tank)
    assert (values, differ) == (27, 0) and comparisons > 1000, out


PLANTS = {
    "setpoints one by one": (80, 31, {}),
    "all setpoints mirrored": (70, 38, {"readback": "0"}),
    "all setpoints mirrored, little-endian": (80, 32, {"readback": "0", "byteorder": "little"}),
    "no handshake": (60, 33, {"sync": "off", "layout_at": "0"}),
    "blocks in, Modbus out": (60, 34, {"wire": "block-modbus", "sync": "off"}),
    "Modbus": (60, 35, {"wire": "modbus", "sync": "off"}),
    "redundant pair": (60, 36, {"address": "192.168.0.10", "second": "192.168.0.11"}),
    "redundant pair, no handshake": (60, 37, {"second": "192.168.0.11", "sync": "off",
                                             "layout_at": "0"}),
}


def made(folder, count, seed, plc):
    rows = maps.rows(count, seed)
    if "readback" in plc:
        rows = [r for r in rows if r["dir"] != "cmd"]
    maps.write(folder, rows, plc)
    assert plcmap("place", folder).status == 0
    return folder


@pytest.mark.parametrize("name", PLANTS)
def test_plants(tmp_path, name):
    """{name}"""
    values, comparisons, differ, out = proved(made(tmp_path / "p", *PLANTS[name]))
    assert values > 60 and comparisons > 20 * values and differ == 0, out


def test_tags(tmp_path):
    """EtherNet/IP: tags of every type, members, elements, bits"""
    values, comparisons, differ, out = proved(controller.write(tmp_path / "ctrl"))
    assert values == 85 and comparisons > 40 * values and differ == 0, out


def test_both_plcs(tmp_path):
    """redundant pair: the values of the second PLC are compared, too"""
    folder = made(tmp_path / "p", *PLANTS["redundant pair"])
    assert plcmap("prove", folder, "--bin", BIN, "--keep", tmp_path / "k").status == 0
    assert "SECOND: SYNC: the IOC holds the PLC's values" in (tmp_path / "k/plcSim.log").read_text()


def test_shared_memory(tmp_path):
    """A word and its bits, each with a record, are proved one after the other"""
    rows = [{"symbol": "Status", "plc": "DB10.DBW0", "type": "WORD", "pv": "Status"}]
    rows += [{"symbol": "S%d" % i, "plc": "DB10.DBX0.%d" % i, "type": "BOOL", "pv": "S%d" % i}
             for i in range(8)]
    folder = maps.write(tmp_path / "p", rows, {"sync": "off"})
    assert plcmap("place", folder).status == 0
    values, _, differ, out = proved(folder)
    assert (values, differ) == (9, 0), out


def test_long_arrays(tmp_path, monkeypatch):
    """Arrays longer than the IOC's shell shows are compared to their end; --keep takes any path"""
    rows = [{"symbol": "A", "plc": "DB10.DBB0", "type": "ARRAY[1..321] OF REAL", "pv": "A"},
            {"symbol": "B", "plc": "DB11.DBB0", "type": "ARRAY[0..150] OF INT", "pv": "B", "dir": "out"}]
    folder = maps.write(tmp_path / "p", rows, {"sync": "off"})
    assert plcmap("place", folder).status == 0
    monkeypatch.chdir(tmp_path)
    result = plcmap("prove", folder, "--bin", BIN, "--keep", "kept")
    assert result.status == 0 and ", 0 differ" in result.out, result.out
    assert (tmp_path / "kept" / "ioc.log").exists()


@pytest.mark.parametrize("family", ["none", "codesys"])
def test_symbols(tmp_path, family):
    """A PLC with symbols instead of addresses: {family}"""
    rows = [{"symbol": "A%d" % i, "plc": "Tank.A%d" % i, "type": kind, "pv": "A%d" % i,
             "dir": "out" if i % 2 else "in"}
            for i, kind in enumerate(["INT", "BOOL", "REAL", "DWORD", "BYTE", "STRING[12]", "LREAL",
                                      "ARRAY[1..3] OF INT"])]
    folder = maps.write(tmp_path / "p", rows, {"family": family})
    assert plcmap("place", folder).status == 0
    values, _, differ, out = proved(folder)
    assert (values, differ) == (8, 0), out


@pytest.mark.parametrize("name", ["tank", "setpoints one by one", "all setpoints mirrored",
                                  "no handshake"])
def test_generated_program(tmp_path, capsys, name):
    """{name}: the generated SCL plays the PLC"""
    from plcmaplib.check import check
    from plcmaplib.files import load
    from plcmaplib.problems import Report
    from plcmaplib.prove import prove
    from sclsim import SclSimulator
    folder = example.write(tmp_path / "p") if name == "tank" else made(tmp_path / "p", *PLANTS[name])
    map_ = load(str(folder), Report())
    assert not check(map_).errors()
    args = argparse.Namespace(bin=str(BIN), keep=None, patience=10.0, verbose=False)
    good = prove(map_, args, SclSimulator)
    out = capsys.readouterr().out
    assert good and int(re.search(r"(\d+) comparisons", out).group(1)) > 1000, out


def test_it_sees(tank, monkeypatch):
    """A record that looks at the wrong byte is found, with its name"""
    from plcmaplib.outputs import records
    link = records.link

    def wrong(map_, leaf, side, base=None):
        text = link(map_, leaf, side, base)
        return text.replace("/58 ", "/60 ") if leaf.symbol == "Tank.Level" else text
    monkeypatch.setattr(records, "link", wrong)
    result = plcmap("prove", tank, "--bin", BIN, "--patience", "0.3")
    assert result.status == 1 and "tank:Level: expected" in result.out


@pytest.mark.skipif(not LARGE, reason="PLCMAP_PROVE=5000")
def test_large(tmp_path):
    """As many rows as PLCMAP_PROVE says"""
    _, comparisons, differ, out = proved(made(tmp_path / "p", LARGE, 6, {}))
    assert comparisons > 50 * LARGE and differ == 0, out


def test_no_programs(tank, tmp_path):
    """Programs that are not there are told"""
    result = plcmap("prove", tank, "--bin", tmp_path)
    assert result.status == 1 and "no plcSim; --bin names the folder" in result.err
    assert example.MAP
