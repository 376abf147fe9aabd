"""A scripted PLC: sends the bytes a test gives it, keeps every byte it receives.

Independent of plcSim and of the driver. One thread accepts, one per connection reads.
"""
import select
import socket
import struct
import threading
import time

from ports import free_port
from waiting import LIMIT, until


class Connection:
    def __init__(self, peer, sock, number):
        self.peer, self.socket, self.number = peer, sock, number
        self.received = bytearray()
        self.arrivals = []  # (seconds, bytes so far) per recv
        self.ended = None   # "fin" or "reset" when the IOC has closed, "closed" when we have
        threading.Thread(target=self.run, daemon=True).start()

    def run(self):
        while True:
            self.peer.reading.wait()
            try:
                select.select([self.socket], [], [])
                # slow readers take small bites; one that cuts takes no byte more
                bite = self.peer.bite
                if self.peer.cut_after > len(self.received):
                    bite = min(bite, self.peer.cut_after - len(self.received))
                data = self.socket.recv(bite)
            except ValueError:  # closed before select
                self.end("closed")
                return
            except OSError as error:
                self.end("reset" if isinstance(error, ConnectionResetError) else "closed")
                return
            if not data:
                self.end("fin")
                return
            with self.peer.changed:
                self.received += data
                self.arrivals.append((time.monotonic(), len(self.received)))
                self.peer.changed.notify_all()
            if self.peer.cut_after and len(self.received) >= self.peer.cut_after:
                self.peer.cut_after = 0
                self.reset()

    def end(self, how):
        with self.peer.changed:
            self.ended = self.ended or how
            self.peer.changed.notify_all()

    def blocks(self):
        size = self.peer.out_size
        return [bytes(self.received[i:i + size])
                for i in range(0, len(self.received) - size + 1, size)]

    def close(self):
        self.end("closed")
        try:
            self.socket.shutdown(socket.SHUT_RDWR)
        except OSError:
            pass
        self.socket.close()

    def reset(self):
        """Ends the connection with RST."""
        self.end("closed")
        self.socket.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
        # wakes recv in the other thread; the RST goes out with close
        try:
            self.socket.shutdown(socket.SHUT_RD)
        except OSError:
            pass
        self.socket.close()


class Peer:
    """in_size, out_size: bytes per block as in s7plcConfigure."""

    def __init__(self, in_size, out_size, port=0, receive_buffer=0):
        self.in_size, self.out_size = in_size, out_size
        self.receive_buffer = receive_buffer
        self.connections = []
        self.changed = threading.Condition()
        self.reading = threading.Event()
        self.reading.set()
        self.bite = 65536
        self.cut_after = 0  # resets the connection that has so many bytes
        self.listener = None
        self.port = port or free_port()
        self.ticker = None
        self.listen()

    def listen(self):
        listener = socket.socket()
        listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        if self.receive_buffer:
            listener.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, self.receive_buffer)
        listener.bind(("127.0.0.1", self.port))
        listener.listen(5)
        self.listener = listener
        threading.Thread(target=self._accept, args=(listener,), daemon=True).start()

    def _accept(self, listener):
        while True:
            try:
                sock, _ = listener.accept()
            except OSError:
                return
            sock.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            with self.changed:
                if self.listener is not listener:
                    sock.close()
                    return
                self.connections.append(Connection(self, sock, len(self.connections)))
                self.changed.notify_all()

    def configure(self, name="PLC", big=1, recv_timeout=30000, send_interval=100):
        """The s7plcConfigure line for this PLC; a busy machine is not taken for a silent PLC."""
        return (f's7plcConfigure("{name}", "127.0.0.1", {self.port}, {self.in_size}, '
                f"{self.out_size}, {big}, {recv_timeout}, {send_interval})")

    # --- connections -----------------------------------------------------------------------

    @property
    def connection(self):
        """The newest connection."""
        return self.connections[-1]

    def wait(self, condition, what="the PLC", limit=LIMIT):
        return until(condition, what, limit)

    def wait_connected(self, count=1, limit=LIMIT):
        """Waits for connection number `count`, counted from 1; returns the newest."""
        until(lambda: len(self.connections) >= count, f"connection {count}", limit)
        return self.connection

    def hang_up(self):
        """Closes the newest connection; the PLC goes on listening."""
        self.connection.close()

    def power_off(self):
        """No listening, all connections reset."""
        listener, self.listener = self.listener, None
        if listener:
            try:
                listener.shutdown(socket.SHUT_RDWR)
            except OSError:
                pass
            listener.close()
        for connection in self.connections:
            if not connection.ended:
                connection.reset()

    def power_on(self):
        self.listen()

    # --- sending ---------------------------------------------------------------------------

    def send(self, data):
        """Sends bytes as they are. False when the connection is gone."""
        try:
            self.connection.socket.sendall(data)
            return True
        except OSError:
            return False

    def every(self, period, data):
        """Sends data (bytes, or a function that makes them) each period, to whoever is
        connected, until stop_sending()."""
        self.stop_sending()
        make = data if callable(data) else lambda: data
        ticker = self.ticker = threading.Event()

        def run():
            while not ticker.wait(period):
                if self.connections and not self.connection.ended:
                    self.send(make())
        threading.Thread(target=run, daemon=True).start()

    def stop_sending(self):
        if self.ticker:
            self.ticker.set()
        self.ticker = None

    # --- receiving -------------------------------------------------------------------------

    def blocks(self):
        """All whole blocks of the newest connection."""
        with self.changed:
            return self.connection.blocks() if self.connections else []

    def last(self):
        """The newest block of the newest connection, or None."""
        blocks = self.blocks()
        return blocks[-1] if blocks else None

    def wait_block(self, wanted, limit=LIMIT):
        """Waits until the newest block is `wanted` (bytes, or a function that judges)."""
        judge = wanted if callable(wanted) else lambda block: block == wanted
        until(lambda: self.last() is not None and judge(self.last()),
              lambda: f"last block {self.last() and self.last()[:80].hex(' ')}", limit)
        return self.last()

    def wait_blocks(self, count, limit=LIMIT):
        until(lambda: len(self.blocks()) >= count,
              lambda: f"{len(self.blocks())} of {count} blocks", limit)
        return self.blocks()

    def close(self):
        self.stop_sending()
        self.reading.set()
        self.power_off()
