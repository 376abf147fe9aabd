"""The command line of plcmap."""
import argparse
import os
import sys

from . import VERSION
from .check import check
from .files import is_workbook, load, load_sheets, save
from .problems import Place, Refused, Report
from .sheets import check_encoding, number

OK, WRONG, USAGE, BROKEN = 0, 1, 2, 3


def _print(lines, file=None):
    for line in lines:
        print(line, file=file or sys.stdout)


def _told(report):
    """Prints what is wrong. True: nothing is."""
    _print(report.lines(), sys.stderr)
    return not report.errors()


def _good(path, args, placed=True):
    """A map that is checked; Refused-like None when it has errors, which are printed."""
    report = Report()
    map_ = load(path, report, getattr(args, "encoding", None))
    check(map_, placed)
    return map_ if _told(report) else None


def cmd_check(args):
    map_ = _good(args.map, args)
    if map_ is None:
        return WRONG
    from .show import head
    _print(head(map_))
    return OK


def cmd_place(args):
    from .model import Map
    from .place import compact, grow_types, place
    report = Report()
    map_, grown = load(args.map, report, args.encoding), []
    if args.grow:
        grown = grow_types(map_)
    if grown:  # what did not fit into its type does now
        report = Report()
        map_ = Map(map_.path, map_.sheets, report)
    if not report.errors():
        lines = grown + (compact(map_) if args.compact else [])
        lines += place(map_, args.grow)
        _print(lines)
        if not report.errors():
            if not args.dry_run and lines:
                save(map_)
            check(map_, not args.dry_run)
    return OK if _told(report) else WRONG


def cmd_generate(args):
    from .outputs import generate
    map_ = _good(args.map, args)
    if map_ is None:
        return WRONG
    _print(generate(map_, args.output, args.only))
    return OK


def cmd_diff(args):
    from .diff import diff
    report = Report()
    maps = [load(path, report, args.encoding) for path in (args.old, args.new)]
    _print(diff(*maps))
    return OK if _told(report) else WRONG


def cmd_show(args):
    from .show import show
    report = Report()
    map_ = load(args.map, report, args.encoding)
    _print(show(map_, args.what))
    return OK if _told(report) else WRONG


def cmd_convert(args):
    from . import columns
    from .sheets import csv_text
    report = Report()
    sheets = load_sheets(args.source, report, args.encoding)
    if args.target == "-":
        for name in columns.SHEETS:
            if name in sheets:
                print("# sheet %s\n%s" % (name, csv_text(sheets[name], ",")), end="")
        return OK if _told(report) else WRONG
    if os.path.exists(args.target) and not args.force:
        raise Refused("is there already; --force overwrites it", Place(args.target))
    for name, sheet in sheets.items():
        sheet.encoding, sheet.delimiter = "utf-8", ","
    if not _told(report):
        return WRONG
    holder = argparse.Namespace(sheets=sheets, path=args.target)
    if not is_workbook(args.target) and args.target.lower().endswith((".csv", ".xls")):
        raise Refused("allowed: a folder (for CSV files) or an .xlsx", Place(args.target))
    _print("%s written" % f for f in save(holder))
    return OK


def cmd_import(args):
    from .imports import run_import
    report = Report()
    try:
        _print(run_import(args, report))
    except Refused:
        _told(report)
        raise
    return OK if _told(report) else WRONG


def cmd_prove(args):
    from .prove import prove
    map_ = _good(args.map, args)
    if map_ is None:
        return WRONG
    return OK if prove(map_, args) else WRONG


def _seconds(text):
    value = number(text)
    if value is None or not 0 < value <= 3600:
        raise argparse.ArgumentTypeError('"%s"; allowed: seconds, up to 3600' % text)
    return value


def _parser():
    parser = argparse.ArgumentParser(
        prog="plcmap", description="One map of a PLC's values: check it, give places, make "
        "everything from it.", epilog="A map is a folder of CSV files (plc.csv map.csv types.csv "
        "enums.csv) or one .xlsx with those sheets. See docs/map.md.")
    parser.add_argument("--version", action="version", version=VERSION)
    parser.add_argument("--encoding", help="of CSV and symbol files that are not UTF-8, such as "
                        "cp1251")
    commands = parser.add_subparsers(dest="command", metavar="command")

    def add(name, function, text):
        sub = commands.add_parser(name, help=text, description=text)
        sub.set_defaults(function=function)
        return sub

    sub = add("check", cmd_check, "tell all errors of a map")
    sub.add_argument("map")
    sub = add("place", cmd_place, "give places to all rows that have none; nothing else moves")
    sub.add_argument("map")
    sub.add_argument("-n", "--dry-run", action="store_true", help="tell them, write nothing")
    sub.add_argument("--grow", action="store_true",
                     help="rows whose type has outgrown their place get another one; in a "
                     "type with a field that has grown, what is behind it moves")
    sub.add_argument("--compact", action="store_true", help="reserved rows go")
    sub = add("generate", cmd_generate, "make records, PLC code, simulator, displays, manual, lists")
    sub.add_argument("map")
    sub.add_argument("-o", "--output", default="gen", help="folder (gen)")
    sub.add_argument("--only", action="append", metavar="ENDING",
                     help="only files that end so, such as .db or .scl")
    sub = add("diff", cmd_diff, "tell what is different, and whether the layout is")
    sub.add_argument("old")
    sub.add_argument("new")
    sub = add("import", cmd_import, "take symbols from exports of PLC tools; their form is seen "
              "from their content")
    sub.add_argument("files", nargs="+", metavar="FILE")
    sub.add_argument("--into", metavar="MAP", help="the map that is updated or made; without it "
                     "the rows are only told")
    sub.add_argument("--select", action="append", metavar="PATTERN",
                     help="only symbols or addresses like this: DB10.* Tank*")
    sub.add_argument("--pv", metavar="RULE", help="names of new records: a pattern and what "
                     "becomes of it, s/Tank\\.(.*)/T1:\\1/; or none")
    sub.add_argument("--dir", choices=["in", "out", "cmd"], default="in",
                     help="direction of new rows (in)")
    sub.add_argument("--types", action="store_true",
                     help="structures of a source become types and rows that use them, instead of "
                     "single values")
    sub.add_argument("--db", metavar="NAME=NUMBER", action="append", default=[],
                     help="number of a data block that the source calls by its name")
    sub.add_argument("--columns", metavar="FILE", help="description of a sheet of your own")
    sub.add_argument("--keep-vanished", action="store_true",
                     help="rows that the export no longer has stay as they are")
    sub = add("show", cmd_show, "the blocks byte by byte, free places, transfers; or one value")
    sub.add_argument("map")
    sub.add_argument("what", nargs="?", help="a byte (54, out.10), a symbol or a record")
    sub = add("convert", cmd_convert, "CSV files to .xlsx and back; - as target prints all sheets")
    sub.add_argument("source")
    sub.add_argument("target")
    sub.add_argument("-f", "--force", action="store_true", help="overwrite")
    sub = add("prove", cmd_prove, "run plcSim and the IOC against each other and compare all values")
    sub.add_argument("map")
    sub.add_argument("--bin", help="folder of plcSim and s7plcIoc (that of plcmap)")
    sub.add_argument("--base-bin", help="folder of softIoc, caget and caput ($EPICS_BASE/bin/...)")
    sub.add_argument("--keep", metavar="FOLDER", help="keep all files and logs there")
    sub.add_argument("--patience", type=_seconds, default=10.0, metavar="S",
                     help="seconds until a value must agree (10)")
    sub.add_argument("-v", "--verbose", action="store_true", help="each comparison")
    return parser


def main(argv=None):
    parser = _parser()
    args = parser.parse_args(argv)
    if not args.command:
        parser.print_help()
        return USAGE
    try:
        if args.encoding is not None:
            check_encoding(args.encoding)
        return args.function(args)
    except Refused as e:
        print("plcmap: %s" % e, file=sys.stderr)
        return WRONG
    except BrokenPipeError:
        sys.stderr.close()
        return OK
    except KeyboardInterrupt:
        return 130
    except Exception as e:  # an error of this program; with its trace for who mends it
        if os.environ.get("PLCMAP_TRACE"):
            raise
        print("plcmap: internal error: %s: %s (PLCMAP_TRACE=1 shows where)"
              % (type(e).__name__, e), file=sys.stderr)
        return BROKEN
