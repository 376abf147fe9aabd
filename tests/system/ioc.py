"""One IOC as a user runs it: s7plcIoc with an st.cmd, commands on its shell, CA to its PVs."""
import itertools
import os
import subprocess
import threading
import time

import epics

from client import ARCH, BASE, TOP
from waiting import LIMIT, until, until_equal

_prefixes = itertools.count()

# An older Base has no AMSG, and its mbboDirect makes VAL of its 16 bits: a put to VAL has no effect.
SINCE_7_0_6 = "AMSG" in (BASE / "dbd/dbCommon.dbd").read_text()


class AnyMessage(str):
    """Stands for AMSG where Base has none: it, and each part of it, equals each text and contains it."""
    __hash__ = str.__hash__

    def __eq__(self, other):
        return True

    def __ne__(self, other):
        return False

    def __contains__(self, part):
        return True

    def __getitem__(self, place):
        return self


def errors_in(log):
    """The lines of a log that are no mere information; under a sanitizer slow records are none."""
    slow = "records that process by I/O Intr took" if os.environ.get("SANITIZE") else None
    return [line for line in log.splitlines() if "sevr=" in line and "sevr=info" not in line
            and not (slow and slow in line)]


class Ioc:
    """P is the prefix of its records: $(P) in the database, left out in get() and put()."""

    def __init__(self, directory, configure, db, after="", wrapper=(), env=None,
                 program="s7plcIoc", templates=()):
        """templates: (file in db/, macros in which $(P) is the prefix) ..."""
        self._setup(f"t{next(_prefixes)}:", wrapper, env, program)
        db_file = directory / f"{self.P[:-1]}.db"
        db_file.write_text(db)
        self.script = directory / f"{self.P[:-1]}.cmd"
        loads = [f'dbLoadRecords("{TOP}/db/{name}", "{macros}")\n'.replace("$(P)", self.P)
                 for name, macros in templates]
        self.script.write_text(
            f'dbLoadDatabase("{TOP / "dbd" / program}.dbd")\n'
            f"{program}_registerRecordDeviceDriver(pdbbase)\n"
            f"{configure}\n"
            f'dbLoadRecords("{db_file}", "P={self.P}")\n'
            f"{''.join(loads)}"
            f"iocInit\n{after}\n")

    @classmethod
    def of_script(cls, script, prefix, macros):
        """An IOC with an st.cmd that is there, started in its directory."""
        ioc = cls.__new__(cls)
        ioc._setup(prefix, (), {**os.environ, **macros})
        ioc.script, ioc.directory = script, script.parent
        return ioc

    def _setup(self, prefix, wrapper, env, program="s7plcIoc"):
        self.P = prefix
        self.program = TOP / "bin" / ARCH / program
        self.directory = None
        self.pvs = {}
        self.lines = []
        self.changed = threading.Condition()
        self.marks = itertools.count()
        self.process = None
        self.wrapper = list(wrapper)
        self.env = env

    # --- the process ---------------------------------------------------------------------

    def start(self, limit=60):
        self.process = subprocess.Popen(
            self.wrapper + [str(self.program), str(self.script)], stdin=subprocess.PIPE,
            stdout=subprocess.PIPE, stderr=subprocess.STDOUT, env=self.env,
            cwd=self.directory)
        threading.Thread(target=self._read, daemon=True).start()
        self.command("", limit)
        return self

    def _read(self):
        for raw in self.process.stdout:
            with self.changed:
                self.lines.append(raw.decode(errors="replace").rstrip("\n"))
                self.changed.notify_all()

    @property
    def log(self):
        """Everything printed so far."""
        with self.changed:
            return "\n".join(self.lines)

    def log_count(self, text):
        return self.log.count(text)

    def wait_log(self, text, limit=LIMIT):
        """Waits for a line that contains `text`; returns it."""
        def find():
            with self.changed:
                return next((line for line in self.lines if text in line), None)
        return until(find, lambda: f"{text!r} in the log:\n{self.log}", limit)

    def command(self, text, limit=LIMIT):
        """Types a command into the IOC shell; returns what it printed. limit: s, or a function that says when it is over."""
        mark = f"mark-{next(self.marks)}"
        with self.changed:
            begin = len(self.lines)
        self.process.stdin.write(f"{text}\neltc 1\necho {mark}\n".encode())
        self.process.stdin.flush()
        deadline = time.monotonic() + (0 if callable(limit) else limit)
        over = limit if callable(limit) else lambda: time.monotonic() > deadline
        with self.changed:
            while mark not in self.lines[begin:]:
                if self.process.poll() is not None:
                    raise AssertionError(f"the IOC ended:\n{self.log}")
                if not self.changed.wait(1 if callable(limit) else min(1, max(0, deadline - time.monotonic()))) and over():
                    raise AssertionError(f"no answer to {text!r}:\n" + "\n".join(self.lines))
            lines = self.lines[begin:self.lines.index(mark, begin)]
        echo = {f"epics> {text}", "epics> eltc 1", f"epics> echo {mark}"}
        return "\n".join(line for line in lines if line not in echo)

    def exit(self, limit=LIMIT):
        """Types exit; returns the exit status. A hang is a failure. limit: as in command()."""
        self.drop_clients()
        try:
            self.process.stdin.write(b"exit\n")
            self.process.stdin.close()
        except (BrokenPipeError, ValueError):
            pass
        while True:
            try:
                return self.process.wait(1 if callable(limit) else limit)
            except subprocess.TimeoutExpired:
                if callable(limit) and not limit():
                    continue
                self.process.kill()
                self.process.wait()
                raise AssertionError(f"the IOC hangs on exit:\n{self.log}") from None

    def drop_clients(self):
        for pv in self.pvs.values():
            pv.disconnect()
        self.pvs.clear()

    def close(self):
        if self.process and self.process.poll() is None:
            assert self.exit() == 0, f"the IOC did not end well:\n{self.log}"
        elif self.process:
            self.drop_clients()
            assert self.process.returncode == 0, f"the IOC died:\n{self.log}"

    def cpu_seconds(self):
        """CPU time that the process has used."""
        with open(f"/proc/{self.process.pid}/stat") as stat:
            fields = stat.read().rsplit(")", 1)[1].split()
        return (int(fields[11]) + int(fields[12])) / 100

    # --- records over Channel Access --------------------------------------------------------

    def pv(self, name):
        if name not in self.pvs:
            pv = epics.PV(self.P + name, auto_monitor=False)
            self.pvs[name] = pv
            assert pv.wait_for_connection(LIMIT), f"no PV {self.P + name}\n{self.log}"
        return self.pvs[name]

    def watch(self, name):
        """A list that has the value, and gets each one that a monitor brings from now on."""
        seen = []
        self.pvs[f"{name}, watched"] = epics.PV(self.P + name,
                                                callback=lambda value=None, **_: seen.append(value))
        until(lambda: seen, f"the first value of a monitor of {self.P + name}")
        return seen

    def connect(self, names):
        """Connects many at once: one by one takes its time."""
        new = [name for name in names if name not in self.pvs]
        self.pvs.update({name: epics.PV(self.P + name, auto_monitor=False) for name in new})
        for name in new:
            assert self.pvs[name].wait_for_connection(LIMIT), f"no PV {self.P + name}"

    def get(self, name, **kw):
        """The value now, asked from the IOC."""
        pv = self.pv(name)
        try:
            value = pv.get(use_monitor=False, timeout=LIMIT, **kw)
        except epics.ca.ChannelAccessGetFailure:
            # A channel that CA itself lost for a moment; a PV that has seen it may hold a wrong
            # type for good.
            self.pvs.pop(name).disconnect()
            value = self.pv(name).get(use_monitor=False, timeout=LIMIT, **kw)
        assert value is not None, f"caget {name} got no answer"
        return value

    def stamp(self, name):
        """The record's time stamp, s since 1970."""
        return self.pv(name).get_with_metadata(form="time", use_monitor=False, timeout=LIMIT)["timestamp"]

    def text(self, name):
        """The value as caget -s has it."""
        return self.get(name, as_string=True)

    def put(self, name, value, wait=True):
        self.pv(name).put(value, wait=wait, timeout=LIMIT)

    def put_direct(self, name, value):
        """A put to an mbboDirect; where Base takes none to VAL, to its bits."""
        if SINCE_7_0_6:
            self.put(name, value)
        for bit in range(0 if SINCE_7_0_6 else 16):
            self.put(f"{name}.B{bit:X}", value >> bit & 1)

    def put_callback(self, name, value):
        """A put with callback; returns an event that is set when it has ended."""
        done = threading.Event()
        self.pv(name).put(value, wait=False, callback=lambda **kw: done.set())
        return done

    def process_record(self, name):
        self.put(name + ".PROC", 1)

    def severity(self, name):
        return self.text(name + ".SEVR")

    def alarm(self, name):
        """SEVR, STAT and AMSG, for example ('INVALID', 'COMM', 'no block for 2.0 s')."""
        return self.severity(name), self.text(name + ".STAT"), self.message(name)

    def message(self, name):
        """AMSG; an AnyMessage where Base has none."""
        return self.text(name + ".AMSG") if SINCE_7_0_6 else AnyMessage()

    def wait_value(self, name, wanted, limit=LIMIT):
        return until_equal(lambda: self.plain(name), wanted, limit)

    def plain(self, name):
        """The value as plain Python data."""
        value = self.get(name)
        return value.tolist() if hasattr(value, "tolist") else value

    def wait_alarm(self, name, *wanted, limit=LIMIT, ask=False):
        """Waits for SEVR, then STAT and AMSG where given (AMSG: a part of it). ask: process
        the record, as a periodic scan would; I/O Intr tells the first reason of a loss."""
        seen = []

        def check():
            if ask:
                self.process_record(name)
            seen[:] = [self.alarm(name)]
            severity, status, message = seen[0]
            return (severity == wanted[0] and
                    (len(wanted) < 2 or status == wanted[1]) and
                    (len(wanted) < 3 or wanted[2] in message))
        until(check, lambda: f"{name} has {seen[0]}, wanted {wanted}", limit)
        return seen[0]

    def memory(self):
        """Resident bytes of the process."""
        with open(f"/proc/{self.process.pid}/statm") as statm:
            return int(statm.read().split()[1]) * 4096

    def descriptors(self):
        """Number of open files of the process."""
        return len(os.listdir(f"/proc/{self.process.pid}/fd"))
