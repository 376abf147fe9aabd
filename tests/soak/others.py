"""PLCs that others have written, in place of plcSim: pymodbus, and cpppo for EtherNet/IP.

    python others.py pymodbus|cpppo <port>

They show the judge's probes and hold setpoints as plcSim does; of faults there are those of the network, of the IOC,
and a PLC that is killed. What they hold is asked by a line on standard input.
"""
import os
import struct
import subprocess
import sys
import threading
import time
from pathlib import Path

if __name__ == "__main__":
    sys.path[:0] = [str(Path(__file__).resolve().parents[1]), str(Path(__file__).resolve().parents[1] / "system")]

from soak import judge

PERIOD = 0.05  # s
TAGS = 3


# --- The process of the PLC ------------------------------------------------------------------

def answer(held):
    """A line is a number of a setpoint: what it holds. With the end of the lines the PLC ends, too."""
    for line in sys.stdin:
        print(f"={held(int(line))}", flush=True)
    os._exit(0)


def pymodbus(port):
    from modbuspeer import ModbusPeer
    peer = ModbusPeer(size=64, port=port)

    def count():
        number = 0
        while True:
            number += 1
            peer.input.put(0, judge.probe(number))
            del peer.requests[:-10], peer.handlers[:-10]
            time.sleep(PERIOD)
    threading.Thread(target=count, daemon=True).start()
    print("ready", flush=True)
    answer(lambda i: peer.holding.unpack(4 * i - 4, "Q")[0])


class Counting:
    """The probe as elements of an array: it is another one when all of it is read, and time has passed."""

    def __init__(self):
        self.number, self.until = 0, 0.0
        self.words = [0] * 16

    def __len__(self):
        return 16

    def __getitem__(self, key):
        if isinstance(key, slice) and time.monotonic() > self.until:
            self.number, self.until = self.number + 1, time.monotonic() + PERIOD
            self.words = struct.unpack("<16i", judge.probe(self.number, "<"))
        return self.words[key]


def cpppo(port):
    from cpppo.server.enip import device, main
    known = {}

    class Attribute(device.Attribute):
        def __init__(self, name, type_cls, default=0, **more):
            super().__init__(name, type_cls, default=Counting() if name == "Probe" else default, **more)
            known[name] = self

    def begin():
        while len(known) < TAGS + 1:
            time.sleep(0.01)
        print("ready", flush=True)
        answer(lambda i: known[f"S{i}"].value)
    threading.Thread(target=begin, daemon=True).start()
    main.main(["-a", f"127.0.0.1:{port}", "--no-udp", "Probe=DINT[16]", *[f"S{i}=LINT" for i in range(1, TAGS + 1)]],
              attribute_class=Attribute)


if __name__ == "__main__":
    {"pymodbus": pymodbus, "cpppo": cpppo}[sys.argv[1]](int(sys.argv[2]))
    sys.exit()


# --- Seen from the soak ----------------------------------------------------------------------

from ports import free_port  # noqa: E402
from waiting import until  # noqa: E402

from .etherip import EtherIp  # noqa: E402
from .modbus import Modbus  # noqa: E402
from .world import IOC, WIRE, Fault  # noqa: E402

FAULTS = WIRE + IOC + [Fault("kill", 3, 0.1, 2)]


class Plc:
    """That process, as soak.world knows a plcSim."""

    def __init__(self, kind):
        self.port = free_port()
        self.lines = []
        self.process = subprocess.Popen([sys.executable, str(Path(__file__).resolve()), kind, str(self.port)],
                                        stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True)
        self.console = self.process.stdin
        until(lambda: self.process.stdout.readline() == "ready\n", f"{kind} that is ready")

    def held(self, record):
        self.console.write(f"{record}\n")
        self.console.flush()
        for line in self.process.stdout:  # what is no answer is something that a library prints
            if line.startswith("="):
                return int(line[1:])
        raise AssertionError("the PLC has ended")

    def command(self, text):
        """It knows no faults of its own."""
        return ""


class PyModbus(Modbus):
    NAME = "pymodbus"
    FAULTS = FAULTS

    def new_sim(self):
        return Plc("pymodbus")

    def target(self, proxy):
        return "127.0.0.1", self.sim.port

    def held(self, record):
        return self.sim.held(record)


class Cpppo(EtherIp):
    """It takes its time: longer time-outs."""

    NAME = "cpppo"
    TIMEOUT = 5.6
    REQUEST_TIMEOUT = 2000
    FAULTS = FAULTS
    OPTIONS = {"requestTimeout": ("2000", "1500"), "holdoff": ("0.2", "0", "20")}

    def new_sim(self):
        return Plc("cpppo")

    def target(self, proxy):
        return "127.0.0.1", self.sim.port

    def held(self, record):
        return self.sim.held(record)
