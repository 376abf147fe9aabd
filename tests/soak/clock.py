"""Builds clockstep.so, by which the time of day of an IOC can be made to jump."""
import os
import re
import subprocess
from pathlib import Path


def build(folder):
    """Into that folder. Without a compiler there are no jumps of the clock, which is said."""
    words = [os.environ.get("CC", "cc"), "-shared", "-fPIC", "-O2", "-o", str(folder / "clockstep.so"),
             str(Path(__file__).with_name("clockstep.c")), "-ldl"]
    done = subprocess.run(words, capture_output=True, text=True)
    if done.returncode:
        print(f"soak: the clock does not jump: {done.stderr.strip()}")


def environment(folder, program, file):
    """For that program: the time of day is the machine's and as many ns more as the file says. The libraries of
    a sanitizer must come first."""
    needs = subprocess.run(["ldd", program], capture_output=True, text=True).stdout
    first = re.findall(r"=> (\S+/lib[atu]b*san\S*)", needs)
    return {**os.environ, "LD_PRELOAD": " ".join([*first, str(folder / "clockstep.so")]), "SOAK_CLOCK": str(file)}
