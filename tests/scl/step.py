"""The program of plcSim, one cycle at a time (tests/unit/simStep.c)."""
import subprocess
from pathlib import Path

from . import tables

UNIT = Path(__file__).resolve().parents[1] / "unit"


def program():
    return next(UNIT.glob("O.*/simStep"), UNIT / "simStep")


class Step:
    """orders: what makes its memory and its program."""

    def __init__(self, orders=None):
        self.process = subprocess.Popen([str(program())], stdin=subprocess.PIPE,
                                        stdout=subprocess.PIPE, text=True)
        for text in orders or with_tables():
            self.order(text)

    def order(self, text):
        self.process.stdin.write(text + "\n")
        self.process.stdin.flush()
        answer = self.process.stdout.readline().strip()
        assert answer and not answer.startswith("error"), f"{text}: {answer}"
        return answer

    def cycle(self, ms, connected, remote, allow, send, block):
        """IE_TX after a cycle that sends, None after another one."""
        self.process.stdin.write(f"cycle {ms} {connected:d} {remote:d} {allow:d} {send:d} "
                                 f"{block.hex() if block else '-'}\n")
        self.process.stdin.flush()
        answer = self.process.stdout.readline().strip()
        return bytes.fromhex(answer) if send else None

    def put(self, number, byte, data):
        self.order(f"put {number} {byte} {data.hex()}")

    def memory(self, number):
        return bytes.fromhex(self.order(f"get {number}"))

    def close(self):
        self.process.stdin.close()
        self.process.stdout.close()
        self.process.wait(10)


def with_tables():
    """The plant of tables.py."""
    yield f"blocks {tables.IN} {tables.OUT}"
    for number, size in tables.PLANT.items():
        yield f"db {number} {size}"
    yield from ("allow write DB10", "allow read DB11", "allow read M 100 100")
    yield f"begin {tables.ROWS} 3000"
