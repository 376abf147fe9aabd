"""STEP 7 classic SCL for S7-300/400: the blocks, the pointer tables, explicit transfers, and the
four functions PACK_TX_DB, UNPACK_RX_DB, CHECKSYNC and IE_COMMS, as docs/plc-programming.md
explains them."""
from string import Template

from ..transfer import layout_id, transfers
from ..types import Elementary

LONG = 240  # bytes that AG_SEND takes; longer blocks need AG_LSEND
LETTERS = {1: "B", 2: "W", 4: "D"}
TO_BITS = {"INT": "INT_TO_WORD", "DINT": "DINT_TO_DWORD", "REAL": "REAL_TO_DWORD",
           "TIME": "TIME_TO_DWORD"}
FROM_BITS = {"INT": "WORD_TO_INT", "DINT": "DWORD_TO_DINT", "REAL": "DWORD_TO_REAL",
             "TIME": "DWORD_TO_TIME"}

HEAD = Template("""$head
// STEP 7 classic SCL. Give these symbols their numbers: IE_TX DB$tx_db, IE_RX DB$rx_db,
// DB_TX_PTRS DB$tx_ptrs, DB_RX_PTRS DB$rx_ptrs, IE_ACC DB$acc_db, IE_HELD DB$held_db. Call IE_COMMS
// in each cycle.

TYPE AnyPoint                       // the fields of an ANY pointer
STRUCT
    SyntaxID   : BYTE;              // B#16#10, 0 = end of the table
    DataType   : BYTE;              // B#16#02 = BYTE
    Count      : INT;               // bytes
    DBNumber   : INT;
    BitPointer : DWORD;             // area in the first byte, then the bit address
END_STRUCT
END_TYPE
""")

PACK = Template("""
FUNCTION $name : INT           // $what. Returns BLKMOV's last error, 0 = none
VAR_TEMP
    SRC : AnyPoint;  ANY_SRC AT SRC : ANY;
    DST : AnyPoint;  ANY_DST AT DST : ANY;
    I   : INT;  ERR : INT;  LAST : INT;
END_VAR
BEGIN
    LAST := 0;
    FOR I := 0 TO $last DO
        SRC := $table.P[I].SRC;
        DST := $table.P[I].DST;
        IF SRC.SyntaxID = B#16#00 THEN EXIT; END_IF;
        ERR := BLKMOV(SRCBLK := ANY_SRC, DSTBLK := ANY_DST);
        IF ERR <> 0 THEN LAST := ERR; END_IF;
    END_FOR;
$explicit    $name := LAST;
END_FUNCTION
""")

CHECK = Template("""
FUNCTION CHECKSYNC : BOOL           // every setpoint of a block equals what the PLC holds
VAR_INPUT
    BLOCK : INT;                    // number of the DB: $rx_db = IE_RX, $acc_db = IE_ACC
END_VAR
VAR_TEMP
    SRC  : AnyPoint;
    DST  : AnyPoint;  ANY_DST AT DST : ANY;
    HELD : AnyPoint;  ANY_HELD AT HELD : ANY;
    I : INT;  N : INT;  FROM : INT;  ERR : INT;  EQUAL : BOOL;
END_VAR
BEGIN
    EQUAL := TRUE;
    FOR I := 0 TO $last DO
        SRC := DB_RX_PTRS.P[I].SRC;
        DST := DB_RX_PTRS.P[I].DST;
        IF SRC.SyntaxID = B#16#00 THEN EXIT; END_IF;
        HELD := SRC;                // what the PLC holds, to the place that it has in IE_RX
        HELD.DBNumber := $held_db;
        ERR := BLKMOV(SRCBLK := ANY_DST, DSTBLK := ANY_HELD);
        IF ERR = 0 THEN             // else UNPACK_RX_DB will not move it either
            FROM := DINT_TO_INT(DWORD_TO_DINT(SHR(IN := SRC.BitPointer AND DW#16#00FFFFFF,
                                                  N := 3)));
            FOR N := FROM TO FROM + SRC.Count - 1 DO
                IF WORD_TO_BLOCK_DB(INT_TO_WORD(BLOCK)).DB[N] <> IE_HELD.DB[N] THEN
                    EQUAL := FALSE;
                END_IF;
            END_FOR;
        END_IF;
    END_FOR;
$explicit    CHECKSYNC := EQUAL;
END_FUNCTION
""")

COMMS = Template("""
FUNCTION_BLOCK IE_COMMS             // call it in each cycle (OB1, or OB35)
VAR_INPUT
    REMOTE    : BOOL;               // FALSE = LOCAL: the HMI has control
    CONNECTED : BOOL;               // the TCP connection is established
    ID        : INT;                // of the connection, from NetPro
    LADDR     : WORD;               // of the communication processor
    LAYOUT    : WORD := W#16#$layout;   // of the map; W#16#0000 = not checked
    PERIOD    : TIME := T#${period}MS;    // from block to block
    WATCHDOG  : TIME := T#${watchdog}MS;
END_VAR
VAR_OUTPUT
    SYNC     : BOOL;
    TIMEOUT  : BOOL;
    PTR_ERR  : INT;                 // of PACK_TX_DB and UNPACK_RX_DB
    RX_STAT  : WORD;
    TX_STAT  : WORD;
END_VAR
VAR
    WAS_CONNECTED : BOOL;
    RX_WATCH : TON;                 // no block from the IOC
    TX_PAUSE : TON;                 // time to send
    TX_WATCH : TON;                 // SEND does not end
    SENDING  : BOOL;
    COUNTER  : INT;
END_VAR
VAR_TEMP
    NDR : BOOL;  ERROR : BOOL;  DONE : BOOL;  GOT : INT;  ERR : INT;
    THEIRS : WORD;  OTHER : BOOL;
END_VAR
BEGIN
    // 1, 2: connection, LOCAL
    IF CONNECTED <> WAS_CONNECTED THEN SYNC := FALSE; SENDING := FALSE; END_IF;
    WAS_CONNECTED := CONNECTED;
    IF NOT REMOTE THEN SYNC := FALSE; END_IF;
$receive
    // 6: send
    TX_PAUSE(IN := NOT SENDING, PT := PERIOD);
    IF TX_PAUSE.Q AND CONNECTED THEN
$header        SENDING := TRUE;
        $send(ACT := TRUE, ID := ID, LADDR := LADDR, SEND := IE_TX.Block,
                LEN := $in_size, DONE := DONE, ERROR := ERROR, STATUS := TX_STAT);
    ELSIF SENDING THEN
        $send(ACT := FALSE, ID := ID, LADDR := LADDR, SEND := IE_TX.Block,
                LEN := $in_size, DONE := DONE, ERROR := ERROR, STATUS := TX_STAT);
        IF DONE OR ERROR THEN SENDING := FALSE; END_IF;
    END_IF;
    TX_WATCH(IN := SENDING, PT := T#10S);
    IF TX_WATCH.Q THEN SENDING := FALSE; END_IF;
END_FUNCTION_BLOCK
""")

SYNC_RECEIVE = Template("""
    // 3: SYNC stands only while the setpoints are those last accepted
    IF SYNC THEN SYNC := CHECKSYNC(BLOCK := $acc_db); END_IF;

    // 4: a block has come
    $recv(ID := ID, LADDR := LADDR, RECV := IE_RX.Block,
            NDR := NDR, ERROR := ERROR, STATUS := RX_STAT, LEN := GOT);
    RX_WATCH(IN := CONNECTED AND NOT NDR, PT := WATCHDOG);
    IF NDR THEN
        THEIRS := IE_RX.Block.Layout;
        OTHER := (LAYOUT <> W#16#0) AND (THEIRS <> W#16#0) AND (THEIRS <> LAYOUT);
        IF OTHER THEN
            SYNC := FALSE;
        ELSIF (IE_RX.Block.Flags AND B#16#01) <> B#16#00 AND REMOTE THEN
            SYNC := CHECKSYNC(BLOCK := $rx_db);
            IF SYNC THEN
                ERR := BLKMOV(SRCBLK := IE_RX.Block, DSTBLK := IE_ACC.Block);
                TIMEOUT := FALSE;
            END_IF;
        ELSIF (IE_RX.Block.Flags AND B#16#02) <> B#16#00 AND SYNC THEN
            PTR_ERR := UNPACK_RX_DB();
            ERR := BLKMOV(SRCBLK := IE_RX.Block, DSTBLK := IE_ACC.Block);
        END_IF;
    END_IF;

    // 5: the watchdog
    IF RX_WATCH.Q THEN
        SYNC := FALSE;              // log it here
        TIMEOUT := TRUE;
    END_IF;
""")

PLAIN_RECEIVE = Template("""
    // 4: a block has come
    $recv(ID := ID, LADDR := LADDR, RECV := IE_RX.Block,
            NDR := NDR, ERROR := ERROR, STATUS := RX_STAT, LEN := GOT);
    RX_WATCH(IN := CONNECTED AND NOT NDR, PT := WATCHDOG);
    IF NDR AND REMOTE THEN PTR_ERR := UNPACK_RX_DB(); END_IF;
    TIMEOUT := RX_WATCH.Q;
""")

SYNC_HEADER = """        IF SYNC THEN SYNC := CHECKSYNC(BLOCK := %d); END_IF;
        PTR_ERR := PACK_TX_DB();
        COUNTER := (COUNTER + 1) MOD 256;
        IE_TX.Block.Flags := B#16#00;
        IF SYNC    THEN IE_TX.Block.Flags := IE_TX.Block.Flags OR B#16#01; END_IF;
        IF REMOTE  THEN IE_TX.Block.Flags := IE_TX.Block.Flags OR B#16#02; END_IF;
        IF TIMEOUT THEN IE_TX.Block.Flags := IE_TX.Block.Flags OR B#16#04; END_IF;
        IE_TX.Block.Counter := INT_TO_BYTE(COUNTER);
        IE_TX.Block.Layout := LAYOUT;
"""


def _block(map_, name, side, note):
    size = map_.block_size(side)
    if not size:
        return ""
    fields, first = "", 0
    if map_.on("sync"):
        fields, first = "        Flags : BYTE;  Counter : BYTE;  Layout : WORD;\n", 4
    if size > first:
        fields += "        Data  : ARRAY [%d..%d] OF BYTE;\n" % (first, size - 1)
    return "\nDATA_BLOCK %s%s// %s\nSTRUCT\n    Block : STRUCT\n%s    END_STRUCT;\nEND_STRUCT\n" \
        "BEGIN END_DATA_BLOCK\n" % (
        name, " " * max(1, 25 - len(name)), note, fields)


def _table(map_, name, spans, side, note):
    """A pointer table: source, then destination; one more row, which ends it."""
    block = map_.number(side + "_db")
    lines = ["", "DATA_BLOCK %s               // %s" % (name, note), "STRUCT",
             "    P : ARRAY [0..%d] OF STRUCT  SRC : AnyPoint;  DST : AnyPoint;  END_STRUCT;"
             % len(spans), "END_STRUCT", "BEGIN"]
    for i, span in enumerate(spans):
        ours = (block, 0x84, span.offset)
        other = (span.memory.db, {"DB": 0x84, "M": 0x83, "I": 0x81, "Q": 0x82}[span.memory.area],
                 span.memory.byte)
        ends = (other, ours) if side == "tx" else (ours, other)
        lines.append("    // %s, %d bytes" % (", ".join(span.names[:3]) +
                                            (" ..." if len(span.names) > 3 else ""), span.length))
        for end, (db, area, byte) in zip(("SRC", "DST"), ends):
            lines.append("    P[%d].%s.SyntaxID := B#16#10;  P[%d].%s.DataType := B#16#02;"
                         % (i, end, i, end))
            lines.append("    P[%d].%s.Count := %d;  P[%d].%s.DBNumber := %d;"
                         % (i, end, span.length, i, end, db))
            lines.append("    P[%d].%s.BitPointer := DW#16#%02X%06X;" % (i, end, area, byte * 8))
    return "\n".join(lines + ["END_DATA_BLOCK", ""])


def _ours(block, e):
    """The place of an explicit transfer in a block: IE_TX.DD54, IE_TX.DX98.0"""
    if e.bit is not None:
        return "%s.DX%d.%d" % (block, e.offset, e.bit)
    return "%s.D%s%d" % (block, LETTERS[e.size], e.offset)


def _indexed(e):
    """The same of the block whose number is in BLOCK."""
    if e.bit is not None:
        return "WORD_TO_BLOCK_DB(INT_TO_WORD(BLOCK)).DX[%d, %d]" % (e.offset, e.bit)
    return "WORD_TO_BLOCK_DB(INT_TO_WORD(BLOCK)).D%s[%d]" % (LETTERS[e.size], e.offset)


def _theirs(e):
    """The place in PLC memory: DB11.DD0, M4.3, "symbol"."""
    a = e.memory
    if not a.area:
        return symbol(a.symbol)
    if a.area == "DB":
        return "DB%d.DX%d.%d" % (a.db, a.byte, a.bit) if e.bit is not None else \
            "DB%d.D%s%d" % (a.db, LETTERS[e.size], a.byte)
    return a.text(e.size)


def symbol(text):
    """In quotes, part by part."""
    if text.startswith('"'):
        return text
    first, dot, rest = text.partition(".")
    return '"%s"%s%s' % (first, dot, rest)


def _typed(e, table):
    """The conversion between a symbol's type and bits, or None."""
    kind = e.leaf.type
    if e.memory.area or not isinstance(kind, Elementary):
        return None
    return table.get(kind.name)


def explicit_lines(found, side):
    """The lines of PACK_TX_DB or UNPACK_RX_DB."""
    lines = []
    for e in found.explicit:
        if e.bit is None and e.size not in LETTERS:
            lines.append("    // %s (%s, %d bytes): by hand" % (e.leaf.symbol, e.leaf.type, e.size))
            continue
        if side == "tx":
            convert = _typed(e, TO_BITS)
            value = "%s(%s)" % (convert, _theirs(e)) if convert else _theirs(e)
            lines.append("    %s := %s;" % (_ours("IE_TX", e), value))
        else:
            convert = _typed(e, FROM_BITS)
            value = "%s(%s)" % (convert, _ours("IE_RX", e)) if convert else _ours("IE_RX", e)
            lines.append("    %s := %s;" % (_theirs(e), value))
        lines[-1] += "  // %s" % e.leaf.symbol
    lines += ["    // %s: no place in the PLC is known" % l.symbol for l in found.unmoved]
    return "".join(l + "\n" for l in lines)


def compare_lines(found):
    """The lines of CHECKSYNC."""
    lines = []
    for e in found.explicit:
        if not e.compared or (e.bit is None and e.size not in LETTERS):
            continue
        convert = _typed(e, TO_BITS)
        ours = "%s(%s)" % (convert, _theirs(e)) if convert else _theirs(e)
        lines.append("    IF %s <> %s THEN EQUAL := FALSE; END_IF;  // %s\n" % (
            _indexed(e), ours, e.leaf.symbol))
    return "".join(lines)


def program(map_, head, crc):
    tx, rx = transfers(map_, "tx"), transfers(map_, "rx")
    in_size, out_size = map_.block_size("tx"), map_.block_size("rx")
    keys = {k: map_.plc[k] for k in ("tx_db", "rx_db", "tx_ptrs", "rx_ptrs", "acc_db", "held_db", "period",
                                     "watchdog")}
    keys.update(head=head, in_size=in_size, out_size=out_size, layout="%04X" % layout_id(crc),
                send="AG_LSEND" if in_size > LONG else "AG_SEND",
                recv="AG_LRECV" if out_size > LONG else "AG_RECV")
    text = HEAD.substitute(keys)
    text += _block(map_, "IE_TX", "tx", "DB%s: what the IOC gets" % map_.plc["tx_db"])
    text += _block(map_, "IE_RX", "rx", "DB%s: what comes from the IOC" % map_.plc["rx_db"])
    if map_.on("sync") and out_size:
        text += _block(map_, "IE_ACC", "rx", "DB%s: the setpoints last accepted"
                       % map_.plc["acc_db"])
        text += _block(map_, "IE_HELD", "rx", "DB%s: the setpoints that the PLC holds"
                       % map_.plc["held_db"])
    text += _table(map_, "DB_TX_PTRS", tx.spans, "tx", "DB%s: PLC memory -> IE_TX"
                   % map_.plc["tx_ptrs"])
    text += PACK.substitute(name="PACK_TX_DB", what="PLC memory -> IE_TX", table="DB_TX_PTRS",
                            last=len(tx.spans), explicit=explicit_lines(tx, "tx") +
                            _layout_line(map_))
    if out_size:
        text += _table(map_, "DB_RX_PTRS", rx.spans, "rx", "DB%s: IE_RX -> PLC memory"
                       % map_.plc["rx_ptrs"])
        text += PACK.substitute(name="UNPACK_RX_DB", what="IE_RX -> PLC memory",
                                table="DB_RX_PTRS", last=len(rx.spans),
                                explicit=explicit_lines(rx, "rx"))
    return text + _comms(map_, keys, rx, out_size)


def _layout_line(map_):
    from ..transfer import layout_crc
    at = map_.number("layout_at")
    if at is None:
        return ""
    return "    IE_TX.DW%d := W#16#%04X;  // layout id\n" % (at, layout_id(layout_crc(map_)))


def _comms(map_, keys, rx, out_size):
    sync = map_.on("sync") and out_size
    text = ""
    if sync:
        text += CHECK.substitute(keys, last=len(rx.spans), explicit=compare_lines(rx))
    receive = SYNC_RECEIVE if sync else PLAIN_RECEIVE if out_size else Template("")
    if sync:
        header = SYNC_HEADER % map_.number("acc_db")
    else:
        header = "        PTR_ERR := PACK_TX_DB();\n"
        if map_.on("sync"):
            header += "        IE_TX.Block.Flags := B#16#00;\n        IF REMOTE THEN IE_TX.Block.Flags := " \
                      "B#16#02; END_IF;\n        COUNTER := (COUNTER + 1) MOD 256;\n        " \
                      "IE_TX.Block.Counter := INT_TO_BYTE(COUNTER);\n        IE_TX.Block.Layout := LAYOUT;\n"
    return text + COMMS.substitute(keys, receive=receive.substitute(keys), header=header) + \
        "\n// In the restart block (OB100): IE_COMMS_DB.SYNC := FALSE; IE_COMMS_DB.TIMEOUT := FALSE;\n"
