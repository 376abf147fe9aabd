"""Which record shows a value, and with which fields. Knows the driver's links; knows no file."""
from ..types import Array, Elementary, Text

LINK_TYPES = {"BYTE": "UINT8", "USINT": "UINT8", "SINT": "INT8", "CHAR": "UINT8", "INT": "INT16",
              "UINT": "UINT16", "WORD": "UINT16", "DATE": "UINT16", "S5TIME": "UINT16",
              "DINT": "INT32", "TIME": "INT32", "UDINT": "UINT32", "DWORD": "UINT32",
              "TIME_OF_DAY": "UINT32", "LINT": "INT64", "LTIME": "INT64", "LDT": "INT64",
              "ULINT": "UINT64", "LWORD": "UINT64", "LTOD": "UINT64", "REAL": "REAL32",
              "LREAL": "REAL64"}
ELEMENTS = {"INT8": "CHAR", "UINT8": "UCHAR", "INT16": "SHORT", "UINT16": "USHORT",
            "INT32": "LONG", "UINT32": "ULONG", "INT64": "INT64", "UINT64": "UINT64",
            "REAL32": "FLOAT", "REAL64": "DOUBLE"}
PREFIXES = "ZR ON TW TH FR FV SX SV EI NI TE EL TV TT FT FF".split()
UNITS = {"TIME": "ms", "TIME_OF_DAY": "ms", "LTIME": "ns", "LTOD": "ns"}
SHORT_TEXT = 39  # characters of a stringin
COMMAND_TIME = "1"  # s until a command bit goes back


class Record:
    """A record: type, name behind the prefix, fields, info items."""
    __slots__ = ("type", "name", "fields", "infos", "leaf", "readback")

    def __init__(self, type_, name, leaf, readback=False):
        self.type = type_
        self.name = name
        self.fields = []
        self.infos = []
        self.leaf = leaf
        self.readback = readback

    def add(self, name, value):
        if value not in (None, ""):
            self.fields.append((name, str(value)))


def number_text(value):
    """4.0 -> 4, 10.1 -> 10.1"""
    return "%d" % value if value == int(value) and abs(value) < 1e15 else repr(value)


def _whole(leaf):
    """All that is said about an integer is whole: a longin can say it."""
    shown = leaf.shown
    values = [v for v in list(shown.limits.values()) + [shown.lopr, shown.hopr] if v is not None]
    return shown.raw is None and not shown.prec and all(v == int(v) for v in values)


def kind_of(map_, leaf):
    """(record type for input, for output) of a leaf."""
    kind = leaf.type
    if isinstance(kind, Array):
        if kind.element.kind == "char":
            return "lsi", "lso"
        return "waveform", "aao"
    if isinstance(kind, Text):
        return ("stringin", "stringout") if kind.length <= SHORT_TEXT else ("lsi", "lso")
    if kind.kind == "bool":
        return "bi", "bo"
    if kind.kind in ("time", "raw"):
        return "waveform", "aao"
    if kind.kind == "char":
        return "stringin", "stringout"
    if leaf.shown.states is not None:
        return "mbbi", "mbbo"
    if kind.kind == "real" or not _whole(leaf):
        return "ai", "ao"
    wide = kind.size == 8 or LINK_TYPES[kind.name] == "UINT32"
    return ("int64in", "int64out") if wide else ("longin", "longout")


def type_options(map_, leaf):
    """T= L= H= B= of a leaf."""
    kind = leaf.type
    if isinstance(kind, Array):
        if kind.element.kind == "char":
            return "T=STRING L=%d" % kind.count()
        return "T=%s" % LINK_TYPES[kind.element.name]
    if isinstance(kind, Text):
        return "T=S7STRING L=%d" % kind.length if map_.s7_strings() else \
            "T=STRING L=%d" % (kind.length + 1)
    if kind.kind == "bool":
        return "T=BYTE B=%d"
    if kind.kind == "char":
        return "T=STRING L=1"
    if kind.kind == "time":
        return "T=TIME"
    if kind.kind == "raw":
        return "T=UINT8"
    text = "T=%s" % LINK_TYPES[kind.name]
    if leaf.shown.raw is not None:
        text += " L=%d H=%d" % leaf.shown.raw
    return text


def link(map_, leaf, side, base=None):
    """The INP or OUT text. base: {"tx": "$(TX)", ...} where the offset is that of a macro plus
    the leaf's own; None: absolute."""
    if map_.plc["wire"] == "etherip":
        return "@%s %s" % (base["plc"] if base else map_.plc["name"], _tag(leaf, base))
    place = getattr(leaf, side)
    options = type_options(map_, leaf)
    if leaf.is_bit():
        options = options % place[1]
    text = "@%s/%s %s" % (base["plc"] if base else map_.plc["name"], _offset(leaf, side, base),
                          options)
    if side == "rx" and leaf.tx is not None and map_.number("readback") is None:
        text += " R=%s" % _offset(leaf, "tx", base)
    return text


def _offset(leaf, side, base):
    if base is None:
        return "%d" % getattr(leaf, side)[0]
    return "%s+%d" % (base[side], leaf.relative[0]) if leaf.relative[0] else base[side]


def _tag(leaf, base):
    if base is None:
        return leaf.address.symbol
    return base["tag"] + leaf.member


def records(map_, leaf, name=None, base=None, desc=None):
    """The records of a leaf: its own, and for a setpoint that of its read-back. Nothing for a
    leaf without a name."""
    if not leaf.pv:
        return []
    name = leaf.pv if name is None else name
    inputs, outputs = kind_of(map_, leaf)
    made = []
    if leaf.dir == "in":
        made.append(_record(map_, leaf, inputs, name, "tx", base, desc))
        return made
    made.append(_record(map_, leaf, outputs, name, "rx", base, desc))
    shown = leaf.tx is not None or not map_.has_blocks()
    if leaf.dir == "out" and shown and map_.plc["rbv"] != "-":
        made.append(_record(map_, leaf, inputs, name + map_.plc["rbv"], "tx", base, desc, True))
    return made


def _record(map_, leaf, type_, name, side, base, desc, readback=False):
    record = Record(type_, name, leaf, readback)
    shown = leaf.shown
    output = side == "rx"
    record.add("DESC", desc if desc is not None else leaf.desc())
    record.add("DTYP", "EtherIP" if map_.plc["wire"] == "etherip" else "S7plc")
    text = link(map_, leaf, side, base)
    if map_.plc["wire"] == "etherip":
        text += " S %g" % (int(map_.plc["period"]) / 1000)
    record.add("OUT" if output else "INP", text)
    if not output:
        record.add("SCAN", "I/O Intr")
        record.add("TSE", "-2")
    _value_fields(map_, record, leaf, output)
    if output or not readback:
        _limits(record, shown)
    if leaf.dir == "cmd" and record.type == "bo":
        record.add("HIGH", COMMAND_TIME)
    record.add("ASG", shown.asg or leaf.owner.shown.asg)
    if not readback:
        own = [f for f in leaf.owner.shown.fields if leaf.field is not None and
               f[0] not in dict(shown.fields)]
        for field, value in shown.fields + own:
            record.fields = [f for f in record.fields if f[0] != field]
            record.add(field, value)
    archive = shown.archive or leaf.owner.shown.archive
    if archive:
        record.infos.append(("archive", "%s %g" % archive))
    return record


def _value_fields(map_, record, leaf, output):
    shown, kind, type_ = leaf.shown, leaf.type, record.type
    if type_ in ("ai", "ao", "longin", "longout", "int64in", "int64out", "waveform", "aao"):
        unit = UNITS.get(kind.name, "") if isinstance(kind, Elementary) else ""
        record.add("EGU", shown.egu or unit)
        record.add("LOPR", None if shown.lopr is None else number_text(shown.lopr))
        record.add("HOPR", None if shown.hopr is None else number_text(shown.hopr))
    if type_ in ("ai", "ao", "waveform", "aao"):
        record.add("PREC", shown.prec)
    if type_ in ("waveform", "aao"):
        _array_fields(record, kind)
    if type_ in ("ai", "ao") and shown.raw is not None:
        _scale(map_, record, shown)
    if type_ in ("lsi", "lso"):
        record.add("SIZV", (kind.count() if isinstance(kind, Array) else kind.length) + 1)
    if type_ in ("bi", "bo"):
        states = shown.states
        record.add("ZNAM", states[0].text if states else "0")
        record.add("ONAM", states[1].text if states else "1")
        if states:
            record.add("ZSV", states[0].severity)
            record.add("OSV", states[1].severity)
    if type_ in ("mbbi", "mbbo"):
        record.add("NOBT", 8 * kind.size)
        for prefix, state in zip(PREFIXES, shown.states):
            record.add(prefix + "VL", state.value & (1 << 8 * kind.size) - 1)
            record.add(prefix + "ST", state.text)
            record.add(prefix + "SV", state.severity)


def _scale(map_, record, shown):
    """From raw to units. Links of EtherNet/IP have no raw range: there by slope and offset."""
    if map_.has_blocks():
        record.add("LINR", "LINEAR")
        record.add("EGUL", number_text(shown.eng[0]))
        record.add("EGUF", number_text(shown.eng[1]))
        return
    slope = (shown.eng[1] - shown.eng[0]) / (shown.raw[1] - shown.raw[0])
    record.add("LINR", "SLOPE")
    record.add("ESLO", number_text(slope))
    record.add("EOFF", number_text(shown.eng[0] - slope * shown.raw[0]))


def _array_fields(record, kind):
    if isinstance(kind, Array):
        record.add("FTVL", ELEMENTS[LINK_TYPES[kind.element.name]])
        record.add("NELM", kind.count())
    else:
        record.add("FTVL", "UCHAR")
        record.add("NELM", kind.size)


def _limits(record, shown):
    if record.type not in ("ai", "ao", "longin", "longout", "int64in", "int64out"):
        return
    for column, value in shown.limits.items():
        if value is not None:
            record.add(column.upper(), number_text(value))
            record.add({"lolo": "LLSV", "low": "LSV", "high": "HSV", "hihi": "HHSV"}[column],
                       shown.severities[column])


def quoted(text):
    """A text for a database file."""
    return '"%s"' % text.replace("\\", "\\\\").replace('"', '\\"')


def record_text(record, prefix):
    """A record as it stands in a database file."""
    lines = ["record(%s, %s) {" % (record.type, quoted(prefix + record.name))]
    lines += ["    field(%s, %s)" % (f, quoted(v)) for f, v in record.fields]
    lines += ["    info(%s, %s)" % (n, quoted(v)) for n, v in record.infos]
    return "\n".join(lines + ["}"])
