"""Maps that the tests make: of any size, with every kind of row, from a seed."""
import csv
import random

SCALARS = ["INT", "REAL", "DINT", "WORD", "UINT", "UDINT", "BYTE", "USINT", "SINT", "DWORD", "TIME",
           "LREAL", "LINT", "ULINT"]
COLUMNS = ("symbol plc type dir tx rx via pv desc egu prec lopr hopr lolo low high hihi sev states "
           "raw eng archive autosave asg group fields note").split()
TYPE_COLUMNS = "type field ftype at suffix dir desc egu prec low high states".split()

TYPES = [
    ("VALVE", "Open", "BOOL", {"desc": "open", "states": "closed|open"}),
    ("", "Fault", "BOOL", {"desc": "fault", "states": "ok|FAULT!MAJOR"}),
    ("", "Cycles", "INT", {"desc": "cycles", "high": "30000"}),
    ("", "Pos", "REAL", {"desc": "position", "egu": "%", "low": "5", "high": "95"}),
    ("AXIS", "Ready", "BOOL", {"desc": "ready"}),
    ("", "Speed", "REAL", {"desc": "speed", "egu": "mm/s", "prec": "2"}),
    ("", "Brake", "VALVE", {"desc": "brake"}),
    ("", "Name", "STRING[11]", {"desc": "name"}),
    ("", "Trace", "ARRAY[0..3] OF INT", {"desc": "trace"}),
    ("", "Ends", "ARRAY[1..2] OF BOOL", {"desc": "end switch"}),
]
SIZES = {"BOOL": 1, "INT": 2, "UINT": 2, "WORD": 2, "REAL": 4, "DINT": 4, "UDINT": 4, "DWORD": 4,
         "TIME": 4, "BYTE": 1, "USINT": 1, "SINT": 1, "LREAL": 8, "LINT": 8, "ULINT": 8, "VALVE": 8,
         "AXIS": 38, "STRING[16]": 18, "STRING[60]": 62, "ARRAY[1..5] OF REAL": 20,
         "ARRAY[0..2] OF UINT": 6, "ARRAY[1..9] OF BOOL": 2, "ARRAY[0..7] OF CHAR": 8,
         "ARRAY[1..2] OF VALVE": 16, "DATE_AND_TIME": 8}


def _letter(kind):
    return {1: "B", 2: "W", 4: "D"}.get(SIZES[kind], "B")


def rows(count, seed, outputs=True):
    """`count` rows without places in the blocks."""
    rnd = random.Random(seed)
    ends = {}
    made = []
    for n in range(count):
        kind = rnd.choice(SCALARS * 3 + ["BOOL"] * 20 + [k for k in SIZES if k not in SCALARS])
        direction = "out" if outputs and rnd.random() < 0.3 else "in"
        if outputs and kind == "BOOL" and rnd.random() < 0.05:
            direction = "cmd"
        db = {"in": 20, "out": 50, "cmd": 80}[direction] + n // 400
        byte, bit = ends.get(db, (0, 0))
        row = {"symbol": "S%d.%s" % (n, kind.split("[")[0]), "type": kind, "dir": direction,
               "pv": "V%04d%s" % (n, ":" if kind in ("VALVE", "AXIS") else ""),
               "desc": "value %d" % n, "group": "G%d" % (n // 500)}
        if kind == "BOOL":
            row["plc"] = "DB%d.DBX%d.%d" % (db, byte, bit)
            byte, bit = (byte, bit + 1) if bit < 7 else (byte + 1, 0)
        else:
            byte, bit = byte + (bit > 0), 0
            if SIZES[kind] > 1 or "[" in kind:
                byte += byte & 1
            row["plc"] = "DB%d.DB%s%d" % (db, _letter(kind) if "[" not in kind else "B", byte)
            byte += SIZES[kind]
        ends[db] = (byte, bit)
        _decorate(row, kind, rnd)
        made.append(row)
    return made


def _decorate(row, kind, rnd):
    """Limits, states, scales, lists."""
    if kind == "INT" and rnd.random() < 0.5:
        row.update(raw="0..27648", eng="0..100", egu="%", prec="1", lolo="5", low="10", high="90",
                   hihi="95", sev="hihi=INVALID")
    elif kind == "REAL" and rnd.random() < 0.5:
        row.update(egu="C", prec="2", low="-5", high="80.5", hihi="95", archive="yes")
    elif kind in ("UINT", "BYTE") and rnd.random() < 0.4:
        row.update(states="@MODE")
    elif kind == "DINT" and rnd.random() < 0.3:
        row.update(low="-100", high="100000", archive="scan 10")
    elif kind == "BOOL" and rnd.random() < 0.4:
        row.update(states="off|ON!MINOR")
    if row["dir"] == "out" and rnd.random() < 0.5:
        row.update(autosave="yes", asg="OPERATOR")


def write(folder, made, plc=(), types=TYPES, columns=COLUMNS, delimiter=","):
    """A folder of CSV files."""
    folder.mkdir(parents=True, exist_ok=True)

    def table(name, header, lines):
        with open(folder / name, "w", newline="", encoding="utf-8") as f:
            writer = csv.writer(f, delimiter=delimiter, lineterminator="\n")
            writer.writerow(header)
            writer.writerows(lines)

    keys = {"name": "P1", "sync": "on", "prefix": "p1:"}
    keys.update(plc)
    table("plc.csv", ["key", "value"], keys.items())
    table("map.csv", columns, [[r.get(c, "") for c in columns] for r in made])
    table("types.csv", TYPE_COLUMNS, [
        [t[0], t[1], t[2]] + [t[3].get(c, "") for c in TYPE_COLUMNS[3:]] for t in types])
    table("enums.csv", ["enum", "value", "text", "sev"],
          [["MODE", "0", "stop", ""], ["", "1", "manual", "MINOR"], ["", "2", "auto", ""],
           ["", "7", "service", "MAJOR"]])
    return folder
