"""What a run ran: when it began, which plclink, which Base, on how many cores. Knows nothing of scenarios."""
import os
import re
import subprocess
import time
from pathlib import Path

TOP = Path(__file__).resolve().parents[2]


def said(*words):
    """The one line that a program of the tree says, or None."""
    try:
        done = subprocess.run(words, cwd=TOP, capture_output=True, text=True)
    except OSError:
        return None
    return done.stdout.strip() if done.returncode == 0 else None


def commit():
    """Of a checkout; None of sources that have none of their own."""
    return said("git", "describe", "--always", "--dirty") if (TOP / ".git").exists() else None


def version():
    """1.0.0, from configure."""
    text = (TOP / "configure/CONFIG_PLCLINK_VERSION").read_text()
    return ".".join(re.search(rf"^PLCLINK_{part}\w* *= *(\d+)", text, re.M).group(1) for part in ("MAJ", "MIN", "PAT"))


def base():
    """EPICS 7.0.8.1, of the Base that the build has."""
    header = Path(said("configure/setup.sh", "named"), "include/epicsVersion.h").read_text()
    return re.search(r'EPICS_VERSION_STRING\s+"([^"]+)"', header).group(1)


def line():
    """To be asked at the start."""
    return (f"Started {time.strftime('%Y-%m-%d %H:%M:%S %z')}; plclink {version()}, commit {commit() or 'unknown'}; "
            f"{base()}; {len(os.sched_getaffinity(0))} cores")
