"""A demonstration of iocBoot, run as without a terminal; knows nothing of what it shows."""
import itertools
import os
import signal
import subprocess
from pathlib import Path

from client import TOP
from waiting import until

_marks = itertools.count()


def marked(mark):
    """{process: command} of the processes that have `mark` in their environment."""
    found = {}
    for process in Path("/proc").glob("[0-9]*"):
        try:
            if mark.encode() in (process / "environ").read_bytes():
                found[int(process.name)] = (process / "cmdline").read_bytes().replace(b"\0", b" ").decode()
        except OSError:  # it has ended, or is another user's
            pass
    return found


def run_demo(folder, limit, **more):
    """What iocBoot/<folder>/demo prints; it ends well within `limit` s, and leaves no process behind.

    Its environment is that of a user who has set nothing for CA, and `more`.
    """
    mark = f"{os.getpid()}.{next(_marks)}."
    env = {name: value for name, value in os.environ.items() if not name.startswith("EPICS_C")}
    run = subprocess.run([TOP / "iocBoot" / folder / "demo"], stdin=subprocess.DEVNULL,
                         env={**env, **more, "DEMO_OF_TEST": mark}, capture_output=True, text=True, timeout=limit)
    mark = f"DEMO_OF_TEST={mark}"
    try:
        until(lambda: not marked(mark), lambda: f"left behind: {marked(mark)}")
    finally:
        for process in marked(mark):
            os.kill(process, signal.SIGKILL)
    assert run.returncode == 0, run.stdout + run.stderr
    assert run.stdout.endswith("demo ok\n"), run.stdout
    return run.stdout
