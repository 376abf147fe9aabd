"""A scenario: an IOC, a PLC, proxies between them, clients, and a thread that plays them by the plan.

What each transport adds is in blocks.py, pair.py, sync.py, modbus.py, etherip.py, tables.py, others.py.
"""
import collections
import os
import signal
import subprocess
import threading
import time
import warnings

os.environ["EPICS_CA_MAX_SEARCH_PERIOD"] = "60"  # s, the least there is: a channel that was lost must come back
import client  # noqa: E402  sets the environment before anything loads libca
import epics  # noqa: E402
from ioc import Ioc  # noqa: E402
from sim import Sim  # noqa: E402

from . import clock, judge, plan, pva, wire  # noqa: E402
from .plan import Fault  # noqa: E402

warnings.filterwarnings("ignore", "ca.get", UserWarning)  # what took too long is asked again, and judged

PATIENCE = 90.0  # s, for what must come in the end, of a machine that keeps up: judge.Patience
WRITE = 2        # alarm status
PVA = "by PVA "  # before the name of a record

WIRE = [Fault("reset", 3), Fault("close", 3), Fault("half-open", 4, 0.5, 4),
        Fault("hold", 4, 0.1, 5), Fault("hold in", 2, 0.1, 4), Fault("hold out", 2, 0.1, 4),
        Fault("trickle", 3, 0.5, 4), Fault("delay", 3, 0.5, 4), Fault("pieces", 3, 0.5, 3),
        Fault("cut in", 3), Fault("cut out", 3), Fault("refuse", 2, 0.1, 3)]
PLC = [Fault("restart", 3, 0.1, 2), Fault("kill", 2, 0.1, 2)]
IOC = [Fault("stop", 3, 0.1, 4), Fault("pause", 2, 0.1, 2), Fault("exit", 2), Fault("ioc killed", 1),
       Fault("options", 4, 0.2, 2), Fault("links", 3), Fault("clock", 2, 0.2, 3), Fault("burst", 4, 0.1, 1)]


class Pulse:
    """How late this machine is: a thread that wants to be woken every 20 ms."""

    def __init__(self):
        self.late = collections.deque(maxlen=1000)
        threading.Thread(target=self.run, daemon=True).start()

    def run(self):
        while True:
            begin = time.monotonic()
            time.sleep(0.02)  # how late does the machine wake a thread
            end = time.monotonic()
            if end - begin > 0.04:
                self.late.append((end, end - begin - 0.02))

    def worst(self, seconds=10.0):
        """By how much it was late, in s."""
        since = time.monotonic() - seconds
        return max((late for at, late in list(self.late) if at > since), default=0.0)

    def slack(self):
        """What must be allowed for it now, in s."""
        return 0.6 + 3 * self.worst()


def record(kind, name, link, more="", dtyp="S7plc", plc="@PLC/"):
    """A record of the IOC; inputs process by I/O Intr."""
    field = "OUT" if kind in ("int64out", "bo") else "INP"
    scan = 'field(SCAN, "I/O Intr")' if field == "INP" else ""
    return (f'record({kind}, "$(P){name}") {{ field(DTYP, "{dtyp}") field({field}, "{plc}{link}") '
            f'{scan} {more} }}\n')


class World:
    """FAULTS, NAME, PROGRAM, ORDER, TIMEOUT and the functions marked with `hook` are each transport's own."""

    NAME = ""
    PROGRAM = "s7plcIoc"
    ORDER = ">"
    TIMEOUT = 2.0    # s: a value that is older has an alarm
    ACKNOWLEDGED = False
    ONE_CLIENT = True  # the PLC serves one connection, the newest
    FAULTS = []
    APART = ()       # faults that are told from each other only when they come alone
    PLC_TEXT = ""
    INPUTS = ("n", "w", "a", "z")
    OUTPUTS = 3
    LIFE = 12        # episodes of one IOC, at most
    PORTS = ("port",)

    def __init__(self, directory, seed, instance, recorder, lie=None, say=print):
        self.directory, self.seed, self.recorder = directory, seed, recorder
        self.key = f"{self.NAME}-{instance}"
        self.say = say
        self.lie = lie if lie and lie.way == wire.TO_IOC else None
        self.lie_of_episodes = lie
        self.pulse = Pulse()
        self.loop = wire.Loop()
        self.inputs = judge.Inputs(self.TIMEOUT)
        self.outputs = judge.Outputs(self.ACKNOWLEDGED)
        self.lock = threading.Lock()  # inputs, outputs: proxies tell while the main thread asks
        self.failure = None
        self.dice = plan.chance(seed, self.key, "world")
        self.sim = self.ioc = None
        self.proxies = []
        self.events = collections.deque()
        self.pva = pva.Pva(lambda *what: self.events.append((PVA + what[0], *what[1:])))
        self.pending = {}     # record -> (number, begin, [done], patience is over)
        self.stopped = self.paused = False
        self.acknowledged = self.ACKNOWLEDGED
        self.losses = 0
        self.lives = 0
        self.fault = None     # of an episode with one alone: figures are its
        self.fault_end = None
        self.invalid_since = None
        self.clock_file = directory / "clock"
        self.base = None

    def log(self, text):
        self.say(f"{self.recorder.now():9.3f} {self.key} {text}")

    def fail(self, error):
        """From any thread: the first one counts."""
        if self.failure is None:
            self.failure = error

    def check(self):
        if self.failure is not None:
            raise self.failure

    def patience(self):
        """A function that says when waiting is over, to be asked often; its `words` say how long that was."""
        patience = judge.Patience(PATIENCE, time.monotonic())

        def over():
            now = time.monotonic()
            return patience.over(now, self.pulse.worst(now - patience.at + 1.0))
        over.words = patience.words
        return over

    # --- The PLC --------------------------------------------------------------------------

    def start_plc(self):
        self.sim = self.new_sim()
        for proxy in self.proxies:
            proxy.target = self.target(proxy)

    def new_sim(self):  # hook
        return Sim(self.directory, self.PLC_TEXT)

    def target(self, proxy):  # hook
        return "127.0.0.1", self.sim.port

    def finders(self):  # hook
        return {wire.TO_IOC: lambda: judge.ProbeFinder(self.ORDER),
                wire.TO_PLC: lambda: judge.PutFinder(self.ORDER)}

    def new_proxy(self, **where):
        proxy = wire.Proxy(self.loop, ("127.0.0.1", 0), finders=self.finders(), on_passed=self.passed,
                           on_ended=self.passage_ended, one_client=self.ONE_CLIENT,
                           seed=self.seed, **where)
        proxy.lie = self.lie
        self.proxies.append(proxy)
        proxy.target = self.target(proxy)
        return proxy

    def passed(self, way, what, passage, now):
        """In the proxies' thread."""
        try:
            with self.lock:
                if way == wire.TO_IOC:
                    self.inputs.delivered(now, what)
                else:
                    self.plc_got(what, passage, now)
        except judge.Wrong as error:
            self.fail(error)

    def plc_got(self, what, passage, now):  # hook
        record, number = what
        self.outputs.got(record, number, passage.number, now)

    def passage_ended(self, passage, now):
        self.losses += 1
        with self.lock:
            if not any(proxy.passages for proxy in self.proxies):
                self.connection_ended(now)

    def connection_ended(self, now):  # hook
        self.inputs.ended(now)

    def console(self, text):
        """plcSim may be dead just now."""
        try:
            return self.sim.command(text)
        except (OSError, AssertionError) as error:
            self.log(f"plcSim: {text}: {error}")
            return ""

    # --- The IOC --------------------------------------------------------------------------

    def configure(self, dice):  # hook
        """Lines of st.cmd before the records."""
        return ""

    def database(self):  # hook
        return ""

    def start_ioc(self):
        dice = plan.chance(self.seed, self.key, "life", self.lives)
        self.lives += 1
        lines = self.configure(dice)
        self.log("IOC " + " | ".join(lines.splitlines()))
        self.clock_file.write_bytes(bytes(8))
        env = None
        if (self.directory.parent / "clockstep.so").exists():
            env = clock.environment(self.directory.parent, client.TOP / "bin" / client.ARCH / self.PROGRAM,
                                    self.clock_file)
        self.ioc = Ioc(self.directory, lines, self.database(), program=self.PROGRAM, env=env)
        with self.lock:
            self.inputs.forget()
            self.outputs.new_ioc()
            self.inputs.begins("loose", time.monotonic())
        self.ioc.start(self.patience())
        self.pvs, self.pending = {}, {}
        self.invalid_since = None
        for name in self.inputs_of_client() + self.outputs_of_client():
            self.pvs[name] = epics.PV(self.ioc.P + name, auto_monitor=False, form="time")
        self.alarmed = {}     # output -> when it was last heard to have an alarm
        self.monitors = [epics.PV(self.ioc.P + name, auto_monitor=True, form="time",
                                  callback=self.hears(name, self.lives))
                         for name in self.watched() + self.outputs_of_client()]
        self.pva.listen(self.ioc.P, self.INPUTS)
        self.all_connected("no channel to")
        self.stopped = self.paused = False
        self.base = None
        for record in range(1, self.OUTPUTS + 1):
            self.put(record)

    def all_connected(self, what):
        over = self.patience()
        for pv in [*self.pvs.values(), *self.monitors]:
            while not pv.wait_for_connection(1.0):
                if over():
                    raise judge.Wrong("stuck", f"{what} {pv.pvname} for {over.words()}")

    def inputs_of_client(self):
        return list(self.INPUTS)

    def outputs_of_client(self):
        return [f"o{i}" for i in range(1, self.OUTPUTS + 1)]

    def watched(self):
        return [self.INPUTS[0], "a", self.INPUTS[-1]]

    def hears(self, name, life):
        def heard(value=None, severity=None, **_):
            if life == self.lives:
                self.events.append((name, value, severity, time.monotonic()))
        return heard

    def end_ioc(self, how="exit"):
        """exit: in any state; status 0 and in time. kill: as a machine that goes off."""
        for pv in [*self.pvs.values(), *self.monitors]:
            pv.disconnect()
        self.pva.forget()
        self.events.clear()
        if how == "kill":
            self.ioc.process.kill()
            self.ioc.process.wait()
            self.ioc.drop_clients()
        else:
            begin = time.monotonic()
            status = self.ioc.exit(self.patience())
            self.recorder.figure("exit", self.NAME, time.monotonic() - begin)
            if status != 0:
                raise judge.Wrong("wrong", f"the IOC ended with status {status}")
        self.ioc.process.stdin and self.ioc.process.stdin.close()
        self.keep_log()

    def keep_log(self):
        with open(self.directory / "ioc.log", "w") as file:
            file.write(self.ioc.log)

    def shell(self, text):
        if not self.stopped:
            return self.ioc.command(text, self.patience())
        return ""

    # --- The client -----------------------------------------------------------------------

    def answering(self):
        return not self.stopped and not self.paused

    def ask(self, name):
        """(value, severity, status, begin, end) of a record."""
        over = self.patience()
        failure = None
        begin = time.monotonic()  # of the request: one that is late is waited for, no other one is made
        while True:
            try:  # form: else the type is what it was when the channel came, which may be no type
                got = self.pvs[name].get_with_metadata(use_monitor=False, timeout=1.0, form="time", as_string=False)
            except (epics.ca.ChannelAccessException, epics.ca.ChannelAccessGetFailure) as error:
                failure, got = error, None  # CA has lost the channel for a moment, as after iocPause
                self.pvs[name].wait_for_connection(1.0)
                begin = time.monotonic()
            if got and got["value"] is not None:
                return got["value"], got["severity"], got["status"], begin, time.monotonic()
            self.ended_well()
            if over():
                raise judge.Wrong("stuck", f"no answer to caget {name} in {over.words()}; {failure or 'no error'}; "
                                           f"another client: {self.second_opinion(name)}")

    def second_opinion(self, name):
        """Who is deaf, the IOC or this client?"""
        try:
            done = subprocess.run([str(client.BASE / "bin" / client.ARCH / "caget"), "-w", "10", self.ioc.P + name],
                                  stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, timeout=60)
        except (OSError, subprocess.TimeoutExpired) as error:
            return repr(error)
        return done.stdout.strip()

    def threads(self):
        """What each thread of the IOC does, where there is a debugger."""
        try:
            return subprocess.run(["gdb", "-p", str(self.ioc.process.pid), "-batch", "-ex", "thread apply all bt 12"],
                                  stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.STDOUT,
                                  text=True, timeout=120).stdout
        except (OSError, subprocess.TimeoutExpired) as error:
            return repr(error)

    def ended_well(self):
        """The IOC must not end by itself."""
        if self.ioc.process.poll() is not None:
            raise judge.Wrong("wrong", f"the IOC ended by itself, status {self.ioc.process.returncode}")

    def array(self, value):  # hook
        return list(value)

    def number(self, name, value):
        """The block that a value is of."""
        if hasattr(value, "__len__"):
            return judge.whole(name, [int(v) for v in self.array(value)])
        return int(value)

    def look(self, name):
        """Asks for an input and judges it; true when it has no alarm."""
        value, severity, _, begin, end = self.ask(name)
        return self.judged(name, value, severity, begin, end)

    def look_by_pva(self, name):
        over = self.patience()
        got = None
        while got is None:
            begin = time.monotonic()
            got = self.pva.get(self.ioc.P + name)
            self.ended_well()
            if got is None and over():
                raise judge.Wrong("stuck", f"no answer to pvget {name} in {over.words()}")
        self.recorder.count("PVA gets")
        return self.judged(PVA + name, *got, begin, time.monotonic())

    def judged(self, name, value, severity, begin, end):
        """Judges what was asked; true when it has no alarm."""
        invalid = severity != 0
        if not invalid or hasattr(value, "__len__") and len(value) > 1:
            number = self.number(name, value)
            with self.lock:
                self.inputs.got(name, begin, end, number, invalid, self.pulse.slack())
        return not invalid

    def put(self, record):
        """A put with callback, if the one before has ended."""
        if record in self.pending:
            return
        with self.lock:
            value = self.outputs.put(record, time.monotonic())
        done = []
        self.pending[record] = (value & 0xFFFFFF, time.monotonic(), done, self.patience())
        self.pvs[f"o{record}"].put(float(value), wait=False, callback=lambda **kw: done.append(1))
        self.recorder.count("puts")

    def completions(self):
        """Looks which puts have ended, and how."""
        for record, (number, begin, done, over) in list(self.pending.items()):
            if done:
                if not self.answering():
                    continue
                del self.pending[record]
                value, severity, status, _, _ = self.ask(f"o{record}")
                self.heard()
                if self.alarmed.get(f"o{record}", 0) > begin:  # it was waiting for the PLC, and that is back
                    severity = severity or 3
                with self.lock:
                    self.put_ended(record, number, int(value), severity, status)
            elif over() and self.answering():
                raise judge.Wrong("stuck", f"put {number} to o{record} does not end, {over.words()}")

    def put_ended(self, record, number, value, severity, status):  # hook
        if self.acknowledged and severity == 0 and value == judge.setpoint(record, number):
            self.outputs.acknowledged_put(record, number)

    def heard(self):
        """Judges what monitors have told."""
        while self.events:
            name, value, severity, at = self.events.popleft()
            if name[0] == "o" and severity:
                self.alarmed[name] = at
            if name in (self.INPUTS[0], "primary"):
                self.watch(name, severity, at, value)
            if name.removeprefix(PVA) in self.INPUTS and severity == 0:
                with self.lock:
                    self.inputs.event(name, self.number(name, value))

    def watch(self, name, severity, at, value):
        """Figures of gaps."""
        if name != self.INPUTS[0]:
            return
        if severity and self.invalid_since is None:
            self.invalid_since = at
            if self.fault and self.inputs.times:
                self.recorder.figure("last block to INVALID", self.fault, at - self.inputs.times[-1]
                                     if at > self.inputs.times[-1] else 0.0)
        elif not severity and self.invalid_since is not None:
            if self.fault:
                self.recorder.figure("gap", self.fault, at - self.invalid_since)
            self.invalid_since = None

    # --- Episodes -------------------------------------------------------------------------

    def act(self, dice):
        """Something that people do."""
        self.put(1 + dice.randrange(self.OUTPUTS))

    def turn(self, dice):
        """One look, one deed."""
        self.check()
        self.heard()
        if not self.stopped:
            self.ended_well()
        if dice.random() < 0.5:
            self.act(dice)
        if self.answering():
            name = dice.choice(self.INPUTS)
            if self.pva.context and dice.random() < 0.1:
                self.look_by_pva(name)
            else:
                self.look(name)
            self.completions()

    def work(self, dice, until):
        while time.monotonic() < until:
            self.turn(dice)
            # the pace of the clients
            time.sleep(min(dice.uniform(0.02, 0.25), max(0, until - time.monotonic())))

    def episode(self, episode):
        dice = plan.chance(episode.dice)
        self.log(f"episode {episode.number}: {episode.words()}")
        self.fault = episode.steps[0].fault if len(episode.steps) == 1 else None
        running = []
        for step in episode.steps:
            self.work(dice, time.monotonic() + step.wait)
            self.recorder.fault(step.fault)
            run = getattr(self, "fault_" + step.fault.replace(" ", "_").replace("-", "_"))(
                plan.chance(step.dice), step.seconds)
            now = time.monotonic()
            with self.lock:
                self.inputs.begins("loose", now)
            if next(run, None) is None:
                running.append((now + step.seconds, run, step.fault))
        for end, run, _ in sorted(running, key=lambda each: each[0]):
            self.work(dice, end)
            next(run, None)
        self.fault_end = time.monotonic()
        self.normal()
        self.settle(dice)
        self.recorder.data["episodes"] += 1

    def normal(self):
        """All faults end."""
        for proxy in self.proxies:
            proxy.refuse(False)
            proxy.normal()
        self.console("normal")

    def leading(self):  # hook
        """The proxies by which blocks come."""
        return self.proxies

    def settled(self):
        """None, or what is not yet as it must be."""
        if any(passage.dead for proxy in self.leading() for passage in list(proxy.passages)):
            return "a connection is half-open, which the IOC has to find out"
        for name in self.inputs_of_client():
            value, severity, _, begin, end = self.ask(name)
            if name in self.INPUTS:
                self.judged(name, value, severity, begin, end)
            if severity:
                return f"{name} has severity {severity}"
            with self.lock:
                if name in self.INPUTS and self.number(name, value) not in list(self.inputs.numbers)[-20:]:
                    return f"{name} shows block {value}"
        if self.pending:
            return f"puts do not end: {self.pending}"
        return self.outputs_settled()

    def outputs_settled(self):  # hook
        for record in range(1, self.OUTPUTS + 1):
            wanted = self.outputs.puts.get(record, [None])[-1]
            if wanted is None:
                continue
            value, severity, *_ = self.ask(f"o{record}")
            if severity:
                return f"o{record} has severity {severity}"
            if int(value) != judge.setpoint(record, wanted):
                raise judge.Wrong("wrong", f"o{record} has {int(value):#x} after put {wanted}")
            if self.outputs.last.get(record) != wanted:
                return f"output {record}: put {wanted} was the last, the PLC has {self.outputs.last.get(record)}"
        return None

    def settle(self, dice):
        """After the faults: all must be well in the end, and stay so."""
        over = self.patience()
        well = None
        while well is None:
            well = self.comes_well(over)
            with self.lock:
                self.inputs.over("loose", time.monotonic())
                self.inputs.over("blind", time.monotonic())
            for record in range(1, self.OUTPUTS + 1):
                self.held_at_rest(record)
            if not self.rests(dice):  # a connection ended meanwhile, by a fault: all begins anew
                well = None
                if over():
                    raise judge.Wrong("stuck", f"connections end again and again, {over.words()} after the faults")
        if self.fault and self.fault_end:
            self.recorder.figure("well again", self.fault, well - self.fault_end)
        self.resources()
        self.counts()
        self.fault = None

    def comes_well(self, over):
        """Waits for that; returns since when."""
        good = 0
        while good < 3:
            self.check()
            self.heard()
            self.completions()
            self.ended_well()
            last = self.settled()
            good = good + 1 if last is None else 0
            if good == 1:
                well = time.monotonic()
                self.whole_at = self.losses
            if last and over():
                raise judge.Wrong("lost" if "was the last" in last else "stuck",
                                  f"not well {over.words()} after the faults: {last}")
            time.sleep(0.1)  # the pace of the looks
        return well

    def rests(self, dice):
        """No alarm without a reason; false when there was one since all has been well."""
        end = time.monotonic() + 0.4
        while time.monotonic() < end:
            name = dice.choice(self.INPUTS)
            if not self.look(name) and self.losses == self.whole_at and \
                    time.monotonic() - self.inputs.times[-1] < self.TIMEOUT / 2 and self.pulse.slack() < 1:
                raise judge.Wrong("wrong", f"{name} is INVALID although all is well")
            time.sleep(0.05)  # the pace of the looks
        return self.losses == self.whole_at

    def held_in_the_end(self, record):
        """What the PLC holds when it has done what it was asked to do."""
        wanted, over = self.outputs.puts[record][-1], self.patience()
        while True:
            value = self.held(record)
            if value == judge.setpoint(record, wanted) or over():
                return value
            if self.losses != self.whole_at:  # a connection ended meanwhile: all begins anew
                return None
            time.sleep(0.05)

    def held_at_rest(self, record):  # hook
        with self.lock:
            self.outputs.quiet(record)

    def held_as_asked(self, record):
        """The same where the PLC can be asked what it has in its memory (`held`)."""
        self.outputs.refusing = False  # now: a busy PLC is asked again and again
        value = self.held_in_the_end(record)
        if value is None:
            return
        put = judge.put_of(value)
        with self.lock:
            self.outputs.quiet(record)
            self.outputs.quiet(record, held=put and put[1])

    def counts(self):
        counts = self.recorder.data["counts"]
        with self.lock:
            counts["values judged"] = self.inputs.judged
            counts["setpoints judged"] = self.outputs.judged
            for latency in self.outputs.latencies:
                self.recorder.figure("put to PLC", self.NAME, latency)
            self.outputs.latencies.clear()
        self.recorder.figure("machine late", self.NAME, self.pulse.worst())
        self.recorder.write(5)

    def resources(self):
        rss, descriptors = self.recorder.sample(self.ioc.process)
        if self.base is None:
            self.base = (rss, descriptors)
        elif rss - self.base[0] > 40e6 or descriptors - self.base[1] > 8:
            raise judge.Wrong("grown", f"the IOC has {rss} bytes and {descriptors} descriptors, "
                                       f"{self.base[0]} and {self.base[1]} when it was young")

    def run(self, seconds, episodes=None):
        """Until the time is over, or so many episodes."""
        self.start_plc()
        self.begin_proxies()
        self.start_ioc()
        self.fault_end = None
        self.settle(self.dice)
        self.lie = self.lie_of_episodes  # to the PLC only now: the first puts alone may be enough for it
        for proxy in self.proxies:
            proxy.lie = self.lie
        number = young = 0
        while self.recorder.now() < seconds and (episodes is None or number < episodes):
            lives = self.lives
            self.episode(plan.episode(self.seed, self.key, number, self.FAULTS, self.APART))
            number += 1
            young = young + 1 if lives == self.lives else 0
            if young >= self.LIFE:
                self.another_ioc("exit")
                self.settle(self.dice)
                young = 0
        self.end_ioc()
        self.recorder.data["ended"] = True
        self.recorder.write()

    def begin_proxies(self):  # hook
        self.new_proxy()

    def another_ioc(self, how):
        self.end_ioc(how)
        self.start_ioc()

    def close(self):
        if self.ioc and self.ioc.process.poll() is None:
            self.ioc.process.kill()
            self.ioc.process.wait()
        if self.sim:
            self.sim.process.kill()
            self.sim.process.wait()
        for proxy in self.proxies:
            proxy.close()
        self.pva.close()

    # --- Faults: generators, `yield` until the fault is to end --------------------------------

    def some(self, dice):
        """One of the proxies, or all."""
        return dice.choice([*[[p] for p in self.proxies], self.proxies])

    def fault_reset(self, dice, seconds):
        for proxy in self.some(dice):
            proxy.end_all(reset=True)
        yield

    def fault_close(self, dice, seconds):
        for proxy in self.some(dice):
            proxy.end_all(reset=False)
        yield

    def fault_half_open(self, dice, seconds):
        for proxy in self.some(dice):
            proxy.half_open()
        yield

    def _hold(self, dice, *ways):
        chosen = self.some(dice)
        for proxy in chosen:
            proxy.hold(*ways)
        yield
        for proxy in chosen:
            proxy.normal()

    def fault_hold(self, dice, seconds):
        yield from self._hold(dice, wire.TO_IOC, wire.TO_PLC)

    def fault_hold_in(self, dice, seconds):
        yield from self._hold(dice, wire.TO_IOC)

    def fault_hold_out(self, dice, seconds):
        yield from self._hold(dice, wire.TO_PLC)

    def _set(self, dice, **faults):
        chosen = self.some(dice)
        for proxy in chosen:
            proxy.set(**faults)
        yield
        for proxy in chosen:
            proxy.normal()

    def fault_trickle(self, dice, seconds):
        yield from self._set(dice, bite={wire.TO_IOC: dice.randint(1, 20), wire.TO_PLC: dice.randint(1, 8)},
                             pause={wire.TO_IOC: dice.uniform(0.001, 0.05), wire.TO_PLC: dice.uniform(0.001, 0.03)})

    def fault_pieces(self, dice, seconds):
        yield from self._set(dice, bite={wire.TO_IOC: dice.randint(20, 90), wire.TO_PLC: dice.randint(5, 30)},
                             pause={wire.TO_IOC: dice.uniform(0.0005, 0.01), wire.TO_PLC: dice.uniform(0.0005, 0.01)})

    def fault_delay(self, dice, seconds):
        yield from self._set(dice, delay={wire.TO_IOC: dice.uniform(0, 0.4), wire.TO_PLC: dice.uniform(0, 0.4)})

    def fault_slip(self, dice, seconds):
        yield from self._set(dice, slips=dice.choice((-1, 1)) * dice.randint(1, 40))

    def fault_cut_in(self, dice, seconds):
        yield from self._set(dice, cut=(wire.TO_IOC, dice.randint(1, 200)))

    def fault_cut_out(self, dice, seconds):
        yield from self._set(dice, cut=(wire.TO_PLC, dice.randint(1, 100)))

    def fault_refuse(self, dice, seconds):
        for proxy in self.proxies:
            proxy.refuse(True)
            proxy.end_all()
        yield
        for proxy in self.proxies:
            proxy.refuse(False)

    def fault_restart(self, dice, seconds):
        self.console(f"restart {int(seconds * 1000)}")
        yield

    def fault_kill(self, dice, seconds):
        """The PLC's process dies, its connections with it, by RST; it comes back with nothing in its memory."""
        for proxy in self.proxies:
            proxy.refuse(True)
            proxy.end_all()
        self.sim.process.kill()
        self.sim.process.wait()
        self.sim.console.close()
        self.plc_died()
        yield
        self.start_plc()
        for proxy in self.proxies:
            proxy.refuse(False)

    def plc_died(self):  # hook
        pass

    def fault_stop(self, dice, seconds):
        self.ioc.process.send_signal(signal.SIGSTOP)
        self.stopped = True
        with self.lock:
            self.inputs.begins("blind", time.monotonic())
        yield
        self.ioc.process.send_signal(signal.SIGCONT)
        self.stopped = False
        time.sleep(self.pulse.slack() / 2)  # what was held up in sockets is taken meanwhile
        with self.lock:
            self.inputs.over("blind", time.monotonic())

    def fault_pause(self, dice, seconds):
        if self.stopped:
            return
        self.shell("iocPause")
        self.paused = True
        with self.lock:
            self.inputs.begins("blind", time.monotonic())
        yield
        if self.stopped:
            self.ioc.process.send_signal(signal.SIGCONT)
            self.stopped = False
        self.shell("iocRun")
        self.channels_again()
        self.paused = False
        with self.lock:
            self.inputs.over("blind", time.monotonic())

    def channels_again(self):
        """iocPause ends the connections of CA clients: what became of puts under way nobody knows."""
        self.all_connected("after iocRun no channel to")
        self.losses += 1
        unknown = list(self.pending)
        self.pending.clear()
        for record in unknown:
            self.put_again(record)

    def put_again(self, record):  # hook
        self.put(record)

    def _another(self, how):
        if self.stopped or self.paused:
            return
        self.another_ioc(how)
        yield

    def fault_exit(self, dice, seconds):
        yield from self._another("exit")

    def fault_ioc_killed(self, dice, seconds):
        yield from self._another("kill")

    OPTIONS = {}  # key -> values to try; the first one is put back

    def fault_options(self, dice, seconds):
        key = dice.choice(sorted(self.OPTIONS))
        self.shell(f"s7plcSetOption PLC {key} {dice.choice(self.OPTIONS[key])}")
        yield
        self.shell(f"s7plcSetOption PLC {key} {self.OPTIONS[key][0]}")

    LINKS = ()  # (record, field, other link, own link)

    def fault_links(self, dice, seconds):
        record, field, other, own = dice.choice(self.LINKS)
        if not self.answering():
            return
        for link in (other, own):
            epics.caput(f"{self.ioc.P}{record}.{field}", link, wait=True, timeout=PATIENCE)
        yield

    def fault_clock(self, dice, seconds):
        """The time of day jumps, and back in the end."""
        step = dice.choice((-1, 1)) * dice.choice((0.3, 2.0, 30.0, 3600.0))
        self.set_clock(step)
        yield
        self.set_clock(0)

    def set_clock(self, step):
        """In place: the file is in the IOC's memory."""
        with open(self.clock_file, "r+b") as file:
            file.write(int(step * 1e9).to_bytes(8, "little", signed=True))

    def fault_burst(self, dice, seconds):
        """Puts as fast as they end."""
        end = time.monotonic() + seconds
        while time.monotonic() < end and self.answering():
            for record in range(1, self.OUTPUTS + 1):
                self.put(record)
            self.completions()
            time.sleep(0.002)  # the pace of the writer
        yield
