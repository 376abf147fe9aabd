"""The CA client (pyepics with Base's libca) and its environment, which the IOCs share.

Importing this module chooses ports that nobody else uses, so that tests of several users,
or several workers of one run, do not see each other's IOCs.
"""
import os
import socket
import struct
import subprocess
import threading
from pathlib import Path

from ports import free_port

TOP = Path(__file__).resolve().parents[2]


class Repeater:
    """Stands in for caRepeater, which would outlive us and keep our stdout open.

    It confirms each client that registers, and repeats nothing: beacons are not needed.
    """

    def __init__(self):
        self.socket = socket.socket(type=socket.SOCK_DGRAM)
        self.socket.bind(("", 0))
        self.port = self.socket.getsockname()[1]
        threading.Thread(target=self.run, daemon=True).start()

    def run(self):
        confirm = struct.pack(">HHHHI4s", 17, 0, 0, 0, 0, socket.inet_aton("127.0.0.1"))
        while True:
            try:
                _, sender = self.socket.recvfrom(1024)
                self.socket.sendto(confirm, sender)
            except OSError:
                return


def epics_base():
    """EPICS_BASE as the build has it, from one of the RELEASE files or the environment."""
    return Path(subprocess.run([TOP / "configure/setup.sh", "named"], check=True, text=True,
                               stdout=subprocess.PIPE).stdout.strip())


BASE = epics_base()
_PRODUCTS = [p for p in TOP.glob("bin/*/s7plcIoc")]
ARCH = os.environ.get("EPICS_HOST_ARCH") or (_PRODUCTS[0].parent.name if _PRODUCTS else "")
PVA_PORT, PVA_UDP = free_port(), free_port()
REPEATER = Repeater()

# Where a second IOC of a test serves its PVs: two on one address share its UDP port, and
# only one of them would hear the clients' searches.
SECOND_IOC = "127.0.0.9"

os.environ.update(
    EPICS_IOCSH_HISTFILE="",
    EPICS_CA_SERVER_PORT=str(free_port()),
    EPICS_CA_REPEATER_PORT=str(REPEATER.port),
    EPICS_CA_ADDR_LIST=f"127.0.0.1 {SECOND_IOC}",
    EPICS_CA_AUTO_ADDR_LIST="NO",
    EPICS_CA_MAX_ARRAY_BYTES="2000000",
    EPICS_CAS_INTF_ADDR_LIST="127.0.0.1",
    EPICS_CAS_AUTO_BEACON_ADDR_LIST="NO",
    EPICS_CAS_BEACON_ADDR_LIST="127.0.0.1",
    EPICS_PVA_SERVER_PORT=str(PVA_PORT),
    EPICS_PVA_BROADCAST_PORT=str(PVA_UDP),
    EPICS_PVA_ADDR_LIST="127.0.0.1",
    EPICS_PVA_AUTO_ADDR_LIST="NO",
    EPICS_PVAS_INTF_ADDR_LIST="127.0.0.1",
    EPICS_PVAS_BEACON_ADDR_LIST="127.0.0.1",
    EPICS_PVAS_AUTO_BEACON_ADDR_LIST="NO",
)
_LIBCA = BASE / "lib" / ARCH / "libca.so"
if _LIBCA.exists():
    os.environ["PYEPICS_LIBCA"] = str(_LIBCA)

import epics  # noqa: E402


def stop():
    epics.ca.finalize_libca()
    REPEATER.socket.close()
