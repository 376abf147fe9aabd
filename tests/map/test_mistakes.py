"""Mistakes that people make in a map: each has a line of its own, with its place, what is wrong
and what is allowed."""
import csv
import io

import pytest

import tank as example
from conftest import plcmap


def changed(text, changes):
    """A sheet with cells replaced: {(key in the first column, column): value}; the key may be a
    line number. A column that is not there is added."""
    rows = list(csv.reader(io.StringIO(text)))
    header = rows[0]
    for (key, column), value in changes.items():
        if column not in header:
            header.append(column)
        at = header.index(column)
        for number, row in enumerate(rows[1:], 2):
            if row[0] == key or number == key:
                row += [""] * (at + 1 - len(row))
                row[at] = value
    out = io.StringIO()
    csv.writer(out, lineterminator="\n").writerows(rows)
    return out.getvalue()


def row(**cells):
    """One more row of the map."""
    header = example.MAP.split("\n", 1)[0].split(",")
    out = io.StringIO()
    csv.writer(out, lineterminator="\n").writerow([cells.get(c, "") for c in header])
    return example.MAP + out.getvalue()


def map_(*changes):
    return {"map": changed(example.MAP, {(c[0], c[1]): c[2] for c in changes})}


def plc(**keys):
    return {"plc": example.PLC + "".join(f"{k},{v}\n" for k, v in keys.items())}


def types_(line, column, value):
    return {"types": changed(example.TYPES, {(line, column): value})}


def both(*parts):
    merged = {}
    for part in parts:
        merged.update(part)
    return merged


NEW = {"symbol": "New", "plc": "DB11.DBW44", "type": "INT", "tx": "124", "pv": "New"}

MISTAKES = [
    # cells of the map
    ("an unknown type", map_(("Tank.Temp", "type", "REEL")), "map.csv:11:3: type: ",
     'unknown type "REEL" (did you mean REAL?)'),
    ("no type", map_(("Tank.Temp", "type", "")), "map.csv:11:3: type: ", "no type"),
    ("bounds that are none", map_(("Tank.Profile", "type", "ARRAY[5] OF INT")),
     "map.csv:16:3: type: ", "no array bounds; allowed: such as ARRAY[1..4] OF REAL"),
    ("bounds the wrong way round", map_(("Tank.Profile", "type", "ARRAY[4..0] OF INT")),
     "map.csv:16:3: type: ", "the first must not be greater"),
    ("arrays of arrays without end", map_(("Tank.Profile", "type", "ARRAY[0..1] OF " * 3000 + "INT")),
     "map.csv:16:3: type: ", "an array has at most 6 dimensions"),
    ("an array without OF", map_(("Tank.Profile", "type", "ARRAY[0..4] INT")),
     "map.csv:16:3: type: ", "is no array"),
    ("too many elements", map_(("Tank.Profile", "type", "ARRAY[0..70000] OF INT")),
     "map.csv:16:3: type: ", "70001 elements are too many"),
    ("a text that is too long", map_(("Tank.Name", "type", "STRING[300]")),
     "map.csv:15:3: type: ", "STRING[300]; allowed: STRING[1] to STRING[254]"),
    ("an unknown direction", map_(("Tank.Temp", "dir", "inn")), "map.csv:11:4: dir: ",
     '"inn" is not allowed (did you mean in?); allowed: in out cmd reserved'),
    ("an unknown transfer", map_(("Tank.Temp", "via", "pointer")), "map.csv:11:7: via: ",
     '"pointer" is not allowed'),
    ("a place that is none", map_(("Tank.Temp", "tx", "abc")), "map.csv:11:5: tx: ",
     '"abc" is no place; allowed: a byte such as 10, or byte.bit such as 10.3'),
    ("bit 8", map_(("Tank.Door", "tx", "98.8")), "map.csv:17:5: tx: ", "is no place"),
    ("a bit for a number", map_(("Tank.Temp", "tx", "54.3")), "map.csv:11:5: tx: ",
     "only a BOOL has a bit, not REAL"),
    ("a byte that is taken", map_(("Tank.Level", "tx", "56")), "map.csv:12:5: tx: ",
     "byte 56 is taken by line 11 (Tank.Temp)"),
    ("a bit that is taken", map_(("Tank.Heater", "tx", "10.0"), ("Tank.Heater", "rx", "10.0")),
     "map.csv:5:5: tx: ", "bit 10.0 is taken by line 4 (Tank.Pump)"),
    ("a structure that reaches into the next", map_(("V101", "tx", "104")), "map.csv:19:5: tx: ",
     "byte 108 is taken by line 18 (V101)"),
    ("the header", map_(("Tank.TempSP", "rx", "2"), ("Tank.TempSP", "tx", "2")),
     "map.csv:2:6: rx: ", "bytes 0 to 3 are the header of the block to the PLC; allowed: 4 and up"),
    ("beyond the longest block", map_(("Clock", "tx", "65532")), "map.csv:20:5: tx: ",
     "65532 + 8 bytes exceed the longest block, 65536"),
    ("an input without a place", map_(("Tank.Temp", "tx", "")), "map.csv:11:5: tx: ",
     "no place in the block to the IOC; `plcmap place` gives one"),
    ("a setpoint without a place", map_(("Tank.TempSP", "rx", "")), "map.csv:2:6: rx: ",
     "no place in the block to the PLC"),
    ("a setpoint without read-back", map_(("Tank.TempSP", "tx", "")), "map.csv:2:5: tx: ",
     "no place in the block to the IOC"),
    ("an input with a place to the PLC", map_(("Tank.Temp", "rx", "54")), "map.csv:11:6: rx: ",
     "an input has no place in the block to the PLC"),
    ("a setpoint that is shown elsewhere", map_(("Tank.Total", "tx", "124")), "map.csv:10:5: tx: ",
     "readback=0 shows byte 50 of the block to the PLC at byte 50, not 124"),
    ("an input among the read-backs", map_(("Tank.Count", "tx", "4")), "map.csv:13:5: tx: ",
     "bytes 4 to 53 show the setpoints (readback=0)"),
    ("a command where all is shown", {"map": row(**{**NEW, "dir": "cmd", "tx": "", "rx": "54"})},
     "map.csv:21:4: dir: ", "a command is not shown: with readback=0 all bytes to the PLC are"),
    ("a command by pointer", {"map": row(**{**NEW, "plc": "DB14.DBW0", "type": "INT", "dir": "cmd", "tx": "", "rx": "54",
                                            "via": "ptr"})},
     "map.csv:21:7: via: ", "a command is not compared, rows of the pointer table are; allowed: explicit"),
    ("the same symbol twice", {"map": row(**{**NEW, "symbol": "Tank.Temp"})}, "map.csv:21:1: symbol: ",
     "Tank.Temp is there twice, see line 11"),
    ("the same symbol in capitals", {"map": row(**{**NEW, "symbol": "TANK.TEMP"})},
     "map.csv:21:1: symbol: ", "TANK.TEMP is there twice, see line 11"),
    ("no symbol", {"map": row(**{**NEW, "symbol": ""})}, "map.csv:21:1: symbol: ",
     "the row has no symbol"),
    # addresses
    ("an address that is none", map_(("Tank.Temp", "plc", "DB11.D0")), "map.csv:11:2: plc: ",
     '"DB11.D0" is no address; allowed: DB10.DBX4.3'),
    ("DBX without a bit", map_(("Tank.Pump", "plc", "DB10.DBX6")), "map.csv:4:2: plc: ",
     "DBX needs a bit"),
    ("bit 9 of a byte", map_(("Tank.Pump", "plc", "DB10.DBX6.9")), "map.csv:4:2: plc: ",
     "a byte has bits 0 to 7"),
    ("DB0", map_(("Tank.Temp", "plc", "DB0.DBD0")), "map.csv:11:2: plc: ", "allowed are DB1 to DB65535"),
    ("peripheral memory", map_(("Tank.Level", "plc", "PIW256")), "map.csv:12:2: plc: ",
     "peripheral memory, which no block can show"),
    ("a width that does not fit", map_(("Tank.Temp", "plc", "DB11.DBW0")), "map.csv:11:2: plc: ",
     "REAL has 4 bytes: write DB11.DBD0"),
    ("a BOOL without a bit", map_(("Tank.Door", "plc", "MB4")), "map.csv:17:2: plc: ",
     "a BOOL needs a bit"),
    ("a bit for a number in the PLC", map_(("Tank.Temp", "plc", "M4.3")), "map.csv:11:2: plc: ",
     "only a BOOL lies in a single bit, not REAL"),
    ("an odd byte of a DB", map_(("Tank.Temp", "plc", "DB11.DBD1")), "map.csv:11:2: plc: ",
     "REAL begins at an even byte in a DB, not 1"),
    ("the program's own DB", map_(("Tank.Temp", "plc", "DB1.DBD0")), "map.csv:11:2: plc: ",
     "DB1 is tx_db, which the program itself uses; allowed: another block, or another number for"),
    ("beyond a data block", map_(("Clock", "plc", "DB13.DBB65530")), "map.csv:20:2: plc: ",
     "65530 + 8 bytes exceed a data block"),
    ("an input of the PLC that is written", map_(("Tank.SpeedSP", "plc", "IW4")), "map.csv:3:2: plc: ",
     "an input of the PLC cannot be written"),
    ("two setpoints at one place", map_(("Tank.SpeedSP", "plc", "DB10.DBW2")), "map.csv:3:2: plc: ",
     "DB10.DBW2 is written by line 2 (Tank.TempSP) too"),
    ("a pointer to a symbol", map_(("Tank.Name", "plc", "Tank.Name")), "map.csv:15:7: via: ",
     "a pointer needs an address such as DB10.DBW4 in column plc, not a symbol"),
    ("a pointer to nothing", map_(("Tank.Name", "plc", "")), "map.csv:15:7: via: ",
     "a pointer needs an address in column plc"),
    ("a pointer that moves a bit to another", map_(("Tank.Door", "via", "ptr")), "map.csv:17:7: via: ",
     "a pointer moves whole bytes: bit 3 of M cannot become bit 0"),
    ("an explicit transfer of a text", map_(("Tank.Name", "via", "explicit")), "map.csv:15:7: via: ",
     "STRING[20] has 22 bytes: an explicit transfer moves 1, 2 or 4; allowed: ptr"),
    ("a text with a symbol", map_(("Tank.Name", "plc", "Tank.Name"), ("Tank.Name", "via", "")),
     "map.csv:15:2: plc: ", "STRING[20] needs an address such as DB10.DBB4, not the symbol Tank.Name"),
    # records
    ("the same record twice", {"map": row(**{**NEW, "pv": "Temp"})}, "map.csv:21:8: pv: ",
     'record "tank:Temp" is there already: line 11 (Tank.Temp)'),
    ("a record that is the read-back of another", {"map": row(**{**NEW, "pv": "TempSP:RBV"})},
     "map.csv:21:8: pv: ", 'record "tank:TempSP:RBV" is there already'),
    ("a name that is too long", map_(("Tank.Temp", "pv", "T" * 58)), "map.csv:11:8: pv: ",
     "has 63 characters; allowed: 60"),
    ("a name with a blank", map_(("Tank.Temp", "pv", "my temp")), "map.csv:11:8: pv: ",
     "characters that no record name can have"),
    ("a name with a dot", map_(("Tank.Temp", "pv", "Temp.VAL")), "map.csv:11:8: pv: ",
     "no . and no $ in a record name"),
    ("a description that is too long", map_(("Tank.Temp", "desc", "d" * 41)), "map.csv:11:9: desc: ",
     "has 41 bytes; allowed: 40"),
    ("a macro in a description", map_(("Tank.Temp", "desc", "temp $(X)")), "map.csv:11:9: desc: ",
     "$( would be taken for a macro"),
    ("a line break in a symbol", map_(("Tank.Temp", "symbol", "Tank\nTemp")), "map.csv:11:1: symbol: ",
     "a line break or another control character; allowed: one line"),
    ("a line break in a group", map_(("Tank.Temp", "group", "A\nB")), "map.csv:11:25: group: ",
     "a line break or another control character; allowed: one line"),
    ("a group that is too long", map_(("Tank.Temp", "group", "g" * 121)), "map.csv:11:25: group: ",
     "121 bytes; allowed: 120"),
    ("a unit that is too long", map_(("Tank.Temp", "egu", "u" * 16)), "map.csv:11:10: egu: ",
     "has 16 bytes; allowed: 15"),
    ("a unit of a text", map_(("Tank.Name", "egu", "m")), "map.csv:15:10: egu: ", "a text has no unit"),
    ("digits that are none", map_(("Tank.Temp", "prec", "two")), "map.csv:11:11: prec: ",
     '"two"; allowed: 0 to 15'),
    ("a digit that is none of ten", map_(("Tank.Temp", "prec", "\u00b2")), "map.csv:11:11: prec: ",
     "allowed: 0 to 15"),
    ("a limit that is no number", map_(("Tank.Temp", "high", "hot")), "map.csv:11:16: high: ",
     '"hot" is no number'),
    ("a decimal comma", map_(("Tank.Temp", "high", "80,5")), "map.csv:11:16: high: ",
     '"80,5" is no number'),
    ("limits out of order", map_(("Tank.Temp", "low", "90")), "map.csv:11:16: high: ",
     "high=80 is below low=90; allowed: lolo <= low <= high <= hihi"),
    ("a display range out of order", map_(("Tank.Temp", "lopr", "200")), "map.csv:11:13: hopr: ",
     "hopr=120 must be greater than lopr=200"),
    ("a limit that cannot be reached", map_(("Tank.Flags", "hihi", "70000")), "map.csv:14:17: hihi: ",
     "70000 cannot be reached: WORD goes from 0 to 65535"),
    ("a limit beyond the scale", map_(("Tank.Level", "high", "500")), "map.csv:12:16: high: ",
     "500 cannot be reached: INT goes from"),
    ("a limit of a text", map_(("Tank.Name", "high", "5")), "map.csv:15:16: high: ",
     "STRING[20] has no limits"),
    ("a limit of states", map_(("Tank.Mode", "high", "5")), "map.csv:6:16: high: ",
     "a state has no limits"),
    ("an unknown severity", map_(("Tank.Temp", "sev", "hihi=FATAL")), "map.csv:11:18: sev: ",
     '"FATAL" is not allowed; allowed: NO_ALARM MINOR MAJOR INVALID'),
    ("a severity of no limit", map_(("Tank.Level", "sev", "hihi=MAJOR")), "map.csv:12:18: sev: ",
     "hihi has no limit in its column"),
    ("a severity without a limit's name", map_(("Tank.Temp", "sev", "MAJOR")), "map.csv:11:18: sev: ",
     "allowed: such as low=MINOR hihi=INVALID"),
    ("an unknown enum", map_(("Tank.Mode", "states", "@MODES")), "map.csv:6:19: states: ",
     'there is no enum "MODES" (did you mean MODE?); allowed: MODE'),
    ("three states of a bit", map_(("Tank.Pump", "states", "a|b|c")), "map.csv:4:19: states: ",
     "a BOOL has the states 0 and 1"),
    ("seventeen states", map_(("Tank.Flags", "states", "|".join("abcdefghijklmnopq"))),
     "map.csv:14:19: states: ", "17 states; allowed: 16"),
    ("a state that is too long", map_(("Tank.Pump", "states", "off|" + "o" * 26)),
     "map.csv:4:19: states: ", "has 26 bytes; allowed: 25"),
    ("a state twice", map_(("Tank.Flags", "states", "a|a")), "map.csv:14:19: states: ",
     'text "a" is there twice'),
    ("a value twice", map_(("Tank.Flags", "states", "1=a|1=b")), "map.csv:14:19: states: ",
     "value 1 is there twice"),
    ("a state beyond the type", map_(("Tank.Flags", "states", "70000=a")), "map.csv:14:19: states: ",
     "state 70000 is beyond WORD (0 ... 65535)"),
    ("states of a REAL", map_(("Tank.Temp", "states", "a|b")), "map.csv:11:19: states: ",
     "REAL has no states"),
    ("an empty state", map_(("Tank.Pump", "states", "off|")), "map.csv:4:19: states: ",
     "a state has no text"),
    ("a raw range that is none", map_(("Tank.Level", "raw", "27648")), "map.csv:12:20: raw: ",
     '"27648" is no range; allowed: such as 0..27648'),
    ("a raw range of nothing", map_(("Tank.Level", "raw", "5..5")), "map.csv:12:20: raw: ",
     "both ends are the same"),
    ("a raw range the wrong way round", map_(("Tank.Level", "raw", "27648..0")), "map.csv:12:20: raw: ",
     "the first must be less"),
    ("a raw range beyond the type", map_(("Tank.Level", "raw", "0..40000")), "map.csv:12:20: raw: ",
     "40000 is no INT (-32768 ... 32767)"),
    ("a raw range without units", map_(("Tank.Level", "eng", "")), "map.csv:12:20: raw: ",
     "raw needs eng beside it"),
    ("a raw range of a REAL", map_(("Tank.Temp", "raw", "0..10"), ("Tank.Temp", "eng", "0..1")),
     "map.csv:11:20: raw: ", "REAL is not scaled"),
    ("an archive period that is none", map_(("Tank.Temp", "archive", "often")), "map.csv:11:22: archive: ",
     '"often"; allowed: yes, no, seconds (such as 1), scan 60'),
    ("an autosave field that is none", map_(("Tank.TempSP", "autosave", "value")),
     "map.csv:2:23: autosave: ", '"value" is no field'),
    ("an empty part of a group", map_(("Tank.Temp", "group", "Tank//x")), "map.csv:11:25: group: ",
     "has an empty part"),
    ("a field that is none", map_(("Tank.Temp", "fields", "pini=YES")), "map.csv:11:26: fields: ",
     '"pini=YES" is no field'),
    ("a field that the map makes", map_(("Tank.Temp", "fields", "INP=@x")), "map.csv:11:26: fields: ",
     "INP comes from the map itself"),
    ("a field twice", map_(("Tank.Temp", "fields", "PINI=YES; PINI=NO")), "map.csv:11:26: fields: ",
     "PINI is there twice"),
    ("a record of reserved bytes", map_(("Tank.Temp", "dir", "reserved")), "map.csv:11:8: pv: ",
     "reserved bytes have no record"),
    ("a type that no record shows", {"map": row(**{**NEW, "type": "WSTRING[5]"})}, "map.csv:21:3: type: ",
     "no record shows WSTRING[5]"),
    # types
    ("an unknown type of a field", types_(6, "ftype", "REEL"), "types.csv:6:3: ftype: ",
     'unknown type "REEL" (did you mean REAL?)'),
    ("a field twice", types_(4, "field", "Open"), "types.csv:4:2: field: ",
     "VALVE.Open is there twice, see line 2"),
    ("a field without a name", types_(4, "field", ""), "types.csv:4:2: field: ", "the field has no name"),
    ("fields that overlap", {"types": changed(example.TYPES, {(5, "at"): "2", (6, "at"): "2"})},
     "types.csv:6:4: at: ", "byte 2 of VALVE is taken by Cycles"),
    ("a field at an odd byte", types_(5, "at", "3"), "types.csv:5:4: at: ", "INT begins at an even byte, not 3"),
    ("a type that contains itself", types_(6, "ftype", "VALVE"), "types.csv:2:1: type: ",
     "type VALVE contains itself"),
    ("a type called as one of the PLC", {"types": example.TYPES.replace("VALVE", "INT")},
     "types.csv:2:1: type: ", '"INT" cannot be the name of a type'),
    ("a type in two parts", {"types": example.TYPES + "X,a,INT,,,,,,\nVALVE,b,INT,,,,,,\n"},
     "types.csv:8:1: type: ", "type VALVE began in line 2: its rows must stand together"),
    # enums
    ("a value that is no number", {"enums": example.ENUMS.replace(",1,", ",one,")}, "enums.csv:3:2: value: ",
     '"one" is no whole number'),
    ("a value of an enum twice", {"enums": example.ENUMS.replace(",2,", ",1,")}, "enums.csv:4:3: text: ",
     "value 1 is there twice"),
    ("a text of an enum twice", {"enums": example.ENUMS.replace("auto", "stop")}, "enums.csv:4:3: text: ",
     'text "stop" is there twice'),
    # sheets and keys
    ("an unknown column", {"map": example.MAP.replace(",desc,", ",descr,", 1)}, "map.csv:1:9: ",
     'unknown column "descr" (did you mean desc?)'),
    ("a column twice", {"map": example.MAP.replace(",egu,", ",desc,", 1)}, "map.csv:1:10: ",
     'the column "desc" is there twice'),
    ("a missing column", {"map": example.MAP.replace("symbol,", "#symbol,", 1)}, "map.csv:1: ",
     'the column "symbol" is missing'),
    ("a cell beyond the last column", {"map": example.MAP.replace("Tank,,\n", "Tank,,,oops\n", 1)},
     "map.csv:2:28: ", '"oops" stands beyond the last column'),
    ("an unknown key", plc(adress="x"), "plc.csv:6:1: key: ", 'unknown key "adress" (did you mean address?)'),
    ("a key twice", plc(name="X"), "plc.csv:6:1: key: ", '"name" is there twice, see line 2'),
    ("a port beyond the range", plc(port="70000"), "plc.csv:6:2: port: ", '"70000"; allowed: 1 to 65535'),
    ("an unknown wire", plc(wire="profibus"), "plc.csv:6:2: wire: ", '"profibus" is not allowed'),
    ("sync over Modbus", plc(wire="modbus"), "plc.csv:3:2: sync: ", "sync=on needs wire=block, not modbus"),
    ("layout_at beside sync", plc(layout_at="2"), "plc.csv:6:2: layout_at: ",
     "with sync=on the layout id is in the header"),
    ("two blocks of one number", plc(rx_db="1"), "plc.csv:6:2: rx_db: ", "DB1 is tx_db already"),
    ("a name of a station with a blank", {"plc": example.PLC.replace("TANK", "TA NK")}, "plc.csv:2:2: name: ",
     '"TA NK" is no name of a station'),
    ("a prefix with a blank", {"plc": example.PLC.replace("tank:", "ta nk:")}, "plc.csv:5:2: prefix: ",
     "characters that no record name can have"),
    ("a prefix with a macro", {"plc": example.PLC.replace("tank:", "$(P)")}, "plc.csv:5:2: prefix: ",
     "characters that no record name can have; allowed: A-Z"),
    ("a name of read-backs with a dot", plc(rbv=".R"), "plc.csv:6:2: rbv: ",
     "characters that no record name can have; allowed: A-Z"),
    ("a port in other digits", plc(port="\u00b2"), "plc.csv:6:2: port: ", "allowed: 1 to 65535"),
    ("an address with quotes", plc(address="'x'"), "plc.csv:6:2: address: ", "is no host name or address"),
    ("a symbol in the PLC with an open quote", map_(("Tank.Temp", "plc", '"Tank')), "map.csv:11:2: plc: ",
     '"Tank cannot be a variable in the PLC\'s program; allowed: such as Motor, "Motor 1".Speed'),
    ("an S7 address in CODESYS", plc(family="codesys"), "map.csv:2:2: plc: ",
     "DB10.DBD0 is a place in an S7; allowed with family=codesys: the name of a variable"),
    ("two addresses in one cell", plc(address="10.0.0.1; 10.0.0.2"), "plc.csv:6:2: address: ",
     "is no host name or address; allowed: one, such as 192.168.0.10"),
    ("a pair over Modbus", {"plc": "key,value\nwire,modbus\nsecond,10.0.0.2\n"},
     "plc.csv:3:2: second: ", "a pair needs wire=block, not modbus"),
    ("registers beyond the last", {"plc": "key,value\nwire,modbus\nin_register,65530\n"},
     "plc.csv:3:2: in_register: ", "allowed: up to register 65535"),
    ("registers of input and output", {"plc": "key,value\nwire,modbus\nout_register,4\n"},
     "plc.csv:3:2: out_register: ", "are input and output; allowed: "),
    ("a download without the handshake", {"plc": "key,value\nsync,off\ndownload,on\n"},
     "plc.csv:3:2: download: ", "download=on needs sync=on"),
]


@pytest.mark.parametrize("title, changes, place, text", MISTAKES, ids=[m[0] for m in MISTAKES])
def test_mistake(tmp_path, title, changes, place, text):
    """{title}"""
    folder = example.write(tmp_path / "m", **changes)
    result = plcmap("check", folder)
    assert result.status == 1
    found = [l for l in result.lines if l.startswith(str(folder) + "/" + place) and text in l]
    assert found, "expected %s ... %s, got:\n%s" % (place, text, result.err)


HEAD = "symbol,plc,type,dir,pv\n"
TAGS = [
    ("no tag", "A,,INT,in,A\n", "2:2: plc: ", "EtherNet/IP needs the name of the tag"),
    ("a name that is none", "A,A..B,INT,in,A\n", "2:2: plc: ", "is no name of a tag; allowed: such as"),
    ("an index that is none", "A,A[x],INT,in,A\n", "2:2: plc: ", "an index is a number; allowed: up to"),
    ("a type that no controller has", "A,A,DATE_AND_TIME,in,A\n", "2:3: type: ",
     "a controller has no DATE_AND_TIME; allowed: BOOL SINT"),
    ("an array that begins at 1", "A,A,ARRAY[1..4] OF INT,in,A\n", "2:3: type: ",
     "arrays of a controller begin at 0"),
    ("a member of a number", "A,T,INT,in,A\nB,T.Level,REAL,in,B\n", "3:2: plc: ",
     "Level is a number or a text, and has no members"),
    ("a number with members", "A,T.Level,REAL,in,A\nB,T,INT,in,B\n", "3:2: plc: ",
     "T has members, and is no INT"),
    ("a tag of two types", "A,T,REAL,in,A\nB,T,DINT,in,B\n", "3:2: plc: ", "T is REAL elsewhere"),
    ("two and one dimensions", 'A,"T[1,2]",INT,in,A\nB,T[3],INT,in,B\n', "3:2: plc: ",
     "the array has 2 dimensions elsewhere"),
    ("a bit of a REAL", "A,T,REAL,in,A\nB,T.3,BOOL,in,B\n", "3:2: plc: ",
     "only whole numbers have bits, and REAL is none"),
]


@pytest.mark.parametrize("title, rows, place, text", TAGS, ids=[t[0] for t in TAGS])
def test_tag(tmp_path, title, rows, place, text):
    """tags: {title}"""
    import controller
    result = plcmap("check", controller.write(tmp_path / "m", map=HEAD + rows))
    assert result.status == 1
    assert [l for l in result.lines if "map.csv:" + place in l and text in l], result.err


@pytest.mark.parametrize("name", ["Motor 1", "a;b", "1abc", "a..b", "a := b", '"My tag"', "(*a"])
def test_variables(tmp_path, name):
    """{name}: what is no variable of CODESYS does not get into the program"""
    folder = example.write(tmp_path / "m", plc="key,value\nfamily,codesys\n",
                           map='symbol,plc,type,tx,pv\nA,"%s",INT,0,A\n' % name.replace('"', '""'))
    result = plcmap("check", folder)
    assert result.status == 1 and "map.csv:2:2: plc: %s cannot be a variable" % name in result.err


@pytest.mark.parametrize("name", ['a"b', "a$(x)b", "-x", "a%b", "x" * 101])
def test_name_of_the_map(tmp_path, name):
    """{name}: no name of a map, because it becomes that of files"""
    result = plcmap("check", example.write(tmp_path / name))
    assert result.status == 1 and "becomes the name of files and stands in st.cmd; allowed: " in result.err


@pytest.mark.parametrize("patience", ["nan", "inf", "1e999", "-1", "0", "x"])
def test_patience(tank, patience):
    """{patience} as --patience is refused: what differs would be read for ever"""
    result = plcmap("prove", tank, "--patience=" + patience)
    assert result.status == 2 and "allowed: seconds, up to 3600" in result.err


@pytest.mark.parametrize("encoding", ["punycode", "undefined", "a\0b", "rot13"])
def test_encoding(tank, encoding):
    """{encoding!r} as --encoding is refused"""
    assert plcmap("--encoding", encoding, "check", tank).status == 1


@pytest.mark.parametrize("command", ["check", "place", "show"])
def test_no_map(tmp_path, command):
    """{command} of a file that is no map names the file and what is one"""
    (tmp_path / "list.txt").write_text("x")
    result = plcmap(command, tmp_path / "list.txt")
    assert result.status == 1 and "list.txt: is no map; allowed: a folder with map.csv" in result.err


def test_nowhere(tank, tmp_path):
    """A target in which nothing can be written is told"""
    (tmp_path / "file").write_text("")
    for words in (["convert", tank, tmp_path / "file" / "x"], ["convert", tank, tmp_path / "file" / "x.xlsx"],
                  ["generate", tank, "-o", tmp_path / "file" / "x"]):
        result = plcmap(*words)
        assert result.status == 1 and "Not a directory" in result.err, result.err


ALLOWED = ("allowed", "leave ", "write ", "needs", "must", "gives one", "would", "shows", "readback=",
           "exceed", "cannot be reached", "beyond", "at an even byte", "of a single bit", "only a BOOL",
           "unless", "no . and no $", "contains itself", "stand together", "there is no", "is no ",
           "has more than", "header", "has no states", "show the setpoints")


BY_ROW = ("an S7 address in CODESYS", "a download without the handshake")  # of a key that rows contradict


@pytest.mark.parametrize("title, changes, place, text", MISTAKES, ids=[m[0] for m in MISTAKES])
def test_what_is_allowed(tmp_path, title, changes, place, text):
    """{title}: each line says what is allowed, or has it in what is wrong; few follow from others"""
    folder = example.write(tmp_path / "m", **changes)
    lines = [l for l in plcmap("check", folder).lines if "warning" not in l]
    assert [l for l in lines if not any(a in l for a in ALLOWED)] == []
    assert len(lines) <= 4 or title in BY_ROW, lines


def test_count():
    """At least 60 kinds are told, each by another line"""
    assert len({m[3] for m in MISTAKES}) >= 60


def test_all_errors(tmp_path):
    """All errors of a map are told, not the first alone"""
    folder = example.write(tmp_path / "m", **map_(
        ("Tank.Temp", "type", "REEL"), ("Tank.Level", "tx", "4"), ("Tank.Mode", "states", "@M"),
        ("Tank.Door", "desc", "d" * 50)))
    lines = plcmap("check", folder).lines
    assert len([l for l in lines if "warning" not in l]) >= 4
    assert [int(l.split(":")[1]) for l in lines] == sorted(int(l.split(":")[1]) for l in lines)


def test_example_is_good(tank):
    """The worked example has no mistakes"""
    result = plcmap("check", tank)
    assert (result.status, result.err) == (0, "")
    assert "in 124 bytes (PLC to IOC), out 54 bytes" in result.out
