"""The random checkers of tests/unit as scenarios: each run has a seed of its own."""
import re
import subprocess
import time

import client

from . import plan

SECONDS = {"blockStressTest", "pairStressTest", "syncStressTest"}  # these take a time as argument
COUNT = {"slipStressTest": 8, "recordStressTest": 200}             # these a number of episodes
NAMES = sorted(SECONDS | set(COUNT))
SHARE = 60  # s of one run


def path(name):
    return client.TOP / "tests/unit" / f"O.{client.ARCH}" / name


def episodes(text):
    """How many a checker says that it ran, in a comment or with a test: the first number of them."""
    return int(re.search(r"\b(\d+) episodes", text).group(1))


def run(name, instance, seed, seconds, recorder, say):
    """Until the time is over. Returns None, or what is wrong."""
    number = 0
    while recorder.now() < seconds:
        own = plan.chance(seed, name, instance, number).randrange(1 << 31)
        share = max(1, min(SHARE, int(seconds - recorder.now())))
        words = [str(path(name)), f"{share}s" if name in SECONDS else str(COUNT[name]), str(own)]
        say(f"{recorder.now():9.3f} {' '.join(words[1:])}")
        begin = time.monotonic()
        done = subprocess.run(words, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE,
                              stderr=subprocess.STDOUT, text=True, cwd=path(name).parent)
        recorder.figure("run", name, time.monotonic() - begin)
        if done.returncode or re.search("^not ok", done.stdout, re.M):
            say(done.stdout)
            return f"wrong: {' '.join(words)} ended with status {done.returncode}"
        recorder.data["episodes"] += episodes(done.stdout)
        recorder.write()
        number += 1
    recorder.data["ended"] = True
    return None
