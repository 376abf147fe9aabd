"""Each column of the sheets, each type and each default of docs/map.md, in what is made of a map."""
import os
import re
import subprocess
import sys
import xml.etree.ElementTree as ET
from pathlib import Path

import pytest

import tank as example
from conftest import TOP, plcmap
from plcmaplib import columns

HEAD = "symbol,plc,type,dir,tx,rx,via,pv,desc,egu,prec,lopr,hopr,lolo,low,high,hihi,sev,states,raw,eng,archive," \
       "autosave,asg,group,fields,note\n"
NONE = {"types": "type,field,ftype\n", "enums": "enum,value,text\n"}


def made(folder, rows, plc="", **sheets):
    """{name of a file: its text} of a map of these rows"""
    map_ = example.write(folder / "m", map=rows, plc="key,value\nname,TANK\nprefix,tank:\n" + plc, **{**NONE, **sheets})
    assert plcmap("place", map_).status == 0, plcmap("place", map_).err
    result = plcmap("generate", map_, "-o", folder / "g")
    assert result.status == 0, result.err
    return {file.name: file.read_text() for file in (folder / "g").iterdir()}


def fields(db, record):
    """(record type, {field: value}) of a record in the text of a database"""
    kind, body = re.search(rf'^record\((\w+), "{re.escape(record)}"\) {{\n(.*?)^}}', db, re.M | re.S).groups()
    return kind, dict(re.findall(r'^ +(?:field|info)\((\w+), "(.*)"\)$', body, re.M))


def test_columns(tmp_path):
    """Each column of the sheet map is where it belongs: in the record, the lists, the tree, the manual"""
    files = made(tmp_path, HEAD + """\
A,DB11.DBD0,REAL,in,,,,A,what it is,m/s,2,-1,11,1,2,8,9,low=INVALID hihi=MINOR,,,,5,VAL HIGH,OPS,Water/Pumps,PINI=YES; FLNK=other,a note
B,DB11.DBW4,INT,,,,,B,,,,,,1,2,98,99,,,0..27648,0..100,scan 60,yes,,,,
C,DB11.DBW6,INT,,,,,C,,,,,,,,,,,0=stop|7=service!MAJOR,,,yes,,,,,
D,DB11.DBX8.0,BOOL,,,,,D,,,,,,,,,,,off|FAULT!MINOR,,,,,,,,
Silent,DB11.DBW10,INT,,,,,,,,,,,,,,,,,,,,,,,,
""")
    db = files["m.db"]
    kind, a = fields(db, "tank:A")
    wanted = {"DESC": "what it is", "EGU": "m/s", "PREC": "2", "LOPR": "-1", "HOPR": "11", "LOLO": "1", "LOW": "2",
              "HIGH": "8", "HIHI": "9", "LLSV": "MAJOR", "LSV": "INVALID", "HSV": "MINOR", "HHSV": "MINOR", "ASG": "OPS",
              "PINI": "YES", "FLNK": "other"}
    assert kind == "ai" and {name: a.get(name) for name in wanted} == wanted
    kind, b = fields(db, "tank:B")
    assert kind == "ai" and (b["LINR"], b["EGUL"], b["EGUF"]) == ("LINEAR", "0", "100") and "L=0 H=27648" in b["INP"]
    assert [b[name] for name in ("LLSV", "LSV", "HSV", "HHSV")] == ["MAJOR", "MINOR", "MINOR", "MAJOR"]
    kind, c = fields(db, "tank:C")
    assert kind == "mbbi" and [c[name] for name in ("ZRVL", "ZRST", "ONVL", "ONST", "ONSV")] == [
        "0", "stop", "7", "service", "MAJOR"]
    assert [fields(db, "tank:D")[1][name] for name in ("ZNAM", "ONAM", "OSV")] == ["off", "FAULT", "MINOR"]
    assert len(re.findall("^record", db, re.M)) == 4  # without pv there is no record
    assert files["m.archive"].splitlines()[1:] == ["tank:A 5 monitor", "tank:B 60 scan", "tank:C 1 monitor"]
    assert files["m.req"].splitlines()[1:] == ["tank:A.HIGH", "tank:A.VAL", "tank:B.VAL"]
    tree = ET.fromstring(files["m-alarms.xml"])
    assert tree.find("component[@name='Water']/component[@name='Pumps']/pv[@name='tank:A']") is not None
    assert "a note |" in files["m.md"] and "tank:A" in files["m-Water_Pumps.bob"]


def test_fields_of_types(tmp_path):
    """The columns of the sheet types: a blank type is that of the row above, suffix makes names, dir is the field's"""
    files = made(tmp_path, HEAD + "D,DB11.DBB8,BOX,in,,,,D,box" + "," * 18 + "\n", types="""\
type,field,ftype,at,suffix,dir,desc,egu,high
INNER,Deep,INT,,,,,,
BOX,Plain,INT,,,,plain,m,5
,Named,INT,,:Other,,,,
,Hidden,INT,,-,,,,
,Long,INT,,,,ddddddddddddddddddddddddddddddddddddddd,,
,Part,INNER,,,,,,
,Set,INT,,,out,,,
""")
    db = files["m-BOX.template"]
    assert re.findall(r'^record\((\w+), "\$\(P\)(.*)"', db, re.M) == [
        ("longin", "Plain"), ("longin", ":Other"), ("longin", "Long"), ("longin", "Part:Deep"), ("longout", "Set"), ("longin", "Set:RBV")]
    assert {"EGU": "m", "HIGH": "5", "DESC": "$(DESC) plain"}.items() <= fields(db, "$(P)Plain")[1].items()
    assert fields(db, "$(P)Long")[1]["DESC"] == "d" * 39  # both do not fit
    assert re.search(r'\{ "TANK", "tank:D", .*, "box" \}', files["m.substitutions"])


# The type, and the records of an input and of a setpoint
KINDS = {
    **dict.fromkeys(["SINT", "INT", "DINT", "USINT", "UINT", "BYTE", "WORD", "TIME", "DATE", "S5TIME"], ("longin", "longout")),
    **dict.fromkeys(["UDINT", "LINT", "ULINT", "LWORD", "DWORD", "TIME_OF_DAY", "LTIME", "LTOD", "LDT"],
                    ("int64in", "int64out")),
    **dict.fromkeys(["REAL", "LREAL"], ("ai", "ao")), "BOOL": ("bi", "bo"), "STRING[39]": ("stringin", "stringout"),
    **dict.fromkeys(["STRING[40]", "ARRAY[0..7] OF CHAR"], ("lsi", "lso")),
    **dict.fromkeys(["ARRAY[1..3] OF INT", "ARRAY[1..2,0..1] OF REAL", "DATE_AND_TIME", "DTL"], ("waveform", "aao")),
}


@pytest.mark.parametrize("kind", KINDS)
def test_record_types(tmp_path, kind):
    """{kind} becomes the records that the table says"""
    rows = [f'I,In,"{kind}",in,I', f'O,Out,"{kind}",out,O']
    db = made(tmp_path, "symbol,plc,type,dir,pv\n" + "\n".join(rows) + "\n", "family,none\nsync,on\n")["m.db"]
    assert (fields(db, "tank:I")[0], fields(db, "tank:O")[0]) == KINDS[kind]
    assert fields(db, "tank:O:RBV")[0] == KINDS[kind][0]


def test_all_types_are_tried():
    """Each type that the document lists is in the test above"""
    text = (TOP / "docs/map.md").read_text().split("**Types.**")[1].split("| value |")[0]
    listed = set(re.findall(r"\b[A-Z][A-Z0-9_]+\b", text)) - {"OF", "ARRAY"}
    tried = set(re.findall(r"\b[A-Z][A-Z0-9_]+\b", " ".join(KINDS)))
    assert len(listed) > 25 and not listed - tried, listed - tried


def test_states_and_limits_choose(tmp_path):
    """An integer with states is mbbi, mbbo; with a limit that is not whole ai, ao; elements of BOOL are records"""
    db = made(tmp_path, "symbol,plc,type,dir,pv,high,states\nI,I,INT,in,I,,a|b\nO,O,INT,out,O,,a|b\n"
                        "J,J,INT,in,J,1.5,\nK,K,INT,out,K,1.5,\nE,E,ARRAY[1..2] OF BOOL,in,E,,\n", "family,none\nsync,on\n")["m.db"]
    assert [fields(db, f"tank:{name}")[0] for name in "IOJK"] == ["mbbi", "mbbo", "ai", "ao"]
    assert len(re.findall(r'^record\(bi, "tank:E', db, re.M)) == 2


@pytest.mark.parametrize("rbv, name", [("", "tank:O:RBV"), ("rbv,-RB\n", "tank:O-RB"), ("rbv,-\n", None)],
                         ids=["blank", "-RB", "-"])
def test_name_of_readback(tmp_path, rbv, name):
    """The key rbv is {id}: the name behind a setpoint's that the PLC shows, or no such record"""
    for number, shown in enumerate(("sync,on\n", "readback,0\n", "")):
        db = made(tmp_path / str(number), "symbol,plc,type,dir,pv\nO,O,INT,out,O\n", "family,none\n" + shown + rbv)["m.db"]
        assert re.findall(r'^record\(longin, "(.*)"', db, re.M) == ([name] if name and shown else []), shown


def test_keys():
    """The table of keys has the default of each key"""
    text = (TOP / "docs/map.md").read_text().split("## Sheet `plc`")[1].split("\n## ")[0]
    documented = {}
    for names, defaults in re.findall(r"^\| (`[^|]*`) \|([^|]*)\|", text, re.M):
        defaults = defaults.strip(" `")
        names, values = re.findall(r"`(\w+)`", names), re.split(r"[,;] | ", defaults)
        documented.update(zip(names, values if len(names) > 1 and len(values) >= len(names) else [defaults] * len(names)))
    assert set(documented) == set(columns.PLC_KEYS)
    words = {"port": "2000; Modbus 502", "address": "2000; Modbus 502", "recvtimeout": "20", "sendinterval": "periods",
             "watchdog": "2000"}  # told in words, which test_command looks at
    wrong = {key: (documented[key], default) for key, (default, _, _) in columns.PLC_KEYS.items()
             if key not in words and documented[key] != default}
    assert not wrong


@pytest.mark.parametrize("keys, command", [
    ("", 's7plcConfigure("TANK", "$(TANK_ADDRESS=127.0.0.1)", $(TANK_PORT=2000), 2, 2, 1, 2000, 100)'),
    ("period,200\nmin_in,50\nmin_out,20\n",
     's7plcConfigure("TANK", "$(TANK_ADDRESS=127.0.0.1)", $(TANK_PORT=2000), 50, 20, 1, 4000, 200)'),
    ("byteorder,little\nport,2001\naddress,10.0.0.1\nrecvtimeout,700\nsendinterval,30\n",
     's7plcConfigure("TANK", "$(TANK_ADDRESS=10.0.0.1)", $(TANK_PORT=2001), 2, 2, 0, 700, 30)'),
    ("wire,modbus\n", 'modbusplcConfigure("TANK", "$(TANK_ADDRESS=127.0.0.1)", $(TANK_PORT=502), 1, '
                      '"holding 0 1 every 100", "holding 1000 1")'),
    ("wire,modbus\nunit,3\nin_register,7\nout_register,9\n",
     'modbusplcConfigure("TANK", "$(TANK_ADDRESS=127.0.0.1)", $(TANK_PORT=502), 3, "holding 7 1 every 100", "holding 9 1")'),
], ids=["defaults", "sizes and period", "times", "Modbus", "Modbus with registers"])
def test_command(tmp_path, keys, command):
    """{id}: the command in x.cmd is as the keys say"""
    files = made(tmp_path, "symbol,plc,type,dir,pv\nI,I,INT,in,I\nO,O,INT,out,O\n", "family,none\n" + keys)
    assert command in files["m.cmd"].splitlines()


def test_heads(tmp_path):
    """A comment at the head of each file has the map's name, layout id and CRC, and no time; a file that is the same is not written"""
    map_ = example.write(tmp_path / "tank")
    assert plcmap("generate", map_, "-o", tmp_path / "g").status == 0
    before = {file: file.stat().st_mtime_ns for file in (tmp_path / "g").iterdir()}
    for file in before:
        head = "\n".join(file.read_text().splitlines()[:2])
        assert re.search(r"map tank, layout id \d+, CRC 0x[0-9A-F]{8}\b", head), file
        assert not re.search(r"20\d\d-\d\d|\d\d:\d\d", head), file
    text = (map_ / "map.csv").read_text()
    (map_ / "map.csv").write_text(text.replace("temperature setpoint", "setpoint of temperature"))
    assert plcmap("generate", map_, "-o", tmp_path / "g").status == 0
    changed = {file.name for file in before if file.stat().st_mtime_ns != before[file]}
    assert "tank.db" in changed and not changed & {"tank-step7.scl", "tank.plc", "tank-VALVE.template", "tank.req"}


def test_only(tmp_path):
    """generate --only makes the files that end so, and no other"""
    map_ = example.write(tmp_path / "tank")
    assert plcmap("generate", map_, "-o", tmp_path / "g", "--only", ".db").status == 0
    assert [file.name for file in (tmp_path / "g").iterdir()] == ["tank.db"]


def test_diff_in_git(tmp_path):
    """The two lines for git: the diff of a workbook shows the cell that changed"""
    text = " ".join((TOP / "docs/map.md").read_text().split())
    configure, attributes = re.search(r"`(git config diff\.plcmap\.textconv .*?)`, and `(.*?)` in", text).groups()
    program = next(TOP.glob("bin/*/plcmap"), None)
    if program is None:
        pytest.skip("the tree is not built")
    env = {**os.environ, "PATH": f"{program.parent}:{Path(sys.executable).parent}:{os.environ['PATH']}"}

    def git(*words):
        run = subprocess.run(["git", "-c", "user.name=n", "-c", "user.email=e", *words], cwd=tmp_path,
                             env=env, capture_output=True, text=True)
        assert run.returncode == 0, run.stderr
        return run.stdout
    git("init", "-q")
    subprocess.run(configure, shell=True, cwd=tmp_path, env=env, check=True)
    (tmp_path / ".gitattributes").write_text(attributes + "\n")
    for desc in ("temperature setpoint", "what it shall be"):
        folder = example.write(tmp_path / "t", map=example.MAP.replace("temperature setpoint", desc))
        (tmp_path / "tank.xlsx").unlink(missing_ok=True)
        assert plcmap("convert", folder, tmp_path / "tank.xlsx").status == 0
        git("add", "tank.xlsx")
        if desc == "temperature setpoint":
            git("commit", "-qm", "first")
    shown = git("diff", "--cached", "tank.xlsx")
    assert re.search(r"^-.*temperature setpoint", shown, re.M) and re.search(r"^\+.*what it shall be", shown, re.M)


def test_python():
    """plcmap is Python that version 3.9 can read"""
    import ast
    for file in (TOP / "s7plcApp/map").rglob("*.py"):
        ast.parse(file.read_text(), feature_version=(3, 9))
