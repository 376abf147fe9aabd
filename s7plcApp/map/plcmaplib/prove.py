"""Runs plcSim and s7plcIoc, both from what was generated, against each other on loopback, and
compares every value: the PLC sets, the record shows; the record puts, the PLC holds.

Talks to the IOC through its shell (dbgf, dbpf), so that it needs no CA client, and to plcSim
through its console.
"""
import os
import random
import re
import select
import shutil
import socket
import subprocess
import sys
import tempfile
import time

from .outputs import contents
from .outputs.records import records
from .problems import Place, Refused
from .proveplaces import number, places, plain
from .provevalues import same, values
from .types import Array

PATIENCE = 30.0  # s for anything to happen
SETTLE = 10.0   # s until values agree
BATCH = 400      # console commands at a time
QUICK = 20       # ms from block to block: values are proved, not times
PROBES = "plcmap:prove:"
PART = 100       # elements of an array that dbgf shows, whatever their type
SHOWN = 40       # differences that are printed


class Simulator:
    """plcSim with its console."""

    def __init__(self, program, file, folder):
        self.path = os.path.join(folder, "plc.sock")
        self.log = open(os.path.join(folder, "plcSim.log"), "w+")
        with open(file) as f:
            text = f.read()
        self.addresses = addresses("\nrole      = pair" in text)
        words = [program, "-n", "-a", self.addresses[0], "-o", "period=%d" % QUICK, "-c", self.path]
        words += self._ports(text)
        self.process = subprocess.Popen(words + [file], stdin=subprocess.DEVNULL, stdout=self.log,
                                        stderr=subprocess.STDOUT)
        self.text = self._wait_for("console on")
        self.port = self._port(r"listening on .*:(\d+)$", "Modbus")  # blocks, or EtherNet/IP
        self.modbus = self._port(r"Modbus listening on .*:(\d+)$", None)
        self.socket = socket.socket(socket.AF_UNIX)
        self.socket.connect(self.path)
        self.rest = b""

    @staticmethod
    def _ports(text):
        """Options: any free ports."""
        if "\netherip_port" in text:
            return ["-o", "etherip_port=0"]
        if "\nrole      = pair" in text:
            return ["-p", free_ports(1)[0]]
        return ["-p", "0"] + (["-o", "modbus_port=0"] if "\nmodbus_port" in text else [])

    def _wait_for(self, text):
        end = time.monotonic() + PATIENCE
        while time.monotonic() < end:
            self.log.flush()
            with open(self.log.name) as f:
                found = f.read()
            if text in found:
                return found
            if self.process.poll() is not None:
                raise Refused("plcSim ended:\n%s" % found)
            time.sleep(0.02)
        raise Refused("plcSim does not start; its log: %s" % self.log.name)

    def _port(self, pattern, but):
        for line in self.text.splitlines():
            m = re.search(pattern, line)
            if m and not (but and but in line):
                return int(m.group(1))
        return None

    def ask(self, commands):
        """The answers, [text] without ok; an error is Refused."""
        answers = []
        for first in range(0, len(commands), BATCH):
            part = commands[first:first + BATCH]
            self.socket.sendall(("\n".join(part) + "\n").encode())
            answers += self._answers(part)
        return answers

    def _answers(self, part):
        found, lines = [], []
        while len(found) < len(part):
            while b"\n" not in self.rest:
                if not select.select([self.socket], [], [], PATIENCE)[0]:
                    raise Refused("plcSim does not answer \"%s\"" % part[len(found)])
                data = self.socket.recv(65536)
                if not data:
                    raise Refused("plcSim closed its console")
                self.rest += data
            line, self.rest = self.rest.split(b"\n", 1)
            text = line.decode(errors="replace").rstrip()
            if text == "ok":
                found.append("\n".join(lines))
                lines = []
            elif text.startswith("error: "):
                raise Refused("plcSim: %s: %s" % (part[len(found)], text))
            else:
                lines.append(text)
        return found

    def close(self):
        self.process.terminate()
        self.process.wait()
        self.log.close()


class Shell:
    """The IOC and its shell."""

    def __init__(self, program, script, folder, env):
        self.folder = folder
        self.log = open(os.path.join(folder, "ioc.log"), "wb")
        self.process = subprocess.Popen([program, script], stdin=subprocess.PIPE,
                                        stdout=subprocess.PIPE, stderr=self.log, env=env,
                                        cwd=folder)
        self.rest = b""
        self.count = 0
        self.run(["dbgf %sblocks" % PROBES])

    def run(self, commands):
        """The lines that commands print, each command's own line among them."""
        self.count += 1
        mark = "plcmap-mark-%d" % self.count
        path = os.path.join(self.folder, "batch.cmd")
        with open(path, "w") as f:
            f.write("\n".join(commands) + "\n")
        self.process.stdin.write(("< %s\necho %s\n" % (path, mark)).encode())
        self.process.stdin.flush()
        lines = []
        while True:
            line = self._line()
            if line == mark:
                return lines
            lines.append(line)

    def _line(self):
        while b"\n" not in self.rest:
            if not select.select([self.process.stdout], [], [], PATIENCE)[0]:
                raise Refused("the IOC does not answer; see %s" % self.log.name)
            data = os.read(self.process.stdout.fileno(), 65536)
            self.log.write(data)
            if not data:
                raise Refused("the IOC ended; see %s" % self.log.name)
            self.rest += data
        line, self.rest = self.rest.split(b"\n", 1)
        text = line.decode(errors="replace").rstrip()
        while text.startswith("epics> "):
            text = text[len("epics> "):]
        return text

    def get(self, names):
        """{name: value} of many fields."""
        lines = self.run(["dbgf \"%s\"" % n for n in names])
        found, current, text = {}, None, []
        for line in lines + ["dbgf \"\""]:
            m = re.match(r'^dbgf "(.*)"$', line)
            if not m:
                text.append(line)
                continue
            if current is not None:
                found[current] = parse(text)
            current, text = m.group(1), []
        return found

    def close(self):
        try:
            self.process.stdin.write(b"exit\n")
            self.process.stdin.close()
            self.process.wait(20)
        except (OSError, subprocess.TimeoutExpired):
            self.process.kill()
            self.process.wait()
        self.log.close()


_ESCAPE = re.compile(r"\\(x[0-9a-fA-F]{2}|[0-7]{3}|.)")
_NUMBER = re.compile(r"(-?(?:inf|nan|\d[\d.eE+-]*))(?: = -?0x[0-9a-f]+)?")


def parse(lines):
    """What dbgf printed: a text, a number, or a list."""
    text = " ".join(l.strip() for l in lines if l.strip())
    m = re.match(r"^DBF_(\w+?)(\[(\d+)\])?:\s*(.*)$", text)
    if not m:
        return text
    kind, is_list, rest = m.group(1), m.group(2), m.group(4)
    if rest.startswith("(empty)"):
        return "" if kind == "CHAR" else []
    if rest.startswith('"'):
        rest = re.sub(r'" \+ "', "", rest)  # a long one is printed in pieces
        return _ESCAPE.sub(lambda e: e.group(1)[-1:], rest[1:rest.rindex('"')])
    numbers = [number(n) for n in _NUMBER.findall(rest)]
    if is_list and kind != "CHAR":
        return numbers
    if kind == "CHAR" and numbers == [0]:
        return ""  # a long text of nothing but its NUL
    return numbers[0] if numbers else rest


def addresses(pair):
    """Where plcSim is: [address], of a pair two beside each other that are this process's own."""
    if not pair:
        return ["127.0.0.1"]
    number = os.getpid() * 2 % 0xFF0000 + 0x100
    return ["127.%d.%d.%d" % (n >> 16, n >> 8 & 255, n & 255) for n in (number, number + 1)]


def free_ports(number):
    """Ports that no other program listens on, below those that the system gives away itself:
    one of these could be a connection's by the time that the IOC binds it."""
    found = []
    for port in random.sample(range(10000, 20000), 10000):
        with socket.socket() as tcp, socket.socket(type=socket.SOCK_DGRAM) as udp:
            try:
                tcp.bind(("", port))
                udp.bind(("", port))
            except OSError:
                continue
        found.append(str(port))
        if len(found) == number:
            return found
    raise Refused("no port from 10000 to 19999 is free for the IOC")


class Proof:
    """One run."""

    def __init__(self, map_, args):
        self.map = map_
        self.verbose = args.verbose
        self.patience = args.patience
        self.places = places(map_)
        self.compared = 0
        self.differences = []
        self.failed = set()  # what has differed: it is not waited for again
        self.cases = [(leaf, records(map_, leaf), values(map_, leaf, n))
                      for n, leaf in enumerate(l for l in map_.leaves() if l.pv)]
        self.layers = self._layers()
        self.parts = parts(map_)

    def run(self, ioc, sim):
        """All rounds, of a pair two more with the other PLC; returns how many there were."""
        rounds = max([len(v) for _, _, v in self.cases] or [0])
        for turn in range(rounds):
            self.from_plc(ioc, sim, turn)
        for turn in range(max([len(v) for l, _, v in self.cases if l.dir != "in"] or [0])):
            self.to_plc(ioc, sim, turn)
        if self.map.plc["second"]:
            sim.ask(["switchover"])
            for turn in (2, 3):
                self.from_plc(ioc, sim, turn)
                self.to_plc(ioc, sim, turn)
        return rounds

    def _layers(self):
        """The cases, sorted out: in each list no two share bits of the PLC's memory."""
        layers = []
        for case in self.cases:
            bits = self.places.bits(case[0])
            for taken, cases in layers:
                if not taken & bits:
                    break
            else:
                taken, cases = set(), []
                layers.append((taken, cases))
            taken |= bits
            cases.append(case)
        return [cases for _, cases in layers]

    # --- names -----------------------------------------------------------------------------

    def pv(self, record):
        """The field that dbgf shows in full."""
        name = self.map.plc["prefix"] + record.name
        return name + ".VAL$" if record.type in ("lsi", "lso") else name

    # --- the two directions -------------------------------------------------------------------

    def note(self, what, expected, found):
        self.compared += 1
        if not same(expected, found):
            self.differences.append("%s: expected %r, found %r" % (what, expected, found))
        elif self.verbose:
            print("  %s = %r" % (what, found))

    def from_plc(self, ioc, sim, turn):
        """Round `turn`: all values are set in the PLC and read from the records."""
        for cases in self.layers:
            self._from_plc(ioc, sim, turn, cases)

    def _from_plc(self, ioc, sim, turn, cases):
        chosen, expected = [], []
        for leaf, made, choice in cases:
            if leaf.dir == "cmd" or (leaf.dir == "out" and not shown(self.map, leaf)):
                continue
            value = choice[turn % len(choice)]
            chosen.append((leaf, value.words))
            for record in made:
                expected.append((self.pv(record), value.shown))
                if value.severity is not None and leaf.dir == "in":
                    expected.append((self.map.plc["prefix"] + record.name + ".SEVR",
                                     value.severity))
        if chosen:
            sim.ask(self.places.set(chosen))
            self.settle(lambda names: self.read(ioc, names), expected)

    def read(self, ioc, names):
        """{name: value}; long arrays from their parts."""
        probes = [p for n in names for p, _, _ in self.parts.get(n, [])]
        ioc.run(['dbpf "%s.PROC" 1' % p for p in probes])
        found = ioc.get([n for n in names if n not in self.parts] + probes)
        for name in names:
            if name in self.parts:
                found[name] = sum((found[p] for p, _, _ in self.parts[name]
                                   if isinstance(found[p], list)), [])
        return found

    def settle(self, read, expected):
        """Compares; what differs is read again until it agrees or patience ends."""
        end = time.monotonic() + self.patience
        open_ = dict(expected)
        while True:
            found = read(list(open_))
            left = {n: v for n, v in open_.items() if not same(v, found.get(n))}
            if not set(left) - self.failed or time.monotonic() > end:
                self.failed |= set(left)
                for name, value in expected:
                    self.note(name, value, found.get(name) if name in left else value)
                return
            open_ = left
            time.sleep(0.05)

    def to_plc(self, ioc, sim, turn):
        """All outputs are put and the PLC's memory is read."""
        for cases in self.layers:
            self._to_plc(ioc, sim, turn, cases)

    def _to_plc(self, ioc, sim, turn, cases):
        puts, expected, back, leaves = {}, [], [], {}
        for leaf, made, choice in cases:
            choice = [v for v in choice if v.put is not None]
            if leaf.dir == "in" or not choice:
                continue
            value = choice[turn % len(choice)]
            key = leaf.symbol + " in the PLC"
            puts[key] = 'dbpf "%s" %s' % (self.pv(made[0]), _put_text(value.put))
            expected.append((key, _sim_value(leaf, value)))
            leaves[key] = leaf
            if value.severity is not None and leaf.dir == "out":
                back.append((self.map.plc["prefix"] + made[0].name + ".SEVR", value.severity))
            back += [(self.pv(r), value.shown) for r in made[1:]]
        if not puts:
            return
        self.wait_synced(ioc)

        def read(names):
            # a bit of a command goes back by itself; a put may have met a check of the PLC
            ioc.run([puts[n] for n in names])
            time.sleep(2.5 * QUICK / 1000)
            answers = sim.ask([self.places.get(leaves[n]) for n in names])
            return {n: self.places.answer(a, leaves[n]) for n, a in zip(names, answers)}
        self.settle(read, expected)
        if back:
            self.settle(lambda names: self.read(ioc, names), back)

    def wait_synced(self, ioc):
        if not self.map.on("sync"):
            return
        end = time.monotonic() + PATIENCE
        while True:
            ioc.run(['dbpf "%ssync.PROC" 1' % PROBES])
            state = ioc.get([PROBES + "sync"])[PROBES + "sync"]
            if state == "synced":
                return
            if time.monotonic() > end:
                raise Refused("the IOC is not synchronised but \"%s\"" % state)
            time.sleep(0.05)

    def wait_blocks(self, ioc):
        """Until the IOC has values."""
        end = time.monotonic() + PATIENCE
        while True:
            ioc.run(['dbpf "%sblocks.PROC" 1' % PROBES])
            if ioc.get([PROBES + "blocks"])[PROBES + "blocks"] == 1:
                return
            if time.monotonic() > end:
                raise Refused("no data from plcSim; see the logs")
            time.sleep(0.05)


def shown(map_, leaf):
    """The PLC shows what it holds of a setpoint."""
    return leaf.tx is not None or not map_.has_blocks()


def _put_text(value):
    if isinstance(value, list):
        return '"[%s]"' % ",".join(repr(v) for v in value)
    return '"%s"' % value


def _sim_value(leaf, value):
    """What plcSim's `get` prints, parsed."""
    words = value.words
    parsed = [plain(w, leaf) for w in words]
    return parsed if len(parsed) > 1 else parsed[0]


def _programs(args, pair):
    here = args.bin or os.path.dirname(os.path.realpath(sys.argv[0]))
    found = []
    for name in ("plcSim", "phoenixIoc" if pair else "s7plcIoc"):
        path = os.path.join(here, name)
        if not os.access(path, os.X_OK):
            raise Refused("no %s; --bin names the folder of plcSim and s7plcIoc"
                          % name, Place(here))
        found.append(os.path.abspath(path))
    return found


def parts(map_):
    """{record: [(probe, first element, elements)]} of arrays that are longer than dbgf shows."""
    found = {}
    for leaf in map_.leaves():
        count = leaf.type.count() if isinstance(leaf.type, Array) else 0
        for record in records(map_, leaf) if count > PART else []:
            if record.type in ("waveform", "aao"):
                name = map_.plc["prefix"] + record.name
                found[name] = [("%spart%d:%d" % (PROBES, len(found), n), n, min(PART, count - n))
                               for n in range(0, count, PART)]
    return found


def _probes(map_):
    """Records that show the state of the station, and parts of long arrays."""
    text = ('record(longin, "%sblocks") { field(DTYP, "S7plc stats") field(INP, "@%s/alive") }\n'
            'record(stringin, "%ssync") { field(DTYP, "S7plc stats") field(INP, "@%s/syncText") }\n'
            % (PROBES, map_.plc["name"], PROBES, map_.plc["name"]))
    types = {map_.plc["prefix"] + r.name: (dict(r.fields)["FTVL"], dict(r.fields)["NELM"])
             for leaf in map_.leaves() for r in records(map_, leaf) if r.type in ("waveform", "aao")}
    for name, probes in parts(map_).items():
        for probe, first, count in probes:
            text += ('record(subArray, "%s") { field(INP, "%s NPP") field(FTVL, "%s") field(MALM, "%s") '
                     'field(INDX, "%d") field(NELM, "%d") }\n'
                     % (probe, name, *types[name], first, count))
    return text


def _script(map_, folder, program, name):
    top = os.path.dirname(os.path.dirname(os.path.dirname(program)))
    ioc = os.path.basename(program)
    dbd = os.path.join(top, "dbd", ioc + ".dbd")
    if not os.path.exists(dbd):
        raise Refused("is not there: it belongs to %s" % program, Place(dbd))
    with open(os.path.join(folder, "probes.db"), "w") as f:
        f.write(_probes(map_))
    path = os.path.join(folder, "prove.cmd")
    with open(path, "w") as f:
        f.write('dbLoadDatabase("%s")\n%s_registerRecordDeviceDriver pdbbase\n< %s.cmd\n'
                's7plcSetOption "%s" sendInterval %d\ns7plcSetOption "%s" readPeriod 100\n'
                'dbLoadRecords("probes.db")\niocInit\n'
                % (dbd, ioc, name, map_.plc["name"], QUICK, map_.plc["name"]))
    return path


def _environment(map_, sim):
    who = re.sub(r"\W", "_", map_.plc["name"])
    env = dict(os.environ)
    ca_port, pva_port = free_ports(2)
    env.update({who + "_ADDRESS": sim.addresses[0], who + "_SECOND": sim.addresses[-1],
                who + "_PORT": str(sim.port or sim.modbus or 0),
                who + "_MODBUS_PORT": str(sim.modbus or 0), "MAPDIR": ".",
                "EPICS_CAS_INTF_ADDR_LIST": "127.0.0.1", "EPICS_CAS_AUTO_BEACON_ADDR_LIST": "NO",
                "EPICS_CAS_BEACON_ADDR_LIST": "127.0.0.1",
                "EPICS_CA_SERVER_PORT": ca_port,
                "EPICS_PVAS_INTF_ADDR_LIST": "127.0.0.1", "EPICS_PVA_SERVER_PORT": "0",
                "EPICS_PVA_BROADCAST_PORT": pva_port,
                "IOCSH_HISTEDIT_DISABLE": "1"})
    if map_.plc["wire"] == "modbus":
        env[who + "_PORT"] = str(sim.modbus)
    if map_.plc["wire"] == "etherip":
        env[who + "_ADDRESS"] = "127.0.0.1:%d" % sim.port
    return env


def prove(map_, args, simulator=Simulator):
    """True when all values agree. Prints what does not, and how many were compared.
    simulator: what plays the PLC, made from program, file and folder."""
    sim_program, ioc_program = _programs(args, bool(map_.plc["second"]))
    folder = os.path.abspath(args.keep or tempfile.mkdtemp(prefix="plcmap-"))
    os.makedirs(folder, exist_ok=True)
    sim = ioc = None
    began = time.monotonic()
    try:
        for file, data in contents(map_).items():
            with open(os.path.join(folder, file), "wb") as f:
                f.write(data)
        name = map_.name()
        sim = simulator(sim_program, os.path.join(folder, name + ".plc"), folder)
        script = _script(map_, folder, ioc_program, name)
        ioc = Shell(ioc_program, script, folder, _environment(map_, sim))
        proof = Proof(map_, args)
        proof.wait_blocks(ioc)
        rounds = proof.run(ioc, sim)
    finally:
        for process in (ioc, sim):
            if process is not None:
                process.close()
        if not args.keep:
            shutil.rmtree(folder, ignore_errors=True)
    for line in proof.differences[:SHOWN]:
        print(line)
    if len(proof.differences) > SHOWN:
        print("... and %d more" % (len(proof.differences) - SHOWN))
    print("%d values in %d rounds: %d comparisons, %d differ (%.1f s)" % (
        len(proof.cases), rounds, proof.compared, len(proof.differences),
        time.monotonic() - began))
    return not proof.differences and proof.compared > 0
