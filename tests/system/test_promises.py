"""docs/promises.md: each sentence stands in its page as it is quoted, and its tests are there and run."""
import os
import re
import subprocess
import sys

import pytest

from client import TOP

PAGE = TOP / "docs/promises.md"
ROW = re.compile(r"^\| (.+) \| (`.+) \|$")
SAID_ELSEWHERE = {"index", "promises", "coverage", "reliability", "glossary", "testing", "performance", "cheatsheet"}


def plain(text):
    """Words alone: no marks of Markdown, one blank where there are several or a new line."""
    text = re.sub(r"!?\[([^\]]*)\]\([^)]*\)", r"\1", text)
    return " ".join(re.sub(r"\\(?=[^a-zA-Z0-9\s])|[*`]", "", text).split())


def promises():
    """{page: [(sentence, [test, ...])]}"""
    found, page = {}, None
    for line in PAGE.read_text().splitlines():
        if line.startswith("## "):
            link = re.search(r"\]\((.+)\)$", line)  # README.md is no page of the site: no link to it
            page = link[1] if link else "../" + line[3:]
            found[page] = []
        elif ROW.match(line):
            sentence, tests = ROW.match(line).groups()
            found[page].append((plain(sentence), tests.split(" · ")))
    return found


def test_quoted():
    """each sentence stands in its page, word for word"""
    for page, rows in promises().items():
        text = plain((PAGE.parent / page).read_text())
        assert not [sentence for sentence, _ in rows if sentence not in text], page


def test_pages():
    """each page that promises something has a chapter, of at least one sentence"""
    pages = {file.stem for file in (TOP / "docs").glob("*.md")} - SAID_ELSEWHERE
    assert not pages - {page.rpartition("/")[2][:-3] for page, rows in promises().items() if rows}


def collected():
    """Names, as test_x.py::test_y, of all tests that pytest finds (conftest.py shows sentences instead)."""
    names = set()
    for folder in ("system", "map"):
        run = subprocess.run([sys.executable, "-m", "pytest", "--collect-only", "-q", "--noconftest",
                              "-p", "no:cacheprovider"], cwd=TOP / "tests" / folder, capture_output=True, text=True,
                             timeout=300, env={**os.environ, "PYTHONPATH": str(TOP / "tests")})
        assert run.returncode == 0, run.stdout[-2000:]
        names |= set(re.findall(r"^(test_\w+\.py::test_\w+)", run.stdout, re.M))
    return names


def unit_programs():
    """{program: the text of its sources}, with literals that go over several lines as one"""
    text = (TOP / "tests/unit/Makefile").read_text()
    found = {}
    for program in re.findall(r"^TESTS \+= (.+)$", text, re.M):
        for name in program.split():
            files = " ".join(re.findall(rf"^{name}_SRCS \+= (.+)$", text, re.M)).split()
            sources = [TOP / "tests/unit" / file for file in files + ["recordTest.c"] * name.startswith("recordTest")]
            both = "".join(file.read_text() for file in sources if file.suffix == ".c" and file.exists())
            found[name] = " ".join(re.sub(r'"\s*\n\s*"', "", both).split())
    return found


def test_tests():
    """each test that is named is there and run, each row of a unit test too"""
    pytests, units, wrong = collected(), unit_programs(), []
    cases = subprocess.run([TOP / "tests/bench/run", "--list"], capture_output=True, text=True, check=True).stdout
    cases = [line.split()[0] for line in cases.splitlines()]
    steps = re.search(r'^steps="(.+)"$', (TOP / "tests/check/run").read_text(), re.M)[1].split()
    assert len(pytests) > 500
    for page, rows in promises().items():
        for sentence, tests in rows:
            assert tests, sentence
            for test in tests:
                name, row = re.fullmatch(r"`([\w.:]+)`(?:: (.+))?", test).groups()
                if name == "check":
                    good = row in steps
                elif name == "bench":
                    good = row in cases
                elif "::" in name:
                    good = name in pytests and not row
                else:
                    good = name in units and plain(row or "") in plain(units.get(name, "").replace("\\", ""))
                if not good:
                    wrong.append(f"{page}: {sentence}: {test}")
    assert not wrong, "\n".join(wrong)


def literals(folders):
    """The texts in the sources, each in one piece, as C has them."""
    text = "\n".join(file.read_text() for folder in folders for file in sorted((TOP / folder).rglob("*.c")))
    return re.findall(r'"((?:\\.|[^"\\\n])*)"', re.sub(r'"\s*\n\s*"', "", text))


def alarm_texts():
    """What docs/alarms.md has in its columns AMSG."""
    column = None
    for line in (TOP / "docs/alarms.md").read_text().splitlines():
        cells = [cell.strip() for cell in line.strip("|").split("|")] if line.startswith("|") else []
        heads = [i for i, cell in enumerate(cells) if cell.startswith("AMSG")]
        column = heads[0] if heads else column if cells else None
        if column is not None:
            yield from re.findall(r"`([^`]+)`", cells[column])


def test_alarm_texts():
    """each text that docs/alarms.md tells is one that the driver says"""
    said = [text.replace("\\", "") for text in literals(["s7plcApp", "phoenixRedundApp"])]
    # Of what is said in two halves the page has the first: "... ; allowed: ..."
    clauses = [re.split(r"%[-+.*0-9lhz]*[a-zA-Z]", half) for text in said if "%" in text
               for half in (text, text.partition("; ")[0])]
    formats = [re.compile(".+?".join(map(re.escape, parts))) for parts in clauses if len("".join(parts)) > 8]
    texts = list(alarm_texts())
    assert len(texts) > 90
    unknown = []
    for text in texts:
        # Numbers, names and types are put in when it is said.
        parts = re.split(r'\.\.\.|\d+(?:\.\d+)?|\([0-9A-F ]+\)|"[^"]*"|\b(?:INT16|INT|FLOT)\b|, |^PLC: ', text)
        in_pieces = all(any(part.strip() in words for words in said) for part in parts if len(part.strip()) > 3)
        if not in_pieces and not any(form.match(text.replace("...", "3 + 4")) for form in formats):
            unknown.append(text)
    assert not unknown, unknown
