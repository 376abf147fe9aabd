"""What a run has measured and counted: kept in memory, written as JSON now and then for the report."""
import json
import os
import random
import time

KEPT = 4000  # values of one figure


def empty(about, failure=None):
    """The result of a scenario that has not played yet."""
    return {"about": about, "episodes": 0, "faults": {}, "counts": {}, "figures": {}, "series": [], "failure": failure,
            "seconds": 0.0, "ended": False}


class Recorder:
    def __init__(self, path, about):
        self.path = path
        self.begin = time.monotonic()
        self.data = empty(about)
        self.written = 0.0

    def now(self):
        return time.monotonic() - self.begin

    def count(self, name, n=1):
        self.data["counts"][name] = self.data["counts"].get(name, 0) + n

    def fault(self, name):
        self.data["faults"][name] = self.data["faults"].get(name, 0) + 1

    def figure(self, name, key, value):
        """One measured value (s) of `name`, under `key`: a fault, say. Of many, a random choice is kept."""
        of = self.data["figures"].setdefault(name, {}).setdefault(key, {"n": 0, "max": 0.0, "values": []})
        of["n"] += 1
        of["max"] = max(of["max"], round(value, 5))
        if len(of["values"]) < KEPT:
            of["values"].append(round(value, 5))
        elif random.randrange(of["n"]) < KEPT:
            of["values"][random.randrange(KEPT)] = round(value, 5)

    def sample(self, process):
        """Memory (bytes) and descriptors of a process."""
        with open(f"/proc/{process.pid}/statm") as statm:
            rss = int(statm.read().split()[1]) * 4096
        descriptors = len(os.listdir(f"/proc/{process.pid}/fd"))
        self.data["series"].append([round(self.now(), 1), rss, descriptors, process.pid])
        if len(self.data["series"]) > 3000:
            del self.data["series"][::2]
        return rss, descriptors

    def write(self, every=0.0):
        if self.now() - self.written < every:
            return
        self.written = self.now()
        self.data["seconds"] = round(self.now(), 1)
        new = self.path.with_suffix(".new")
        new.write_text(json.dumps(self.data))
        new.rename(self.path)
