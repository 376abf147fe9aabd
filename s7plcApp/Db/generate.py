#!/usr/bin/env python3
"""Writes the databases that show the health of a PLC, from the tables below.

    s7plcApp/Db/generate.py           writes the files
    s7plcApp/Db/generate.py --check   says which differ from what it would write; status 1

What it writes is committed, so that a build needs no Python. It knows names and fields of
records; what a statistic means is in docs/statistics.md.
"""
import sys
from pathlib import Path

HERE = Path(__file__).resolve().parent
PAIR = HERE.parents[1] / "phoenixRedundApp/Db"

# How a value is posted. "change": when it differs. "runs": it counts or grows while all is
# well. "time": it is measured anew with each block. "once": it never changes.
NO_ORDER = [("VAL", "0"), ("UDF", "0"), ("PINI", "YES")]  # 0 does nothing
CHANGES, SLOWLY = "Monitor, 00:00:01, VAL", "Scan, 00:01:00, VAL"  # for info(archive)
QUIET = {"runs": "$(QUIET_COUNT=1000000000)", "age": "$(QUIET_AGE=600)", "time": "$(QUIET_MS=1000)"}


class Row:
    """One record. `limits`: "high" or "both", with macros NAME_HIGH, NAME_HSV, ..."""

    def __init__(self, name, kind, statistic, text, post="change", unit="", prec=None,
                 small=False, archive=None, limits=None, fields=(), alias=None, scan="I/O Intr",
                 dtyp="S7plc stats"):
        self.name, self.kind, self.statistic, self.text = name, kind, statistic, text
        self.post, self.unit, self.prec, self.small = post, unit, prec, small
        self.archive, self.limits, self.fields, self.alias = archive, limits, fields, alias
        self.scan, self.dtyp = scan, dtyp

    def lines(self):
        order = self.kind == "bo"
        out = [f'record({self.kind}, "{name(self.name, order)}") {{']
        if self.alias:
            out.append(f'    alias("$(P){self.alias}$(R=)")')
        put = [("DESC", self.text)]
        if self.dtyp:
            put += [("DTYP", self.dtyp), ("OUT" if order else "INP",
                                         "@$(PLC)/" + self.statistic if self.statistic
                                         else "@$(PLC)")]
            if not order:
                put += [("SCAN", self.scan), ("PINI", "YES")]
            else:
                put += NO_ORDER
        if self.unit:
            put.append(("EGU", self.unit))
        if self.prec is not None:
            put.append(("PREC", self.prec))
        quiet = QUIET.get(self.post)
        if quiet:
            put += [("MDEL", quiet), ("ADEL", quiet)]
        put += [*self.fields, *self._limits()]
        put.append(("ASG", "$(ASG_ORDER=)" if order else "$(ASG=)"))
        out += [f'    field({field + ",":5} "{value}")' for field, value in put]
        if self.limits:
            low = "LOLO LOW LLSV LSV " if self.limits == "both" else ""
            out.append(f'    info(autosaveFields, "{low}HIGH HIHI HSV HHSV")')
        if self.archive:
            out.append(f'    info(archive, "{self.archive}")')
        return out + ["}", ""]

    def _limits(self):
        if not self.limits:
            return []
        macro = self.name.upper()
        both = [("LOLO", "0", "LLSV"), ("LOW", "0", "LSV")] if self.limits == "both" else []
        put = []
        for field, default, severity in both + [("HIGH", "0", "HSV"), ("HIHI", "0", "HHSV")]:
            put += [(field, f"$({macro}_{field}={default})"),
                    (severity, f"$({macro}_{severity}=NO_ALARM)")]
        return put


def name(short, order=False):
    """The macro of a whole name, with what it is by default."""
    return f"$(N_{short}=$(P){short}$({'S' if order else 'R'}=))"


def states(texts, severities=None):
    """Fields of an mbbi: values 0, 1, ... with these texts."""
    two = "ZR ON TW TH FR FV SX SV EI NI TE EL TV TT FT FF".split()
    put = [(two[i] + "VL", i) for i in range(len(texts))]
    put += [(two[i] + "ST", text) for i, text in enumerate(texts)]
    return put + [(two[i] + "SV", s) for i, s in enumerate(severities or []) if s]


def bi(no, yes, no_severity=None, yes_severity=None):
    put = [("ZNAM", no), ("ONAM", yes)]
    put += [("ZSV", no_severity)] if no_severity else []
    return put + ([("OSV", yes_severity)] if yes_severity else [])


def text(size="256"):
    return [("SIZV", size)]


SEV, NSSV = "$(SEV=MAJOR)", "$(NSSV=MINOR)"

STATE = [
    Row("State", "mbbi", "state", "State of $(PLC)", small=True, archive=CHANGES,
        fields=states(("no address", "connecting", "waiting for data", "ok", "wrong size",
                       "frozen", "no PRIMARY", "layout mismatch", "some reads refused",
                       "reads refused"),
                      (SEV, SEV, SEV, None, SEV, SEV, SEV, SEV, "$(SOME_SV=MINOR)", SEV))),
    Row("Setpoints", "mbbi", "setpoints", "What becomes of puts to $(PLC)", small=True,
        archive=CHANGES,
        fields=states(("no output", "they pass", "they wait", "LOCAL", "mismatch",
                       "PLC refuses some", "none", "not known"),
                      (SEV, None, NSSV, "$(LSV=NO_ALARM)", SEV, "$(REFUSED_SV=MINOR)", None,
                       NSSV))),
    Row("Alive", "bi", "alive", "Data of $(PLC) is valid", small=True, archive=CHANGES,
        fields=bi("not valid", "valid")),
    Row("TcpConnected", "bi", "connected", "TCP to $(PLC) is up",
        fields=bi("disconnected", "connected")),
    Row("StateTime", "ai", "stateTime", "Time in this state", "age", "s", 0, small=True),
    Row("LostTime", "lsi", "lostTime", "When valid data was last lost", small=True,
        fields=text("40")),
]
WORDS = [
    Row("Name", "lsi", "name", "Name of the PLC", small=True, fields=text()),
    Row("Reason", "lsi", "reason", "Why data is not valid", small=True, fields=text()),
    Row("LastError", "lsi", "lastError", "Last loss or failure", small=True, fields=text()),
    Row("LastErrorTime", "lsi", "lastErrorTime", "When that was", small=True,
        fields=text("40")),
    Row("Address", "lsi", "address", "host:port", small=True, fields=text()),
    Row("AddressFirst", "lsi", "addressFirst", "host:port of FIRST", fields=text()),
    Row("AddressSecond", "lsi", "addressSecond", "host:port of SECOND", fields=text()),
    Row("Options", "lsi", "options", "Options that are set", fields=text()),
    Row("ConnectTime", "lsi", "connectTime", "When the connection was made",
        fields=text("40")),
]
COUNTERS = [
    Row("InSize", "int64in", "inSize", "Block PLC -> IOC", unit="bytes"),
    Row("OutSize", "int64in", "outSize", "Block IOC -> PLC", unit="bytes"),
    Row("BurstSize", "int64in", "burstSize", "Size the PLC sends, 0 = right", unit="bytes"),
    Row("BlocksIn", "int64in", "blocksIn", "Blocks received: the heartbeat", small=True,
        archive=SLOWLY),
    Row("BlocksOut", "int64in", "blocksOut", "Blocks sent", "runs", archive=SLOWLY),
    Row("BytesIn", "int64in", "bytesIn", "Bytes received", "runs", "bytes"),
    Row("BytesOut", "int64in", "bytesOut", "Bytes sent", "runs", "bytes"),
    Row("Skipped", "int64in", "skipped", "Old blocks of a backlog", limits="high"),
    Row("Coalesced", "int64in", "coalesced", "Blocks while records were busy", limits="high"),
    Row("Ignored", "int64in", "ignored", "Blocks of a PLC that does not lead"),
    Row("Heartbeats", "int64in", "heartbeats", "Unchanged blocks sent", "runs"),
    Row("RefusedWrites", "int64in", "refusedWrites", "Puts refused", small=True,
        limits="high", archive=CHANGES),
    Row("PutsWaiting", "int64in", "putsWaiting", "Puts that wait for the PLC"),
    Row("PutsDropped", "int64in", "putsDropped", "Puts that had to be dropped", limits="high"),
    Row("SlowSends", "int64in", "slowSends", "Blocks that waited for the PLC", limits="high"),
    Row("Doubts", "int64in", "doubts", "Times a block began where none should"),
    Row("OutOfStep", "int64in", "outOfStep", "Times the stream was out of step",
        limits="high"),
    Row("SizeMismatches", "int64in", "sizeMismatches", "Times the size was wrong"),
    Row("LayoutPlc", "int64in", "layoutPlc", "Layout id that the PLC shows"),
    Row("LayoutMismatches", "int64in", "layoutMismatches", "Times the layout differed"),
    Row("Connects", "int64in", "connects", "Connections made"),
    Row("Reconnects", "int64in", "reconnects", "Connections lost", small=True,
        limits="high", archive=CHANGES),
    Row("ConnectErrors", "int64in", "connectErrors", "Attempts that failed"),
    Row("ClockErrors", "int64in", "clockErrors", "PLC clocks without a valid date"),
]
TIMES = [
    Row("ConnectedFor", "ai", "connectedFor", "Connected for", "age", "s", 0),
    Row("BlockAge", "ai", "blockAge", "Since the last block in", "change", "s", 1, small=True,
        limits="high", fields=[("MDEL", "1"), ("ADEL", "1")]),
    Row("HeartbeatAge", "ai", "heartbeatAge", "Since the last block out", "age", "s", 1,
        limits="high"),
    Row("ClockOffset", "ai", "clockOffset", "PLC clock - IOC clock", "change", "s", 3,
        limits="both", archive=SLOWLY, fields=[("MDEL", "$(QUIET_CLOCK=1)"),
                                                    ("ADEL", "$(QUIET_CLOCK=1)")]),
    Row("Period", "ai", "period", "From block to block", "time", "ms", 2, limits="high"),
    Row("PeriodMin", "ai", "periodMin", "The shortest", "time", "ms", 2),
    Row("PeriodMax", "ai", "periodMax", "The longest", "time", "ms", 2, limits="high"),
    Row("PeriodMean", "ai", "periodMean", "The mean", "time", "ms", 2, archive=SLOWLY),
    Row("Jitter", "ai", "jitter", "Standard deviation", "time", "ms", 3, limits="high",
        archive=SLOWLY),
    Row("SendLatency", "ai", "sendLatency", "Put to kernel", "time", "ms", 3, limits="high"),
    Row("SendLatencyMax", "ai", "sendLatencyMax", "Put to kernel, longest", "time", "ms", 3,
        limits="high"),
    Row("ScanLatency", "ai", "scanLatency", "Block to end of scan", "time", "ms", 3,
        limits="high"),
    Row("ScanLatencyMax", "ai", "scanLatencyMax", "Block to end of scan, longest", "time",
        "ms", 3, limits="high"),
]
# LiveTick makes these process.
BINS = [("FTVL", "DOUBLE"), ("NELM", "64")]
SHAPES = [
    Row("BlockTime", "lsi", "blockTime", "Stamp of the last block", scan="Passive",
        fields=text("40") + [("FLNK", name("PeriodHistogram"))]),
    Row("PeriodHistogram", "waveform", "periodHistogram", "Blocks per bin of period",
        unit="blocks", scan="Passive", fields=BINS + [("FLNK", name("LatencyHistogram"))]),
    Row("LatencyHistogram", "waveform", "latencyHistogram", "Passes per bin of scanLatency",
        unit="passes", scan="Passive", fields=BINS),
    Row("HistogramBins", "waveform", "histogramBins", "Start of each bin", unit="ms",
        scan="Passive", fields=BINS),
]
ORDERS = [
    Row("Reset", "bo", "reset", "1: statistics begin anew", small=True,
        fields=bi("-", "reset") + [("HIGH", "1")]),
    Row("Send", "bo", "send", "1: the output block leaves now", small=True,
        fields=bi("-", "send") + [("HIGH", "1")]),
]


def plain(kind, short, text, fields, order=False):
    put = [("DESC", text), *fields, ("ASG", "$(ASG_ORDER=)" if order else "$(ASG=)")]
    return ([f'record({kind}, "{name(short, order)}") {{'] +
            [f'    field({field + ",":5} "{value}")' for field, value in put] + ["}", ""])


def fan(short, source, targets, follow=None):
    """A dfanout that copies `source` to the MDEL of the targets."""
    fields = [("DOL", name(source)), ("OMSL", "closed_loop")]
    fields += [("OUT" + "ABCDEFGH"[i], name(t) + ".MDEL") for i, t in enumerate(targets)]
    return plain("dfanout", short, "Deadbands", fields + ([("FLNK", name(follow))] if follow
                                                          else []))


def deadbands(short, text, quiet, targets, follow, source=None):
    """Records that set MDEL of the targets: 0 while Live is 1, else `quiet`."""
    records = plain("calc", short, text,
                    [("INPA", source or name("Live", True)), ("CALC", "A?0:B"),
                     ("INPB", quiet), ("FLNK", name(short + "A"))])
    while targets:
        records += fan(short + "A" if len(records) < 10 else short + "B", short, targets[:8],
                       short + "B" if targets[8:] else follow)
        targets = targets[8:]
    return records


def live():
    """While Live is 1 all numbers are posted each second."""
    def of(post):
        return [r.name for r in COUNTERS + TIMES + STATE if r.post == post]
    return (
        plain("bo", "Live", "1: all numbers each second, 10 min",
              [*NO_ORDER, ("ZNAM", "quiet"), ("ONAM", "live"), ("HIGH", "$(LIVE_S=600)"),
               ("FLNK", name("LiveRuns"))], order=True) +
        deadbands("LiveRuns", "Deadband of what counts", QUIET["runs"], of("runs"), "LiveAges") +
        deadbands("LiveAges", "Deadband of ages", QUIET["age"], of("age"), "LiveTimes") +
        deadbands("LiveTimes", "Deadband of what is measured", QUIET["time"], of("time"), None) +
        # Once a second: live, or another state, or 300 s are over
        plain("calcout", "LiveTick", "When shapes are posted",
              [("SCAN", "1 second"), ("INPA", name("Live", True)), ("INPB", name("State")),
               ("CALC", "E:=E+1;D:=A||B#C||E>=300;E:=D?0:E;C:=B;D"),
               ("OOPT", "When Non-zero"), ("OUT", name("BlockTime") + ".PROC")]))


MACROS = """\
#   P     prefix of the record names           PLC   name given to s7plcConfigure
"""
COMMON = """\
#   R     end of the names of what is read, S of orders: default "". With R=-R P=Area:PLC1- the
#         state is Area:PLC1-State-R. A whole name: N_State=Any:Name, the same for all others.
#   ASG, ASG_ORDER   access security groups of what is read, and of orders
"""
FULL = """\
# The health of one PLC connection: everything that plclink knows of it, for experts. Operators
# need no more than s7plcStationSmall.db. docs/statistics.md explains each value; op/ has
# displays for it. Written by generate.py: change that.
#
""" + MACROS + """\
#   SEV   severity of a state other than ok, default MAJOR
#   NSSV  severity while puts wait for the PLC, default MINOR; LSV in LOCAL, NO_ALARM;
#         REFUSED_SV where the PLC refused some, MINOR
#   SOME_SV   severity while the PLC refuses to show some places, default MINOR; all: SEV
""" + COMMON + """\
#   BLOCKAGE_HIGH, BLOCKAGE_HSV, BLOCKAGE_HIHI, BLOCKAGE_HHSV   alarm limits and severities
#         of BlockAge. The same for each record that has them below
#   QUIET_COUNT, QUIET_AGE (s), QUIET_MS   deadbands of what counts, ages and measured times
#
# All of it is processed when the state changes and once a second, never faster. A PLC where
# nothing happens posts next to nothing but BlocksIn: what counts or varies all the time has a
# wide deadband (caget reads the value of the last second). 1 in $(P)Live: all of it is posted
# each second, for 10 minutes.
"""
SMALL = """\
# The health of one PLC connection for operators. Part of s7plcStation.db, which has all;
# load one of the two. docs/statistics.md explains each value. Written by generate.py: change
# that.
#
""" + MACROS + """\
#   SEV, NSSV, LSV, REFUSED_SV, limits, QUIET_AGE   as in s7plcStation.db
""" + COMMON
SYNC_HEAD = """\
# The sync handshake with one PLC: may setpoints leave, and if not, why not.
# For a PLC with the option sync=on; docs/sync.md. Written by generate.py: change that.
#
""" + MACROS + """\
#   NSSV  severity while setpoints may not leave, default MINOR
#   LSV   severity in LOCAL, default NO_ALARM
""" + COMMON + """\
#
# The names with a colon ($(P)Sync:Time) are aliases, as in earlier databases.
"""
SYNC = [
    Row("Sync", "mbbi", "syncState", "Sync handshake with $(PLC)", archive=CHANGES,
        fields=states(("disconnected", "waiting", "checking", "synced", "LOCAL",
                       "layout mismatch", "map mismatch", "map download"),
                      (NSSV, NSSV, NSSV, None, "$(LSV=NO_ALARM)", "MAJOR", "MAJOR", NSSV))),
    Row("SyncRemote", "bi", "remote", "Who has control of $(PLC)", alias="Sync:Remote",
        archive=CHANGES, fields=bi("LOCAL", "REMOTE")),
    Row("SyncTime", "ai", "syncTime", "Time in this state", "age", "s", 0, alias="Sync:Time"),
    Row("SyncRefused", "int64in", "refusedWrites", "Puts to $(PLC) that were refused",
        alias="Sync:Refused"),
    Row("SyncCount", "int64in", "syncs", "Times $(PLC) agreed to our values",
        alias="Sync:Count"),
    Row("SyncLost", "int64in", "syncsLost", "Times that ended", alias="Sync:Lost"),
    Row("SyncReadbacks", "int64in", "readbacks", "Times outputs took the PLC's value",
        alias="Sync:Readbacks"),
]
TABLES_HEAD = """\
# The table of pointers of one PLC: does it work with ours, and if not, why not?
# For a PLC with the option map=check or map=download; docs/plc-tables.md. Written by
# generate.py: change that.
#
""" + MACROS + COMMON + """\
#
# The names with a colon ($(P)Map:Reason) are aliases, as in earlier databases.
"""
TABLES = [
    Row("Map", "mbbi", "mapState", "Table of pointers of $(PLC)", archive=CHANGES,
        fields=states(("disconnected", "waiting", "fixed tables", "equal", "map mismatch",
                       "beginning", "loading", "PLC checks", "refused"),
                      (None, None, None, None, "MAJOR", "MINOR", "MINOR", "MINOR", "MAJOR"))),
    Row("MapProgress", "longin", "mapProgress", "Of our table the PLC has", unit="%",
        alias="Map:Progress", fields=[("HOPR", "100")]),
    Row("MapReason", "lsi", "mapReason", "Why not our table", alias="Map:Reason",
        fields=text("120")),
    Row("MapCrc", "int64in", "mapCrc", "CRC-32 of our table", alias="Map:Crc"),
    Row("MapPlcCrc", "int64in", "mapPlcCrc", "CRC-32 of the PLC's table", alias="Map:PlcCrc"),
    Row("MapDownloads", "int64in", "mapDownloads", "Tables that $(PLC) took",
        alias="Map:Downloads"),
    Row("MapRefusals", "int64in", "mapRefusals", "Tables that $(PLC) refused",
        alias="Map:Refusals"),
]
MODBUS_HEAD = """\
# Health of a PLC's Modbus/TCP or EtherNet/IP wire, beside s7plcStation.db. Written by
# generate.py: change that.
#
""" + MACROS + """\
#   SEV   severity while outputs go nowhere, default MAJOR
#   LIVE  the record Live of s7plcStation.db; "" where that is not loaded
""" + COMMON
MODBUS = [
    Row("OutputConnected", "bi", "outputConnected", "Outputs of $(PLC) go somewhere",
        archive=CHANGES, fields=bi("disconnected", "connected", "$(SEV=MAJOR)")),
    Row("Requests", "int64in", "requests", "Requests sent", "runs"),
    Row("Exceptions", "int64in", "exceptions", "Requests refused", limits="high",
        archive=CHANGES),
    Row("RefusedReads", "int64in", "refusedReads", "Places that are not shown now", limits="high",
        archive=CHANGES),
    Row("RequestTimeouts", "int64in", "requestTimeouts", "Requests not answered",
        limits="high", archive=CHANGES),
    Row("RequestLatency", "ai", "requestLatency", "Request to answer", "time", "ms", 3,
        limits="high", archive=SLOWLY),
    Row("RequestLatencyMax", "ai", "requestLatencyMax", "The longest", "time", "ms", 3,
        limits="high"),
]


def live_requests():
    """The same for requests; Live is in s7plcStation.db."""
    return (deadbands("LiveRequests", "Deadband of what counts", QUIET["runs"], ["Requests"],
                      "LiveAnswers", "$(LIVE=$(P)Live$(S=)) CP") +
            deadbands("LiveAnswers", "Deadband of what is measured", QUIET["time"],
                      ["RequestLatency", "RequestLatencyMax"], None,
                      "$(LIVE=$(P)Live$(S=))"))


PAIR_HEAD = """\
# The state of a redundant pair of PLCs: who leads, is the other one ready, what happened.
# For a single PLC (redundancy=0) Backup says "no partner". Written by s7plcApp/Db/generate.py:
# change that.
#
#   P     prefix of the record names           PLC   name given to phoenixplcConfigure
#   SWITCHED_SV   severity of a switch-over that nobody has seen (SwitchSeen), NO_ALARM
""" + COMMON + """\
#
# The names in capitals ($(P)PRIMARY, $(P)SWITCH_TIME) are aliases, as in earlier databases.
"""


def pair(short, kind, what, text, alias, fields=(), **more):
    return Row(short, kind, what, text, alias=alias, fields=fields, dtyp="phoenixplc", **more)


SWITCHED = "$(SWITCHED_SV=NO_ALARM)"
ANSWERS = states(("no answer", "answers", "not known"), ("MINOR",))
PAIR_ROWS = [
    # with the states of the paper (THPEA016)
    pair("Backup", "mbbi", "", "BACKUP PLC: which one, and linked?", "BACKUP",
         states(("no partner", "plc-1st unlinked", "plc-2nd unlinked", "plc-1st linked",
                 "plc-2nd linked", "unknown"), (None, "MINOR", "MINOR", None, None, "MINOR")),
         archive=CHANGES),
    pair("BackupLink", "stringin", "backupLink", "By what the BACKUP is linked, or not",
         "BACKUP_LINK"),
    pair("Primary", "mbbi", "primary", "PRIMARY PLC: the one that leads", "PRIMARY",
         states(("none", "FIRST", "SECOND"), ("MAJOR",)), archive=CHANGES),
    pair("Switchovers", "longin", "switchovers", "Switch-overs since the IOC started",
         "SWITCHOVERS", archive=CHANGES),
    pair("SwitchTime", "stringin", "lastSwitchTime", "When the last switch-over was",
         "SWITCH_TIME"),
    pair("SwitchReason", "stringin", "lastSwitchReason", "Why the last switch-over was",
         "SWITCH_REASON"),
    pair("SwitchDuration", "ai", "lastSwitchDuration", "From last old to first new block",
         "SWITCH_DURATION", unit="ms", prec=1, archive=CHANGES),
    pair("Connected1", "bi", "connected1", "TCP connection to FIRST", "CONNECTED1",
         bi("not connected", "connected", "MINOR")),
    pair("Connected2", "mbbi", "connected2", "TCP connection to SECOND", "CONNECTED2",
         states(("not connected", "connected", "no partner"), ("MINOR",))),
    pair("Reachable1", "mbbi", "reachable1", "FIRST answers ICMP echo", "REACHABLE1", ANSWERS),
    pair("Reachable2", "mbbi", "reachable2", "SECOND answers ICMP echo", "REACHABLE2",
         ANSWERS),
    pair("TwoPrimaries", "bi", "twoPrimaries", "Both PLCs send", "TWO_PRIMARIES",
         bi("no", "two PRIMARIES", None, "MAJOR"), archive=CHANGES),
    pair("TwoPrimariesCount", "longin", "twoPrimariesCount", "How often both began to send",
         "TWO_PRIMARIES_COUNT"),
]


def pair_more():
    """What several of them say together; and which switch-overs an operator has seen."""
    return (
        plain("calc", "PairNumber", "For Pair",
              [("INPA", name("Primary") + " CP"), ("INPB", name("TwoPrimaries") + " CP"),
               ("INPC", name("SwitchNew") + " CP"), ("CALC", "B?3:(A&&C?A+3:A)"),
               ("FLNK", name("Pair"))]) +
        plain("mbbi", "Pair", "Who leads $(PLC)",
              [("INP", name("PairNumber")),
               *states(("no PRIMARY", "FIRST leads", "SECOND leads", "two PRIMARIES",
                        "switched to FIRST", "switched to SECOND"),
                       ("MAJOR", None, None, "MAJOR", SWITCHED, SWITCHED))]) +
        plain("longout", "SwitchSeen", "Process: all switch-overs are seen",
              [("PINI", "YES"), ("DOL", name("Switchovers")), ("OMSL", "closed_loop"),
               ("FLNK", name("SwitchNew"))], order=True) +
        plain("calc", "SwitchNew", "Switch-overs that nobody has seen",
              [("INPA", name("Switchovers") + " CP"), ("INPB", name("SwitchSeen", True)),
               ("CALC", "A-B")]))


def refused():
    """A lamp for a count."""
    return plain("bi", "Refused", "Puts were refused since a reset",
                 [("DTYP", "Raw Soft Channel"), ("INP", name("RefusedWrites") + " CP"),
                  ("PINI", "YES"), *bi("none refused", "puts refused", None,
                                       "$(REFUSED_COUNT_SV=NO_ALARM)")])


def text_of(head, *groups):
    out = [head]
    for title, rows in groups:
        if title:
            out.append(f"# --- {title} " + "-" * (88 - len(title)) + "\n")
        for row in rows:
            out += row.lines() if isinstance(row, Row) else [row]
    return "\n".join(out).rstrip("\n") + "\n"


def station():
    return [("State", STATE), ("In words", WORDS),
              ("Counters since start or a reset", COUNTERS), ("Times", TIMES),
              ("Shapes: three bins to the octave; HistogramBins is the x axis", SHAPES),
              ("Orders", ORDERS)]


def small():
    return [(title, [r for r in rows if r.small]) for title, rows in station()
            if any(r.small for r in rows)]


def files():
    """Path and text of each file."""
    return {
        HERE / "s7plcStation.db": text_of(FULL, *station(), ("Refusals", refused()),
                                          ("Live", live())),
        HERE / "s7plcStationSmall.db": text_of(SMALL, *small(), ("Refusals", refused())),
        HERE / "s7plcSync.db": text_of(SYNC_HEAD, ("", SYNC)),
        HERE / "s7plcTables.db": text_of(TABLES_HEAD, ("", TABLES)),
        HERE / "s7plcModbus.db": text_of(MODBUS_HEAD, ("", MODBUS), ("", live_requests())),
        PAIR / "phoenixplcStatus.db": text_of(PAIR_HEAD, ("", PAIR_ROWS), ("", pair_more())),
    }


def main(arguments):
    differ = 0
    for path, text in files().items():
        if arguments == ["--check"]:
            if not path.exists() or path.read_text() != text:
                print(f"{path.name} is not what generate.py writes")
                differ = 1
        else:
            path.write_text(text)
    return differ


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
