"""What a row says about its record: description, unit, limits, states, archive ... taken apart.

Knows the columns; knows no types and no offsets. Every refusal names its cell.
"""
import re

from . import columns
from .problems import nearest, one_of
from .sheets import number, whole

ASCII_PV = re.compile(r"^[A-Za-z0-9_\-+:\[\]<>;.$(){}#%/*&|!?~^@=]*$")
MAX_GROUP = 120  # its name becomes that of a file
_RANGE = re.compile(r"^(.+?)\.\.(.+)$")
_FIELD = re.compile(r"^[A-Z][A-Z0-9]{1,3}$")


class State:
    """One state of a bit or a number."""
    __slots__ = ("value", "text", "severity")

    def __init__(self, value, text, severity=""):
        self.value = value
        self.text = text
        self.severity = severity


class Shown:
    """Parsed cells of one row of the sheets map and types."""
    __slots__ = ("row", "desc", "egu", "prec", "lopr", "hopr", "limits", "severities", "states",
                 "enum", "raw", "eng", "archive", "autosave", "asg", "group", "fields", "note")

    def __init__(self, row, report, enums):
        self.row = row
        get = row.get
        self.desc = self._text(report, "desc", columns.MAX_DESC)
        self.egu = self._text(report, "egu", columns.MAX_EGU)
        self.prec = self._whole(report, "prec", 0, 15)
        self.lopr = self._number(report, "lopr")
        self.hopr = self._number(report, "hopr")
        self.limits = {c: self._number(report, c) for c in columns.LIMIT_COLUMNS}
        self.severities = self._severities(report)
        self.enum = ""
        self.states = self._states(report, enums)
        self.raw = self._range(report, "raw")
        self.eng = self._range(report, "eng")
        self.archive = self._archive(report)
        self.autosave = self._names(report, "autosave")
        self.asg = get("asg")
        self.group = self._group(report)
        self.fields = self._fields(report)
        self.note = " ".join(get("note").split())

    def _text(self, report, column, most):
        text = self.row.get(column)
        if len(text.encode("utf-8", "replace")) > most:
            report.error(self.row.place(column), column, '"%s..." has %d bytes; allowed: %d'
                         % (text[:20], len(text.encode("utf-8", "replace")), most))
        return text

    def _number(self, report, column):
        text = self.row.get(column)
        if not text:
            return None
        value = number(text, self.row.sheet.delimiter)
        if value is None or value in (float("inf"), float("-inf")):
            report.error(self.row.place(column), column, '"%s" is no number; allowed: such as '
                         "10, -2.5, 1e3" % text)
            return None
        return value

    def _whole(self, report, column, low, high):
        text = self.row.get(column)
        if not text:
            return None
        if len(text) > 9 or whole(text) is None or not low <= int(text) <= high:
            report.error(self.row.place(column), column, '"%s"; allowed: %d to %d'
                         % (text, low, high))
            return None
        return int(text)

    def _range(self, report, column):
        text = self.row.get(column)
        if not text:
            return None
        m = _RANGE.match(text)
        ends = [number(p.strip(), self.row.sheet.delimiter) for p in m.groups()] if m else [None]
        if None in ends:
            report.error(self.row.place(column), column,
                         '"%s" is no range; allowed: such as 0..27648' % text)
            return None
        if ends[0] == ends[1]:
            report.error(self.row.place(column), column,
                         '"%s": both ends are the same; allowed: such as 0..27648' % text)
            return None
        return ends[0], ends[1]

    def _severities(self, report):
        found = {"lolo": "MAJOR", "low": "MINOR", "high": "MINOR", "hihi": "MAJOR"}
        for word in re.split(r"[\s,;]+", self.row.get("sev")):
            if not word:
                continue
            limit, equals, severity = word.partition("=")
            if not equals:
                report.error(self.row.place("sev"), "sev", '"%s"; allowed: such as low=MINOR '
                             "hihi=INVALID" % word)
            elif limit not in found:
                report.error(self.row.place("sev"), "sev", one_of(limit, columns.LIMIT_COLUMNS))
            elif severity not in columns.SEVERITIES:
                report.error(self.row.place("sev"), "sev", one_of(severity, columns.SEVERITIES))
            else:
                if self.limits[limit] is None:
                    report.error(self.row.place("sev"), "sev", "%s has no limit in its column; allowed: "
                                 "severities of limits that are given" % limit)
                found[limit] = severity
        return found

    def _states(self, report, enums):
        text = self.row.get("states")
        if not text:
            return None
        if text.startswith("@"):
            name = text[1:].strip()
            if name.upper() not in enums:
                names = [e.name for e in enums.values()]
                report.error(self.row.place("states"), "states", 'there is no enum "%s"%s; allowed: %s' % (
                    name, nearest(name, names), " ".join(names) or "one of the sheet enums"))
                return None
            self.enum = enums[name.upper()].name
            return enums[name.upper()].states
        return parse_states(text, self.row.place("states"), report)

    def _archive(self, report):
        text = self.row.get("archive")
        if text in ("", "no", "0"):
            return None
        if text == "yes":
            return "monitor", 1.0
        m = re.match(r"^(?:(scan|monitor)\s+)?([\d.]+)$", text)
        period = number(m.group(2)) if m else None
        if not period or period > 86400:
            report.error(self.row.place("archive"), "archive", '"%s"; allowed: yes, no, seconds '
                         "(such as 1), scan 60" % text)
            return None
        return m.group(1) or "monitor", period

    def _names(self, report, column):
        text = self.row.get(column)
        if text in ("", "no"):
            return []
        if text in ("yes", "1"):
            return ["VAL"]
        names = re.split(r"[\s,;]+", text)
        for name in names:
            if not _FIELD.match(name):
                report.error(self.row.place(column), column, '"%s" is no field; allowed: yes, no, '
                             "or names such as VAL HIGH LOW" % name)
        return names

    def _group(self, report):
        text = self.row.get("group")
        parts = [p.strip() for p in text.split("/")] if text else []
        if any(not p for p in parts):
            report.error(self.row.place("group"), "group", '"%s" has an empty part; allowed: such '
                         "as Tank/Valves" % text)
        if len(text.encode("utf-8")) > MAX_GROUP:
            report.error(self.row.place("group"), "group", "%d bytes; allowed: %d"
                         % (len(text.encode("utf-8")), MAX_GROUP))
        return "/".join(p for p in parts if p)

    def _fields(self, report):
        """[(name, value)]; values may contain everything but ;"""
        found = []
        for part in self.row.get("fields").split(";"):
            name, equals, value = part.partition("=")
            name = name.strip()
            if not part.strip():
                continue
            if not equals or not _FIELD.match(name):
                report.error(self.row.place("fields"), "fields", '"%s" is no field; allowed: such '
                             "as PINI=YES; FLNK=x" % part.strip())
            elif name in ("DTYP", "INP", "OUT"):
                report.error(self.row.place("fields"), "fields",
                             "%s comes from the map itself; allowed: any field but DTYP INP OUT" % name)
            elif name in [f for f, _ in found]:
                report.error(self.row.place("fields"), "fields", "%s is there twice; allowed: each field once" % name)
            else:
                found.append((name, value.strip()))
        return found


def parse_states(text, place, report):
    """off|on, ok|FAULT!MAJOR, 0=stop|7=service -> [State]"""
    found, value = [], 0
    for part in text.split("|"):
        part = part.strip()
        m = re.match(r"^(-?\d+)=(.*)$", part)
        if m:
            value, part = int(m.group(1)), m.group(2).strip()
        name, mark, severity = part.rpartition("!")
        if not mark:
            name, severity = part, ""
        check_state(found, value, name.strip(), severity.strip(), place, "states", report)
        found.append(State(value, name.strip(), severity.strip()))
        value += 1
    if len(found) > columns.MAX_STATES:
        report.error(place, "states", "%d states; allowed: %d" % (len(found), columns.MAX_STATES))
    return found


def check_state(before, value, text, severity, place, column, report):
    """One state against those before it."""
    if not text:
        report.error(place, column, "a state has no text; allowed: up to %d characters"
                     % columns.MAX_STATE)
    if len(text.encode("utf-8", "replace")) > columns.MAX_STATE:
        report.error(place, column, 'state "%s" has %d bytes; allowed: %d'
                     % (text, len(text.encode("utf-8", "replace")), columns.MAX_STATE))
    if severity and severity not in columns.SEVERITIES:
        report.error(place, column, one_of(severity, columns.SEVERITIES))
    if value in [s.value for s in before]:
        report.error(place, column, "value %d is there twice; allowed: each value once" % value)
    if text and text in [s.text for s in before]:
        report.error(place, column, 'text "%s" is there twice; allowed: each text once' % text)
