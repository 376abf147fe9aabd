"""Expressions: types as strict as classic SCL's, and the Python that computes them.

Implicit conversions are only those of class A (BYTE to WORD, INT to DINT, ...): INT is not
WORD, TIME is not S5TIME. Integer arithmetic wraps as in the CPU. An operand that is no plain
local is a Place: where in which memory.
"""
import re
from dataclasses import dataclass

from . import literals
from .parse import SclError
from .types import (ANY, BITS, BOOL, BYTE, DINT, DWORD, IMPLICIT, INT, NUMBERS, REAL, TIME,
                    WIDTH, WORD, Array, Basic, Instance, Struct, Text)

BLOCK_DB = Basic("BLOCK_DB")

# Conversions of class B: explicit ones, (from, to) -> Python
def _wrap(kind):
    bits = WIDTH[kind]
    if kind == BOOL:
        return "bool({} & 1)"
    if kind in (INT, DINT, TIME):
        half = 1 << bits - 1
        return f"(({{}}) + {half} & {2 * half - 1}) - {half}"
    return f"({{}}) & {(1 << bits) - 1}"


CONVERSIONS = {f"{a}_TO_{b}": (a, b, _wrap(b)) for a, b in [
    (BYTE, BOOL), (WORD, BOOL), (DWORD, BOOL), (INT, BOOL), (DINT, BOOL),
    (WORD, BYTE), (DWORD, BYTE), (INT, BYTE), (DINT, BYTE), (DWORD, WORD), (INT, WORD),
    (DINT, WORD), (INT, DWORD), (DINT, DWORD), (BYTE, INT), (WORD, INT), (DWORD, INT),
    (DINT, INT), (BYTE, DINT), (WORD, DINT), (DWORD, DINT), (DINT, TIME), (TIME, DINT),
    (BOOL, BYTE), (BOOL, WORD), (BOOL, DWORD), (BYTE, WORD), (BYTE, DWORD), (WORD, DWORD)]}
CONVERSIONS.update({
    "INT_TO_DINT": (INT, DINT, "{}"), "INT_TO_REAL": (INT, REAL, "float({})"),
    "DINT_TO_REAL": (DINT, REAL, "float({})"), "REAL_TO_DINT": (REAL, DINT, "round({})"),
    "REAL_TO_INT": (REAL, INT, "round({})"),
    "REAL_TO_DWORD": (REAL, DWORD, "_bits({})"), "DWORD_TO_REAL": (DWORD, REAL, "_real({})"),
    "WORD_TO_BLOCK_DB": (WORD, BLOCK_DB, "{}"), "BLOCK_DB_TO_WORD": (BLOCK_DB, WORD, "{}")})

SHIFTS = {"SHL": "({0} << {1}) & {2}", "SHR": "{0} >> {1}",
          "ROL": "_rol({0}, {1}, {3})", "ROR": "_rol({0}, -{1}, {3})"}

MEMORY = re.compile(r"([MIQ])([BWD]?)(\d*)$")
DB_PART = re.compile(r"D([BWDX]?)(\d*)$")
PARTS = {"B": BYTE, "W": WORD, "D": DWORD, "X": BOOL, "": BOOL}


@dataclass
class Value:
    """Python that computes it; `constant` is set where it is known before the run."""
    type: object
    code: str
    constant: object = None


@dataclass
class Place:
    """memory[byte], bit: Python each. checked: the place may be outside, look when it runs.
    local: the name of a Python variable instead."""
    type: object
    memory: str = ""
    byte: str = ""
    bit: str = ""
    checked: bool = False
    local: str = ""
    db: int = None          # number of the data block, where it is known
    writable: bool = True

    def load(self):
        if self.local:
            return self.local
        kind, at = self.type, f"{self.memory}, {self.byte}"
        if kind == BOOL:
            return f"_bit({at}, {self.bit})"
        if isinstance(kind, Basic) and kind.format and kind != ANY:
            return f"{'_check' if self.checked else ''}_get_{kind.format}({at})"
        return f"_cut({at}, {kind.size})"

    def store(self, code):
        if self.local:
            return f"{self.local} = {code}"
        kind, at = self.type, f"{self.memory}, {self.byte}"
        if kind == BOOL:
            return f"_set_bit({at}, {self.bit}, {code})"
        if isinstance(kind, Basic) and kind.format and kind != ANY:
            return f"{'_check' if self.checked else ''}_put_{kind.format}({at}, {code})"
        return f"_paste({at}, {kind.size}, {code})"

    def part(self, kind, byte, bit=0):
        return Place(kind, self.memory, add(self.byte, byte), str(bit), self.checked,
                     db=self.db, writable=self.writable)


def add(code, number):
    """Python for code + number, short where both are known."""
    if code.isdigit() and isinstance(number, int):
        return str(int(code) + number)
    return f"{code} + {number}" if number else code


def convert(value, kind, pos, what="assigned"):
    """The value as that type, or an error."""
    have = value.type
    if have == kind:
        return value.code
    if isinstance(kind, Struct) and isinstance(have, Struct) and have.shape() == kind.shape():
        return value.code
    if (have, kind) in IMPLICIT:
        if kind == REAL:
            return f"float({value.code})"
        return f"int({value.code})" if have == BOOL else value.code
    raise SclError(pos, f"{have} {what} to {kind}")


def wrapped(kind, code):
    return code if kind == REAL else "(" + _wrap(kind).format(code) + ")"


class Expressions:
    """Needs of its heir: local(name, pos), db(name), block(name), call(node)."""

    def value(self, node):
        method = getattr(self, "value_" + node.kind, None)
        if method:
            return method(node)
        place = self.place(node)
        if isinstance(place, Value):
            return place
        if isinstance(place.type, Instance):
            raise SclError(node.pos, f"{place.type} is an instance, not a value")
        return Value(place.type, place.load())

    def value_number(self, node):
        kind, value = literals.number(node.text, node.pos)
        return Value(kind, repr(value), value)

    def value_literal(self, node):
        kind, value = literals.literal(node.text, node.pos)
        return Value(kind, repr(value), value)

    def value_string(self, node):
        kind, value = literals.string(node.text, node.pos)
        return Value(kind, repr(value), value)

    def value_bool(self, node):
        return Value(BOOL, repr(node.value), node.value)

    def value_pointer(self, node):
        raise SclError(node.pos, "classic SCL knows no P# constants; name a variable")

    def value_call(self, node):
        name = node.what.name if node.what.kind == "name" else ""
        if name in CONVERSIONS:
            have, kind, code = CONVERSIONS[name]
            argument = convert(self.only(node), have, node.pos, f"given for {name}")
            return Value(kind, "(" + code.format(argument) + ")")
        if name in SHIFTS:
            return self.shift(name, node)
        if name == "ABS":
            argument = self.only(node)
            if argument.type not in NUMBERS:
                raise SclError(node.pos, f"ABS of {argument.type}")
            return Value(argument.type, wrapped(argument.type, f"abs({argument.code})"))
        return self.call(node)

    def only(self, node):
        if len(node.arguments) != 1 or node.arguments[0][0]:
            raise SclError(node.pos, f"{node.what.name} takes one argument without a name")
        return self.value(node.arguments[0][1])

    def shift(self, name, node):
        given = {n: e for n, e, _ in node.arguments}
        if set(given) != {"IN", "N"} or len(node.arguments) != 2:
            raise SclError(node.pos, f"{name} takes IN and N")
        value = self.value(given["IN"])
        if value.type not in BITS[1:]:
            raise SclError(node.pos, f"{name} of {value.type}")
        count = convert(self.value(given["N"]), INT, node.pos, "given for N")
        bits = WIDTH[value.type]
        return Value(value.type, "(" + SHIFTS[name].format(
            f"({value.code})", f"({count})", (1 << bits) - 1, bits) + ")")

    def value_unary(self, node):
        value, kind = self.value(node.value), None
        if node.operator == "NOT" and value.type in BITS:
            mask = (1 << WIDTH[value.type]) - 1
            code = f"(not {value.code})" if value.type == BOOL else f"({value.code} ^ {mask})"
            return Value(value.type, code)
        if node.operator != "NOT" and (value.type in NUMBERS or value.type == TIME):
            kind = value.type
        if kind is None:
            raise SclError(node.pos, f"{node.operator} {value.type}")
        if node.operator == "+":
            return value
        constant = -value.constant if value.constant is not None else None
        return Value(kind, wrapped(kind, f"-{value.code}"), constant)

    def value_binary(self, node):
        left, right = self.value(node.left), self.value(node.right)
        kind, code = operation(node.operator, left, right, node.pos)
        return Value(kind, code)

    # --- places ------------------------------------------------------------------------

    def place(self, node):
        method = getattr(self, "place_" + node.kind, None)
        if not method:
            raise SclError(node.pos, "a variable expected")
        return method(node)

    def place_call(self, node):
        return self.value(node)

    def place_name(self, node):
        place = self.local(node.name, node.pos) or self.db(node.name)
        if place:
            return place
        match = MEMORY.match(node.name)
        if match and match[2] and match[3]:
            return Place(PARTS[match[2]], match[1], match[3], "0", checked=True)
        raise SclError(node.pos, f"{node.name} is not declared before")

    def place_field(self, node):
        base = self.place(node.of)
        match = DB_PART.match(node.name)
        if isinstance(base, Value):
            if base.type != BLOCK_DB or not match or not match[2]:
                raise SclError(node.pos, f"{base.type} has no {node.name}")
            return self.in_block(f"_db({base.code})", match[1], match[2], node)
        if isinstance(base.type, (Struct, Instance)):
            field = base.type.fields.get(node.name)
            if field:
                return base.part(field.type, field.byte, field.bit)
        if base.db is not None and match and match[2] and base.byte == "0":
            return self.in_block(base.memory, match[1], match[2], node, base.db)
        raise SclError(node.pos, f"{base.type} has no {node.name}")

    def in_block(self, memory, part, byte, node, db=None):
        if part in ("X", ""):
            raise SclError(node.pos, f"{node.name} wants a bit: {node.name}.0")
        return Place(PARTS[part], memory, byte, "0", checked=True, db=db)

    def place_bit(self, node):
        """M4.3, DB10.DX4.3"""
        if not 0 <= node.bit <= 7:
            raise SclError(node.pos, f"bit {node.bit}; allowed: 0 to 7")
        of = node.of
        match = MEMORY.match(of.name) if of.kind == "name" else None
        if match and not match[2] and match[3]:
            return Place(BOOL, match[1], match[3], str(node.bit), checked=True)
        match = DB_PART.match(of.name) if of.kind == "field" else None
        if match and match[1] in ("X", "") and match[2]:
            base = self.place(of.of)
            memory = f"_db({base.code})" if isinstance(base, Value) else base.memory
            return Place(BOOL, memory, match[2], str(node.bit), checked=True)
        raise SclError(node.pos, "a bit of what?")

    def place_index(self, node):
        of = node.of
        if of.kind == "name" and not self.local(of.name, of.pos):
            match = MEMORY.match(of.name)
            if match and match[2] and not match[3]:
                return Place(PARTS[match[2]], match[1], self.index(node, 1)[0], "0", True)
        if of.kind == "field":
            place = self.block_index(node)
            if place:
                return place
        base = self.place(of)
        if isinstance(base, Value) or not isinstance(base.type, Array):
            raise SclError(node.pos, f"{base.type} is no array")
        return self.element(base, node)

    def index(self, node, count):
        if len(node.index) != count:
            raise SclError(node.pos, f"{len(node.index)} indices; wanted: {count}")
        codes = []
        for item in node.index:
            value = self.value(item)
            if value.type != INT:
                raise SclError(item.pos, f"an index is INT, not {value.type}")
            codes.append(value.code)
        return codes

    def block_index(self, node):
        """DB10.DW[i], WORD_TO_BLOCK_DB(w).DB[i]; None when it is something else"""
        match = DB_PART.match(node.of.name)
        if not match or match[2]:
            return None
        base = self.place(node.of.of)
        if isinstance(base, Value):
            if base.type != BLOCK_DB:
                return None
            memory = f"_db({base.code})"
        elif base.db is not None and base.byte == "0" and node.of.name not in getattr(
                base.type, "fields", {}):
            memory = base.memory
        else:
            return None
        kind = PARTS[match[1]]
        codes = self.index(node, 2 if kind == BOOL else 1)
        return Place(kind, memory, codes[0], codes[1] if kind == BOOL else "0", True)

    def element(self, base, node):
        kind = base.type
        codes = self.index(node, len(kind.bounds))
        rows, last = "", None
        for (low, high), code, item in zip(kind.bounds, codes, node.index):
            constant = self.value(item).constant
            if constant is not None and not low <= constant <= high:
                raise SclError(item.pos, f"index {constant} is outside {low}..{high}")
            at = str(constant - low) if constant is not None else f"_index({code}, {low}, {high})"
            if last is not None:
                rows = f"({rows} * {size} + {last})" if rows else last
            last, size = at, high - low + 1
        row = f" + ({rows}) * {kind.row}" if rows else ""
        if kind.of == BOOL:
            return Place(BOOL, base.memory, f"({base.byte}{row}) + ({last}) // 8",
                         f"({last}) % 8", base.checked, writable=base.writable)
        if not rows and last.isdigit():
            return base.part(kind.of, int(last) * kind.step)
        return Place(kind.of, base.memory, f"{base.byte}{row} + {last} * {kind.step}", "0",
                     base.checked, writable=base.writable)


def operation(operator, left, right, pos):
    a, b = left.type, right.type
    wrong = SclError(pos, f"{a} {operator} {b}")
    if operator in ("AND", "OR", "XOR"):
        if a not in BITS or b not in BITS:
            raise wrong
        python = {"AND": "&", "OR": "|", "XOR": "^"}[operator]
        return max(a, b, key=BITS.index), f"({left.code} {python} {right.code})"
    if operator in ("=", "<>", "<", ">", "<=", ">="):
        bits = a in BITS and b in BITS
        numbers = a in NUMBERS and b in NUMBERS
        if not (numbers or (bits and operator in ("=", "<>")) or
                (a == b and a in (TIME, literals.CHAR))):
            raise wrong
        python = {"=": "==", "<>": "!="}.get(operator, operator)
        return BOOL, f"({left.code} {python} {right.code})"
    if a == TIME and (b == TIME and operator in "+-" or b == INT and operator in "*/"):
        kind = TIME
    elif a in NUMBERS and b in NUMBERS and not (
            operator in ("MOD", "DIV") and REAL in (a, b)):
        kind = max(a, b, key=NUMBERS.index)
    else:
        raise wrong
    if operator in ("/", "DIV") and kind != REAL:
        code = f"_div({left.code}, {right.code})"
    elif operator == "MOD":
        code = f"_mod({left.code}, {right.code})"
    else:
        code = f"{left.code} {operator} {right.code}"
    return kind, wrapped(kind, code)
