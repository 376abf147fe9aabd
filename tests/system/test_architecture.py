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
