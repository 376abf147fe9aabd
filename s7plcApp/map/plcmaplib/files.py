"""A map in its files: a folder of CSV files or a workbook, read and written."""
import os

from . import columns
from .model import Map
from .problems import Place, Refused
from .sheets import Sheet, csv_text, encoded, read_csv, write_bytes

def is_workbook(path):
    return path.lower().endswith((".xlsx", ".xlsm"))


def load_sheets(path, report, encoding=None):
    """{name: Sheet} of a folder of CSV files, a workbook, or one CSV file of a folder."""
    if is_workbook(path):
        from .workbook import read_sheets
        sheets = read_sheets(path, columns.SHEETS, report)
    else:
        if os.path.isfile(path):
            if os.path.basename(path) not in [n + ".csv" for n in columns.SHEETS]:
                raise Refused("is no map; allowed: a folder with map.csv, or an .xlsx", Place(path))
            path = os.path.dirname(path) or "."
        if not os.path.isdir(path):
            raise Refused("no such folder or .xlsx", Place(path))
        sheets = {}
        for name in columns.SHEETS:
            file = os.path.join(path, name + ".csv")
            if os.path.exists(file):
                sheets[name] = read_csv(file, name, report, encoding)
    if "map" not in sheets:
        raise Refused("no sheet map (%s)" % ("a sheet of that name" if is_workbook(path)
                                             else "map.csv"), Place(path))
    return sheets


def load(path, report, encoding=None):
    """A map from its files."""
    return Map(path, load_sheets(path, report, encoding), report)


def save(map_, path=None):
    """Writes the sheets back, to where they came from or elsewhere. Files whose content is
    the same are left alone. Returns the files written."""
    path = path or map_.path
    sheets = [map_.sheets[n] for n in columns.SHEETS if n in map_.sheets]
    if is_workbook(path):
        from .workbook import update_sheets, write_sheets
        if os.path.exists(path) and any(s.file == path and s.read for s in sheets):
            update_sheets(path, sheets)
        else:
            write_sheets(path, sheets, columns.choices())
        return [path]
    if os.path.isfile(path):
        path = os.path.dirname(path) or "."
    try:
        os.makedirs(path, exist_ok=True)
    except OSError as e:
        raise Refused(e.strerror or str(e), Place(path)) from None
    files = {os.path.join(path, s.name + ".csv"): s for s in sheets}
    files = {file: encoded(file, csv_text(s), s.encoding) for file, s in files.items()}
    return [file for file, data in files.items() if write_bytes(file, data)]


def empty(path):
    """The sheets of a new map."""
    report_sheets = {}
    for name, table in columns.SHEETS.items():
        report_sheets[name] = Sheet(name, path if is_workbook(path) else
                                    os.path.join(path, name + ".csv"), list(table),
                                    name if is_workbook(path) else None)
    return report_sheets
