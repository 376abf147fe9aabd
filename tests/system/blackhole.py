"""A TCP port that swallows connects: its accept queue is full, so Linux drops each SYN."""
import socket


class BlackHole:
    def __init__(self):
        self.listener = socket.socket()
        self.listener.bind(("127.0.0.1", 0))
        self.listener.listen(0)
        self.port = self.listener.getsockname()[1]
        self.fill = []
        while True:
            filler = socket.socket()
            filler.settimeout(0.5)
            self.fill.append(filler)
            try:
                filler.connect(("127.0.0.1", self.port))
            except TimeoutError:
                return

    def close(self):
        for filler in self.fill:
            filler.close()
        self.listener.close()
