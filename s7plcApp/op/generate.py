#!/usr/bin/env python3
"""Writes the displays of plclink for Phoebus, MEDM, caQtDM and PyDM.

    s7plcApp/op/generate.py                         all of them, into the folders here
    s7plcApp/op/generate.py --check                 says which differ; status 1
    s7plcApp/op/generate.py --plcs FILE -o FOLDER   the overview of other PLCs
    ... --read=-R --order=-S                        all of them, for names with these ends

A line of FILE: name, prefix of the records, and what the PLC has of MODBUS SYNC MAP EIP PAIR:

    PRESS   hall2:PRESS:   MODBUS
    OVEN    hall2:OVEN:    SYNC MAP

What it writes is committed, so that a build needs no Python.
"""
import argparse
import sys
from pathlib import Path

HERE = Path(__file__).resolve().parent
sys.path.insert(0, str(HERE))

from plcdisplays import adl, bob, displays, lint, ui  # noqa: E402

# folder: (ending of its files, what writes them)
TOOLS = {"bob": ("bob", bob.write), "adl": ("adl", adl.write),
         "ui": ("ui", ui.CaQtDM("ui").write), "pydm": ("ui", ui.PyDM("ui").write)}


def read_plcs(path):
    plcs = []
    for number, line in enumerate(Path(path).read_text().splitlines(), 1):
        words = line.split("#")[0].split()
        if not words:
            continue
        wrong = [p for p in words[2:] if p not in displays.PARTS]
        if len(words) < 2 or wrong:
            sys.exit(f"{path}:{number}: a line is: name, prefix, and any of "
                     f"{' '.join(displays.PARTS)}; not {line.strip()!r}")
        plcs.append((words[0], words[1], words[2:]))
    return plcs


def files(plcs, folder=HERE, only=None, ends=("", "")):
    """Path and text of each file."""
    return {folder / tool / f"{d.name}.{ending}": write(d)
            for tool, (ending, write) in TOOLS.items()
            for d in displays.all_displays(plcs, *ends) if only in (None, d.name)}


def main():
    parser = argparse.ArgumentParser(description=__doc__,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--check", action="store_true")
    parser.add_argument("--plcs", metavar="FILE", default=HERE / "demos.plcs")
    parser.add_argument("-o", metavar="FOLDER", type=Path, dest="folder")
    parser.add_argument("--read", metavar="END", default="", help="the macro R of the databases")
    parser.add_argument("--order", metavar="END", default="", help="their macro S")
    options = parser.parse_args()
    plcs = read_plcs(options.plcs)
    ends = options.read, options.order
    if any(ends) and not options.folder:
        parser.error("--read and --order need a folder of their own: -o FOLDER")
    only = "plclinkOverview" if options.folder and not any(ends) else None
    written = files(plcs, options.folder or HERE, only, ends)
    differ = [p for p, text in written.items() if not p.exists() or p.read_text() != text]
    if options.check:
        faults = lint.faults(displays.all_displays(plcs))
        for line in [f"{p.parent.name}/{p.name} is not what generate.py writes"
                     for p in differ] + faults:
            print(line)
        return bool(differ or faults)
    for path, text in written.items():
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)
    return 0


if __name__ == "__main__":
    sys.exit(main())
