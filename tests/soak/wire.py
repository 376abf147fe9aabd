"""A TCP proxy between IOC and PLC that makes the faults of a network, and tells what has passed.

One thread runs all proxies of a process (asyncio). What passes is looked at after the faults and before the
lies, on the way to the IOC; on the way to the PLC after both: so what the judge hears is what a PLC has sent
and got. A lie is a fault that no network makes (a torn, repeated or dropped block): it is there to show that
the judge finds it.
"""
import asyncio
import random
import socket
import struct
import threading
import time

TO_IOC, TO_PLC = "to IOC", "to PLC"


class Loop:
    """The thread in which proxies live."""

    def __init__(self):
        self.loop = asyncio.new_event_loop()
        self.thread = threading.Thread(target=self.loop.run_forever, daemon=True)
        self.thread.start()

    def call(self, coroutine):
        """Runs it there; returns its result."""
        return asyncio.run_coroutine_threadsafe(coroutine, self.loop).result(60)

    def close(self):
        self.loop.call_soon_threadsafe(self.loop.stop)
        self.thread.join(10)


def abort(writer):
    """Ends a connection by RST, if it is not closed yet."""
    sock = writer.get_extra_info("socket")
    if sock is not None:
        try:
            sock.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
        except OSError:
            pass
    writer.transport.abort()


class Passage:
    """One connection: two pumps."""

    def __init__(self, proxy, number, near, far):
        self.proxy, self.number = proxy, number
        self.writers = {TO_IOC: near[1], TO_PLC: far[1]}
        self.readers = {TO_IOC: far[0], TO_PLC: near[0]}
        self.dead = False     # half-open: swallows all
        self.ended = False
        self.finders = {way: make() for way, make in proxy.finders.items()}
        self.state = {}       # of a lie

    async def run(self):
        pumps = [asyncio.ensure_future(self.pump(way)) for way in (TO_IOC, TO_PLC)]
        done, rest = await asyncio.wait(pumps, return_when=asyncio.FIRST_COMPLETED)
        for task in rest:
            task.cancel()
        reset = any(task.exception() or task.result() == "reset" for task in done)
        self.end(reset)

    async def pump(self, way):
        reader = self.readers[way]
        while True:
            try:
                data = await reader.read(65536)
            except OSError:
                return "reset"
            if not data:
                if self.dead and way == TO_IOC:
                    await asyncio.sleep(3600)  # a half-open connection does not tell of its end
                return "closed"
            if self.dead:
                continue
            if way == TO_PLC and self.proxy.lie:
                data = self.proxy.lie(way, data, self.state)
            try:
                await self.deliver(way, data)
            except OSError:
                return "reset"

    async def deliver(self, way, data):
        """As the faults in force have it; each piece is told of when it has gone."""
        for piece, pause in self.proxy.pieces(way, data):
            if pause:
                await asyncio.sleep(pause)  # the fault: this piece comes so late
            await self.proxy.flowing[way].wait()
            if self.dead or self.ended:
                return
            if self.readers[way].exception():  # a reset overtakes what has not arrived
                raise ConnectionResetError
            cut = self.proxy.cut
            if cut and cut[0] == way and self.ready_to_cut(piece):
                self.end(True)
                return
            self.tell(way, piece)
            if way == TO_IOC and self.proxy.lie:
                piece = self.proxy.lie(way, piece, self.state)
            self.writers[way].write(piece)
            await self.writers[way].drain()

    def ready_to_cut(self, piece):
        """The connection breaks within this piece: only its beginning leaves."""
        way, count = self.proxy.cut
        self.proxy.cut = (way, count - len(piece))
        if count > len(piece):
            return False
        self.proxy.cut = None
        self.tell(way, piece[:count])
        self.writers[way].write(piece[:count])
        return True

    def tell(self, way, piece):
        if way == TO_PLC and self.proxy.one_client and self.proxy.passages[-1] is not self:
            return  # the PLC has another connection by now
        finder = self.finders.get(way)
        for what in finder.feed(piece) if finder else ():
            self.proxy.on_passed(way, what, self, time.monotonic())

    def end(self, reset):
        if self.ended:
            return
        self.ended = True
        for writer in self.writers.values():
            if reset:
                abort(writer)
            else:
                writer.close()
        self.proxy.gone(self)


class Proxy:
    """Listens on address:port and passes on to `target` (address, port), which may change.

    finders: way -> function that makes one with feed(bytes) for each connection;
    on_passed(way, what it found, passage, time); on_ended(passage, time).
    """

    def __init__(self, loop, target, address="127.0.0.1", port=0, finders=(), on_passed=None,
                 on_ended=None, one_client=False, seed=0):
        self.one_client = one_client  # the PLC ends a connection when another one is made
        self.loop, self.target, self.address, self.port = loop, target, address, port
        self.finders = dict(finders)
        self.on_passed = on_passed or (lambda *args: None)
        self.on_ended = on_ended or (lambda *args: None)
        self.dice = random.Random(seed)
        self.passages, self.count = [], 0
        self.server = None
        self.lie = None
        loop.call(self._begin())

    async def _begin(self):
        self.flowing = {TO_IOC: asyncio.Event(), TO_PLC: asyncio.Event()}
        self._normal()
        await self._listen()

    async def _listen(self):
        self.server = await asyncio.start_server(self._accept, self.address, self.port,
                                                 reuse_address=True)
        self.port = self.server.sockets[0].getsockname()[1]

    async def _accept(self, reader, writer):
        try:
            far = await asyncio.wait_for(asyncio.open_connection(*self.target), 2)
            if reader.exception() or reader.at_eof() or reader._eof:  # given up meanwhile
                far[1].transport.abort()
                raise ConnectionResetError
        except (OSError, asyncio.TimeoutError):
            abort(writer)
            return
        for each in (writer, far[1]):
            each.get_extra_info("socket").setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self.count += 1
        passage = Passage(self, self.count, (reader, writer), far)
        self.passages.append(passage)
        await passage.run()

    def gone(self, passage):
        if passage in self.passages:
            self.passages.remove(passage)
        self.on_ended(passage, time.monotonic())

    # --- Faults --------------------------------------------------------------------------

    def _normal(self):
        self.delay = {TO_IOC: 0.0, TO_PLC: 0.0}
        self.bite = {TO_IOC: 0, TO_PLC: 0}     # bytes of a piece, 0: all
        self.pause = {TO_IOC: 0.0, TO_PLC: 0.0}  # between pieces, s
        self.slips = 0      # bytes that are lost (< 0) or too many (> 0), once
        self.cut = None     # (way, bytes until the connection breaks)
        for event in self.flowing.values():
            event.set()

    def pieces(self, way, data):
        """(bytes, pause before them, s) ..."""
        if way == TO_IOC and self.slips:
            at, slip = self.dice.randrange(len(data)), self.slips
            self.slips = 0
            data = data[:at] + (self.dice.randbytes(slip) if slip > 0 else b"") + \
                data[at + max(-slip, 0):]
        bite = self.bite[way] or max(len(data), 1)
        return [(data[i:i + bite], self.pause[way] if i else self.delay[way])
                for i in range(0, len(data), bite)]

    def _do(self, function):
        async def run():
            return function()
        return self.loop.call(run())

    def normal(self):
        """All faults end but a refusal; half-open connections stay so."""
        self._do(self._normal)

    def set(self, **faults):
        """delay=, bite=, pause= as {way: value}, slips=, cut=."""
        def change():
            for name, value in faults.items():
                if isinstance(value, dict):
                    getattr(self, name).update(value)
                else:
                    setattr(self, name, value)
        self._do(change)

    def hold(self, *ways):
        """Nothing passes; it comes later, as over a network that was away."""
        self._do(lambda: [self.flowing[way].clear() for way in ways])

    def half_open(self):
        """The connections there are carry nothing any more, and nobody is told."""
        def kill():
            for passage in self.passages:
                passage.dead = True
        self._do(kill)

    def end_all(self, reset=True):
        self._do(lambda: [passage.end(reset) for passage in list(self.passages)])

    def refuse(self, on):
        """Nobody listens."""
        async def change():
            if on and self.server:
                self.server.close()
                self.server = None
            elif not on and not self.server:
                await self._listen()
        self.loop.call(change())

    def close(self):
        self.refuse(True)
        self.end_all()


# --- Lies: the judge must find them ----------------------------------------------------------

def lie_of(kind, way, size):
    """A lie about now and then a block of `size` bytes. kind: tear (half of it is of the block before), repeat (the block
    of five before), drop (it and all later ones, the one before is sent instead), swap (of two halves)."""
    every = 40 if way == TO_IOC else 7  # fewer go to the PLC

    def lie(at, data, state):
        if at == way and "frozen" in state:
            return state["frozen"]
        if at != way or len(data) != size:
            return data
        seen = state.setdefault("seen", [])
        seen.append(data)
        count = state["count"] = state.get("count", 0) + 1
        del seen[:-6]
        if count < every:
            return data
        if kind == "drop":
            state["frozen"] = seen[-2]
            return seen[-2]
        if count % every:
            return data
        if kind == "tear":
            return data[:size // 2] + seen[-2][size // 2:]
        return seen[0]
    lie.way = way
    return lie
