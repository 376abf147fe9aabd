"""Tables in .xlsx files, by openpyxl, which is needed for nothing else.

Cells come typed: whole numbers become 4, others 10.1, dates are an error (somebody typed 1.2
and the program made the 1st of February of it), formulas give their last value.
"""
import datetime
import io

from .problems import Place, Refused
from .sheets import clean, sheet_from_rows, write_bytes

WIDE = {"desc": 30, "note": 30, "symbol": 24, "type": 22, "fields": 20, "states": 20}


def _openpyxl():
    try:
        import openpyxl
    except ImportError:
        raise Refused("an .xlsx needs the Python package openpyxl: pip install openpyxl, or "
                      "use a folder of CSV files") from None
    return openpyxl


def _load(path, **how):
    openpyxl = _openpyxl()
    try:
        return openpyxl.load_workbook(path, **how)
    except OSError as e:
        raise Refused(e.strerror or str(e), Place(path)) from None
    except Exception as e:  # openpyxl has no one exception for a file that is spoilt
        raise Refused("no .xlsx that can be read: %s: %s" % (type(e).__name__, str(e)[:120]),
                      Place(path)) from None


def _text(value, place, report):
    if value is None:
        return ""
    if isinstance(value, bool):
        return "True" if value else "False"
    if isinstance(value, (datetime.datetime, datetime.date, datetime.time, datetime.timedelta)):
        report.error(place, None, "the cell is a date (%s): somebody typed a number such as 1.2; "
                     "format the column as text" % value)
        return ""
    if isinstance(value, float):
        return "%d" % value if value == int(value) and abs(value) < 1e15 else repr(value)
    return str(value)


def sheet_names(path):
    return _load(path, read_only=False).sheetnames


class Cells(dict):
    """{tab: [(line, [texts])]}. lost: {tab: {(line, column): why it has no value}}, for whom reads
    the cell to tell: formulas that were never calculated, and all but the first of merged cells."""

    def __init__(self):
        super().__init__()
        self.lost = {}


def read_cells(path, report):
    """Cells of a workbook, whatever is in it."""
    values = _load(path, data_only=True)
    formulas = _load(path, data_only=False)
    found = Cells()
    for tab in values.worksheets:
        name = tab.title
        width = _width(tab)
        rows = []
        other = formulas[name]
        last_row, last_column = other.max_row or 0, other.max_column or 0
        lost = found.lost.setdefault(name, {})
        for merged in getattr(tab, "merged_cells", None).ranges if tab.merged_cells else []:
            if merged.min_row > 1:
                why = "merged cells %s: only the first one has the value" % merged
                for row in range(merged.min_row, merged.max_row + 1):
                    lost.update({(row, column): why for column in
                                 range(merged.min_col, min(merged.max_col, width) + 1)})
                lost.pop((merged.min_row, merged.min_col), None)
        for line, cells in enumerate(tab.iter_rows(max_col=width, values_only=True), 1):
            texts = []
            for number, value in enumerate(cells, 1):
                place = Place(path, line, number, name)
                if value is None and line <= last_row and number <= last_column:
                    formula = other.cell(line, number).value
                    if isinstance(formula, str) and formula.startswith("="):
                        lost[line, number] = "the formula %s was never calculated: open the " \
                            "file and save it" % formula[:40]
                texts.append(_text(value, place, report))
            while texts and not clean(texts[-1]):
                texts.pop()
            rows.append((line, texts))
        while rows and not rows[-1][1]:
            rows.pop()
        found[name] = rows
    return found


def _width(tab):
    """Columns that have something in one of the first rows: used ranges lie (AMJ)."""
    widest = 1
    for row in tab.iter_rows(max_row=min(tab.max_row or 1, 50), values_only=True):
        for number, value in enumerate(row, 1):
            if value is not None:
                widest = max(widest, number)
    return widest


def read_sheets(path, names, report):
    """{name: Sheet} of the sheets of a map that the workbook has."""
    found = {}
    cells = read_cells(path, report)
    for tab, rows in cells.items():
        if tab.lower() in names:
            for (line, number), why in cells.lost[tab].items():
                report.warning(Place(path, line, number, tab), None, why)
            found[tab.lower()] = sheet_from_rows(tab.lower(), path, tab, rows, report)
    if not found:
        raise Refused("no sheet of a map; it has %s; a map has the sheets %s"
                      % (", ".join(cells), " ".join(names)), Place(path))
    return found


def write_sheets(path, sheets, choices):
    """Writes sheets: all cells are text, the header stays in sight, columns with a list of
    words (choices: {(sheet, column): [words]}) have drop-downs."""
    openpyxl = _openpyxl()
    from openpyxl.styles import Font
    from openpyxl.utils import get_column_letter
    from openpyxl.worksheet.datavalidation import DataValidation
    book = openpyxl.Workbook()
    book.remove(book.active)
    for sheet in sheets:
        tab = book.create_sheet(sheet.name)
        tab.append(sheet.header)
        for row in sheet.rows:
            tab.append([row.get(c) or None for c in sheet.header])
        for row in tab.iter_rows():
            for cell in row:
                cell.number_format = "@"
                if isinstance(cell.value, str):
                    cell.data_type = "s"  # never a formula
        for number, column in enumerate(sheet.header, 1):
            letter = get_column_letter(number)
            tab.cell(1, number).font = Font(bold=True)
            tab.column_dimensions[letter].width = WIDE.get(column, 10)
            words = choices.get((sheet.name, column))
            if words:
                rule = DataValidation(type="list", formula1='"%s"' % ",".join(words),
                                      allow_blank=True)
                tab.add_data_validation(rule)
                rule.add("%s2:%s%d" % (letter, letter, max(len(sheet.rows) + 200, 1000)))
        tab.freeze_panes = "B2"
    book.properties.created = book.properties.modified = datetime.datetime(2000, 1, 1)
    _save(book, path)


def update_sheets(path, sheets):
    """Writes what has changed into the workbook that the sheets were read from. Everything else
    in it stays: other sheets, notes, widths, formulas."""
    book = _load(path, keep_vba=path.lower().endswith(".xlsm"))
    for sheet in sheets:
        if sheet.tab is None or sheet.tab not in book.sheetnames:
            if not sheet.rows:
                continue
            tab = book.create_sheet(sheet.name)
            sheet.read, sheet.line = {}, 1
        else:
            tab = book[sheet.tab]
        for number, column in enumerate(sheet.header, 1):
            _put(tab, sheet.line, number, column)
        lines = {row.line: row for row in sheet.rows}
        for line in sorted(set(lines) | set(sheet.read)):
            old = sheet.read.get(line, {})
            for number, column in enumerate(sheet.header, 1):
                value = lines[line].get(column) if line in lines else ""
                if column and value != old.get(column, ""):
                    _put(tab, line, number, value)
    _save(book, path)


def _put(tab, line, number, value):
    """A cell as text; what is the same stays."""
    cell = tab.cell(line, number)
    if (cell.value or "") != value:
        cell.value = value or None
        cell.number_format = "@"
        if value:
            cell.data_type = "s"


def _save(book, path):
    held = io.BytesIO()
    try:
        book.save(held)
    except Exception as e:  # a character that no workbook can hold
        raise Refused("cannot be written: %s" % str(e)[:120], Place(path)) from None
    write_bytes(path, held.getvalue())
