"""Tables in CSV files: read with the place of every cell, written without loss.

Knows nothing of maps. A folder of CSV files and a workbook (workbook.py) give the same
Sheet objects.
"""
import codecs
import csv
import io
import os
import re
import shutil

from .problems import Place, Refused

MAX_FILE = 200 * 1024 * 1024


class Row:
    """One row: cells by column name, and where they stand."""
    __slots__ = ("sheet", "line", "cells")

    def __init__(self, sheet, line, cells):
        self.sheet = sheet
        self.line = line
        self.cells = cells

    def get(self, column):
        return self.cells.get(column, "")

    def place(self, column=None):
        header = self.sheet.header
        number = header.index(column) + 1 if column in header else 1
        return Place(self.sheet.file, self.line, number, self.sheet.tab)


class Sheet:
    """A header and rows. tab: the name in a workbook, None in a CSV file."""

    def __init__(self, name, file, header, tab=None, delimiter=",", encoding="utf-8"):
        self.name = name
        self.file = file
        self.tab = tab
        self.header = header
        self.rows = []
        self.delimiter = delimiter
        self.encoding = encoding
        self.line = 1   # of the header
        self.last = 0   # greatest line of a row
        self.read = {}  # line -> cells, as they were read: what else is in a workbook stays

    def place(self, column=None):
        number = self.header.index(column) + 1 if column in self.header else None
        return Place(self.file, self.line, number, self.tab)

    def append(self, cells, line=None):
        if line is None:
            line = max(self.last, self.line) + 1
        self.last = max(self.last, line)
        row = Row(self, line, cells)
        self.rows.append(row)
        return row

    def column(self, name):
        """Makes sure there is such a column."""
        if name not in self.header:
            self.header.append(name)


def read_bytes(path):
    """The bytes of a file, or Refused in words."""
    try:
        size = os.path.getsize(path)
        if size > MAX_FILE:
            raise Refused("%d bytes are too many; allowed: up to %d" % (size, MAX_FILE),
                          Place(path))
        with open(path, "rb") as f:
            return f.read()
    except OSError as e:
        raise Refused(e.strerror or str(e), Place(path)) from None
    except ValueError as e:  # a NUL in the path
        raise Refused(str(e), Place(repr(path))) from None


_MARKS = (b"\xef\xbb\xbf", b"\xff\xfe", b"\xfe\xff")


def check_encoding(encoding):
    """Refused where it is none of text in files, before any file is read."""
    try:
        if "a,b\n".encode(encoding).decode(encoding) == "a,b\n" and \
                codecs.lookup(encoding).name not in ("punycode", "idna"):  # for names of hosts
            return
    except (LookupError, ValueError):
        pass
    raise Refused('"%s" is no encoding; allowed: such as utf-8 cp1252 cp1251 utf-16'
                  % repr(encoding)[1:-1])


def decoded(data, encoding, place):
    """Text of bytes in that encoding; Refused where they are none."""
    try:
        return data.decode(encoding)
    except UnicodeDecodeError as e:
        raise Refused("not %s: byte 0x%02X at %d; --encoding says another"
                      % (encoding, data[e.start], e.start), place) from None
    except UnicodeError as e:
        raise Refused("not %s: %s" % (encoding, str(e)[:80]), place) from None


def decode(data, path, report=None, encoding=None):
    """Text of bytes: a BOM says UTF-8 or UTF-16; else it is `encoding`; without one strict
    UTF-8; else cp1252, with a warning that names the first line that is no ASCII. Returns
    (text, encoding)."""
    if encoding and not data.startswith(_MARKS):
        return decoded(data, encoding, Place(path)), encoding
    try:
        if data.startswith(b"\xef\xbb\xbf"):
            return data[3:].decode("utf-8"), "utf-8-sig"
        if data.startswith((b"\xff\xfe", b"\xfe\xff")):
            return data.decode("utf-16"), "utf-16"
    except UnicodeDecodeError as e:
        raise Refused("the byte order mark promises %s, but there is something else at byte %d"
                      % (e.encoding, e.start), Place(path)) from None
    try:
        return data.decode("utf-8"), "utf-8"
    except UnicodeDecodeError:
        pass
    text = data.decode("cp1252", "replace")
    if report is not None:
        for number, line in enumerate(text.split("\n"), 1):
            if any(ord(c) > 127 for c in line):
                report.warning(Place(path, number), None, "no UTF-8: read as cp1252; "
                               "--encoding says another (first line that is no ASCII)")
                break
    return text, "cp1252"


def is_utf8(data):
    try:
        return "\0" not in data.decode("utf-8")
    except UnicodeDecodeError:
        return False


def clean(text):
    """Without blanks and no-break blanks around it."""
    return text.replace("\u00a0", " ").strip()


def _delimiter(text):
    """The one of , ; TAB that the header row has most of."""
    first = text.lstrip("\r\n").split("\n", 1)[0]
    return max(",;\t", key=lambda d: (first.count(d), -",;\t".index(d)))


def csv_rows(text, delimiter, path, blanks=False):
    """[(line, [cells])]; a row over several lines has the first one's number. blanks: a quoted
    cell may have blanks in front."""
    reader = csv.reader(io.StringIO(text, newline=""), delimiter=delimiter,
                        skipinitialspace=blanks)
    rows, line = [], 1
    try:
        for cells in reader:
            rows.append((line, cells))
            line = reader.line_num + 1
    except csv.Error as e:
        raise Refused("no CSV: %s" % e, Place(path, reader.line_num or 1)) from None
    return rows


def read_csv(path, name, report, encoding=None):
    """A CSV file with a header row as a Sheet. encoding: if it is not UTF-8."""
    data = read_bytes(path)
    text, used = decode(data, path, report, None if is_utf8(data) else encoding)
    if "\0" in text:
        line = text[:text.index("\0")].count("\n") + 1
        raise Refused("a NUL character: this is no text", Place(path, line))
    delimiter = _delimiter(text)
    rows = csv_rows(text, delimiter, path)
    while rows and not any(clean(c) for c in rows[0][1]):
        rows.pop(0)
    return _fill(_headed(Sheet(name, path, [], None, delimiter, used), rows), rows[1:], report)


def _headed(sheet, rows):
    """The sheet with the header of the first row."""
    if rows:
        sheet.line, sheet.header = rows[0][0], [clean(c) for c in rows[0][1]]
    return sheet


def _fill(sheet, rows, report):
    """The rows below the header. Empty ones are left out; cells beyond the header are an
    error."""
    while sheet.header and not sheet.header[-1]:
        sheet.header.pop()
    for number, column in enumerate(sheet.header, 1):
        if column and column in sheet.header[:number - 1]:
            report.error(Place(sheet.file, sheet.line, number, sheet.tab), None,
                         'the column "%s" is there twice; allowed: each once' % column)
        elif not column and any(len(r) >= number and clean(r[number - 1]) for _, r in rows):
            report.error(Place(sheet.file, sheet.line, number, sheet.tab), None,
                         "the column has values but no name; notes need a name that begins "
                         "with #")
    for line, cells in rows:
        cells = [clean(c) for c in cells]
        if not any(cells):
            continue
        for number, cell in enumerate(cells[len(sheet.header):], len(sheet.header) + 1):
            if cell:
                report.error(Place(sheet.file, line, number, sheet.tab), None,
                             '"%s" stands beyond the last column; allowed: notes below a name that '
                             "begins with #" % cell[:40])
        row = sheet.append({c: v for c, v in zip(sheet.header, cells) if c and v}, line)
        sheet.read[line] = dict(row.cells)
    return sheet


def sheet_from_rows(name, path, tab, rows, report):
    """The same from rows of a workbook: [(line, [cells])]."""
    while rows and not any(clean(c) for c in rows[0][1]):
        rows.pop(0)
    return _fill(_headed(Sheet(name, path, [], tab), rows), rows[1:], report)


def csv_text(sheet, delimiter=None):
    """A sheet as CSV text."""
    out = io.StringIO()
    writer = csv.writer(out, delimiter=delimiter or sheet.delimiter, lineterminator="\n")
    writer.writerow(sheet.header)
    for row in sheet.rows:
        writer.writerow([row.get(c) for c in sheet.header])
    return out.getvalue()


def encoded(path, text, encoding="utf-8"):
    """The bytes of a file; Refused where its encoding lacks a character."""
    try:
        return text.encode(encoding)
    except UnicodeEncodeError as e:
        raise Refused('%s has no "%s"; allowed: save the file as UTF-8 first'
                      % (encoding, text[e.start]), Place(path)) from None


def write_bytes(path, data):
    """Writes a file when its content is another; whole or not at all, also when two write at
    the same time. True: written."""
    path = os.path.realpath(path)
    part = "%s.%d.part" % (path, os.getpid())
    try:
        if os.path.exists(path):
            with open(path, "rb") as f:
                if f.read() == data:
                    return False
        with open(part, "wb") as f:
            f.write(data)
        if os.path.exists(path):
            shutil.copymode(path, part)
        os.replace(part, path)
        return True
    except OSError as e:
        if os.path.exists(part):
            os.remove(part)
        raise Refused(e.strerror or str(e), Place(path)) from None


def one_line(text):
    """True when there is no line break and no other control character."""
    return not any(ord(c) < 32 or ord(c) == 127 for c in text)


def whole(text):
    """The number of a cell that has nothing but the digits 0 to 9, or None."""
    return int(text) if text.isascii() and text.isdigit() else None


def number(text, delimiter=","):
    """A float of a cell, or None. With ; as delimiter a decimal comma is one."""
    if delimiter == ";" and re.match(r"^[+-]?\d+,\d+$", text):
        text = text.replace(",", ".")
    if not re.match(r"^[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?$", text):
        return None
    return float(text)
