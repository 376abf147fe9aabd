"""A program on a terminal of its own: what it prints there, and what is typed."""
import os
import pty
import re
import signal
import subprocess

from waiting import LIMIT, until


class Terminal:
    """Ends the program, and all that it has begun, with the `with`."""

    def __init__(self, words, env):
        self.ours, theirs = pty.openpty()
        self.program = subprocess.Popen(words, stdin=theirs, stdout=theirs, stderr=theirs, env=env, start_new_session=True)
        os.close(theirs)
        os.set_blocking(self.ours, False)
        self.seen = ""

    def __enter__(self):
        return self

    def __exit__(self, *error):
        if self.program.poll() is None:
            os.killpg(self.program.pid, signal.SIGTERM)
        os.close(self.ours)

    def read(self):
        try:
            self.seen += os.read(self.ours, 65536).decode(errors="replace")
        except (BlockingIOError, OSError):
            pass  # nothing yet, or the other end is closed
        return self.seen

    def wait(self, text, limit=LIMIT):
        """Waits until this regular expression has been printed."""
        until(lambda: re.search(text, self.read()), lambda: self.seen, limit)

    def type(self, text):
        os.write(self.ours, text.encode())

    def status(self):
        """Waits for the end; returns the status."""
        until(lambda: self.read() and self.program.poll() is not None, lambda: self.seen)
        return self.program.returncode
