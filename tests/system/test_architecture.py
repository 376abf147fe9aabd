"""The floors of the driver: which file may use which, from the sources alone.

A file may include and call files of its own floor and of those below, no circle of files is
allowed, and the core names no wire. `floors` is the plan; docs/architecture.md describes it.
"""
import re

import pytest

from client import TOP

FLOORS = {"src/value": 1, "src/tcp": 1, "src/image": 2, "src/scan": 2, "src/station": 3,
          "src/block": 4, "src/record": 4, "src/shell": 5, "modbus": 6, "etherip": 6, "asyn": 6,
          "pair": 6}
CORE = [folder for folder in FLOORS if folder.startswith("src/")]
# A hint may name a type of another driver, "asyn's modbus".
WIRES = re.compile(r"(?<!asyn's )modbus|ethernet/ip|\bcip\b|\beip", re.I)
COMMENTS = re.compile(r'/\*.*?\*/|//[^\n]*|"(?:\\.|[^"\\\n])*"|\'(?:\\.|[^\'\\\n])*\'', re.S)
DEFINITION = re.compile(r"^(?!static|typedef|extern|#|\}|return|else|struct \w+ \{)"
                        r"[A-Za-z_][\w \t*]*?[ *](\w+)(?:\(|\[[^;\n]*\] *=| *=|;)", re.M)


def folder_path(folder):
    return TOP / "phoenixRedundApp/src" if folder == "pair" else TOP / "s7plcApp" / folder


def blank(match):
    """A comment or text without its words, but with its lines."""
    text = match.group()
    return text[0] + text[-1] if text[0] == '"' else re.sub(r"[^\n]", " ", text)


class Source:
    def __init__(self, path, folder):
        self.path, self.folder, self.floor = path, folder, FLOORS[folder]
        self.name = path.name
        self.text = path.read_text()
        self.code = COMMENTS.sub(blank, self.text)
        self.where = path.relative_to(TOP)

    def line(self, at):
        number = self.code.count("\n", 0, at)
        return f"{self.where}:{number + 1}: {self.text.splitlines()[number].strip()}"


@pytest.fixture(scope="module")
def sources():
    found = [Source(path, folder) for folder in FLOORS
             for path in sorted(folder_path(folder).glob("*.[ch]"))]
    assert len(found) > 100
    return found


@pytest.fixture(scope="module")
def uses(sources):
    """(user, used, word, line) of every call across files: used is where the word is defined."""
    defined = {}
    for source in sources:
        if source.path.suffix == ".c":
            for match in DEFINITION.finditer(source.code):
                defined[match.group(1)] = source
    assert defined["plcStationFind"].name == "plcStation.c"
    assert defined["s7plcDebug"].folder == "src/station"
    assert defined["plcStatRows"].name == "plcStatsTable.c"
    found = []
    for source in sources:
        if source.path.suffix != ".c":
            continue
        own = set(re.findall(r"^static [\w \t*]*?[ *](\w+)(?:\(|\[| *=|;)", source.code, re.M))
        for match in re.finditer(r"(?<![\w.>])\w+", source.code):
            used = defined.get(match.group())
            if used and used is not source and match.group() not in own:
                found.append((source, used, match.group(), source.line(match.start())))
    assert len(found) > 1000
    return found


def test_includes_point_down(sources):
    """no file includes one of a higher floor"""
    headers = {source.name: source for source in sources if source.path.suffix == ".h"}
    wrong = []
    for source in sources:
        for match in re.finditer(r'^#include "([\w.]+)"', source.text, re.M):
            other = headers.get(match.group(1))
            if other and other.floor > source.floor:
                wrong.append(source.line(match.start()))
    assert not wrong, "\n".join(wrong)


def test_libraries_are_apart(sources):
    """a wire, the pair and asyn include nothing of each other"""
    headers = {source.name: source for source in sources if source.path.suffix == ".h"}
    wrong = [source.line(match.start()) for source in sources if source.floor == 6
             for match in re.finditer(r'^#include "([\w.]+)"', source.text, re.M)
             if headers.get(match.group(1), source).floor == 6
             and headers.get(match.group(1), source).folder != source.folder]
    assert not wrong, "\n".join(wrong)


def test_calls_point_down(uses):
    """no file calls one of a higher floor"""
    wrong = [line for user, used, _, line in uses if used.floor > user.floor]
    assert not wrong, "\n".join(wrong)


def circles(edges):
    """The groups of files each of which reaches all others of its group."""
    reach = {}
    for start in edges:
        seen, todo = set(), [start]
        while todo:
            for other in edges.get(todo.pop(), ()):
                if other not in seen:
                    seen.add(other)
                    todo.append(other)
        reach[start] = seen
    return sorted({tuple(sorted(other for other in reach[start] if start in reach.get(other, ())))
                   for start in edges if start in reach[start]})


def test_no_circles(uses):
    """no circle of files that call each other"""
    edges, lines = {}, {}
    for user, used, _, line in uses:
        edges.setdefault(user.where.stem, set()).add(used.where.stem)
        lines.setdefault((user.where.stem, used.where.stem), line)
    wrong = []
    for group in circles(edges):
        wrong.append(" ".join(group) + ":")
        wrong += [f"  {line}" for (user, used), line in lines.items()
                  if user in group and used in group]
    assert not wrong, "\n".join(wrong)


def test_circles_are_found():
    """the search for circles itself"""
    assert circles({"a": {"b"}, "b": {"c"}, "c": {"a"}, "d": {"a"}}) == [("a", "b", "c")]
    assert circles({"a": {"b", "c"}, "b": {"c"}, "c": set()}) == []


def test_core_names_no_wire(sources):
    """the core neither knows nor mentions a wire other than blocks"""
    wrong = []
    for source in sources:
        if source.folder in CORE:
            wrong += [f"{source.where}:{number}: {line.strip()}"
                      for number, line in enumerate(source.text.splitlines(), 1)
                      if WIRES.search(line)]
    assert not wrong, "\n".join(wrong)


def test_locks(sources):
    """docs/architecture.md says of each mutex in which order it is taken"""
    made = {source.path.stem for source in sources
            if re.search(r"\bepicsMutex(Must)?Create\w*\(", source.code)}
    table = (TOP / "docs/architecture.md").read_text().split("## Locks")[1].split("\n## ")[0]
    told = {name for row in re.findall(r"^\| [^|]*\| ([^|]*) \|", table, re.M)
            for name in re.findall(r"`(\w+)`", row)}
    assert made == told


# What a file that "knows nothing of" it neither includes nor calls.
NOTHING_OF = {
    "sockets": r"sys/socket\.h|netinet/|osiSock\.h|plcConnection\.h|eipSocket\.h|plcModbusSocket\.h|\b(socket|recv|connect|accept)\(",
    "how to connect": r"plcConnection\.h|\bconnect\(|getaddrinfo", "addresses": r"plcResolver\.h|\bconnect\(|getaddrinfo",
    "records": r"(dbCommon|dbAccess|recSup|recGbl|devSup|dbStaticLib|\w+Record|dev\w+)\.h|\bdbCommon\b",
    "IOCs": r"(dbCommon|dbAccess|recSup|devSup|initHooks|iocsh|plcStation)\.h",
    "libmodbus": r"\bmodbus_\w+\(|<modbus(/modbus)?\.h>", "threads": r"epicsThread\.h|epicsMutex\.h|epicsThread\w+\(",
    "the log": r"errlog|plcStationLog", "clocks": r"epicsTime\.h|epicsMonotonicGet|clock_gettime",
    "time": r"epicsTimeGetCurrent|epicsMonotonicGet|clock_gettime", "asyn": r"<asyn|\basynUser\b", "files": r"\bf?open\(",
    "stations": r"plcStation\w*\.h", "PLCs": r"plcStation\w*\.h", "images": r"plcImage\w*\.h", "links": r"plcLink\w*\.h",
    "types": r"plcCodec\.h", "tags": r"eipTags\.h|eipUnits\.h", "blocks": r"plcBlocks\.h|plcFraming\.h",
}


def told_of_files():
    """(file, what it knows nothing of) of each row of the tables of files in docs/architecture.md"""
    for line in (TOP / "docs/architecture.md").read_text().splitlines():
        cells = [cell.strip() for cell in line.strip("|").split("|")] if line.startswith("| `") else []
        if len(cells) != 3:
            continue
        for name in re.findall(r"`([\w/.]+)`", cells[0]):
            places = [TOP / "s7plcApp" / folder / (name + end) for folder in ("src", "", "asyn") for end in (".c", ".h", "")]
            for file in (place for place in places if place.is_file()):
                yield from ((file, word.strip()) for word in re.split(r"[,;]| or ", cells[2]))


def test_knows_nothing_of():
    """what docs/architecture.md says that a file knows nothing of it neither includes nor calls"""
    wrong, count = [], 0
    for file, word in told_of_files():
        code = COMMENTS.sub(lambda m: m.group() if m.group().endswith('.h"') else blank(m), file.read_text())
        found = word in NOTHING_OF and re.search(NOTHING_OF[word], code)
        count += word in NOTHING_OF
        if found:
            wrong.append(f"{file.relative_to(TOP)}: {word}: {found.group()}")
    assert count > 150 and not wrong, "\n".join(wrong)


def test_workers_are_apart(sources):
    """the worker of Modbus touches no input image, no record and no log, the station does; none but it asks by libmodbus"""
    workers = [s for s in sources if re.fullmatch(r"plcModbus(Ask|Turns|Reads|Writes)?\.[ch]", s.name)]
    assert len(workers) == 6
    what = re.compile("|".join(NOTHING_OF[word] for word in ("records", "the log", "stations")) +
                      r"|plcImage(Publish|Invalidate|Read|Peek|Reason|Valid)\w*\(")
    wrong = [f"{s.where}: {m.group()}" for s in workers for m in [what.search("\n".join(
        line for line in s.text.splitlines() if line.startswith("#include")) + s.code)] if m]
    asking = {s.name for s in sources if re.search(r"\bmodbus_(read|write|mask|send|receive|report)\w*\(", s.code)}
    assert asking and asking <= {s.name for s in workers}
    assert not wrong, "\n".join(wrong)


PAGE = TOP / "docs/architecture.md"


def test_files_are_told(sources):
    """each source file stands in docs/architecture.md, and each file of its tables is there"""
    page = PAGE.read_text()
    rows = [line.strip("|").split("|")[0] for line in page.splitlines() if line.startswith("| `") and line.count("|") == 4]
    told = {name for row in rows for name in re.findall(r"`([\w/.]+)`", row)}
    files = {source.path.stem: source for source in sources if source.path.suffix == ".c" and source.folder != "pair"}
    assert not set(files) - {name.rpartition("/")[2] for name in told}
    core = {name for name in told if "/" in name and not name.endswith("/")}
    missing = {name for name in core if not any((TOP / "s7plcApp" / folder / (name + end)).is_file()
                                                for folder in ("src", "") for end in (".c", ".h", ""))}
    assert len(core) > 80 and not missing
    order = re.search(r"the floors of the library `s7plc`, from the ground up: ([^;]*);", page)[1]
    assert ["src/" + folder for folder in re.findall(r"`(\w+)`", order)] == CORE


def test_names(sources):
    """each name of the code that docs/architecture.md tells is in the sources, a function in the file told with it"""
    page = PAGE.read_text()
    code = {source.name: source.code for source in sources}
    words = set(re.findall(r"\w+", "\n".join(code.values())))
    names = {name for name in re.findall(r"`(\w+)`", page) if re.match(r"(plc|eip|dev|drv|pair|s7plc)[A-Z](?!\w*Test$)", name)} - {"plcSim", "s7plcDNS"}
    stems = {name.rpartition(".")[0] for name in code}
    unknown = names - words - stems
    assert len(names) > 60 and not unknown
    told = [(name, file) for listed, file in re.findall(r"((?:`\w+`(?:, | and )?)+)\s*\(`(\w+\.c)`\)", page)
            for name in re.findall(r"`(\w+)`", listed)]
    wrong = [(name, file) for name, file in told if not re.search(rf"^[\w \t*]*\b{name}\(", code[file], re.M)]
    assert len(told) > 12 and not wrong


def test_order_in_station(uses):
    """within station the files stand one above the other as docs/architecture.md lists them"""
    listed = re.search(r"within `station` (`plcStationState` is the lowest[^.]*)\.", PAGE.read_text())[1]
    order = re.findall(r"`(\w+)`", listed)
    assert len(order) == 8
    wrong = [line for user, used, _, line in uses
             if {user.path.stem, used.path.stem} <= set(order) and order.index(used.path.stem) > order.index(user.path.stem)]
    assert not wrong, "\n".join(wrong)


def test_threads(sources):
    """each file that starts a thread does it for one of docs/architecture.md's table, by the name there"""
    table = PAGE.read_text().split("## Threads")[1].split("\n## ")[0]
    started = {"plcStation": "one per PLC, named as the PLC", "plcAsynPort": "one per asyn port, named as the port",
               "plcResolver": '"s7plcDNS"', "pairWatch": '"pairWatch"', "plcModbus": '-mb"', "plcModbusRelay": '-mbw"',
               "eipWorker": '-eip"', "plcAsynTrace": ' trace"'}
    text = "".join(source.text for source in sources)
    makers = [source for source in sources if re.search(r"\bepicsThreadCreate\w*\(", source.code)]
    assert {source.path.stem for source in makers} == set(started)
    for source in makers:
        name = started[source.path.stem]
        assert name.strip('"').strip() in table, name
        assert name in text if '"' in name else re.search(r"epicsThreadCreate\(\w+->name,", source.code), name


FUNCTION = re.compile(r"^(static )?(?!static )[A-Za-z_][\w \t*]*?[ *](\w+)\([^;{}]*?\)\s*\n\{\n(.*?)^\}", re.M | re.S)
# What may last, or takes locks of Base: the log, scan requests, records, the system.
LASTS = re.compile(r"errlog\w*|plcStationLog\w*|scanOnce|scanIo(Request|Immediate)|callbackRequest\w*|db(Process|Put\w*|Get\w*|ScanLock)|getaddrinfo|"
                   r"poll|ppoll|recv|send|read|write|connect|socket|close|pipe2?|posix_spawn\w*|waitpid|epicsThread(Sleep|Create\w*|MustJoin)|"
                   r"epicsEvent(Must)?Wait\w*|epicsSocket\w+|fopen|printf|modbus_\w+")
LOCKS = re.compile("epicsMutexMustLock|lockList|enter|plcWorkerEnter")
# What the last column of the table tells: in a file, what is called: what lasts in it.
TOLD_TO_LAST = {
    "plcResolver.c": "epicsThreadCreate: .*", "plcAsynDrvUser.c": "plcAsynPlaceView: write",
    "plcStation.c": "startThread: .*|plcStationWake: write|plcConnectionClose: epicsSocketDestroy|plcWakeFree: close",
    "phoenixPair.c": "plcScanRequestAll: .*", "pairWatch.c": r"(makePipe|close|spawn): (pipe2?|close|posix_spawn\w*)",
    **dict.fromkeys(("eipWorker.c", "plcModbus.c", "plcModbusRelay.c", "plcModbusSocket.c"), r"\w+: (close|epicsSocketDestroy)")}


def test_nothing_lasts_under_a_lock(sources):
    """while a lock is held nothing is logged, requested or processed, nor a system call made that the table does not tell"""
    functions = {}
    for source in sources:
        if source.path.suffix == ".c":
            for match in FUNCTION.finditer(source.code):
                functions[(source.name if match[1] else "", match[2])] = (source, match[3], match.start(3))
    assert len(functions) > 1500

    def calls(source, text):
        for match in re.finditer(r"(?<![\w.>])(\w+)\s*\(", text):
            key = (source.name, match[1]) if (source.name, match[1]) in functions else ("", match[1])
            yield match.start(), match[1], key

    reached = {}

    def reach(key):
        """The lasting ones that a function reaches."""
        if key not in reached:
            reached[key] = set()
            source, body, _ = functions[key]
            for _, name, other in calls(source, body):
                reached[key] |= {name} if LASTS.fullmatch(name) else reach(other) if other in functions else set()
        return reached[key]

    def unlocks(key):
        return "epicsMutexUnlock(" in functions[key][1] and not LOCKS.search(functions[key][1])

    wrong, held = [], 0
    for source, body, start in functions.values():
        locked = 0
        for at, name, key in calls(source, body):
            locked += bool(LOCKS.fullmatch(name)) - (name in ("epicsMutexUnlock", "unlockList") and locked > 0)
            if locked and not LOCKS.fullmatch(name):
                held += 1
                lasting = {name} if LASTS.fullmatch(name) else reach(key) if key in functions and not unlocks(key) else set()
                wrong += [f"{source.line(start + at)}: {last}" for last in sorted(lasting)
                          if not re.fullmatch(TOLD_TO_LAST.get(source.name, ""), f"{name}: {last}")]
                locked -= key in functions and unlocks(key)
    assert held > 200 and not wrong, "\n".join(wrong)


def test_map_modules():
    """each module of plcmap imports only from those before it in docs/architecture.md"""
    rows = [line.strip("|").split("|")[0] for line in PAGE.read_text().split("| module in plcmaplib |")[1].split("\n\n")[0].splitlines()
            if line.startswith("| `")]
    folder = TOP / "s7plcApp/map/plcmaplib"
    floors = {name.strip("/"): floor for floor, row in enumerate(rows) for name in re.findall(r"`([\w/]+)`", row)}
    files = [file for file in sorted(folder.rglob("*.py")) if file.name not in ("__init__.py", "main.py") or file.parent != folder]
    wrong = []
    for file in files:
        own = file.relative_to(folder).parts[0].removesuffix(".py")
        text, up = file.read_text(), ".." if file.parent != folder else "."
        used = re.findall(rf"^\s*from {re.escape(up)}(\w+)", text, re.M)
        for names in re.findall(rf"^\s*from {re.escape(up)} import ([\w, ]+)", text, re.M):
            used += [name for name in names.split(", ") if name in floors]
        wrong += [f"{file.relative_to(folder)}: {name}" for name in used if floors[name] > floors[own]]
    assert len(files) > 25 and not wrong, "\n".join(wrong)
