"""What all system tests share: ports of our own, fixtures, and sentences as test names."""
import os
import subprocess
import sys
from pathlib import Path

import pytest

sys.path[:0] = [str(Path(__file__).parent), str(Path(__file__).parents[1])]

import client  # noqa: E402  (sets the environment before anything loads libca)
from blackhole import BlackHole  # noqa: E402
from eipplant import Plant  # noqa: E402
from ioc import SINCE_7_0_6, Ioc  # noqa: E402
from modbuspeer import ModbusPeer  # noqa: E402
from peer import Peer  # noqa: E402
from scl.plc import SclPlc  # noqa: E402
from sim import Sim  # noqa: E402

PLCS = {"plcSim": Sim, "SCL": SclPlc}


def pytest_report_header():
    return None if SINCE_7_0_6 else "EPICS Base is older than 7.0.6 and has no AMSG: what alarms say is not compared"


def left_out(item):
    """A run against the SCL that takes its time and shows little that others do not."""
    always = getattr(item.module, "SCL_ALWAYS", ())
    return ("SCL" in getattr(getattr(item, "callspec", None), "id", "").split("-")
            and item.originalname not in always and not os.environ.get("PLCLINK_ALL"))


def pytest_collection_modifyitems(items):
    """The first line of a test's docstring is its name in the report. {x} is a parameter.

    PLCLINK_ALL=1: all tests of the handshake and of tables against the SCL, too.
    """
    items[:] = [item for item in items if not left_out(item)]
    for item in items:
        sentence = (item.obj.__doc__ or item.name).strip().splitlines()[0].rstrip(".")
        if hasattr(item, "callspec"):
            words = {k: getattr(v, "__name__", v) for k, v in item.callspec.params.items()}
            ids = item.callspec.id.split("-")
            words["id"] = "-".join(i for i in ids if i not in PLCS)
            sentence = sentence.format_map(words) + (" [SCL]" if "SCL" in ids else "")
        item._nodeid = f"{item.nodeid.split('::')[0]}::{sentence}"


@pytest.fixture
def closing():
    """Collects what has close(); closes it after the test, last made first."""
    things = []
    yield things.append
    errors = []
    for thing in reversed(things):
        try:
            thing.close()
        except Exception as error:  # the others must be closed all the same
            errors.append(error)
    if errors:
        raise errors[0]


@pytest.fixture
def new_ioc(tmp_path, closing):
    """new_ioc(configure lines, database text, ...) makes an IOC and waits for iocInit."""
    def make(*args, start=True, **kw):
        ioc = Ioc(tmp_path, *args, **kw)
        closing(ioc)
        return ioc.start() if start else ioc
    return make


@pytest.fixture
def plant(new_sim, new_ioc):
    """plcSim with tags, and an IOC with records on them: tests of EtherNet/IP."""
    return Plant(new_sim, new_ioc)


@pytest.fixture
def new_peer(closing):
    """new_peer(in bytes, out bytes) makes a scripted PLC that listens."""
    def make(*args, **kw):
        peer = Peer(*args, **kw)
        closing(peer)
        return peer
    return make


@pytest.fixture
def new_modbus(closing):
    """new_modbus(size=, unit=) makes a Modbus PLC that listens."""
    def make(*args, **kw):
        peer = ModbusPeer(*args, **kw)
        closing(peer)
        return peer
    return make


@pytest.fixture
def new_sim(tmp_path, closing):
    """new_sim(lines of a .plc file) starts plcSim."""
    def make(text, *options):
        sim = Sim(tmp_path, text, *options)
        closing(sim)
        return sim
    return make


@pytest.fixture(params=PLCS.values(), ids=PLCS)
def new_plc(request, tmp_path, closing):
    """As new_sim; the program in the PLC is plcSim's, or the SCL of the documents."""
    def make(text, *options):
        plc = request.param(tmp_path, text, *options)
        closing(plc)
        return plc
    return make


@pytest.fixture
def black_hole(closing):
    """A port that answers nothing to a connect: no RST, no SYN-ACK."""
    hole = BlackHole()
    closing(hole)
    return hole


@pytest.fixture
def no_sanitizer():
    """Skips the test under a sanitizer: it builds what has none, or counts what a sanitizer does, too."""
    if os.environ.get("SANITIZE"):
        pytest.skip("not under a sanitizer")


@pytest.fixture
def need_root():
    """Skips the test where namespaces of our own are not allowed."""
    if os.geteuid() != 0:
        pytest.skip("needs root")
    try:
        subprocess.run(["unshare", "-n", "-m", "true"], check=True, capture_output=True)
    except (OSError, subprocess.CalledProcessError):
        pytest.skip("needs network and mount namespaces (unshare)")


@pytest.fixture(scope="session", autouse=True)
def ca_client():
    yield
    client.stop()
