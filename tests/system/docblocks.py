"""The code blocks of README.md and docs/: where each is, and which of them no test runs."""
import re
import textwrap

from client import TOP

FILES = [TOP / "README.md", *sorted(file for file in (TOP / "docs").rglob("*.md")
                                    if "O.site" not in file.parts)]
LIST = TOP / "tests/system/blocks-not-run"
FENCE = re.compile(r"^ *```(.*)$")


class Block:
    """page: below docs/; line: of its fence; kind: the word behind the fence, or ""."""

    def __init__(self, file, line, kind, lines):
        self.page = str(file.relative_to(TOP)).removeprefix("docs/")
        self.line, self.kind = line, kind
        self.text = textwrap.dedent("".join(line + "\n" for line in lines))
        self.first = next((line.strip() for line in lines if line.strip()), "")

    @property
    def place(self):
        return f"{self.page}:{self.line}"


def blocks():
    """Each Block between two fences; a table of contents is none."""
    for file in FILES:
        opened = None
        for number, line in enumerate(file.read_text().splitlines(), 1):
            fence = FENCE.match(line)
            if fence and opened is None:
                opened, kind, lines = number, fence[1], []
            elif fence:
                if not kind.startswith("{"):
                    yield Block(file, opened, kind, lines)
                opened = None
            elif opened is not None:
                lines.append(line)


def not_run():
    """[page, how the block begins, class, reason] of each line of the list."""
    return [[word.strip() for word in re.split(r" \| ", line)]
            for line in LIST.read_text().splitlines() if line and not line.startswith("#")]
