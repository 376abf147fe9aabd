"""Imports: the form is seen from the content, one table in several forms gives the same rows, an
import again keeps what was written by hand, and what is not understood is told."""
import csv

import pytest

import forms
from conftest import plcmap


def rows(folder):
    with open(folder / "map.csv", newline="", encoding="utf-8") as f:
        return list(csv.DictReader(f))


def write(tmp_path, name, data, ending="bin"):
    file = tmp_path / ("%s.%s" % (name.replace(" ", "_"), ending))
    file.write_bytes(data)
    return file


def imported(tmp_path, data, *options, name="x"):
    """{symbol: (plc, type, desc)} of an import into a new map, and the result."""
    folder = tmp_path / "into"
    result = plcmap("import", write(tmp_path, name, data), "--into", folder, *options)
    if result.status:
        return None, result
    return {r["symbol"]: (r["plc"], r["type"], r["desc"]) for r in rows(folder)}, result


TABLE = {"Start": ("I0.0", "BOOL", 'start "now"; \u00fcber'), "Speed": ("MW10", "INT", "speed")}


@pytest.mark.parametrize("form", forms.FORMS)
def test_table(tmp_path, form):
    """{form}: one symbol table, the same rows"""
    found, result = imported(tmp_path, forms.FORMS[form])
    want = dict(TABLE)
    if form == "seq":  # has no types
        want["Speed"] = ("MW10", "WORD", "speed")
    assert found == want, result.out + result.err
    if forms.FORMS[form].find(b"Clock") >= 0:  # with a block and a timer
        assert ", 2 rows are no memory" in result.out, result.out


def test_workbook_of_tags(tmp_path):
    """tags of TIA as a workbook: the same rows, by the names of its columns"""
    openpyxl = pytest.importorskip("openpyxl")
    book = openpyxl.Workbook()
    tab = book.active
    tab.title = "PLC Tags"
    tab.append(["Name", "Path", "Data Type", "Logical Address", "Comment", "Hmi Visible"])
    tab.append(["Start", "t", "Bool", "%I0.0", 'start "now"; \u00fcber', "True"])
    tab.append(["Speed", "t", "Int", "%MW10", "speed", "True"])
    tab.append(["Old", "t", "Timer", "%T9", "''", "True"])
    book.create_sheet("Constants").append(["Name", "Value"])
    book.save(tmp_path / "tags.xlsx")
    plcmap("import", tmp_path / "tags.xlsx", "--into", tmp_path / "into")
    assert {r["symbol"]: (r["plc"], r["type"], r["desc"]) for r in rows(tmp_path / "into")} == TABLE


def test_other_workbook(tmp_path):
    """a workbook with other columns is refused, with the columns that it has"""
    openpyxl = pytest.importorskip("openpyxl")
    book = openpyxl.Workbook()
    book.active.append(["Name", "Connection", "HMI data type"])
    book.save(tmp_path / "hmi.xlsx")
    result = plcmap("import", tmp_path / "hmi.xlsx")
    assert result.status == 1 and "Name, Connection, HMI data type" in result.err


def test_source(tmp_path):
    """a source of data blocks: fields with addresses by the layout rules"""
    found, result = imported(tmp_path, forms.OTHERS["source"], "--db", "Motor=12")
    assert found == {
        "Motor.Left.Run": ("DB12.DBX0.0", "BOOL", "runs"),
        "Motor.Left.Speed": ("DB12.DBW2", "INT", "speed"),
        "Motor.Left.01[1]": ("DB12.DBX4.0", "BOOL", ""),
        "Motor.Left.01[2]": ("DB12.DBX4.1", "BOOL", ""),
        "Motor.Both[0].Run": ("DB12.DBX6.0", "BOOL", "runs"),
        "Motor.Both[0].Speed": ("DB12.DBW8", "INT", "speed"),
        "Motor.Both[0].01[1]": ("DB12.DBX10.0", "BOOL", ""),
        "Motor.Both[0].01[2]": ("DB12.DBX10.1", "BOOL", ""),
        "Motor.Both[1].Run": ("DB12.DBX12.0", "BOOL", "runs"),
        "Motor.Both[1].Speed": ("DB12.DBW14", "INT", "speed"),
        "Motor.Both[1].01[1]": ("DB12.DBX16.0", "BOOL", ""),
        "Motor.Both[1].01[2]": ("DB12.DBX16.1", "BOOL", ""),
        "Motor.Name": ("DB12.DBB18", "STRING[9]", "name"),
        "Motor.Last": ("DB12.DBB40", "BYTE", ""),
    }, result.err
    assert "Motor.Where: no record shows ANY: left out" in result.err


def test_source_as_types(tmp_path):
    """a source of data blocks as types with instances: checked, placed, generated"""
    found, _ = imported(tmp_path, forms.OTHERS["source"], "--db", "Motor=12", "--types")
    assert found["Motor.Left"] == ("DB12.DBB0", "Drive", "")
    assert found["Motor.Both"] == ("DB12.DBB6", "ARRAY[0..1] OF Drive", "")
    folder = tmp_path / "into"
    for r in rows(folder):
        assert r["pv"]
    assert plcmap("place", folder).status == 0
    result = plcmap("check", folder)
    assert result.status == 0, result.err


def test_number_of_a_block(tmp_path):
    """a symbol table in the same import tells the number of a data block"""
    table = write(tmp_path, "t", forms.asc("Motor", "DB     12", "DB     12"))
    source = write(tmp_path, "s", forms.OTHERS["source"])
    plcmap("import", source, table, "--into", tmp_path / "into")
    assert {r["plc"] for r in rows(tmp_path / "into")} >= {"DB12.DBX0.0", "DB12.DBB40"}


def test_openness_block(tmp_path):
    """a data block of Openness: offsets by the rules; optimised access is an error"""
    found, _ = imported(tmp_path, forms.OTHERS["openness db"])
    assert found == {"Motor.Run": ("DB12.DBX0.0", "BOOL", "runs"),
                     "Motor.Set.Speed": ("DB12.DBW2", "INT", ""),
                     "Motor.Set.Ramp": ("DB12.DBB4", "ARRAY[1..3] OF REAL", ""),
                     "Motor.Name": ("DB12.DBB16", "STRING[10]", "")}
    result = plcmap("import", write(tmp_path, "o", (forms.OPENNESS_DB % "Optimized").encode()))
    assert result.status == 1 and "set the block to standard access" in result.err


def test_optimised_source(tmp_path):
    """a source with optimised access is refused, with its line"""
    data = forms.SOURCE.replace("'FALSE'", "'TRUE'").encode()
    result = plcmap("import", write(tmp_path, "o", data))
    assert result.status == 1
    assert "o.bin:10: \"Motor\" has optimised access" in result.err


def test_outline(tmp_path):
    """an outline of a compiled block: its offsets are those of the rules, else it is told"""
    data = forms.OTHERS["outline"]
    found, result = imported(tmp_path, data)
    assert found == {"DB12.Run": ("DB12.DBX0.0", "BOOL", ""), "DB12.Stop": ("DB12.DBX0.1", "BOOL", ""),
                     "DB12.Rows[1].A": ("DB12.DBB2", "BYTE", ""), "DB12.Rows[1].B": ("DB12.DBW4", "INT", ""),
                     "DB12.Rows[2].A": ("DB12.DBB6", "BYTE", ""), "DB12.Rows[2].B": ("DB12.DBW8", "INT", ""),
                     "DB12.Name": ("DB12.DBB10", "STRING[9]", ""), "DB12.Last": ("DB12.DBB21", "BYTE", "")}
    result = plcmap("import", write(tmp_path, "w", data.replace(b"021.0", b"022.0")))
    assert result.status == 1 and "w.bin:10: Last is at 22.0 here, and at 21.0 by the layout rules" in \
        result.err


def test_offsets(tmp_path):
    """texts with offsets, in two forms"""
    found, result = imported(tmp_path, forms.OTHERS["offsets"], "--db", "X=6")
    assert found == {"Run": ("DB6.DBX0.0", "BOOL", "runs"), "Speed": ("DB6.DBW2", "INT", ""),
                     "Ramp": ("DB6.DBB4", "ARRAY[1..3] OF REAL", "")}
    assert '"Late" has no offset' in result.err
    result = plcmap("import", write(tmp_path, "p", forms.OTHERS["plain offsets"]), "--db", "X=6")
    assert "Name DB6.DBB4 STRING[10]" in result.out


def test_explorer(tmp_path):
    """CSV of S7-Project-Explorer"""
    found, _ = imported(tmp_path, forms.OTHERS["explorer"])
    assert found == {"Tank.Run": ("DB6.DBX20.1", "BOOL", ""), "Tank.Speed": ("DB6.DBW22", "INT", "")}


def test_pcworx(tmp_path):
    """variables of PC WORX"""
    found, _ = imported(tmp_path, forms.OTHERS["pcworx"])
    assert found == {"RUN": ("RUN", "BOOL", "runs"), "SPEED": ("SPEED", "INT", "")}


def test_rockwell_forms(tmp_path):
    """L5K and L5X of one controller give equal rows; CSV has tags, without types"""
    expected = {"Start": ("Start", "BOOL", 'start "now"'),
                "Speed": ("Speed", "ARRAY[0..1,0..2] OF INT", ""),
                "Left.Run": ("Left.Run", "BOOL", "left runs"),
                "Left.Ramp": ("Left.Ramp", "ARRAY[0..2] OF REAL", ""),
                "Program:Main.Count": ("Program:Main.Count", "DINT", ""),
                "Ramp1.EnableIn": ("Ramp1.EnableIn", "BOOL", ""),
                "Ramp1.Out": ("Ramp1.Out", "REAL", "value")}
    expected.update({"Wait." + m: ("Wait." + m, "BOOL" if len(m) == 2 else "DINT", "")
                     for m in ("PRE", "ACC", "EN", "TT", "DN")})
    for form in ("L5K", "L5X"):
        folder = tmp_path / form
        folder.mkdir()
        assert imported(folder, forms.OTHERS[form])[0] == expected
    found, result = imported(tmp_path, forms.OTHERS["rockwell csv"])
    assert found == {"Start": ("Start", "BOOL", 'start "now"; \u00fcber'),
                     "Speed": ("Speed", "ARRAY[0..1,0..2] OF INT", "speed")}
    assert 'unknown type "Drive"' in result.err


def test_iec_forms(tmp_path):
    """TwinCAT, CODESYS, PLCopen: one structure and an array"""
    for form, prefix in (("tmc", "GVL."), ("codesys", "GVL."), ("plcopen", "")):
        folder = tmp_path / form
        folder.mkdir()
        found, result = imported(folder, forms.OTHERS[form])
        assert {s: t[1] for s, t in found.items()} == {
            prefix + "Left.Run": "BOOL", prefix + "Left.Name": "STRING[10]",
            prefix + "Speed": "ARRAY[1..3] OF INT"}, result.err


GOOD = [f for f in forms.FORMS if f != "dif"] + [
    "source", "offsets", "explorer", "pcworx", "rockwell csv", "L5K", "L5X", "tmc", "codesys", "plcopen",
    "outline"]


@pytest.mark.parametrize("form", GOOD)
def test_import_then_check(tmp_path, form):
    """{form}: import, place, check, generate, without a line of writing"""
    imported(tmp_path, {**forms.FORMS, **forms.OTHERS}[form], "--db", "Motor=12")
    folder = tmp_path / "into"
    for words in (["place", folder], ["check", folder], ["generate", folder, "-o", tmp_path / "gen"]):
        result = plcmap(*words)
        assert result.status == 0, result.err


@pytest.mark.parametrize("form, keys", [("L5X", {"wire": "etherip", "family": "none"}),
                                        ("codesys", {"family": "codesys"}), ("openness", {"family": "tia"}),
                                        ("asc", {})])
def test_keys_of_a_form(tmp_path, form, keys):
    """{form}: a new map gets the keys that its symbols need; another map is told"""
    data = {**forms.FORMS, **forms.OTHERS}[form]
    imported(tmp_path, data)
    found = dict(csv.reader((tmp_path / "into" / "plc.csv").read_text().splitlines()))
    assert found == {"key": "value", "name": "PLC", **keys}
    (tmp_path / "into" / "plc.csv").write_text("key,value\nname,PLC\n")
    _, result = imported(tmp_path, data)
    for key, value in keys.items():
        assert "plc.csv: warning: %s: " % key in result.err and "it is %s" % value in result.err


def test_own_blocks(tmp_path):
    """A PLC that has the program's data blocks itself: a new map gives those other numbers"""
    _, result = imported(tmp_path, forms.OTHERS["explorer"])
    assert "held_db: 7, because the PLC has a DB6" in result.out
    assert "held_db,7" in (tmp_path / "into" / "plc.csv").read_text()


def test_long_names(tmp_path):
    """Names of records that would be too long: one line says so, and what helps"""
    data = forms.TMC.replace("GVL.Left", "GVL." + "L" * 56).encode()
    _, result = imported(tmp_path, data)
    assert "2 values would have records with more than 60 characters" in result.err
    assert "--pv makes shorter names" in result.err
    assert sum(1 for r in rows(tmp_path / "into") if r["pv"]) == 1


def test_unknown_field(tmp_path):
    """TwinCAT: a field of a type that is not there is left out by itself, and told"""
    _, result = imported(tmp_path, forms.OTHERS["tmc"])
    assert 'type Drive: warning: Id: unknown type "GUID": left out' in result.err


def test_iec_types(tmp_path):
    """a worksheet of types by itself brings no rows; it says what it has"""
    result = plcmap("import", write(tmp_path, "t", forms.OTHERS["iec"]))
    assert result.status == 0 and "2 types" in result.out


# --- again --------------------------------------------------------------------------------------

def test_again(tmp_path):
    """an import again changes nothing"""
    imported(tmp_path, forms.FORMS["asc"])
    before = (tmp_path / "into" / "map.csv").read_bytes()
    _, result = imported(tmp_path, forms.FORMS["asc"])
    assert "0 new, 0 changed, 2 as they were" in result.out
    assert (tmp_path / "into" / "map.csv").read_bytes() == before


def hand(folder, of, **cells):
    found = rows(folder)
    for r in found:
        if r["symbol"] == of:
            r.update(cells)
    with open(folder / "map.csv", "w", newline="", encoding="utf-8") as f:
        writer = csv.DictWriter(f, found[0].keys(), lineterminator="\n")
        writer.writeheader()
        writer.writerows(found)


def test_hand_written_stays(tmp_path):
    """what was written by hand stays: description, record, limits, places, notes"""
    imported(tmp_path, forms.FORMS["asc"])
    mine = {"desc": "mine", "pv": "My:Speed", "hihi": "90", "tx": "40", "note": "n", "dir": "in"}
    hand(tmp_path / "into", "Speed", **mine)
    imported(tmp_path, forms.FORMS["asc"].replace(b"speed", b"other"))
    row = next(r for r in rows(tmp_path / "into") if r["symbol"] == "Speed")
    assert {k: row[k] for k in mine} == mine


def test_renamed_retyped_moved(tmp_path):
    """renamed, retyped and moved rows are told and updated"""
    folder = tmp_path / "into"
    imported(tmp_path, forms.FORMS["asc"])
    hand(folder, "Speed", tx="4", hihi="9")
    hand(folder, "Start", tx="8.0")
    data = forms.FORMS["asc"].replace(b"126,Speed ", b"126,Velo  ").replace(b"E       0.0 ",
                                                                           b"E       0.5 ")
    _, result = imported(tmp_path, data)
    assert "renamed: Speed is Velo now (MW10)" in result.out
    assert "moved in the PLC: Start I0.5, was I0.0" in result.out
    found = {r["symbol"]: r for r in rows(folder)}
    assert found["Velo"]["tx"] == "4" and found["Velo"]["hihi"] == "9"
    _, result = imported(tmp_path, data.replace(b"INT ", b"WORD"))
    assert "retyped: Velo WORD, was INT" in result.out and "is given up" in result.out


def test_named(tmp_path):
    """a row written by hand without a symbol gets that of its address; two of one symbol are no end"""
    folder = tmp_path / "into"
    imported(tmp_path, forms.FORMS["asc"])
    hand(folder, "Speed", symbol="", tx="4")
    _, result = imported(tmp_path, forms.FORMS["asc"])
    assert "renamed: a row without a symbol is Speed now (MW10)" in result.out
    assert next(r for r in rows(folder) if r["symbol"] == "Speed")["tx"] == "4"
    hand(folder, "Speed", symbol="Same")
    hand(folder, "Start", symbol="Same")
    _, result = imported(tmp_path, forms.FORMS["asc"])
    assert "renamed: Same is Speed now (MW10)" in result.out and "renamed: Same is Start now" in result.out
    assert sorted(r["symbol"] for r in rows(folder)) == ["Speed", "Start"]


def test_vanished(tmp_path):
    """a field that a data block no longer has: its bytes are reserved, or the row stays"""
    folder = tmp_path / "into"
    imported(tmp_path, forms.OTHERS["source"], "--db", "Motor=12")
    plcmap("place", folder)
    data = forms.SOURCE.replace("      Name : String[9];   // name\n", "").encode()
    _, result = imported(tmp_path, data, "--db", "Motor=12", "--keep-vanished")
    assert "vanished: Motor.Name (DB12.DBB18); the row stays" in result.out
    _, result = imported(tmp_path, data, "--db", "Motor=12")
    row = next(r for r in rows(folder) if r["symbol"] == "Motor.Name")
    assert row["dir"] == "reserved" and row["tx"] and not row["pv"]
    assert plcmap("check", folder).status == 0


def test_select_and_names(tmp_path):
    """--select takes a part, --pv makes names"""
    found, _ = imported(tmp_path, forms.OTHERS["source"], "--db", "Motor=12", "--select",
                        "Motor.Left.*", "--pv", r"s/Motor\.(.*)/M1:\1/")
    assert len(found) == 4
    assert rows(tmp_path / "into")[0]["pv"] == "M1:Left:Run"


# --- refusals -----------------------------------------------------------------------------------

REFUSED = [("nothing", b"", "the file is empty"), ("a picture", b"\x89PNG\r\n\x1a\n\0\0\0", "no text"),
           ("prose", b"Dear colleague,\nplease find the list below.\n", "a form that is not known"),
           ("another XML", b"<html><body/></html>", "XML of <html>: not known"),
           ("broken XML", b"<Tagtable><Tag></Tagtable>", "no well-formed XML"),
           ("a document type", b"<!DOCTYPE x [<!ENTITY a 'b'>]><Tagtable/>", "document type"),
           ("a broken workbook", b"PK\x03\x04 nothing", "no .xlsx that can be read"),
           ("a source that breaks off", b"TYPE \"x\"\nSTRUCT\n a : INT;\n", "END_STRUCT expected"),
           ("a source with a wrong bound", b"DATA_BLOCK DB1\nSTRUCT\n a : ARRAY[5..1] OF INT;\n",
            "the first must not be greater"),
           ("a source without a colon", b"DATA_BLOCK DB1\nSTRUCT\n a INT;\n", ": expected, not \"INT\""),
           ("L5X of nothing", b"<RSLogix5000Content/>", "without a controller")]


@pytest.mark.parametrize("title, data, text", REFUSED, ids=[r[0] for r in REFUSED])
def test_refused(tmp_path, title, data, text):
    """{title} is refused with a reason"""
    if data.startswith(b"PK"):
        pytest.importorskip("openpyxl")
    result = plcmap("import", write(tmp_path, "r", data))
    assert result.status == 1 and text in result.err, result.err


WORDS = [(["--columns", "nix"], "nix: No such file"), (["--select", "["], '"[" means none of the 2 symbols'),
         (["--select", "DB99.*"], "such as Start I0.0; allowed: * ? [abc]"),
         (["--pv", "s///"], '--pv "s///"; allowed: none, or such as'),
         (["--pv", "s/a/b/x"], "allowed: none, or such as"), (["--pv", "s/(/b/"], "unterminated"),
         (["--db", "x"], '--db "x"; allowed: such as Tank=10'), (["--db", "x=0"], "allowed: such as Tank=10")]


@pytest.mark.parametrize("words, text", WORDS, ids=[" ".join(w[0]) for w in WORDS])
def test_wrong_words(tmp_path, words, text):
    """{id} is refused with what is allowed, and nothing is written"""
    _, result = imported(tmp_path, forms.FORMS["asc"], *words)
    assert result.status == 1 and text in result.err, result.err
    assert not (tmp_path / "into").exists()


def test_no_file(tmp_path):
    """a file that is not there is told"""
    assert "No such file" in plcmap("import", tmp_path / "none").err


def test_name_means_nothing(tmp_path):
    """the name of a file means nothing"""
    for ending in ("xlsx", "L5K", "txt"):
        result = plcmap("import", write(tmp_path, "n", forms.FORMS["asc"], ending))
        assert "STEP 7 symbol table (.asc), 2 values" in result.out


def test_code_page(tmp_path):
    """--encoding says what bytes cannot"""
    data = forms.asc("X", "M 0.0", "BOOL").replace(b"   BOOL", b"   BOOL") + b""
    data = data[:50] + "\u0411\u0430\u043a".encode("cp1251") + data[53:]
    result = plcmap("--encoding", "cp1251", "import", write(tmp_path, "c", data))
    assert "\u0411\u0430\u043a" in result.out
