"""The layout id over 1,000 random edits: it changes if and only if another signal, or another type, is in
some byte. The truth is kept by the test itself: which PLC memory and which field is where."""
import random

import maps
from conftest import plcmap
from plcmaplib.files import load
from plcmaplib.problems import Report
from plcmaplib.transfer import layout_crc, layout_id
from test_edit import read, write

EDITS = 1000


def truth(folder, rows, fields, keys):
    """What the bytes mean, from the sheets alone."""
    inner = {}
    for field in fields:
        inner.setdefault(field["type"], []).append((field["field"], field["ftype"], field["at"]))

    def meaning(kind):
        base = kind.split(" OF ")[-1]
        if base in inner:
            return kind.split(" OF ")[0], tuple(sorted(
                (at, name, meaning(ftype)) for name, ftype, at in inner[base]))
        return kind
    found = {(side, row[side]): (row["plc"].replace("DBB", "DBX").replace("DBW", "DBX"),
                                 meaning(row["type"]), row["dir"])
             for row in rows if row["dir"] != "reserved" for side in ("tx", "rx") if row[side]}
    sizes = tuple(model(folder).block_size(side) for side in ("tx", "rx"))
    return found, sizes, keys["byteorder"]


def model(folder):
    report = Report()
    map_ = load(str(folder), report)
    assert not report.errors(), report.lines()
    return map_


class Plant:
    """The sheets, and edits of them as people make them."""

    def __init__(self, folder, seed):
        self.folder, self.rnd = folder, random.Random(seed)
        maps.write(folder, maps.rows(60, seed), {"byteorder": "big"})
        assert plcmap("place", folder).status == 0
        self.rows = read(folder)
        self.fields, self.keys, self.count = self.read_types(), {"byteorder": "big"}, 0

    def read_types(self):
        import csv
        with open(self.folder / "types.csv", newline="", encoding="utf-8") as f:
            fields = list(csv.DictReader(f))
        for before, field in zip([{"type": ""}] + fields, fields):
            field["type"] = field["type"] or before["type"]
        return fields

    def save(self):
        maps.write(self.folder, self.rows, self.keys, types=[
            (f["type"], f["field"], f["ftype"], f) for f in self.fields])
        if any(r["dir"] != "reserved" and not r["tx"] and not r["rx"] for r in self.rows):
            result = plcmap("place", self.folder)
            assert result.status == 0, result.err
            self.rows = read(self.folder)

    def live(self, *types):
        """Rows that are not reserved, of these types or of any."""
        return [r for r in self.rows if r["dir"] != "reserved" and (not types or r["type"] in types)]

    # --- edits ------------------------------------------------------------------------------

    def pairs(self, cells):
        """Two rows that can swap these cells, and whether the swap means something."""
        for _ in range(200):
            a, b = self.rnd.sample(self.live(), 2)
            if (a["type"], a["dir"], bool(a["tx"]), bool(a["rx"])) == (
                    b["type"], b["dir"], bool(b["tx"]), bool(b["rx"])) and "." not in a["tx"] + b["tx"]:
                for cell in cells:
                    a[cell], b[cell] = b[cell], a[cell]
                return

    def swap_places(self):
        self.pairs(["tx", "rx"])

    def swap_memory(self):
        self.pairs(["plc"])

    def swap_names(self):
        self.pairs(["symbol", "pv", "desc"])

    def rename(self):
        self.rnd.choice(self.rows)["symbol"] = "Renamed%d" % self.count

    def rename_record(self):
        self.rnd.choice(self.live())["pv"] = "R%d%s" % (self.count, self.rnd.choice(["", ":"]))

    def describe(self):
        self.rnd.choice(self.rows).update(desc="text %d" % self.count, note="n", group="G/%d" % self.count)

    def limit(self):
        self.rnd.choice(self.live("REAL", "INT", "DINT", "UINT")).update(hopr="7%d" % self.count)

    def shuffle(self):
        self.rnd.shuffle(self.rows)

    def replace(self):
        """Another signal in the place of one: other memory, other name."""
        row = self.rnd.choice(self.live("INT", "REAL", "DINT"))
        row.update(symbol="New%d" % self.count, pv="New%d" % self.count,
                   plc="DB%d.DB%s0" % (100 + self.count, "W" if row["type"] == "INT" else "D"))

    def insert(self):
        self.rows.insert(self.rnd.randrange(len(self.rows)), dict.fromkeys(maps.COLUMNS, "") | {
            "symbol": "I%d" % self.count, "plc": "DB%d.DBW4" % (100 + self.count), "type": "INT",
            "pv": "I%d" % self.count, "dir": "in"})

    def delete(self):
        if len(self.rows) > 50:
            del self.rows[self.rnd.randrange(len(self.rows))]

    def reserve(self):
        if len(self.live()) > 40:
            self.rnd.choice(self.live("BOOL", "INT", "DINT")).update(dir="reserved", pv="", states="")

    def retype(self):
        row = self.rnd.choice([r for r in self.live("INT", "WORD", "UINT") if
                               not r["raw"] and not r["states"]])
        row["type"] = self.rnd.choice([t for t in ("INT", "WORD", "UINT") if t != row["type"]])

    def swap_fields(self):
        """Two bits of a type change places."""
        bits = [f for f in self.fields if f["type"] == "VALVE" and f["ftype"] == "BOOL"]
        bits[0]["field"], bits[1]["field"] = bits[1]["field"], bits[0]["field"]

    def turn(self):
        self.keys["byteorder"] = "little" if self.keys["byteorder"] == "big" else "big"

    def lengthen(self):
        self.keys["min_in"] = str(self.rnd.choice([0, 1000, 1200, 1201]))


EDIT = [name for name in vars(Plant) if name not in ("read_types", "save", "live", "pairs") and name[0] != "_"]


def test_random_edits(tmp_path):
    """1,000 random edits: the id changes if and only if some byte means something else"""
    changed = same = 0
    kinds = {}
    for seed in range(5):
        plant = Plant(tmp_path / str(seed), seed)
        before = None
        for plant.count in range(EDITS // 5 + 1):
            kind = plant.rnd.choice(EDIT)
            if plant.count:
                getattr(plant, kind)()
                plant.save()
            ident = layout_id(layout_crc(model(plant.folder)))
            now = truth(plant.folder, plant.rows, plant.fields, plant.keys)
            if before is not None:
                assert (ident != before[0]) == (now != before[1]), "%s, edit %d" % (kind, plant.count)
                changed, same = changed + (now != before[1]), same + (now == before[1])
                kinds.setdefault(kind, set()).add(now != before[1])
            before = ident, now
    assert changed + same == EDITS and min(changed, same) > 300, (changed, same)
    assert kinds["rename"] == {False} and kinds["swap_fields"] == {True} and True in kinds["swap_places"]
