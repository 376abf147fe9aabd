"""Servers of EtherNet/IP that others have written, each in a process of its own.

    python eipservers.py cm <port> name=TYPE[count] ...     cm-ethernetip
    CpppoServer and CmServer start them for a test.
"""
import re
import subprocess
import sys
import threading
from pathlib import Path

from ports import free_port
from waiting import until

CODES = {"BOOL": 0xC1, "SINT": 0xC2, "INT": 0xC3, "DINT": 0xC4, "LINT": 0xC5, "REAL": 0xCA,
         "LREAL": 0xCB, "DWORD": 0xD3}


class Server:
    """A process that listens on self.port once it has started."""

    def __init__(self, *words):
        self.port = free_port()
        self.lines = []
        self.process = subprocess.Popen([sys.executable, *self.command(*words)],
                                        stdin=subprocess.DEVNULL, stdout=subprocess.PIPE,
                                        stderr=subprocess.STDOUT)
        threading.Thread(target=self._read, daemon=True).start()
        until(self.listens, lambda: "a server that listens:\n" + "\n".join(self.lines))

    def _read(self):
        for raw in self.process.stdout:
            self.lines.append(raw.decode(errors="replace").rstrip())

    def listens(self):
        """Looks without a connection: some servers say much about one that asks nothing."""
        assert self.process.poll() is None, "\n".join(self.lines)
        with open("/proc/net/tcp") as table:
            return any(f":{self.port:04X} 00000000:0000 0A" in line for line in table)

    def close(self):
        self.process.terminate()
        try:
            self.process.wait(10)
        except subprocess.TimeoutExpired:
            self.process.kill()
            self.process.wait()


class CmServer(Server):
    """cm-ethernetip: tags as "name=TYPE[count]"."""

    def command(self, *tags):
        return [str(Path(__file__).resolve()), "cm", str(self.port), *tags]


class CpppoServer(Server):
    """cpppo: tags as "name=TYPE[count]"."""

    def command(self, *tags):
        return ["-m", "cpppo.server.enip", "-a", f"127.0.0.1:{self.port}", "--no-udp", *tags]


def serve_cm(port, tags):
    import asyncio

    from ethernetip.cip.identity_info import IdentityInfo
    from ethernetip.logix.logix_dispatcher import LogixDispatcher
    from ethernetip.logix.tag_database import TagDatabase
    from ethernetip.protocol.eip_adapter import EipAdapter

    database = TagDatabase()
    for tag in tags:
        name, kind, count = re.fullmatch(r"(\w+)=(\w+)(?:\[(\d+)\])?", tag).groups()
        database.add_tag(name, CODES[kind], int(count or 1))
    identity = IdentityInfo(vendor_id=1, device_type=14, product_code=55, major_revision=20,
                            minor_revision=1, serial_number=1, product_name="1756-L61")

    async def serve():
        await EipAdapter(LogixDispatcher(database, identity), identity).listen("127.0.0.1", port)
        await asyncio.Event().wait()

    asyncio.run(serve())


if __name__ == "__main__":
    serve_cm(int(sys.argv[2]), sys.argv[3:])
