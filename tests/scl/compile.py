"""Blocks and statements of SCL: declarations with their places, and a Python module.

One pass from top to bottom: what a block uses must stand above it, as in a source that STEP 7
compiles. `Program.namespace` has a function for each code block.
"""
import re

from . import blocks
from .check import Expressions, Place, Value, convert
from .parse import SclError, parse
from .types import (ANY, BOOL, DINT, INT, REAL, Array, Basic, Instance, Layout, Struct,
                    Text, BASIC, make_struct)

NUMBER = re.compile(r"(DB|FC|FB|OB)(\d+)$")


class Function:
    """What a caller of an FC has to know."""

    def __init__(self, name, inputs, outputs, result):
        self.name, self.inputs, self.outputs, self.result = name, inputs, outputs, result


class Program:
    """A whole source. symbols: name of a data block -> its number."""

    def __init__(self, text, symbols):
        self.symbols = {name.upper(): number for name, number in symbols.items()}
        self.types, self.dbs, self.functions, self.fbs, self.obs = {}, {}, {}, {}, []
        self.sections = {}      # of each function block: name -> VAR_INPUT, ...
        self.lines, self.positions = [], []
        for node in parse(text):
            getattr(self, "add_" + node.kind)(node)
        self.source = "\n".join(self.lines) + "\n"

    def emit(self, indent, code, pos):
        self.lines.append("    " * indent + code)
        self.positions.append(pos)

    # --- types -------------------------------------------------------------------------

    def type(self, node):
        if node.kind == "struct":
            return self.struct("", node)
        if node.kind == "array":
            of = self.type(node.of)
            for low, high in node.bounds:
                if low > high:
                    raise SclError(node.pos, f"ARRAY [{low}..{high}] has no element")
            return Array(tuple(node.bounds), of)
        if node.kind == "named":
            known = self.types.get(node.name) or self.fbs.get(node.name)
            if node.name in blocks.STANDARD:
                known = blocks.STANDARD[node.name][0]
            if not known:
                raise SclError(node.pos, f"type {node.name} is not declared before")
            return known
        if node.name == "STRING":
            if not 1 <= node.size <= 254:
                raise SclError(node.pos, "a STRING has 1 to 254 characters")
            return Text(node.size)
        if node.name not in BASIC and node.name != "BLOCK_DB":
            raise SclError(node.pos, f"{node.name} is no type")
        return Basic(node.name)

    def struct(self, name, node):
        fields = []
        for item in node.fields:
            if item.view:
                raise SclError(item.pos, "AT is for variables of a block")
            kind = self.type(item.type)
            fields.append((item.name, kind, self.initial(item, kind), item.pos))
        if not fields:
            raise SclError(node.pos, "a structure without fields")
        return make_struct(name, fields)

    def initial(self, node, kind):
        """Python of the initial value, None without one."""
        if node.initial is None:
            return None
        value = Expressions().value(node.initial)
        if value.constant is None:
            raise SclError(node.initial.pos, "an initial value is a constant")
        return convert(value, kind, node.initial.pos)

    def add_udt(self, node):
        self.fresh(node)
        self.types[node.name] = self.struct(node.name, node.type)

    def fresh(self, node):
        for known in (self.types, self.dbs, self.functions, self.fbs):
            if node.name in known:
                raise SclError(node.pos, f"{node.name} exists already")

    # --- data blocks -------------------------------------------------------------------

    def number(self, node):
        match = NUMBER.match(node.name)
        number = int(match[2]) if match else self.symbols.get(node.name)
        if number is None:
            raise SclError(node.pos, f"{node.name} has no number in the symbol table")
        if any(number == other for other, _ in self.dbs.values()):
            raise SclError(node.pos, f"{node.name} is DB{number}, and so is another one")
        return number

    def add_db(self, node):
        self.fresh(node)
        number, kind = self.number(node), self.type(node.type)
        if not isinstance(kind, (Struct, Instance)):
            raise SclError(node.type.pos, "a data block is a structure or an instance")
        self.dbs[node.name] = (number, kind)
        self.emit(0, f"def init_{number}():", node.pos)
        self.emit(1, f"DB{number}[:] = bytes({kind.size})", node.pos)
        for field, code in initials(kind, Place(kind, f"DB{number}", "0", "0")):
            self.emit(1, field.store(code), node.pos)
        Body(self, DbScope(self, number, kind)).statements(node.initial, 1)

    # --- code --------------------------------------------------------------------------

    def add_code(self, node):
        self.fresh(node)
        scope = Scope(self, node)
        if node.block == "FUNCTION_BLOCK":
            self.fbs[node.name] = scope.instance
            self.sections[node.name] = scope.sections
        elif node.block == "ORGANIZATION_BLOCK":
            if not NUMBER.match(node.name) or scope.names("VAR_INPUT", "VAR_OUTPUT", "VAR"):
                raise SclError(node.pos, "an organization block has VAR_TEMP only")
            self.obs.append(node.name)
        parameters = [f"v_{name}" for name in scope.names("VAR_INPUT")]
        if node.block == "FUNCTION_BLOCK":
            parameters = ["S", "B"]
        self.emit(0, f"def f_{node.name}({', '.join(parameters)}):", node.pos)
        scope.begin()
        Body(self, scope).statements(node.body, 1)
        scope.end(node)
        if node.block == "FUNCTION":
            self.functions[node.name] = Function(
                node.name, scope.typed("VAR_INPUT"), scope.typed("VAR_OUTPUT"), scope.result)


def initials(kind, place):
    """(place, Python of the value) of all that is not zero at first."""
    for field in getattr(kind, "fields", {}).values():
        part = place.part(field.type, field.byte, field.bit)
        if field.initial is not None:
            yield part, field.initial
        yield from initials(field.type, part)


class DbScope:
    """BEGIN ... END_DATA_BLOCK sees the fields of its own block alone."""

    result_name = None

    def __init__(self, program, number, kind):
        self.place = Place(kind, f"DB{number}", "0", "0", db=number)

    def find(self, name, pos):
        field = self.place.type.fields.get(name)
        if not field:
            raise SclError(pos, f"{name} is no field of this data block")
        return self.place.part(field.type, field.byte, field.bit)


class Scope:
    """The variables of a code block. Elementary ones of a function and VAR_TEMP are Python
    variables, so that a read before the first write shows; those that a view shares, and
    large ones, lie in L, which begins with garbage as a CPU's stack does."""

    def __init__(self, program, node):
        self.program, self.node = program, node
        self.variables, self.sections = {}, {}
        self.result = program.type(node.result) if node.result else None
        if self.result is not None and not (isinstance(self.result, Basic)
                                            and self.result.format or self.result == BOOL):
            raise SclError(node.pos, f"a function of type {self.result} is not in this subset")
        self.views = {v.view for _, v in node.variables if v.view}
        self.frame, self.in_frame = Layout(), []
        fields = []
        for section, item in node.variables:
            self.declare(section, item, fields)
        self.instance = None
        if node.block == "FUNCTION_BLOCK":
            self.instance = Instance(node.name, make_struct(node.name, fields))
            for field in self.instance.fields.values():
                place = Place(field.type, "S", f"B + {field.byte}", str(field.bit))
                self.variables[field.name] = place

    def declare(self, section, item, fields):
        name, kind = item.name, self.program.type(item.type)
        if name in self.variables or any(name == f[0] for f in fields):
            raise SclError(item.pos, f"{name} is declared twice")
        if section == "VAR_IN_OUT":
            raise SclError(item.pos, "VAR_IN_OUT is not in this subset")
        static = self.node.block == "FUNCTION_BLOCK" and section != "VAR_TEMP"
        if section == "VAR" and not static:
            raise SclError(item.pos, "VAR is for function blocks; here it is VAR_TEMP")
        self.sections[name] = section
        initial = self.program.initial(item, kind)
        if initial is not None and not static:
            raise SclError(item.pos, f"{section} here has no initial value")
        if item.view:
            self.variables[name] = self.view(item, kind, section)
        elif static:
            fields.append((name, kind, initial, item.pos))
        elif isinstance(kind, Instance):
            raise SclError(item.pos, f"an instance of {kind} belongs into VAR")
        elif name not in self.views and isinstance(kind, Basic) and kind not in (REAL, ANY):
            self.variables[name] = Place(kind, local=f"v_{name}",
                                         writable=section != "VAR_INPUT")
        else:
            byte, bit = self.frame.place(kind)
            self.in_frame.append((name, section))
            self.variables[name] = Place(kind, "L", str(byte), str(bit),
                                         writable=section != "VAR_INPUT")

    def view(self, item, kind, section):
        place = self.variables.get(item.view)
        if not place or self.sections[item.view] != section:
            raise SclError(item.pos, f"AT {item.view}: not declared before in this section")
        if kind != BOOL and kind.size > place.type.size:
            raise SclError(item.pos, f"{kind} is longer than {item.view}")
        return Place(kind, place.memory, place.byte, "0")

    def names(self, *sections):
        return [name for name, section in self.sections.items() if section in sections]

    def typed(self, section):
        return [(name, self.variables[name].type) for name in self.names(section)]

    def begin(self):
        emit, pos = self.program.emit, self.node.pos
        emit(1, "pass", pos)
        if self.in_frame:
            emit(1, f"L = bytearray(b'\\xa5' * {self.frame.end()})", pos)
        for name, section in self.in_frame:
            if section == "VAR_INPUT":
                emit(1, self.variables[name].store(f"v_{name}"), pos)

    def end(self, node):
        self.program.emit(1, self.return_code(), node.pos)

    def return_code(self):
        outputs = [self.variables[name].load() for name in self.names("VAR_OUTPUT")]
        if self.node.block != "FUNCTION":
            return "return"
        result = ["r_result"] if self.result is not None else ["None"]
        return f"return ({', '.join(result + outputs)},)" if outputs else f"return {result[0]}"

    def find(self, name, pos):
        if name == self.node.name and self.result is not None:
            return Place(self.result, local="r_result")
        return self.variables.get(name)


class Body(Expressions):
    def __init__(self, program, scope):
        self.program, self.scope = program, scope
        self.loops = []         # of each loop: its variable, and what CONTINUE does first
        self.level = 1

    def local(self, name, pos):
        return self.scope.find(name, pos)

    def db(self, name):
        known = self.program.dbs.get(name)
        match = NUMBER.match(name)
        if known:
            return Place(known[1], f"DB{known[0]}", "0", "0", db=known[0])
        if match and match[1] == "DB":
            for number, kind in self.program.dbs.values():
                if number == int(match[2]):
                    return Place(kind, f"DB{number}", "0", "0", db=number)
            # The plant's: it is there when the program runs, or the CPU stops
            return Place(Struct(name), f"_db({int(match[2])})", "0", "0", db=int(match[2]))
        return None

    # --- statements --------------------------------------------------------------------

    def emit(self, code, pos):
        self.program.emit(self.level, code, pos)

    def statements(self, nodes, level):
        before, self.level = self.level, level
        for node in nodes:
            getattr(self, "do_" + node.kind)(node)
        if not nodes:
            self.emit("pass", None)
        self.level = before

    def block(self, nodes):
        self.statements(nodes, self.level + 1)

    def do_set(self, node):
        place = self.target(node.target)
        value = self.outcome(node.value)
        self.emit(place.store(convert(value, place.type, node.pos)), node.pos)

    def outcome(self, node):
        """The right side of an assignment. Here a call may have outputs too."""
        if node.kind != "call" or node.what.kind != "name" or not (
                self.named(node.what.name) and self.named(node.what.name).outputs):
            return self.value(node)
        function = self.function(node)
        if function.result is None:
            raise SclError(node.pos, f"{function.name} returns nothing")
        self.run(node, function)
        return Value(function.result, "r_call[0]")

    def target(self, node):
        place = self.place(node)
        if isinstance(place, Value) or isinstance(place.type, Instance):
            raise SclError(node.pos, "nothing can be assigned to that")
        if not place.writable:
            raise SclError(node.pos, "an input is not written")
        if node.kind == "name" and any(node.name == name for name, _ in self.loops):
            raise SclError(node.pos, f"{node.name} counts this loop: it is not written")
        return place

    def condition(self, node):
        value = self.value(node)
        if value.type != BOOL:
            raise SclError(node.pos, f"a condition is BOOL, not {value.type}")
        return value.code

    def do_if(self, node):
        for number, (condition, body) in enumerate(node.branches):
            self.emit(f"{'elif' if number else 'if'} {self.condition(condition)}:",
                      condition.pos)
            self.block(body)
        if node.other:
            self.emit("else:", node.pos)
            self.block(node.other)

    def do_case(self, node):
        value = self.value(node.value)
        if value.type != INT:
            raise SclError(node.pos, f"CASE of {value.type}; allowed: INT")
        seen = {}
        self.emit(f"t_{self.level} = {value.code}", node.pos)
        for number, (labels, body) in enumerate(node.branches):
            tests = []
            for low, high, pos in labels:
                if any(low <= b and a <= high for a, b in seen):
                    raise SclError(pos, f"{low} is there already")
                seen[low, high] = True
                tests.append(f"{low} <= t_{self.level} <= {high}")
            self.emit(f"{'elif' if number else 'if'} {' or '.join(tests)}:", node.pos)
            self.block(body)
        if node.other is not None:
            self.emit("else:" if node.branches else "if True:", node.pos)
            self.block(node.other)

    def do_for(self, node):
        place = self.target(node.variable)
        if place.type not in (INT, DINT) or node.variable.kind != "name":
            raise SclError(node.pos, "a loop counts in a variable of type INT or DINT")
        last = f"e_{self.level}"
        first = convert(self.value(node.first), place.type, node.first.pos)
        self.emit(f"{last} = {convert(self.value(node.last), place.type, node.last.pos)}",
                  node.pos)
        self.emit(place.store(first), node.pos)
        self.emit(f"while {place.load()} {'<=' if node.step > 0 else '>='} {last}:", node.pos)
        again = place.store(f"{place.load()} + {node.step}")
        self.loops.append((node.variable.name, again))
        self.block(node.body)
        self.loops.pop()
        self.program.emit(self.level + 1, again, node.pos)

    def do_while(self, node):
        self.emit(f"while {self.condition(node.condition)}:", node.pos)
        self.loops.append((None, None))
        self.block(node.body)
        self.loops.pop()

    def do_repeat(self, node):
        self.emit("while True:", node.pos)
        self.loops.append((None, f"if {self.condition(node.condition)}: break"))
        self.block(node.body)
        self.loops.pop()
        self.program.emit(self.level + 1, f"if {self.condition(node.condition)}: break",
                          node.pos)

    def do_exit(self, node):
        self.in_loop(node)
        self.emit("break", node.pos)

    def do_continue(self, node):
        self.in_loop(node)
        if self.loops[-1][1]:
            self.emit(self.loops[-1][1], node.pos)
        self.emit("continue", node.pos)

    def in_loop(self, node):
        if not self.loops:
            raise SclError(node.pos, f"{node.kind.upper()} outside of a loop")

    def do_return(self, node):
        self.emit(self.scope.return_code(), node.pos)

    # --- calls -------------------------------------------------------------------------

    def do_do(self, node):
        call = node.call
        if call.what.kind == "field":
            return self.call_block(call, self.instance_of(call))
        place = self.scope.find(call.what.name, call.pos)
        if place and isinstance(place.type, Instance):
            return self.call_block(call, place)
        function = self.function(call)
        if function.result is not None:
            raise SclError(call.pos, f"the value of {function.name} must go somewhere")
        return self.run(call, function)

    def run(self, call, function):
        codes, stores = self.parameters(call, function)
        if not stores:
            return self.emit(self.invoke(function, codes), call.pos)
        self.emit(f"r_call = {self.invoke(function, codes)}", call.pos)
        for number, (place, kind) in enumerate(stores):
            value = Value(kind, f"r_call[{number + 1}]")
            self.emit(place.store(convert(value, place.type, call.pos)), call.pos)
        return None

    def call(self, node):
        """A function in an expression."""
        if node.what.kind != "name":
            raise SclError(node.pos, "a function block has no value")
        function = self.function(node)
        if function.result is None:
            raise SclError(node.pos, f"{function.name} returns nothing")
        codes, stores = self.parameters(node, function)
        if stores:
            raise SclError(node.pos, f"{function.name} has outputs: in this subset such a call "
                           "stands alone behind :=")
        return Value(function.result, self.invoke(function, codes))

    def function(self, node):
        name = node.what.name
        known = self.named(name)
        if not known:
            raise SclError(node.pos, f"{name} is not declared before")
        return known

    def named(self, name):
        return self.program.functions.get(name) or blocks.SYSTEM.get(name)

    def invoke(self, function, codes):
        if isinstance(function, blocks.System):
            return f"_system({', '.join([repr(function.name)] + codes)})"
        return f"f_{function.name}({', '.join(codes)})"

    def parameters(self, node, function):
        """Python of the inputs; places and types of the outputs. All must be given."""
        given = self.given(node, function.inputs + function.outputs)
        codes = [self.input(given, name, kind, node) for name, kind in function.inputs]
        stores = []
        for name, kind in function.outputs:
            if name not in given:
                raise SclError(node.pos, f"{function.name}: {name} is missing")
            stores.append((self.target(given.pop(name)), kind))
        return codes, stores

    def given(self, node, formal):
        names, given = [name for name, _ in formal], {}
        for name, value, pos in node.arguments:
            if name is None:
                if len(names) != 1:
                    raise SclError(pos, "more than one parameter: each with its name")
                name = names[0]
            if name not in names:
                raise SclError(pos, f"there is no parameter {name}; allowed: {', '.join(names)}")
            if name in given:
                raise SclError(pos, f"{name} is given twice")
            given[name] = value
        return given

    def input(self, given, name, kind, node):
        if name not in given:
            raise SclError(node.pos, f"{name} is missing")
        value = given.pop(name)
        if kind == ANY:
            return self.any(value)
        return convert(self.value(value), kind, value.pos, f"given for {name}")

    def any(self, node):
        """An ANY pointer to what the node names."""
        if node.kind == "name" and not self.local(node.name, node.pos) and self.db(node.name):
            raise SclError(node.pos, f"{node.name} is a block, not what is in it: name a part")
        if node.kind in ("pointer", "number", "literal", "bool"):
            return self.value(node).code if node.kind == "pointer" else self.no_any(node)
        place = self.place(node)
        if isinstance(place, Value) or place.type == BOOL:
            return self.no_any(node)
        if place.type == ANY:
            return place.load()
        if place.db is None:
            raise SclError(node.pos, "ANY of local data is not in this subset")
        return f"_any({place.db}, {place.byte}, {place.type.size})"

    def no_any(self, node):
        raise SclError(node.pos, "ANY wants a variable")

    def instance_of(self, call):
        """FB.DB( ... )"""
        block, db = call.what.of, self.program.dbs.get(call.what.name)
        known = self.program.fbs.get(block.name) if block.kind == "name" else None
        if not known or not db or db[1] is not known:
            raise SclError(call.pos, "a function block is called with its instance: FB.DB( )")
        return Place(known, f"DB{db[0]}", "0", "0", db=db[0])

    def call_block(self, node, place):
        fields = [(f.name, f.type) for f in place.type.fields.values()]
        inputs = self.program_inputs(place.type, fields)
        given = self.given(node, inputs)
        for name, kind in inputs:
            if name in given:
                field = place.type.fields[name]
                code = self.input(given, name, kind, node)
                self.emit(place.part(kind, field.byte, field.bit).store(code), node.pos)
        if place.type.name in blocks.STANDARD:
            self.emit(f"_timer({place.type.name!r}, {place.memory}, {place.byte})", node.pos)
        else:
            self.emit(f"f_{place.type.name}({place.memory}, {place.byte})", node.pos)

    def program_inputs(self, kind, fields):
        if kind.name in blocks.STANDARD:
            return fields[:blocks.STANDARD[kind.name][1]]
        sections = self.program.sections[kind.name]
        return [(name, kind) for name, kind in fields if sections.get(name) == "VAR_INPUT"]
