"""Text of SCL to a tree. Every node has `pos`, the line and column where it begins.

Knows the grammar and nothing of types: a name is a name.
"""
import re


class SclError(Exception):
    """What the compiler or the CPU says: where, and what is wrong."""

    def __init__(self, pos, text):
        self.pos = pos
        super().__init__(f"line {pos[0]}:{pos[1]}: {text}" if pos else text)


class Node:
    """kind, pos, and whatever the kind has."""

    def __init__(self, kind, pos, **fields):
        self.kind, self.pos = kind, pos
        self.__dict__.update(fields)

    def __repr__(self):
        rest = ", ".join(f"{k}={v!r}" for k, v in self.__dict__.items() if k not in ("kind", "pos"))
        return f"{self.kind}({rest})"


TOKEN = re.compile(r"""
    (?P<space>\s+|//[^\n]*|\(\*.*?\*\))
  | (?P<pointer>P\#\S+(?:[ ]+[A-Z]+[ ]+\d+)?)
  | (?P<literal>(?:[A-Za-z][A-Za-z0-9]*|\d+)\#[0-9A-Za-z_.+\-#]*[0-9A-Za-z])
  | (?P<number>\d+\.\d+(?:[eE][+-]?\d+)?|\d[\d_]*)
  | (?P<string>'(?:[^'$\n]|\$.)*')
  | (?P<name>"[^"\n]+"|\#?[A-Za-z_]\w*)
  | (?P<op>:=|=>|\.\.|<>|<=|>=|\*\*|[-+*/=<>()\[\],;:.&])
""", re.X | re.S)

KEYWORDS = set("""
    AND ANY ARRAY AT BEGIN BLOCK_DB BOOL BY BYTE CASE CHAR CONST CONTINUE DATA_BLOCK DATE
    DATE_AND_TIME DINT DIV DO DT DWORD ELSE ELSIF END_CASE END_CONST END_DATA_BLOCK END_FOR
    END_FUNCTION END_FUNCTION_BLOCK END_IF END_ORGANIZATION_BLOCK END_REPEAT END_STRUCT
    END_TYPE END_VAR END_WHILE EXIT FALSE FOR FUNCTION FUNCTION_BLOCK GOTO IF INT LABEL MOD
    NIL NOT OF OK OR ORGANIZATION_BLOCK POINTER REAL REPEAT RETURN S5TIME STRING STRUCT THEN
    TIME TIMER TO TOD TRUE TYPE UNTIL VAR VAR_INPUT VAR_IN_OUT VAR_OUTPUT VAR_TEMP VOID WHILE
    WORD XOR EN ENO
""".split())

LEVELS = (("OR",), ("XOR",), ("AND", "&"), ("=", "<>"), ("<", ">", "<=", ">="), ("+", "-"),
          ("*", "/", "MOD", "DIV"))

SECTIONS = ("VAR_INPUT", "VAR_OUTPUT", "VAR_IN_OUT", "VAR_TEMP", "VAR")


class Parser:
    def __init__(self, text):
        self.tokens = list(tokens(text))
        self.index = 0

    # --- tokens ------------------------------------------------------------------------

    @property
    def here(self):
        return self.tokens[self.index]

    @property
    def pos(self):
        return self.here[2]

    def word(self, ahead=0):
        """The token, in capitals where case does not matter."""
        kind, text, _ = self.tokens[min(self.index + ahead, len(self.tokens) - 1)]
        return text.upper() if kind in ("name", "op") else ""

    def fail(self, text):
        found = self.here[1] or "the end of the text"
        raise SclError(self.pos, f"{text}, found {found}")

    def next(self):
        token = self.here
        self.index += 1
        return token

    def expect(self, word):
        if self.word() != word:
            self.fail(f"{word} expected")
        return self.next()

    def option(self, word):
        if self.word() != word:
            return False
        self.next()
        return True

    def name(self):
        kind, text, pos = self.here
        if kind != "name":
            self.fail("a name expected")
        if text[0] != '"' and text.strip("#").upper() in KEYWORDS:
            self.fail("a name expected, not a keyword")
        self.next()
        bare = text.strip('"#')
        if len(bare) > 24:
            raise SclError(pos, f"{bare} has {len(bare)} characters; allowed: 24")
        if "__" in bare or (len(bare) > 1 and bare.endswith("_")):
            raise SclError(pos, f"{bare}: an underscore stands between two characters")
        return bare.upper()

    def integer(self):
        sign = -1 if self.option("-") else 1
        kind, text, pos = self.next()
        if kind != "number" or "." in text:
            raise SclError(pos, f"a whole number expected, found {text}")
        return sign * int(text.replace("_", ""))

    # --- declarations ------------------------------------------------------------------

    def type(self):
        pos = self.pos
        if self.option("STRUCT"):
            fields = []
            while not self.option("END_STRUCT"):
                fields += self.declaration()
            return Node("struct", pos, fields=fields)
        if self.option("ARRAY"):
            return self.array(pos)
        word = self.word()
        if word in KEYWORDS:
            self.next()
            size = None
            if word == "STRING":
                size = 254
                if self.option("["):
                    size = self.integer()
                    self.expect("]")
            return Node("basic", pos, name=word, size=size)
        return Node("named", pos, name=self.name())

    def array(self, pos):
        self.expect("[")
        bounds = []
        while True:
            low = self.integer()
            self.expect("..")
            bounds.append((low, self.integer()))
            if not self.option(","):
                break
        self.expect("]")
        self.expect("OF")
        return Node("array", pos, bounds=bounds, of=self.type())

    def declaration(self):
        """One line of a structure or a section: as many variables as it names."""
        names = [(self.name(), self.tokens[self.index - 1][2])]
        while self.option(","):
            names.append((self.name(), self.tokens[self.index - 1][2]))
        view = self.name() if self.option("AT") else None
        self.expect(":")
        kind = self.type()
        initial = self.expression() if self.option(":=") else None
        if not self.option(";") and self.tokens[self.index - 1][1].upper() != "END_STRUCT":
            self.fail("; expected")
        return [Node("variable", pos, name=name, type=kind, view=view, initial=initial)
                for name, pos in names]

    def program(self):
        blocks = []
        while self.here[0] != "end":
            pos, word = self.pos, self.word()
            if word == "TYPE":
                blocks.append(self.udt(pos))
            elif word == "DATA_BLOCK":
                blocks.append(self.data_block(pos))
            elif word in ("FUNCTION", "FUNCTION_BLOCK", "ORGANIZATION_BLOCK"):
                blocks.append(self.code_block(pos, word))
            else:
                self.fail("TYPE, DATA_BLOCK, FUNCTION, FUNCTION_BLOCK or ORGANIZATION_BLOCK "
                          "expected")
            self.option(";")
        return blocks

    def udt(self, pos):
        self.next()
        name = self.name()
        kind = self.type()
        self.option(";")
        self.expect("END_TYPE")
        return Node("udt", pos, name=name, type=kind)

    def data_block(self, pos):
        self.next()
        name = self.name()
        kind = self.type()
        self.option(";")
        self.expect("BEGIN")
        initial = self.statements(("END_DATA_BLOCK",))
        self.next()
        return Node("db", pos, name=name, type=kind, initial=initial)

    def code_block(self, pos, word):
        self.next()
        name = self.name()
        result = None
        if word == "FUNCTION":
            self.expect(":")
            if not self.option("VOID"):
                result = self.type()
        sections = []
        while self.word() in SECTIONS:
            section = self.next()[1].upper()
            while not self.option("END_VAR"):
                sections += [(section, variable) for variable in self.declaration()]
            self.option(";")
        self.expect("BEGIN")
        body = self.statements((f"END_{word}",))
        self.next()
        return Node("code", pos, block=word, name=name, result=result, variables=sections,
                    body=body)

    # --- statements --------------------------------------------------------------------

    def statements(self, ends):
        body = []
        while self.word() not in ends:
            if self.here[0] == "end":
                self.fail(f"{' or '.join(ends)} expected")
            if self.option(";"):
                continue
            body.append(self.statement())
            self.expect(";")
        return body

    def statement(self):
        pos, word = self.pos, self.word()
        method = {"IF": self.if_, "FOR": self.for_, "WHILE": self.while_,
                  "REPEAT": self.repeat, "CASE": self.case}.get(word)
        if method:
            self.next()
            return method(pos)
        if word in ("EXIT", "CONTINUE", "RETURN"):
            self.next()
            return Node(word.lower(), pos)
        target = self.primary()
        if target.kind == "call":
            return Node("do", pos, call=target)
        self.expect(":=")
        return Node("set", pos, target=target, value=self.expression())

    def if_(self, pos):
        branches = [(self.condition("THEN"), self.statements(("ELSIF", "ELSE", "END_IF")))]
        while self.option("ELSIF"):
            branches.append((self.condition("THEN"),
                             self.statements(("ELSIF", "ELSE", "END_IF"))))
        other = self.statements(("END_IF",)) if self.option("ELSE") else []
        self.expect("END_IF")
        return Node("if", pos, branches=branches, other=other)

    def condition(self, end):
        value = self.expression()
        self.expect(end)
        return value

    def for_(self, pos):
        variable = self.primary()
        self.expect(":=")
        first = self.expression()
        self.expect("TO")
        last = self.expression()
        step = self.integer() if self.option("BY") else 1
        self.expect("DO")
        body = self.statements(("END_FOR",))
        self.next()
        return Node("for", pos, variable=variable, first=first, last=last, step=step, body=body)

    def while_(self, pos):
        value = self.condition("DO")
        body = self.statements(("END_WHILE",))
        self.next()
        return Node("while", pos, condition=value, body=body)

    def repeat(self, pos):
        body = self.statements(("UNTIL",))
        self.next()
        value = self.condition("END_REPEAT")
        return Node("repeat", pos, condition=value, body=body)

    def case(self, pos):
        value = self.condition("OF")
        branches, other = [], None
        while self.word() not in ("ELSE", "END_CASE"):
            labels = [self.label()]
            while self.option(","):
                labels.append(self.label())
            self.expect(":")
            branches.append((labels, self.case_body()))
        if self.option("ELSE"):
            self.option(":")
            other = self.statements(("END_CASE",))
        self.expect("END_CASE")
        return Node("case", pos, value=value, branches=branches, other=other)

    def label(self):
        pos, first = self.pos, self.integer()
        return (first, self.integer() if self.option("..") else first, pos)

    def case_body(self):
        body = []
        while self.word() not in ("ELSE", "END_CASE") and self.here[0] != "number":
            if not self.option(";"):
                body.append(self.statement())
                self.expect(";")
        return body

    # --- expressions -------------------------------------------------------------------

    def expression(self, level=0):
        if level == len(LEVELS):
            return self.unary()
        left = self.expression(level + 1)
        while self.word() in LEVELS[level]:
            _, operator, pos = self.next()
            right = self.expression(level + 1)
            left = Node("binary", pos, operator=operator.upper().replace("&", "AND"),
                        left=left, right=right)
        return left

    def unary(self):
        if self.word() in ("NOT", "-", "+"):
            _, operator, pos = self.next()
            return Node("unary", pos, operator=operator.upper(), value=self.unary())
        return self.primary()

    def primary(self):
        kind, text, pos = self.here
        if self.option("("):
            value = self.expression()
            self.expect(")")
            return value
        if kind in ("number", "literal", "string", "pointer"):
            self.next()
            return Node(kind, pos, text=text)
        if self.word() in ("TRUE", "FALSE"):
            self.next()
            return Node("bool", pos, value=text.upper() == "TRUE")
        node = Node("name", pos, name=self.name())
        return self.suffixes(node)

    def suffixes(self, node):
        while True:
            pos = self.pos
            if self.word() == "(" and node.kind in ("name", "field"):
                node = Node("call", node.pos, what=node, arguments=self.arguments())
            elif self.option("."):
                kind, text, _ = self.here
                if kind == "number":
                    node = Node("bit", pos, of=node, bit=self.integer())
                else:
                    node = Node("field", pos, of=node, name=self.name())
            elif self.option("["):
                index = [self.expression()]
                while self.option(","):
                    index.append(self.expression())
                self.expect("]")
                node = Node("index", pos, of=node, index=index)
            else:
                return node

    def arguments(self):
        self.expect("(")
        arguments = []
        while not self.option(")"):
            pos, name = self.pos, None
            if self.word(1) in (":=", "=>"):
                name = self.name()
                self.next()
            arguments.append((name, self.expression(), pos))
            if self.word() != ")":
                self.expect(",")
        return arguments


def tokens(text):
    index, line, begin = 0, 1, 0
    while index < len(text):
        pos = (line, index - begin + 1)
        match = TOKEN.match(text, index)
        if not match:
            raise SclError(pos, f"what is {text[index]!r}?")
        if match.lastgroup != "space":
            yield match.lastgroup, match.group(), pos
        newlines = match.group().count("\n")
        if newlines:
            line += newlines
            begin = match.start() + match.group().rindex("\n") + 1
        index = match.end()
    yield "end", "", (line, index - begin + 1)


def parse(text):
    return Parser(text).program()
