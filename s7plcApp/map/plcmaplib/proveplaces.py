"""Where a value lies in plcSim, in the words of its console: PLC memory, or the tags of a controller.
Knows commands and answers; runs nothing."""
import re

from . import tags
from .outputs.simulator import Memory
from .provevalues import sim_type


WORDS = 100  # values in one command


def plain(word, leaf):
    """A word of an answer: a number, or text where the type is one."""
    kind = getattr(leaf.type, "element", leaf.type)
    if getattr(kind, "kind", "text") in ("text", "char", "time", "raw"):
        return word
    return number(word)


def number(text):
    return int(text) if re.match(r"^-?\d+$", text) else float(text)


def quoted(words):
    return " ".join('"%s"' % w if w == "" or " " in w else w for w in words)


def _listed(found):
    return found if len(found) != 1 else found[0]


class Places:
    """PLC memory: `set DB10.4 INT 5`, `get DB10.4 INT`."""

    def __init__(self, map_):
        self.map = map_
        self.memory = Memory(map_)

    def where(self, leaf):
        """Place and type."""
        a = self.memory.of(leaf)
        if leaf.is_bit():
            return "%s BOOL" % a.text(1, a.bit)
        return "%s %s" % (self._byte(a, 0), sim_type(self.map, leaf.type))

    @staticmethod
    def _byte(a, more):
        return "%s%d" % ("DB%d." % a.db if a.area == "DB" else a.area, a.byte + more)

    def bits(self, leaf):
        """What it takes: values that share something cannot be set at one time."""
        a = self.memory.of(leaf)
        if leaf.is_bit():
            return {(a.area, a.db, a.byte, a.bit)}
        return {(a.area, a.db, a.byte + i, bit) for i in range(leaf.size()) for bit in range(8)}

    def set(self, values):
        """Commands that set [(leaf, words)]."""
        found = []
        for leaf, words in values:
            if len(words) <= WORDS:
                found.append("set %s %s" % (self.where(leaf), quoted(words)))
                continue
            kind = leaf.type.element
            for first in range(0, len(words), WORDS):
                part = words[first:first + WORDS]
                found.append("set %s %s[%d] %s" % (
                    self._byte(self.memory.of(leaf), first * kind.size), sim_type(self.map, kind),
                    len(part), quoted(part)))
        return found

    def get(self, leaf):
        return "get " + self.where(leaf)

    def answer(self, text, leaf):
        """What an answer says: DB10.4 INT16 = 5"""
        text = text.partition(" = ")[2]
        if text.startswith('"'):
            return text[1:-1]
        return _listed([plain(p, leaf) for p in text.split()])


class Tags:
    """Tags: `etherip set Tank.Level 5`. The console knows no bits of numbers: they are set and
    read with the whole number."""

    def __init__(self, map_):
        self.map = map_
        self.numbers = {}  # tag -> what was set last, of tags with single bits

    def bits(self, leaf):
        text, bit = tags.place(leaf)
        if bit is not None:
            return {(text.upper(), bit)}
        names = [text]
        if hasattr(leaf.type, "indices"):
            names += ["%s[%s]" % (text, i) for i in leaf.type.indices()]
        return {(n.upper(), b) for n in names for b in range(64)}

    def set(self, values):
        commands, wholes = [], []
        for leaf, words in values:
            text, bit = tags.place(leaf)
            if bit is None and len(words) <= WORDS:
                commands.append("etherip set %s %s" % (text, quoted(words)))
                continue
            if bit is None:
                indices = leaf.type.indices()
                commands += ["etherip set %s[%s] %s" % (text, indices[n], quoted(words[n:n + WORDS]))
                             for n in range(0, len(words), WORDS)]
                continue
            old = self.numbers.get(text, 0)
            self.numbers[text] = old | 1 << bit if words[0] == "1" else old & ~(1 << bit)
            if text not in wholes:
                wholes.append(text)
        return commands + ["etherip set %s %s" % (t, self._signed(t)) for t in wholes]

    def _signed(self, text):
        """Arrays of BOOL are DWORD, other bits lie in a DINT."""
        value = self.numbers[text]
        return value if text.endswith("]") or value < 2 ** 31 else value - 2 ** 32

    def get(self, leaf):
        return "etherip get %s" % tags.place(leaf)[0]

    def answer(self, text, leaf):
        text, bit = text.partition(" = ")[2], tags.place(leaf)[1]
        if bit is not None:
            return int(text) >> bit & 1
        if text.startswith('"'):
            return text[1:-1]
        return _listed([plain(p, leaf) for p in text.split()])


def places(map_):
    return Places(map_) if map_.has_blocks() else Tags(map_)
