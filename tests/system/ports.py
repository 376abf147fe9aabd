"""Ports for servers that are told theirs; knows nothing of who they are.

The system gives connections and unbound sockets ports out of net.ipv4.ip_local_port_range. A
port chosen there may be theirs by the time that an IOC binds it ("CAS: No TCP server started"),
so ours lie outside. Each process that imports this has a block of them to itself: it holds an
abstract unix socket of that block's name, which no other process of this network can bind
meanwhile, and which goes when the process ends.
"""
import errno
import random
import socket

BLOCK = 100  # ports
FIRST, END = 20000, 65536  # below are known services, demonstrations and plcmap prove


def ephemeral_range():
    """The first and last port that the system gives away by itself."""
    with open("/proc/sys/net/ipv4/ip_local_port_range") as file:
        first, last = map(int, file.read().split())
    return first, last


def blocks(first, last):
    """First ports of the blocks outside first..last; where there is no room, of all blocks."""
    everywhere = range(FIRST, END - BLOCK + 1, BLOCK)
    return [b for b in everywhere if b + BLOCK <= first or b > last] or list(everywhere)


def reserve():
    """A block that no other process has: its socket and its ports."""
    places = blocks(*ephemeral_range())
    for first in random.sample(places, len(places)):
        name = socket.socket(socket.AF_UNIX)
        try:
            name.bind(f"\0plclink-tests-{first}")
            return name, iter(range(first, first + BLOCK))
        except OSError as error:
            name.close()
            if error.errno != errno.EADDRINUSE:
                raise
    raise OSError(errno.EADDRINUSE, "every block of ports is reserved by a test")


def is_free(port):
    """Nobody has the port, for TCP or UDP, on any address."""
    with socket.socket() as tcp, socket.socket(type=socket.SOCK_DGRAM) as udp:
        tcp.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)  # closed ones do not count
        try:
            tcp.bind(("", port))
            udp.bind(("", port))
        except OSError as error:
            if error.errno != errno.EADDRINUSE:
                raise
            return False
    return True


_held, _ports = [], iter(())


def free_port():
    """A port that is free for TCP and UDP, and of no other test while this process lives."""
    global _ports
    while True:
        for port in _ports:
            if is_free(port):
                return port
        name, _ports = reserve()
        _held.append(name)
