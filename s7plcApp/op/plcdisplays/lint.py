"""What is wrong with a display, as lines: a PV without a record, things that overlap or lie
outside, words that are wider than their place. Needs no tool that shows displays; the width
of words is estimated from that of Liberation Sans (and Helvetica and Arial, which have the
same).
"""
import re
from pathlib import Path

TOP = Path(__file__).resolve().parents[3]
DATABASES = ["s7plcApp/Db/s7plcStation.db", "s7plcApp/Db/s7plcSync.db",
             "s7plcApp/Db/s7plcTables.db", "s7plcApp/Db/s7plcModbus.db",
             "phoenixRedundApp/Db/phoenixplcStatus.db", "s7plcApp/Db/eip_stat.db"]

# Thousandths of the font size; digits and most small letters: 556
NARROW = {c: w for group, w in (("ijl'", 222), ("ft.,:;/!I |", 278), ("r()-", 333),
                                ("ckszvxyJ", 500), ("FTZ", 611), ("ABEKPSVXY", 667),
                                ("CDHNRUw", 722), ("GOQ", 778), ("Mm", 833), ("W", 944),
                                ("%", 889)) for c in group}


def width(text, size, bold):
    """Pixels, at most: bold letters are a little wider."""
    units = sum(NARROW.get(c, 556) for c in text)
    return units * size / 1000 * (1.08 if bold else 1)


def expand(text, macros):
    """$(NAME) and $(NAME=default), also one within another."""
    def value(match):
        return macros.get(match[1], match[3] if match[2] else match[0])
    while True:
        after = re.sub(r"\$\((\w+)(=([^$()]*))?\)", value, text)
        if after == text:
            return text
        text = after


def records(macros, files=DATABASES):
    """Names of the records and aliases of these databases."""
    names = set()
    for file in files:
        text = (TOP / file).read_text()
        for name in re.findall(r'(?:record\(\s*\w+\s*,|alias\()\s*"([^"]+)"', text):
            names.add(expand(name, macros))
    return names


def _overlap(a, b):
    return a.x < b.x + b.w and b.x < a.x + a.w and a.y < b.y + b.h and b.y < a.y + a.h


def faults_of(display, known, prefixes):
    name = display.name
    for i in display.items:
        if i.x < 0 or i.y < 0 or i.x + i.w > display.w or i.y + i.h > display.h:
            yield f"{name}: {i.kind} at {i.x},{i.y} is outside"
        for pv in i.pvs():
            plain = pv.split(".")[0]
            for prefix in prefixes:
                if plain.startswith(prefix):
                    plain = "P:" + plain[len(prefix):]
            if plain not in known:
                yield f"{name}: no record for {pv}"
        for text, size, bold in i.texts():
            text = text.replace("$(NAME)", "ABCDEFGH-12")
            margin = 4 if i.kind in ("lamp", "open", "order") else 0
            if width(text, size, bold) > i.w - margin:
                yield (f'{name}: "{text}" needs {width(text, size, bold):.0f} pixels, '
                       f"has {i.w - margin}")
            if size * 1.15 > i.h:
                yield f'{name}: "{text}" is {size} pixels high, has {i.h}'
    for n, a in enumerate(display.items):
        for b in display.items[n + 1:]:
            if _overlap(a, b):
                yield f"{name}: {a.kind} at {a.x},{a.y} overlaps {b.kind} at {b.x},{b.y}"


def faults(displays):
    """All that is wrong. The overview names its PLCs in full: those of its buttons."""
    known = records({"P": "P:", "IOC": "P"})
    prefixes = {"$(P)"} | {i.macros["P"] for d in displays for i in d.items
                           if i.kind == "open" and "P" in i.macros}
    files = {d.name for d in displays}
    out = [line for d in displays for line in faults_of(d, known, prefixes)]
    return out + [f"{d.name}: no display {i.display}" for d in displays for i in d.items
                  if i.kind == "open" and i.display not in files]
