"""The same records over PV Access: get, put, monitor."""
import os
import struct
import threading

import pytest
from p4p.client.thread import Context

import client
from ioc import SINCE_7_0_6
from waiting import until

pytestmark = pytest.mark.skipif("registerStartPVAServer" not in (client.TOP / "dbd/s7plcIoc.dbd").read_text(),
                                reason="EPICS Base is built without PVA")

DB = """
record(int64in, "$(P)in")   { field(DTYP, "S7plc") field(INP, "@PLC/0 T=INT64") field(SCAN, "I/O Intr") }
record(int64out, "$(P)out") { field(DTYP, "S7plc") field(OUT, "@PLC/0 T=UINT64") }
record(waveform, "$(P)wf")  { field(DTYP, "S7plc") field(INP, "@PLC/8") field(FTVL, "SHORT") field(NELM, "4") field(SCAN, "I/O Intr") }
"""


@pytest.fixture
def pva():
    with Context("pva", conf={"EPICS_PVA_ADDR_LIST": "127.0.0.1",
                              "EPICS_PVA_AUTO_ADDR_LIST": "NO",
                              "EPICS_PVA_BROADCAST_PORT": str(client.PVA_UDP),
                              "EPICS_PVA_SERVER_PORT": str(client.PVA_PORT)},
                 useenv=False) as context:
        yield context


def test_pva(pva, new_peer, new_ioc):
    """pvget, pvput and pvmonitor see 64-bit values, arrays, alarms and their message"""
    peer = new_peer(16, 8)
    ioc = new_ioc(peer.configure(recv_timeout=20000), DB)
    peer.wait_connected()
    peer.send(struct.pack(">q4h", -2 ** 62 - 1, 1, -2, 3, -4))
    until(lambda: pva.get(ioc.P + "in", timeout=30).raw.value == -2 ** 62 - 1, "the value")
    assert pva.get(ioc.P + "wf", timeout=30).tolist() == [1, -2, 3, -4]

    pva.put(ioc.P + "out", 2 ** 62 + 1, timeout=30)
    peer.wait_block(struct.pack(">Q", 2 ** 62 + 1))

    seen, enough = [], threading.Event()

    def update(value):
        seen.append((value.raw.value, value.raw.alarm.severity))
        if seen[-1][1] == 3:
            enough.set()
    subscription = pva.monitor(ioc.P + "in", update)
    until(lambda: seen, "the first update")
    peer.send(struct.pack(">q4h", 5, 0, 0, 0, 0))
    until(lambda: seen[-1] == (5, 0), lambda: f"updates {seen}")
    peer.power_off()
    assert enough.wait(60)
    subscription.close()
    # The reason is that of the loss, then that of the attempts since.
    until(lambda: not SINCE_7_0_6 or pva.get(ioc.P + "in", timeout=30).raw.alarm.message == "connection refused by PLC",
          lambda: pva.get(ioc.P + "in", timeout=30).raw.alarm.message)
    assert "reset by PLC" in ioc.log


def test_no_interface(new_peer, new_ioc):
    """Where PVA finds no network and breaks off iocInit, outputs leave all the same, a while later"""
    peer = new_peer(16, 8)
    ioc = new_ioc(peer.configure(recv_timeout=20000), DB,
                  env={**os.environ, "EPICS_PVAS_INTF_ADDR_LIST": "192.0.2.77"})
    assert "No (specified) network interface" in ioc.log
    peer.wait_connected()
    ioc.put("out", 5)
    peer.wait_block(struct.pack(">Q", 5))
    ioc.wait_log("another module has broken off iocInit")
