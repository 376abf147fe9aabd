"""The columns of the sheets and the keys of the sheet plc: what they mean, what is allowed.
One table; check, convert, the documentation and messages all read it."""

SEVERITIES = ["NO_ALARM", "MINOR", "MAJOR", "INVALID"]
DIRECTIONS = ["in", "out", "cmd", "reserved"]
TRANSFERS = ["", "explicit", "ptr"]
YES = ["", "yes", "no"]

# name -> (words or None, help)
MAP_COLUMNS = {
    "symbol": (None, "name of the value in the PLC; the key of the row"),
    "plc": (None, "its place in PLC memory (DB10.DBD0, M4.3), or its symbol or tag there"),
    "type": (None, "INT REAL BOOL STRING[16] ARRAY[1..4] OF REAL, or a type of the sheet types"),
    "dir": (DIRECTIONS, "in: PLC to IOC; out: setpoint, compared and read back; cmd: command, "
            "neither; reserved: bytes that nobody uses yet, or any more"),
    "tx": (None, "place in the block PLC to IOC: byte or byte.bit, header counted"),
    "rx": (None, "place in the block IOC to PLC"),
    "via": (TRANSFERS, "how the PLC moves it: explicit, by pointer (ptr), or as it fits (blank)"),
    "pv": (None, "name of the record, behind the prefix; blank: no record"),
    "desc": (None, "DESC, 40 characters"),
    "egu": (None, "unit, 15 characters"),
    "prec": (None, "digits behind the point"),
    "lopr": (None, "display range, low"),
    "hopr": (None, "display range, high"),
    "lolo": (None, "alarm limit"),
    "low": (None, "alarm limit"),
    "high": (None, "alarm limit"),
    "hihi": (None, "alarm limit"),
    "sev": (None, "severities of the limits: such as low=MINOR hihi=INVALID; without it MAJOR "
            "for lolo and hihi, MINOR for low and high"),
    "states": (None, "off|on, ok|FAULT!MAJOR, 0=stop|7=service, or @ENUM"),
    "raw": (None, "raw range of an integer: 0..27648"),
    "eng": (None, "the same range in units: 0..100"),
    "archive": (None, "yes, a number of seconds (monitor), or scan and seconds"),
    "autosave": (None, "yes (VAL), or names of fields"),
    "asg": (None, "access security group"),
    "group": (None, "display and alarm tree: Tank, or Tank/Valves"),
    "fields": (None, "more fields of the record: PINI=YES; FLNK=x"),
    "note": (None, "a remark; goes into the manual"),
}
TYPE_COLUMNS = {
    "type": (None, "name of the type; blank: that of the row above"),
    "field": (None, "name of the field in the PLC"),
    "ftype": (None, "its type"),
    "at": (None, "its place in the type: byte or byte.bit; blank: as an S7 places it"),
    "suffix": (None, "what its record's name gets; blank: the field's name (structures: and a "
               "colon); -: no record"),
    "dir": (["", "in", "out", "cmd", "reserved"], "blank: that of the row that uses the type"),
}
TYPE_COLUMNS.update({c: MAP_COLUMNS[c] for c in (
    "desc egu prec lopr hopr lolo low high hihi sev states raw eng archive autosave asg group "
    "fields note").split()})
ENUM_COLUMNS = {
    "enum": (None, "name of the list; blank: that of the row above"),
    "value": (None, "number in the PLC"),
    "text": (None, "25 characters"),
    "sev": ([""] + SEVERITIES, "severity of this state"),
}
PLC_COLUMNS = {
    "key": (None, "see the table of keys"),
    "value": (None, ""),
}
SHEETS = {"plc": PLC_COLUMNS, "map": MAP_COLUMNS, "types": TYPE_COLUMNS, "enums": ENUM_COLUMNS}

ON_OFF = ["on", "off"]
FAMILIES = ["s7-classic", "tia", "codesys", "none"]
WIRES = ["block", "block-modbus", "modbus", "etherip"]

# key -> (default, words or (low, high) or None, help)
PLC_KEYS = {
    "name": ("PLC", None, "name of the station in links"),
    "address": ("", None, "host name or address of the PLC"),
    "second": ("", None, "a redundant pair: address of SECOND; blank: one PLC"),
    "port": ("", (1, 65535), "TCP port; blank: 2000, with Modbus 502"),
    "wire": ("block", WIRES, "block; block-modbus: blocks in, Modbus out; modbus; etherip"),
    "family": ("s7-classic", FAMILIES, "which PLC code is generated"),
    "byteorder": ("big", ["big", "little"], "of the values in the blocks"),
    "sync": ("off", ON_OFF, "the sync handshake, with a header of 4 bytes"),
    "readback": ("", (0, 65535), "byte 0 of the block IOC to PLC is shown at this byte of the other "
                 "one; blank: each setpoint by itself"),
    "download": ("off", ON_OFF, "pointer tables come from the IOC: 16 bytes of header in the block "
                 "to the IOC"),
    "layout_at": ("", (0, 65535), "without sync: byte where the block shows the layout id (a WORD)"),
    "tx_db": ("1", (1, 65535), "DB of the block PLC to IOC"),
    "rx_db": ("2", (1, 65535), "DB of the block IOC to PLC"),
    "tx_ptrs": ("3", (1, 65535), "DB of the pointer table PLC to IOC"),
    "rx_ptrs": ("4", (1, 65535), "DB of the pointer table IOC to PLC"),
    "acc_db": ("5", (1, 65535), "DB of the setpoints last accepted"),
    "held_db": ("6", (1, 65535), "DB of the setpoints that the PLC holds, for CHECKSYNC"),
    "min_in": ("0", (0, 65536), "least bytes of the block PLC to IOC"),
    "min_out": ("0", (0, 65536), "least bytes of the block IOC to PLC"),
    "prefix": ("", None, "in front of all record names"),
    "rbv": (":RBV", None, "behind the name of a setpoint: the record of its read-back; -: none"),
    "period": ("100", (1, 3600000), "ms from block to block"),
    "recvtimeout": ("", (10, 3600000), "ms of silence; blank: 20 periods, 2000 at least"),
    "sendinterval": ("", (1, 3600000), "ms between two blocks to the PLC; blank: period"),
    "watchdog": ("3000", (0, 3600000), "ms without a block from the IOC until the PLC's SYNC falls"),
    "unit": ("1", (0, 255), "Modbus: unit identifier"),
    "in_register": ("0", (0, 65535), "Modbus: holding register of byte 0 of the input"),
    "out_register": ("1000", (0, 65535), "Modbus: holding register of byte 0 of the output"),
    "slot": ("0", (0, 255), "EtherNet/IP: slot of the controller"),
}

OWN_BLOCKS = ["tx_db", "rx_db", "tx_ptrs", "rx_ptrs", "acc_db", "held_db"]  # of the PLC's program
LIMIT_COLUMNS = ["lolo", "low", "high", "hihi"]
MAX_PV = 60
MAX_DESC = 40
MAX_EGU = 15
MAX_STATE = 25
MAX_STATES = 16


def choices():
    """{(sheet, column): words} for drop-downs."""
    return {(sheet, column): [w for w in words if w]
            for sheet, columns in SHEETS.items()
            for column, (words, _) in columns.items() if words}
