"""The ports of the tests' own servers: outside those that the system gives away, two tests never share one."""
import socket
import subprocess
import sys
from pathlib import Path

import ports


def test_outside():
    """A port of a server is none that the system gives to a connection"""
    first, last = ports.ephemeral_range()
    for _ in range(3 * ports.BLOCK):
        assert not first <= ports.free_port() <= last
    assert all(b + ports.BLOCK <= 2000 or b > 60000 for b in ports.blocks(2000, 60000))
    assert len(ports.blocks(0, 65535)) == (ports.END - ports.FIRST) // ports.BLOCK


RESERVE = """
import random, sys, ports
random.sample = lambda places, number: places
held, block = ports.reserve()
print(next(block), flush=True)
sys.stdin.read()
"""


def test_reserved():
    """Processes that look at the same block first get one each"""
    running = [subprocess.Popen([sys.executable, "-c", RESERVE], cwd=Path(__file__).parent,
                                stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
               for _ in range(3)]
    got = [process.stdout.readline() for process in running]
    for process in running:
        process.communicate()
    assert len(set(got)) == 3 and all(got), got


def test_taken():
    """A port that somebody has for UDP alone, on any address, is not free"""
    with socket.socket(type=socket.SOCK_DGRAM) as other:
        other.bind(("127.0.0.9", 0))
        assert not ports.is_free(other.getsockname()[1])
    assert ports.is_free(ports.free_port())
