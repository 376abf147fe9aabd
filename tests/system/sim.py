"""plcSim as a child process, with its console on a unix socket."""
import itertools
import socket
import subprocess
import threading

from client import ARCH, TOP
from ports import free_port
from waiting import until

PROGRAM = TOP / "bin" / ARCH / "plcSim"
_numbers = itertools.count()


class Sim:
    def __init__(self, directory, text, *options, wrapper=()):
        number = next(_numbers)
        file = directory / f"sim{number}.plc"
        file.write_text(text)
        self.path = directory / f"sim{number}.sock"
        self.lines = []
        self.port = None
        self.modbus_port = None  # where the file has modbus_port = 0
        self.etherip_port = None  # where it has etherip_port = 0
        self.process = subprocess.Popen(
            [*wrapper, str(PROGRAM), "-n", "-p", str(free_port()), "-c", str(self.path), *options,
             str(file)],
            stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.STDOUT)
        threading.Thread(target=self._read, daemon=True).start()
        until(lambda: self.port and any("console on" in line for line in self.lines),
              lambda: "plcSim listening:\n" + "\n".join(self.lines))
        self.console = socket.socket(socket.AF_UNIX)
        self.console.connect(str(self.path))
        self.answers = self.console.makefile("r")

    def _read(self):
        for raw in self.process.stdout:
            line = raw.decode(errors="replace").rstrip()
            if " Modbus listening on " in line:
                self.modbus_port = int(line.rsplit(":", 1)[1])
            elif " EtherNet/IP listening on " in line:
                self.etherip_port = int(line.rsplit(":", 1)[1])
            elif " listening on " in line and self.port is None:
                self.port = int(line.rsplit(":", 1)[1])
            self.lines.append(line)

    def command(self, text):
        """A console command; returns its answer without the closing "ok"."""
        self.console.sendall(text.encode() + b"\n")
        answer = []
        for line in self.answers:
            line = line.rstrip("\n")
            assert not line.startswith("error: "), f"plcSim: {text}: {line}"
            if line == "ok":
                return "\n".join(answer)
            answer.append(line)
        raise AssertionError("plcSim closed its console")

    def close(self):
        self.console.close()
        self.process.terminate()
        try:
            self.process.wait(10)
        except subprocess.TimeoutExpired:
            self.process.kill()
            raise AssertionError("plcSim does not end on SIGTERM") from None
