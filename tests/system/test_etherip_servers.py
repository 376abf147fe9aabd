"""DTYP "EtherIP" and plcTag against servers that others have written: cm-ethernetip, cpppo."""
import re
import subprocess

import pytest

from eipservers import CmServer, CpppoServer
from ioc import errors_in
from test_etherip import PLC_TAG, rec
from waiting import until

COMMON = ["SINT", "INT", "DINT", "REAL"]
KINDS = {"cm": [*COMMON, "LINT", "LREAL"],
         "cpppo": [*COMMON, "LINT", "LREAL", "USINT", "UINT", "UDINT", "ULINT"]}
VALUES = {"SINT": -7, "INT": -700, "DINT": -70000, "LINT": -7000000000, "USINT": 200,
          "UINT": 50000, "UDINT": 4000000000, "ULINT": 5000000000, "REAL": 0.25, "LREAL": 1 / 3}


@pytest.fixture(params=["cm", "cpppo"])
def server(request, closing):
    """One of them, with a tag and an array of 40 of each type, and a long one."""
    tags = [f"{kind}=" + kind for kind in KINDS[request.param]]
    tags += [f"{kind}s={kind}[40]" for kind in KINDS[request.param]]
    server_size = 3000 if request.param == "cm" else 600  # cpppo takes its time
    tags += [f"Big=DINT[{server_size}]"] + (["Bools=DWORD[11]"] if request.param == "cm" else
                                  ["Text=SSTRING"])
    server = (CmServer if request.param == "cm" else CpppoServer)(*tags)
    server.name, server.size = request.param, server_size
    closing(server)
    return server


def tag(server, *words, options=()):
    return subprocess.run([PLC_TAG, *options, f"127.0.0.1:{server.port}", *words],
                          capture_output=True, text=True, timeout=60, check=True).stdout.strip()


def blocks(ioc):
    return int(re.search(r"in: +(\d+) blocks", ioc.command("drvEtherIP_report 1")).group(1))


def test_every_type(server, new_ioc):
    """Every type of {id} is read and written, a long array in fragments, a missing tag beside"""
    kinds = KINDS[server.name]
    db = "".join(rec("ai", f"a{k}", f"{k} S 0.05") + rec("ao", f"o{k}", f"{k} S 0.05") +
                 rec("ai", f"e{k}", f"{k}s[39] S 0.05") + rec("ao", f"p{k}", f"{k}s[39] S 0.05") +
                 rec("waveform", f"w{k}", f"{k}s S 0.1", "FTVL=DOUBLE", "NELM=40") for k in kinds)
    db += rec("waveform", "big", "Big S 0.5", "FTVL=LONG", f"NELM={server.size}")
    db += rec("longout", "last", f"Big[{server.size - 1}] S 0.5") + rec("ai", "nix", "Nix S 0.05")
    if server.name == "cm":
        db += rec("bi", "b", "Bools[351] S 0.1") + rec("bi", "b0", "Bools[1] S 0.1")
    else:
        db += rec("stringin", "si", "Text S 0.1") + rec("stringout", "so", "Text S 0.1")
    ioc = new_ioc(f'etheripConfigure("P", "127.0.0.1:{server.port}", 0, "instances=always")', db,
                  program="eipIoc")
    if server.name == "cpppo":  # ends the session when it is asked for a list of its tags
        ioc.wait_log("encapsulation error")
        until(lambda: "2 made" in ioc.command("drvEtherIP_report 1"), "another connection")
        before = blocks(ioc)
        until(lambda: blocks(ioc) > before + 3, "values on the new connection")
    for k in kinds:
        ioc.wait_value(f"a{k}", 0.0)
        until(lambda: {ioc.severity(f"{o}{k}") for o in "op"} == {"NO_ALARM"})
        ioc.put(f"o{k}", VALUES[k])
        ioc.put(f"p{k}", VALUES[k])
    for k in kinds:
        ioc.wait_value(f"a{k}", VALUES[k])
        ioc.wait_value(f"e{k}", VALUES[k])
        until(lambda: ioc.plain(f"w{k}") == [0.0] * 39 + [VALUES[k]], k)
        assert float(tag(server, "read", k).split("=")[1]) == VALUES[k]
        assert ioc.severity(f"o{k}") == "NO_ALARM"
    ioc.put("last", 12345)
    until(lambda: ioc.plain("big") == [0] * (server.size - 1) + [12345])
    ioc.wait_alarm("nix", "INVALID", "READ", "no such tag")
    if server.name == "cm":
        tag(server, "write", "Bools", "2")
        ioc.wait_value("b0", 1)
        assert "instance" in ioc.command("drvEtherIP_dump")
    else:
        ioc.put("so", "hello")
        ioc.wait_value("si", "hello")
    assert [line for line in errors_in(ioc.log) if "Nix" not in line] == [] or \
        server.name == "cpppo"
    assert tag(server, "read", "Big", options=("-n", str(server.size))).endswith(" 12345")
    assert tag(server, "read", "Big", options=("-u", "-n", str(server.size))).endswith(" 12345")
