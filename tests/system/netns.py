"""A plant network on this machine: PLCs in network namespaces on a bridge, with cables that can
be pulled, and a proxy that delays. Needs root, for as long as a test runs."""
import itertools
import os
import shutil
import socket
import subprocess
import threading
import time

import pytest

_numbers = itertools.count()


def run(*words):
    return subprocess.run([str(w) for w in words], check=True, capture_output=True, text=True).stdout


class Plant:
    """A bridge with address .254 here, and PLCs 0, 1, ... at .1, .2, ..."""

    def __init__(self, plcs):
        # Not more than 15 characters: names of interfaces
        self.name = f"px{os.getpid() % 100000}{chr(97 + next(_numbers) % 26)}"
        self.net = f"10.{200 + os.getpid() % 50}.{os.getpid() // 50 % 250}"
        self.spaces = [f"{self.name}n{i}" for i in range(plcs)]
        try:
            run("ip", "link", "add", self.name, "type", "bridge")
            run("ip", "addr", "add", f"{self.net}.254/24", "dev", self.name)
            run("ip", "link", "set", self.name, "up")
            for i, space in enumerate(self.spaces):
                run("ip", "netns", "add", space)
                run("ip", "link", "add", self.cable(i), "type", "veth", "peer", "name", "eth0",
                    "netns", space)
                run("ip", "link", "set", self.cable(i), "master", self.name, "up")
                self.inside(i, "ip", "addr", "add", f"{self.address(i)}/24", "dev", "eth0")
                self.inside(i, "ip", "link", "set", "eth0", "up")
                self.inside(i, "ip", "link", "set", "lo", "up")
        except (OSError, subprocess.CalledProcessError) as error:
            self.close()
            detail = getattr(error, "stderr", "") or str(error)
            pytest.skip(f"no network namespaces here: {detail.strip()}")

    def cable(self, i):
        return f"{self.name}v{i}"

    def address(self, i):
        return f"{self.net}.{i + 1}"

    def wrapper(self, i):
        """Words in front of a command that is to run in the PLC."""
        return ["ip", "netns", "exec", self.spaces[i]]

    def inside(self, i, *words):
        return run(*self.wrapper(i), *words)

    def pull(self, i):
        run("ip", "link", "set", self.cable(i), "down")

    def plug(self, i):
        run("ip", "link", "set", self.cable(i), "up")

    def firewall(self, i, *words):
        """A rule of iptables for what comes in, or goes out, of PLC i."""
        if not shutil.which("iptables"):
            pytest.skip("iptables is not installed")
        try:
            return self.inside(i, "iptables", *words)
        except subprocess.CalledProcessError as error:
            pytest.skip(f"iptables {' '.join(words)}: {error.stderr.strip()}")

    def close(self):
        links = [self.name, *(self.cable(i) for i in range(len(self.spaces)))]
        for words in [["link", "del", link] for link in links] + [
                ["netns", "del", space] for space in self.spaces]:
            subprocess.run(["ip", *words], capture_output=True)


class DelayProxy:
    """Passes TCP on to another address at the same port, each byte `delay` seconds later."""

    def __init__(self, address, target, port, delay):
        self.target, self.delay = (target, port), delay
        self.listener = socket.create_server((address, port))
        self.sockets = []
        threading.Thread(target=self._serve, daemon=True).start()

    def _serve(self):
        while True:
            try:
                near, _ = self.listener.accept()
                far = socket.create_connection(self.target)
            except OSError:
                return
            self.sockets += [near, far]
            for source, sink in ((near, far), (far, near)):
                source.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
                threading.Thread(target=self._pass, args=(source, sink), daemon=True).start()

    def _pass(self, source, sink):
        pieces, more = [], threading.Condition()

        def deliver():
            while True:
                with more:
                    while not pieces:
                        more.wait()
                    due, data = pieces.pop(0)
                time.sleep(max(0, due - time.monotonic()))  # the delay of this line
                try:
                    if data:
                        sink.sendall(data)
                    else:
                        sink.shutdown(socket.SHUT_WR)
                except OSError:
                    pass
                if not data:
                    return
        threading.Thread(target=deliver, daemon=True).start()
        data = True
        while data:
            try:
                data = source.recv(65536)
            except OSError:
                data = b""
            with more:
                pieces.append((time.monotonic() + self.delay, data))
                more.notify()

    def close(self):
        for s in [self.listener, *self.sockets]:
            s.close()
