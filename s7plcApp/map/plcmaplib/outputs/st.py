"""Structured Text for CODESYS, TwinCAT and Phoenix Contact PLCs: both blocks are arrays of bytes,
and every value is moved byte by byte, so that no controller's own packing matters."""
from ..transfer import layout_id, transfers
from ..types import Array, Elementary, Text

HEAD = """%s
// Structured Text (CODESYS, TwinCAT 3, PLCnext). IE_TX and IE_RX are the blocks to and from the
// IOC; PACK_TX and UNPACK_RX move the values, byte by byte. Call PACK_TX before a block is sent,
// UNPACK_RX when one has come%s.
// PC WORX: replace the bodies of REAL_BITS, BITS_REAL, LREAL_BITS and BITS_LREAL, which use a
// UNION here, by its blocks REAL_TO_BUF and BUF_TO_REAL.
"""

HELPERS = """
TYPE U_REAL : UNION
    v : REAL;
    b : DWORD;
END_UNION
END_TYPE

TYPE U_LREAL : UNION
    v : LREAL;
    b : LWORD;
END_UNION
END_TYPE

FUNCTION REAL_BITS : DWORD
VAR_INPUT v : REAL; END_VAR
VAR u : U_REAL; END_VAR
u.v := v;
REAL_BITS := u.b;
END_FUNCTION

FUNCTION BITS_REAL : REAL
VAR_INPUT b : DWORD; END_VAR
VAR u : U_REAL; END_VAR
u.b := b;
BITS_REAL := u.v;
END_FUNCTION

FUNCTION LREAL_BITS : LWORD
VAR_INPUT v : LREAL; END_VAR
VAR u : U_LREAL; END_VAR
u.v := v;
LREAL_BITS := u.b;
END_FUNCTION

FUNCTION BITS_LREAL : LREAL
VAR_INPUT b : LWORD; END_VAR
VAR u : U_LREAL; END_VAR
u.b := b;
BITS_LREAL := u.v;
END_FUNCTION
"""

WIDE = {1: "BYTE", 2: "WORD", 4: "DWORD", 8: "LWORD"}


def _shift(size, i, big):
    """Bits to shift so that byte i of a value is the lowest."""
    return 8 * (size - 1 - i if big else i)


def _bits(kind, value):
    """A value as BYTE, WORD, DWORD or LWORD with the same bits."""
    if kind.kind in ("bits", "bool"):
        return value
    if kind.kind == "real":
        return "%s_BITS(%s)" % (kind.name, value)
    return "%s_TO_%s(%s)" % (kind.name, WIDE[kind.size], value)


def _value(kind, bits):
    if kind.kind in ("bits", "bool"):
        return bits
    if kind.kind == "real":
        return "BITS_%s(%s)" % (kind.name, bits)
    return "%s_TO_%s(%s)" % (WIDE[kind.size], kind.name, bits)


def _put(kind, value, at, big):
    """Statements that put a value at byte `at` (a text) of IE_TX."""
    wide = WIDE[kind.size]
    if kind.size == 1:
        return ["IE_TX[%s] := %s;" % (at, _bits(kind, value))]
    lines = ["b%s := %s;" % (wide, _bits(kind, value))]
    for i in range(kind.size):
        lines.append("IE_TX[%s] := %s_TO_BYTE(SHR(b%s, %d) AND %s#16#FF);" % (
            _plus(at, i), wide, wide, _shift(kind.size, i, big), wide))
    return lines


def _get(kind, target, at, big):
    """Statements that take a value from IE_RX."""
    wide = WIDE[kind.size]
    if kind.size == 1:
        return ["%s := %s;" % (target, _value(kind, "IE_RX[%s]" % at))]
    parts = ["SHL(BYTE_TO_%s(IE_RX[%s]), %d)" % (wide, _plus(at, i), _shift(kind.size, i, big))
             for i in range(kind.size)]
    return ["b%s := %s;" % (wide, " OR ".join(parts)), "%s := %s;" % (
        target, _value(kind, "b" + wide))]


def _plus(at, i):
    return str(int(at) + i) if at.isdigit() else "%s + %d" % (at, i) if i else at


def name_of(leaf):
    """The variable of the PLC: what column plc says, else the symbol."""
    if leaf.address is not None:
        return leaf.address.symbol or "%" + leaf.address.text(leaf.size(), leaf.address.bit)
    return leaf.symbol


def _move(map_, leaf, side):
    """All statements of a leaf."""
    big = map_.plc["byteorder"] == "big"
    name, kind = name_of(leaf), leaf.type
    byte, bit = getattr(leaf, side)
    block = "IE_TX" if side == "tx" else "IE_RX"
    one = _put if side == "tx" else _get
    if leaf.is_bit():
        return ["%s[%d].%d := %s;" % (block, byte, bit, name)] if side == "tx" else \
            ["%s := %s[%d].%d;" % (name, block, byte, bit)]
    if isinstance(kind, Text):
        return _text(name, kind, byte, side)
    if isinstance(kind, Array):
        if len(kind.bounds) > 1:
            return ["// %s: an array of several dimensions: by hand" % leaf.symbol]
        low, high = kind.bounds[0]
        size = kind.element.size
        at = "%d + (i - %d) * %d" % (byte, low, size) if low else "%d + i * %d" % (byte, size)
        element = Elementary("BYTE", 1, "bits") if kind.element.kind == "char" else kind.element
        return ["FOR i := %d TO %d DO" % (low, high)] + [
            "    " + l for l in one(element, name + "[i]", at, big)] + ["END_FOR"]
    if kind.kind in ("time", "raw"):
        return ["// %s (%s): %d bytes at %d, by hand" % (leaf.symbol, kind, kind.size, byte)]
    return one(kind, name, str(byte), big)


def _text(name, kind, byte, side):
    """A STRING(n): n characters and a NUL."""
    if side == "tx":
        return ["n := LEN(%s);" % name, "FOR i := 0 TO %d DO" % kind.length,
                "    IF i < n THEN IE_TX[%d + i] := %s[i]; ELSE IE_TX[%d + i] := 0; END_IF"
                % (byte, name, byte), "END_FOR"]
    return ["FOR i := 0 TO %d DO" % (kind.length - 1), "    %s[i] := IE_RX[%d + i];" % (name, byte),
            "END_FOR", "%s[%d] := 0;" % (name, kind.length)]


def _program(name, lines):
    used = [w for w in ("BYTE", "WORD", "DWORD", "LWORD") if any("b%s " % w in l for l in lines)]
    declared = "".join("    b%s : %s;\n" % (w, w) for w in used)
    if any("FOR i" in l for l in lines):
        declared += "    i : INT;\n"
    if any(l.startswith("n := ") for l in lines):
        declared += "    n : INT;\n"
    return "\nPROGRAM %s\nVAR\n%sEND_VAR\n%s\nEND_PROGRAM\n" % (
        name, declared, "\n".join(lines or [";"]))


def _compare(map_, leaves):
    """CHECKSYNC: unpacked values are compared by packing what the PLC holds."""
    lines = ["CHECKSYNC := TRUE;"]
    for leaf in leaves:
        if leaf.dir != "out":
            continue
        byte, bit = leaf.rx
        back, back_bit = leaf.tx
        if leaf.is_bit():
            lines.append("IF BLOCK[%d].%d <> IE_TX[%d].%d THEN CHECKSYNC := FALSE; END_IF"
                         % (byte, bit, back, back_bit))
        else:
            lines.append("FOR i := 0 TO %d DO IF BLOCK[%d + i] <> IE_TX[%d + i] THEN CHECKSYNC := "
                         "FALSE; END_IF END_FOR" % (leaf.size() - 1, byte, back))
    return lines


def program(map_, head, crc):
    tx = [l for l in map_.leaves() if l.tx is not None]
    rx = [l for l in map_.leaves() if l.rx is not None]
    sizes = map_.block_size("tx"), map_.block_size("rx")
    sync = map_.on("sync")
    text = HEAD % (head, ", in the order of docs/plc-programming.md" if sync else "")
    lines = ["    LAYOUT_ID : WORD := 16#%04X;" % layout_id(crc)]
    for name, size in (("IE_TX", sizes[0]), ("IE_RX", sizes[1])):
        if size:
            lines.append("    %s : ARRAY[0..%d] OF BYTE;" % (name, size - 1))
    if sync and sizes[1]:
        lines.append("    IE_ACC : ARRAY[0..%d] OF BYTE;" % (sizes[1] - 1))
    text += "\nVAR_GLOBAL\n%s\nEND_VAR\n" % "\n".join(lines) + HELPERS
    body = []
    for leaf in tx:
        body += ["// %s" % leaf.symbol] + _move(map_, leaf, "tx")
    at = map_.number("layout_at")
    if at is not None:
        body += _put(Elementary("WORD", 2, "bits"), "LAYOUT_ID", str(at),
                     map_.plc["byteorder"] == "big")
    text += _program("PACK_TX", body)
    body = []
    for leaf in rx:
        body += ["// %s" % leaf.symbol] + _move(map_, leaf, "rx")
    if sizes[1]:
        text += _program("UNPACK_RX", body)
    if sync and sizes[1]:
        text += "\n// PACK_TX must have run: it has what the PLC holds\nFUNCTION CHECKSYNC : BOOL\n" \
            "VAR_INPUT BLOCK : ARRAY[0..%d] OF BYTE; END_VAR\nVAR i : INT; END_VAR\n%s\n" \
            "END_FUNCTION\n" % (sizes[1] - 1, "\n".join(_compare(map_, rx)))
    return text


__all__ = ["program", "transfers"]
