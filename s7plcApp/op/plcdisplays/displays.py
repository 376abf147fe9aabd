"""The displays of plclink: which PV is where. Knows no file format."""
from .layout import BLUE, GREEN, GREY, HEADING, ORANGE, RED, TEXT, TIME, Display

STATE = [(0, "NO ADDRESS", RED), (1, "CONNECTING", RED), (2, "NO DATA", RED), (3, "DATA OK", GREEN),
         (4, "WRONG SIZE", RED), (5, "FROZEN", RED), (6, "NO PRIMARY", RED), (7, "LAYOUT", RED),
         (8, "SOME REFUSED", ORANGE), (9, "ALL REFUSED", RED)]
SETPOINTS = [(0, "NO OUTPUT", RED), (1, "output ok", GREEN), (2, "OUTPUT WAITS", ORANGE),
             (3, "LOCAL", BLUE), (4, "MISMATCH", RED), (5, "PLC REFUSES", ORANGE),
             (6, "no output", GREY), (7, "OUTPUT ?", ORANGE)]
REFUSED = [(0, "IOC refused none", GREY), (1, "IOC REFUSED", ORANGE)]
SYNC = [(0, "DISCONNECTED", ORANGE), (1, "WAITING", ORANGE), (2, "CHECKING", ORANGE),
        (3, "SYNCED", GREEN), (4, "LOCAL", BLUE), (5, "LAYOUT MISMATCH", RED),
        (6, "MAP MISMATCH", RED), (7, "MAP DOWNLOAD", ORANGE)]
REMOTE = [(0, "HMI controls", BLUE), (1, "EPICS controls", GREY)]
MAP = [(0, "DISCONNECTED", ORANGE), (1, "WAITING", ORANGE), (2, "FIXED TABLES", GREY),
       (3, "EQUAL", GREEN), (4, "MAP MISMATCH", RED), (5, "BEGINNING", ORANGE),
       (6, "LOADING", ORANGE), (7, "PLC CHECKS", ORANGE), (8, "REFUSED", RED)]
OUTPUT = [(0, "NOT CONNECTED", RED), (1, "connected", GREEN)]
PAIR = [(0, "NO PRIMARY", RED), (1, "FIRST leads", GREEN), (2, "SECOND leads", GREEN),
        (3, "2 PRIMARIES", RED), (4, "NOW FIRST", ORANGE), (5, "NOW SECOND", ORANGE)]
BACKUP = [(0, "no partner", GREY), (1, "BACKUP LOST", ORANGE), (2, "BACKUP LOST", ORANGE),
          (3, "BACKUP ready", GREEN), (4, "BACKUP ready", GREEN), (5, "BACKUP ?", ORANGE)]
CONNECTED = [(0, "NOT CONNECTED", ORANGE), (1, "connected", GREEN), (2, "no partner", GREY)]
ANSWERS = [(0, "NO ANSWER", ORANGE), (1, "answers", GREEN), (2, "not known", GREY)]

PARTS = ("MODBUS", "SYNC", "MAP", "EIP", "PAIR")
# Records of eip_stat.db: ether_ip's names, without ends of their own
EIP_STAT = ("PLC_ERRORS", "PLC_TASK_SLOW", "LIST_SCAN_TIME", "LIST_MAX_SCAN_TIME")
NUMBER = "1234567890"
BYTES = "12345678901 bytes"
MS = "123456.789 ms"
SECONDS = "31536000.0 s"

# What a button hands on: the PLC, and what it has.
ALONG = {"P": "$(P)", "NAME": "$(NAME)", **{"HAS_" + p: f"$(HAS_{p})" for p in PARTS}}


def heading(display, text, buttons):
    """Title and, at the right, buttons: (text, display, part or None) ..."""
    x = display.w - 12 - 98 * len(buttons)
    display.label(text, 16, 8, x - 24, 34, 24, True)
    for i, (words, file, part) in enumerate(buttons):
        display.open(words, x + 98 * i, 10, 92, 28, file,
                     {} if file == "plclinkOverview" else ALONG, part)


UP = [("Station", "plclinkStation", None), ("All PLCs", "plclinkOverview", None)]


def overview(plcs):
    """plcs: name, prefix, and the parts that it has."""
    d = Display("plclinkOverview", "All PLCs", 1284, max(160, 84 + 36 * len(plcs)),
                "All PLCs on one page. generate.py makes it from a list of PLCs")
    d.label("All PLCs", 12, 8, 400, 34, 24, True)
    for text, x, w, right in (("PLC", 16, 130, 0), ("State", 152, 150, 0), ("Why", 312, 290, 0),
                              ("Last block", 606, 80, 1), ("Losses", 692, 60, 1),
                              ("Setpoints", 764, 136, 0), ("Pair", 1032, 200, 0)):
        d.label(text, x, 48, w, 20, 13, True, HEADING, bool(right))
    for i, (name, prefix, parts) in enumerate(plcs):
        y = 74 + 36 * i
        macros = {"P": prefix, "NAME": name,
                  **{"HAS_" + p: "1" if p in parts else "0" for p in PARTS}}
        d.open(name, 12, y, 134, 30, "plclinkStation", macros)
        d.lamp(prefix + "State", 152, y, 150, 30, STATE, 14)
        d.value(prefix + "Reason", 312, y, 290, 30, 14)
        d.value(prefix + "BlockAge", 606, y, 80, 30, 14, right=True, longest="12345.0 s")
        d.value(prefix + "Reconnects", 692, y, 60, 30, 14, right=True, longest="12345")
        d.lamp(prefix + "Setpoints", 764, y, 136, 30, SETPOINTS, 13)
        d.lamp(prefix + "Refused", 904, y, 120, 30, REFUSED, 12)
        if "PAIR" in parts:
            d.lamp(prefix + "Pair", 1032, y, 118, 30, PAIR, 12)
            d.lamp(prefix + "Backup", 1154, y, 118, 30, BACKUP, 12)
    return d


def station():
    d = Display("plclinkStation", "PLC $(NAME)", 1000, 804,
                "One PLC: s7plcStation.db. Macros: P, NAME; HAS_MODBUS, ...: 1 or 0")
    heading(d, "PLC $(NAME)", [("Modbus", "plclinkModbus", "MODBUS"),
                               ("Sync", "plclinkSync", "SYNC"),
                               ("Tables", "plclinkTables", "MAP"),
                               ("EtherNet/IP", "plclinkEtherIP", "EIP"),
                               ("Pair", "plclinkPair", "PAIR"),
                               ("All PLCs", "plclinkOverview", None)])
    d.lamp("$(P)State", 16, 50, 240, 56, STATE, 26)
    d.value("$(P)Reason", 266, 50, 480, 30, 20, True)
    d.label("for", 266, 84, 30)
    d.value("$(P)StateTime", 298, 84, 110, longest="31536000 s")
    d.label("data lost at", 420, 84, 90)
    d.value("$(P)LostTime", 512, 84, 234, longest=TIME)
    d.lamp("$(P)Setpoints", 760, 50, 228, 56, SETPOINTS, 24)
    d.lamp("$(P)Refused", 760, 112, 228, 28, REFUSED, 16)
    d.lamp("$(P)Pair", 16, 112, 240, 28, PAIR, 16, "PAIR")
    d.lamp("$(P)Backup", 266, 112, 240, 28, BACKUP, 16, "PAIR")
    d.group("Connection", 16, 158, 124, 340,
            [("Address", "Address", TEXT), ("Connected at", "ConnectTime", TIME),
             ("Connected for", "ConnectedFor", SECONDS), ("Last error", "LastError", TEXT),
             ("  at", "LastErrorTime", TIME)])
    d.label("Options", 16, 304, 124)
    d.value("$(P)Options", 140, 304, 370, 20, 11, long=True)
    d.group("Since reset", 520, 158, 116, 104,
            [("Connections", "Connects", NUMBER), ("Losses", "Reconnects", NUMBER),
             ("Failed attempts", "ConnectErrors", NUMBER), ("Blocks in", "BlocksIn", NUMBER),
             ("Blocks out", "BlocksOut", NUMBER), ("Heartbeats", "Heartbeats", NUMBER)])
    d.group("Trouble since reset", 760, 158, 124, 104,
            [("Skipped", "Skipped", NUMBER), ("Coalesced", "Coalesced", NUMBER),
             ("Puts refused", "RefusedWrites", NUMBER), ("Puts dropped", "PutsDropped", NUMBER),
             ("Slow sends", "SlowSends", NUMBER),
             ("Doubts", "Doubts", NUMBER), ("Out of step", "OutOfStep", NUMBER),
             ("Wrong size", "SizeMismatches", NUMBER),
             ("Clock errors", "ClockErrors", NUMBER)])
    d.group("Now", 16, 334, 130, 100,
            [("Since block in", "BlockAge", SECONDS), ("Since block out", "HeartbeatAge", SECONDS),
             ("Size in", "InSize", "12345678 bytes"), ("Size out", "OutSize", "12345678 bytes"),
             ("If wrong: it sends", "BurstSize", "12345678 bytes"),
             ("Layout of PLC", "LayoutPlc", "65535"),
             ("PLC clock - IOC", "ClockOffset", "-86400.000 s")])
    d.group("Block to block", 16, 530, 130, 100,
            [("Last", "Period", MS), ("Shortest", "PeriodMin", MS), ("Longest", "PeriodMax", MS),
             ("Mean", "PeriodMean", MS), ("Jitter", "Jitter", MS)])
    d.group("Latency", 16, 678, 130, 100,
            [("Put to kernel", "SendLatency", MS), ("  longest", "SendLatencyMax", MS),
             ("Block to records", "ScanLatency", MS), ("  longest", "ScanLatencyMax", MS)])
    d.plot("From block to block", "$(P)PeriodHistogram", "$(P)HistogramBins", 264, 430, 360, 322,
           "blocks")
    d.plot("From block to end of scan", "$(P)LatencyHistogram", "$(P)HistogramBins", 630, 430,
           360, 322, "passes")
    d.label("Numbers stand still while all is quiet:", 264, 764, 264)
    d.order("Live for 10 min", "$(P)Live", 530, 762, 120, 28, 1, "")
    d.order("Send now", "$(P)Send", 712, 762, 120, 28, 1, "Send the output block of $(NAME) now?")
    d.order("Reset counters", "$(P)Reset", 868, 762, 120, 28, 1,
            "Set counters and longest times of $(NAME) to 0?")
    return d


def requests(name, title, about, more=()):
    more = list(more)
    d = Display(name, title, 560, 326 + 26 * len(more), about)
    heading(d, title, UP)
    d.lamp("$(P)OutputConnected", 16, 50, 240, 52, OUTPUT, 24)
    d.lamp("$(P)Setpoints", 266, 50, 278, 52, SETPOINTS, 24)
    d.label("Last error", 16, 114, 160)
    d.value("$(P)LastError", 180, 114, 364, long=True)
    rows = [("at", "LastErrorTime", TIME), ("Requests", "Requests", NUMBER),
            ("Refused by the PLC", "Exceptions", NUMBER),
            ("Places not shown now", "RefusedReads", NUMBER),
            ("Not answered", "RequestTimeouts", NUMBER),
            ("Answer takes", "RequestLatency", MS), ("  longest", "RequestLatencyMax", MS), *more]
    for i, (words, pv, longest) in enumerate(rows):
        d.label(words, 16, 140 + 26 * i, 160)
        d.value("$(P)" + pv, 180, 140 + 26 * i, 190 if longest is TIME else 150,
                right=longest is not TIME, longest=longest)
    return d


def sync():
    d = Display("plclinkSync", "Sync $(NAME)", 560, 280, "s7plcSync.db. Macros: P, NAME")
    heading(d, "Sync $(NAME)", UP)
    d.lamp("$(P)Sync", 16, 50, 270, 56, SYNC, 24)
    d.lamp("$(P)SyncRemote", 296, 50, 248, 56, REMOTE, 24)
    d.label("In this state for", 16, 118, 240)
    d.value("$(P)SyncTime", 266, 118, 134, right=True, longest="31536000 s")
    for i, (words, pv) in enumerate((("Puts refused", "SyncRefused"),
                                     ("Times the PLC agreed", "SyncCount"),
                                     ("Times that ended", "SyncLost"),
                                     ("Outputs that took the PLC's value", "SyncReadbacks"))):
        d.label(words, 16, 146 + 26 * i, 240)
        d.value("$(P)" + pv, 266, 146 + 26 * i, 134, right=True, longest=NUMBER)
    return d


def tables():
    d = Display("plclinkTables", "Table of pointers $(NAME)", 640, 270,
                "s7plcTables.db. Macros: P, NAME")
    heading(d, "Tables of $(NAME)", UP)
    d.lamp("$(P)Map", 16, 50, 300, 56, MAP, 24)
    d.label("has of our table", 330, 68, 120)
    d.value("$(P)MapProgress", 452, 68, 80, right=True, longest="100 %")
    d.value("$(P)MapReason", 16, 116, 608, 24, 16, True, long=True)
    for i, (words, pv) in enumerate((("CRC-32 of our table", "MapCrc"),
                                     ("CRC-32 of the PLC's table", "MapPlcCrc"),
                                     ("Tables that the PLC took", "MapDownloads"),
                                     ("Tables that it refused", "MapRefusals"))):
        d.label(words, 16, 150 + 26 * i, 200)
        d.value("$(P)" + pv, 220, 150 + 26 * i, 134, right=True, longest=NUMBER)
    return d


def pair():
    d = Display("plclinkPair", "Pair $(NAME)", 700, 430, "phoenixplcStatus.db. Macros: P, NAME")
    heading(d, "Redundant pair $(NAME)", UP)
    d.lamp("$(P)Pair", 16, 50, 330, 56, PAIR, 26)
    d.lamp("$(P)Backup", 354, 50, 330, 56, BACKUP, 26)
    for text, x in (("Connection", 122), ("ICMP echo", 288), ("Address", 428)):
        d.label(text, x, 118, 130, 20, 14, True, HEADING)
    for i, which in enumerate(("FIRST", "SECOND")):
        y = 144 + 34 * i
        d.label(which, 16, y, 100, 28, 16, True)
        d.lamp(f"$(P)Connected{i + 1}", 122, y, 156, 28, CONNECTED, 14)
        d.lamp(f"$(P)Reachable{i + 1}", 288, y, 130, 28, ANSWERS, 14)
        d.value(f"$(P)Address{which.title()}", 428, y, 256, 28, long=True)
    d.label("Last switch-over", 16, 226, 200, 20, 14, True, HEADING)
    for i, (words, pv, w, longest) in enumerate((
            ("when", "SwitchTime", 240, TIME), ("why", "SwitchReason", 500, TEXT),
            ("without data", "SwitchDuration", 110, "123456.7 ms"),
            ("switch-overs in all", "Switchovers", 110, NUMBER),
            ("times two PRIMARIES", "TwoPrimariesCount", 110, NUMBER))):
        d.label(words, 16, 250 + 26 * i, 160)
        d.value("$(P)" + pv, 184, 250 + 26 * i, w, longest=longest,
                right=longest not in (TEXT, TIME))
    d.order("Switch-overs are seen", "$(P)SwitchSeen.PROC", 16, 388, 180, 28, 1, "")
    return d


def _with_ends(display, read, order):
    """The same display of records that were loaded with R=read, S=order."""
    for i in display.items:
        if i.kind in ("value", "lamp", "order") and not i.pv.endswith(EIP_STAT):
            name, dot, field = i.pv.partition(".")
            i.pv = name + (order if i.kind == "order" else read) + dot + field
        elif i.kind == "plot":
            i.x_pv, i.y_pv = i.x_pv + read, i.y_pv + read
    return display


def all_displays(plcs, read="", order=""):
    """Every display; plcs: rows of the overview; the macros R and S of the databases."""
    return [_with_ends(d, read, order) for d in _plain(plcs)]


def _plain(plcs):
    return [
        overview(plcs), station(), sync(), tables(), pair(),
        requests("plclinkModbus", "Modbus $(NAME)", "s7plcModbus.db. Macros: P, NAME"),
        requests("plclinkEtherIP", "EtherNet/IP $(NAME)",
                 "s7plcModbus.db and eip_stat.db (IOC: P without its colon). Macros: P, NAME",
                 zip(("Connections lost", "Reads left out", "A round of reads", "  longest"),
                     EIP_STAT, (NUMBER, NUMBER, "12345.6789 s", "12345.6789 s"))),
    ]
