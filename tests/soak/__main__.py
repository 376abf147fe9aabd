"""`make soak`: all scenarios side by side, each in a process of its own; then one report.

    python -m soak [--duration 10m] [--seed N] [--transports blocks,pair ...] [--instances 1] [--out DIR]

Status 1: something was lost, doubled, torn, stale or wrong; the last lines say what, and how to do it again.
"""
import argparse
import json
import os
import random
import re
import signal
import subprocess
import sys
import time
import traceback
from pathlib import Path

HERE = Path(__file__).resolve().parent
sys.path[:0] = [str(HERE.parent / "system"), str(HERE.parent)]

TRANSPORTS = {"blocks": "blocks.Blocks", "pair": "pair.Pair", "sync": "sync.Sync", "tables": "tables.Tables",
              "modbus": "modbus.Modbus", "etherip": "etherip.EtherIp", "pymodbus": "others.PyModbus",
              "cpppo": "others.Cpppo"}
PROGRAMS = ("blockStressTest", "pairStressTest", "syncStressTest", "slipStressTest", "recordStressTest")
LIES = ("tear", "repeat", "drop")


def seconds(text):
    """90, 90s, 10m, 1.5h."""
    match = re.fullmatch(r"(\d+(?:\.\d+)?)([smh]?)", text)
    if not match:
        raise argparse.ArgumentTypeError(f"{text!r} is no time; allowed: 90, 90s, 10m, 1.5h")
    return float(match.group(1)) * {"": 1, "s": 1, "m": 60, "h": 3600}[match.group(2)]


def names(text):
    chosen = text.split(",")
    for name in chosen:
        if name not in TRANSPORTS and name not in PROGRAMS:
            raise argparse.ArgumentTypeError(
                f"{name!r} is no transport; allowed: {' '.join([*TRANSPORTS, *PROGRAMS])}")
    return chosen


def arguments():
    parser = argparse.ArgumentParser(prog="soak", description=__doc__.splitlines()[0])
    parser.add_argument("--duration", type=seconds, default=600.0, help="90s, 10m, 1.5h (10m)")
    parser.add_argument("--seed", type=int, help="whole number (from the clock)")
    parser.add_argument("--transports", type=names, default=[t for t in TRANSPORTS if t != "cpppo"] + [*PROGRAMS],
                        help="some of: " + ",".join([*TRANSPORTS, *PROGRAMS]))
    parser.add_argument("--instances", type=int, default=1, help="of each, side by side (1)")
    parser.add_argument("--episodes", type=int, help="at most so many of each transport")
    parser.add_argument("--out", type=Path, help="folder of logs and report (tests/soak/O.<seed>)")
    parser.add_argument("--one", help=argparse.SUPPRESS)
    parser.add_argument("--instance", type=int, default=0, help=argparse.SUPPRESS)
    parser.add_argument("--lie", help=argparse.SUPPRESS)  # kind:in|out:bytes
    options = parser.parse_args()
    options.seed = random.randrange(1 << 31) if options.seed is None else options.seed
    options.out = (options.out or HERE / f"O.{options.seed}").resolve()
    return options


# --- One scenario: a process -----------------------------------------------------------------

def make_world(options, recorder, say):
    import importlib

    from . import wire
    module, name = TRANSPORTS[options.one].split(".")
    lie = None
    if options.lie:
        kind, way, size = options.lie.split(":")
        lie = wire.lie_of(kind, {"in": wire.TO_IOC, "out": wire.TO_PLC}[way], int(size))
    return getattr(importlib.import_module(f"soak.{module}"), name)(
        recorder.path.parent, options.seed, options.instance, recorder, lie=lie, say=say)


def one(options):
    """Runs a scenario; its result is a file. Status 1: wrong."""
    from . import recorder as recorders
    folder = options.out / f"{options.one}-{options.instance}"
    folder.mkdir(parents=True, exist_ok=True)
    log = open(folder / "log.txt", "w", buffering=1)
    recorder = recorders.Recorder(folder / "result.json", {
        "name": options.one, "instance": options.instance, "seed": options.seed,
        "duration": options.duration})

    def say(text):
        print(text, file=log)

    if options.one in PROGRAMS:
        from . import programs
        recorder.data["failure"] = programs.run(options.one, options.instance, options.seed,
                                                options.duration, recorder, say)
    else:
        play(options, recorder, say)
    recorder.write()
    log.flush()
    os._exit(1 if recorder.data["failure"] else 0)  # threads of libca and of the proxies remain


def play(options, recorder, say):
    world = make_world(options, recorder, say)
    try:
        world.run(options.duration, options.episodes)
    except BaseException as error:
        recorder.data["failure"] = f"{error}" or repr(error)
        say(traceback.format_exc())
        if world.ioc:
            say("--- the IOC's threads\n" + world.threads())
            say("--- the IOC's log\n" + world.ioc.log)
            world.keep_log()
        if world.sim:
            say("--- plcSim\n" + "\n".join(world.sim.lines[-200:]))
        with world.lock:
            say(f"--- the last blocks: {list(zip(world.inputs.times, world.inputs.numbers))[-40:]}")
            say(f"--- setpoints that the PLC got last: {world.outputs.last}, now {time.monotonic():.3f}")
    finally:
        world.close()


# --- All of them -----------------------------------------------------------------------------

def started(options):
    """The scenarios of this run: name and number of the instance of each."""
    return [(name, instance) for name in options.transports for instance in range(options.instances)]


def result_file(options, name, instance):
    return options.out / f"{name}-{instance}" / "result.json"


def forget(options):
    """Removes what an earlier run into the same folder has found."""
    for name, instance in started(options):
        result_file(options, name, instance).unlink(missing_ok=True)
    (options.out / "report.html").unlink(missing_ok=True)


def results(options):
    """Of this run's scenarios, so far; an older one's in the same folder do not count."""
    files = [result_file(options, name, instance) for name, instance in started(options)]
    return [json.loads(file.read_text()) for file in files if file.exists()]


def outcome(options, bad):
    """The result of each scenario that was started. Which ended badly (their names: `bad`), or without one of these
    did not end at all, has a failure. Report, console and status are made of this."""
    from . import recorder
    found = []
    for name, instance in started(options):
        file = result_file(options, name, instance)
        result = json.loads(file.read_text()) if file.exists() else recorder.empty(
            {"name": name, "instance": instance}, "it wrote no result")
        if not result["failure"] and (f"{name}-{instance}" in bad or not (bad or result["ended"])):
            result["failure"] = "did not end"
        found.append(result)
    return found


def start(options):
    """One process for each scenario and instance."""
    children = {}
    for name, instance in started(options):
        words = [sys.executable, "-m", "soak", "--one", name, "--instance", str(instance),
                 "--seed", str(options.seed), "--duration", str(options.duration), "--out", str(options.out)]
        if options.episodes is not None:
            words += ["--episodes", str(options.episodes)]
        if options.lie:
            words += ["--lie", options.lie]
        children[f"{name}-{instance}"] = subprocess.Popen(
            words, cwd=HERE.parent, stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL,
            preexec_fn=os.setpgrp)
    return children


def progress(options, begin):
    data = results(options)
    counts = {}
    for result in data:
        for name, n in result["counts"].items():
            counts[name] = counts.get(name, 0) + n
    elapsed = int(time.monotonic() - begin)
    print(f"soak {elapsed // 3600}:{elapsed // 60 % 60:02}:{elapsed % 60:02}  {len(data)} scenarios, "
          f"{sum(r['episodes'] for r in data)} episodes, {counts.get('values judged', 0)} values and "
          f"{counts.get('setpoints judged', 0)} setpoints judged", flush=True)


def stop(children):
    """Each with what it has started, be it stopped or not: they are groups of their own."""
    for child in children.values():
        try:
            os.killpg(child.pid, signal.SIGKILL)
        except ProcessLookupError:
            pass
        child.wait()


def watch(options, children):
    """Until all have ended, or one of them badly, which is returned."""
    begin = shown = time.monotonic()
    limit = begin + options.duration + 300
    while any(child.poll() is None for child in children.values()):
        bad = [name for name, child in children.items() if child.poll() not in (None, 0)]
        if bad:
            return bad
        if time.monotonic() > limit:
            return [name for name, child in children.items() if child.poll() is None]
        if time.monotonic() - shown > 10:
            shown = time.monotonic()
            progress(options, begin)
        time.sleep(0.2)  # the pace of the looks
    progress(options, begin)
    return [name for name, child in children.items() if child.returncode]


def tell(options, failed):
    """The last lines on the console."""
    for result in failed:
        about = result["about"]
        name = f"{about['name']}-{about['instance']}"
        print(f"soak: {name}, episode {result['episodes']}: {result['failure']}")
        print(f"soak: log {options.out / name / 'log.txt'}; again: make soak SEED={options.seed} "
              f"TRANSPORTS={about['name']} DURATION={options.duration:g}s INSTANCES={options.instances}")


def main():
    options = arguments()
    if options.one:
        one(options)
    from . import clock, origin, report
    options.out.mkdir(parents=True, exist_ok=True)
    forget(options)
    clock.build(options.out)
    begun = origin.line()
    print(f"soak: seed {options.seed}, {options.duration:g} s, {', '.join(options.transports)}, "
          f"{options.instances} of each; logs and report in {options.out}", flush=True)
    children = {}
    try:
        children = start(options)
        bad = watch(options, children)
    finally:
        stop(children)
    found = outcome(options, bad)
    page = options.out / "report.html"
    page.write_text(report.page(options, found, begun))
    print(f"soak: report {page}")
    failed = [result for result in found if result["failure"]]
    tell(options, failed)
    sys.exit(1 if failed else 0)


if __name__ == "__main__":
    main()
