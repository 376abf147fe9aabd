"""One TCP connection as a communication processor has it: it listens, and blocks of a fixed
size go either way. AG_SEND and AG_RECV use it; it knows nothing of what is in a block.

Everything here is called from the PLC's thread, and nothing waits.
"""
import socket
import struct
import time

BLOCKING = (BlockingIOError, InterruptedError)


class Link:
    def __init__(self, out_size, address="127.0.0.1", port=0):
        self.out_size = out_size        # bytes of a block from the IOC
        self.address, self.port = address, port
        self.listener = self.client = None
        self.connected = False          # as the program is told
        self.unplugged = False
        self.cut = None                 # bytes until the connection breaks
        self.history, self.count = [], 0
        self.listen()

    def listen(self):
        self.listener = socket.socket()
        self.listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        self.listener.bind((self.address, self.port))
        self.listener.listen(8)
        self.listener.setblocking(False)
        self.port = self.listener.getsockname()[1]

    def step(self):
        """New connections, and bytes. A new one replaces the old one, which the program sees
        as an end first."""
        if self.unplugged:
            return
        if self.client and not self.connected:
            self.connected = True
        client = self.accept()
        if client and self.client:
            self.drop()
        if client:
            self.client, self.data, self.rest = client, b"", b""
        if self.client:
            self.transfer()

    def accept(self):
        try:
            client = self.listener.accept()[0] if self.listener else None
        except BLOCKING:
            return None
        if client:
            client.setblocking(False)
            client.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        return client

    def transfer(self):
        try:
            if self.rest:
                self.rest = self.rest[self.client.send(self.rest):]
            new = self.client.recv(65536)
        except BLOCKING:
            return
        except OSError:
            self.drop()
            return
        self.data += new
        if self.cut is not None:
            self.cut -= len(new)
        if not new or self.cut is not None and self.cut <= 0:
            self.drop(with_reset=bool(new))

    def drop(self, with_reset=False):
        if self.client:
            reset(self.client) if with_reset else self.client.close()
        self.client, self.connected, self.cut = None, False, None

    # --- for AG_SEND and AG_RECV -----------------------------------------------------------

    def busy(self):
        return bool(self.client and (self.rest or self.unplugged))

    def send(self, block):
        self.rest = block
        if self.client and not self.unplugged:
            self.transfer()

    def receive(self, size):
        if self.unplugged or not self.client or len(self.data) < size:
            return None
        block, self.data = self.data[:size], self.data[size:]
        self.count += 1
        self.history.append((self.count, time.monotonic(), block))
        del self.history[:-1000]
        return block

    # --- the cable and the power -----------------------------------------------------------

    def unplug(self):
        self.unplugged = True
        self.stop_listening()

    def plug(self):
        self.unplugged = False
        self.refuse(False)

    def refuse(self, on):
        """New connections get RST: nobody listens."""
        if on:
            self.stop_listening()
        elif not self.listener:
            self.listen()

    def stop_listening(self):
        if self.listener:
            self.listener.close()
        self.listener = None

    def close(self, with_reset=False):
        self.drop(with_reset)
        self.stop_listening()


def reset(client):
    client.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
    client.close()
