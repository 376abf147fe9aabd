"""Mutants of an SCL text: small changes of the kind that a slip of the keyboard makes.

A mutant is (where, what was changed, the new text). Nothing here knows what the text means.
"""
import re

from . import texts
from .compile import Program
from .parse import SclError, parse, tokens

SWAPS = {"=": "<>", "<>": "=", "<": "<=", ">": ">=", "<=": "<", ">=": ">", "+": "-", "-": "+",
         "AND": "OR", "OR": "AND", "TRUE": "FALSE", "FALSE": "TRUE", "SRC": "DST", "DST": "SRC",
         "SRCBLK": "DSTBLK", "FROM": "DEST", "BYTE": "INT", "WORD": "INT", "INT": "WORD",
         "DWORD": "DINT", "TIME": "S5TIME", "BOOL": "BYTE", "IE_RX": "IE_TX", "IE_TX": "IE_RX",
         "IE_ACC": "IE_RX", "DB_TX_PTRS": "DB_RX_PTRS", "DB_RX_PTRS": "DB_TX_PTRS",
         "TON": "TOF", "PERIOD": "WATCHDOG", "WATCHDOG": "PERIOD", "EXIT": "CONTINUE"}


def tried(text, step, survives):
    """Each `step`-th mutant: how many do not compile, how many do not survive, and (what, pos) of
    those that do. survives(text, program)."""
    refused = noticed = 0
    left = []
    for number, (pos, what, mutant) in enumerate(mutants(text)):
        if number % step:
            continue
        try:
            program = Program(mutant, texts.symbols(mutant))
        except SclError:
            refused += 1
            continue
        if survives(mutant, program):
            left.append((what, pos))
        else:
            noticed += 1
    print(f"{refused} refused, {noticed} noticed, {len(left)} without effect")
    return refused, noticed, left


def agrees(page, pattern, text, step, counts):
    """What a page says: so many slips, of which so many do not compile, are noticed, do nothing. The last three are
    compared where each slip was tried."""
    said = [int(number.replace(",", "")) for number in re.search(pattern, " ".join(page.split())).groups()]
    return said[0] == sum(said[1:]) == sum(1 for _ in mutants(text)) and (step != 1 or said[1:] == list(counts))


def mutants(text):
    spots = list(tokens(text))
    places = offsets(text)
    for kind, word, pos in spots:
        at = places[pos[0] - 1] + pos[1] - 1
        for new in changes(kind, word):
            yield pos, f"{word} -> {new or 'nothing'}", text[:at] + new + text[at + len(word):]
    yield from without_statements(text, places)


def changes(kind, word):
    if word.upper() in SWAPS:
        yield SWAPS[word.upper()]
    elif word.upper() == "NOT":
        yield ""
    elif kind == "number" and word.isdigit():
        yield str(int(word) + 1)
    elif kind == "literal":
        match = re.match(r"(.*?)([0-9A-F]+)(MS|S)?$", word, re.I)
        if match:
            digits = format(int(match[2], 16) ^ 1, f"0{len(match[2])}X")
            yield match[1] + digits + (match[3] or "")


def offsets(text):
    at, result = 0, []
    for line in text.split("\n"):
        result.append(at)
        at += len(line) + 1
    return result


def without_statements(text, places):
    """Each assignment or call left out."""
    for block in parse(text):
        for node in simple(getattr(block, "body", None) or getattr(block, "initial", []) or []):
            at = places[node.pos[0] - 1] + node.pos[1] - 1
            end = end_of(text, at)
            yield node.pos, f"without {text[at:end].split(chr(10))[0]}", \
                text[:at] + ";" + " " * (end - at - 1) + text[end:]


def end_of(text, at):
    depth = 0
    while text[at] != ";" or depth:
        depth += {"(": 1, ")": -1}.get(text[at], 0)
        at += 1
    return at + 1


def simple(nodes):
    for node in nodes:
        if node.kind in ("set", "do", "exit"):
            yield node
        for body in bodies(node):
            yield from simple(body)


def bodies(node):
    if node.kind in ("if", "case"):
        yield from (body for _, body in node.branches)
        yield node.other or []
    elif node.kind in ("for", "while", "repeat"):
        yield node.body
