"""What is wrong with a file, where, and what is allowed. Knows no format."""
import difflib


class Place:
    """A cell, a line or a whole file.

    CSV: map.csv:12:5   a workbook: tank.xlsx [map] E12   any other file: db.awl:12
    """
    __slots__ = ("file", "sheet", "line", "column")

    def __init__(self, file, line=None, column=None, sheet=None):
        self.file = file
        self.sheet = sheet
        self.line = line
        self.column = column

    def __str__(self):
        if self.sheet is not None:
            if self.line is None:
                return "%s [%s]" % (self.file, self.sheet)
            return "%s [%s] %s%d" % (self.file, self.sheet, letters(self.column or 1), self.line)
        parts = [str(self.file)]
        if self.line is not None:
            parts.append(str(self.line))
            if self.column is not None:
                parts.append(str(self.column))
        return ":".join(parts)

    def key(self):
        """For sorting."""
        return (str(self.file), self.sheet or "", self.line or 0, self.column or 0)


def letters(column):
    """1 -> A, 27 -> AA."""
    text = ""
    while column > 0:
        column, rest = divmod(column - 1, 26)
        text = chr(ord("A") + rest) + text
    return text


class Problem:
    """One line for people: `place: column: text`."""
    __slots__ = ("place", "column", "text", "error")

    def __init__(self, place, column, text, error=True):
        self.place = place
        self.column = column
        self.text = text
        self.error = error

    def __str__(self):
        what = "%s: " % self.column if self.column else ""
        return "%s: %s%s%s" % (self.place, "" if self.error else "warning: ", what, self.text)


class Report:
    """All problems of a run, in the order of their places; the same line only once."""

    def __init__(self):
        self.problems = []
        self.seen = set()

    def add(self, problem):
        text = str(problem)
        if text not in self.seen:
            self.seen.add(text)
            self.problems.append(problem)

    def error(self, place, column, text):
        self.add(Problem(place, column, text))

    def warning(self, place, column, text):
        self.add(Problem(place, column, text, error=False))

    def errors(self):
        return [p for p in self.problems if p.error]

    def lines(self):
        return [str(p) for p in sorted(self.problems, key=lambda p: p.place.key())]


class Refused(Exception):
    """A file or a command that cannot be used at all; the text is for people."""

    def __init__(self, text, place=None):
        super().__init__("%s: %s" % (place, text) if place is not None else text)


def nearest(word, allowed):
    """' (did you mean X?)', or ''."""
    by_case = {str(a).lower(): a for a in allowed}
    found = difflib.get_close_matches(str(word).lower(), list(by_case), n=1, cutoff=0.6)
    return " (did you mean %s?)" % by_case[found[0]] if found else ""


def one_of(word, allowed):
    """'"x" is not allowed (did you mean y?); allowed: a b c'."""
    return '"%s" is not allowed%s; allowed: %s' % (
        word, nearest(word, allowed), " ".join(str(a) if a != "" else "(blank)" for a in allowed))
