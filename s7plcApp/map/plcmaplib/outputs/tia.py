"""SCL for S7-1200/1500 (an external source for TIA Portal): standard-access blocks, transfers by
POKE_BLK, PEEK and POKE, communication by TSEND and TRCV."""
from string import Template

from ..address import AREAS
from ..transfer import layout_id, transfers
from ..types import Elementary
from .scl import symbol

SIZES = {1: "BYTE", 2: "WORD", 4: "DWORD", 8: "LWORD"}

HEAD = Template("""$head
// For S7-1200/1500: add as an external source, generate blocks. The data blocks that the map
// names must have standard (not optimised) access. Blocks: IE_TX DB$tx_db, IE_RX DB$rx_db,
// IE_ACC DB$acc_db: give them these numbers. Call IE_COMMS in a cyclic interrupt.
""")

SAME = """
FUNCTION "SAME_BYTES" : BOOL
{ S7_Optimized_Access := 'FALSE' }
VERSION : 0.1
VAR_INPUT
    Db : INT;  From : INT;                      // ours
    Area : BYTE;  OtherDb : INT;  OtherFrom : INT;
    Count : INT;
END_VAR
VAR_TEMP
    I : INT;
END_VAR
BEGIN
    #SAME_BYTES := TRUE;
    FOR #I := 0 TO #Count - 1 DO
        IF PEEK(area := 16#84, dbNumber := #Db, byteOffset := #From + #I) <>
           PEEK(area := #Area, dbNumber := #OtherDb, byteOffset := #OtherFrom + #I) THEN
            #SAME_BYTES := FALSE;
            RETURN;
        END_IF;
    END_FOR;
END_FUNCTION
"""

COMMS = Template("""
FUNCTION_BLOCK "IE_COMMS"
{ S7_Optimized_Access := 'FALSE' }
VERSION : 0.1
VAR_INPUT
    REMOTE : BOOL;                  // FALSE = LOCAL: the HMI has control
    CONNECTED : BOOL;               // the TCP connection (TCON, passive) is established
    ID : CONN_OUC;                  // of the connection
    LAYOUT : WORD := 16#$layout;    // of the map; 0 = not checked
    PERIOD : TIME := T#${period}MS;
    WATCHDOG : TIME := T#${watchdog}MS;
END_VAR
VAR_OUTPUT
    SYNC : BOOL;
    TIMEOUT : BOOL;
END_VAR
VAR
    WAS_CONNECTED : BOOL;
    RX_WATCH : TON_TIME;
    TX_PAUSE : TON_TIME;
    SEND : TSEND;
    RECEIVE : TRCV;
    SENDING : BOOL;
    START : BOOL;
    COUNTER : INT;
END_VAR
VAR_TEMP
    FLAGS : BYTE;
    THEIRS : WORD;
END_VAR
BEGIN
    IF #CONNECTED <> #WAS_CONNECTED THEN #SYNC := FALSE; #SENDING := FALSE; END_IF;
    #WAS_CONNECTED := #CONNECTED;
    IF NOT #REMOTE THEN #SYNC := FALSE; END_IF;
$receive
    #TX_PAUSE(IN := NOT #SENDING, PT := #PERIOD);
    #START := FALSE;
    IF #TX_PAUSE.Q AND #CONNECTED THEN
$header        #SENDING := TRUE;
        #START := TRUE;
    END_IF;
    #SEND(REQ := #START, ID := #ID, LEN := $in_size, DATA := "IE_TX".Data);
    IF #SEND.DONE OR #SEND.ERROR THEN #SENDING := FALSE; END_IF;
END_FUNCTION_BLOCK
""")

SYNC_RECEIVE = Template("""    IF #SYNC THEN #SYNC := "CHECKSYNC"(BLOCK := $acc_db); END_IF;
    #RECEIVE(EN_R := #CONNECTED, ID := #ID, LEN := $out_size, DATA := "IE_RX".Data);
    #RX_WATCH(IN := #CONNECTED AND NOT #RECEIVE.NDR, PT := #WATCHDOG);
    IF #RECEIVE.NDR THEN
        #FLAGS := PEEK(area := 16#84, dbNumber := $rx_db, byteOffset := 0);
        #THEIRS := PEEK_WORD(area := 16#84, dbNumber := $rx_db, byteOffset := 2);
        IF (#LAYOUT <> 16#0) AND (#THEIRS <> 16#0) AND (#THEIRS <> #LAYOUT) THEN
            #SYNC := FALSE;
        ELSIF (#FLAGS AND 16#01) <> 16#00 AND #REMOTE THEN
            #SYNC := "CHECKSYNC"(BLOCK := $rx_db);
            IF #SYNC THEN "IE_ACC".Data := "IE_RX".Data; #TIMEOUT := FALSE; END_IF;
        ELSIF (#FLAGS AND 16#02) <> 16#00 AND #SYNC THEN
            "UNPACK_RX_DB"();
            "IE_ACC".Data := "IE_RX".Data;
        END_IF;
    END_IF;
    IF #RX_WATCH.Q THEN #SYNC := FALSE; #TIMEOUT := TRUE; END_IF;
""")

PLAIN_RECEIVE = Template("""    #RECEIVE(EN_R := #CONNECTED, ID := #ID, LEN := $out_size, DATA := "IE_RX".Data);
    #RX_WATCH(IN := #CONNECTED AND NOT #RECEIVE.NDR, PT := #WATCHDOG);
    IF #RECEIVE.NDR AND #REMOTE THEN "UNPACK_RX_DB"(); END_IF;
    #TIMEOUT := #RX_WATCH.Q;
""")

SYNC_HEADER = Template("""$check        "PACK_TX_DB"();
        #COUNTER := (#COUNTER + 1) MOD 256;
        #FLAGS := 16#00;
        IF #SYNC THEN #FLAGS := #FLAGS OR 16#01; END_IF;
        IF #REMOTE THEN #FLAGS := #FLAGS OR 16#02; END_IF;
        IF #TIMEOUT THEN #FLAGS := #FLAGS OR 16#04; END_IF;
        POKE(area := 16#84, dbNumber := $tx_db, byteOffset := 0, value := #FLAGS);
        POKE(area := 16#84, dbNumber := $tx_db, byteOffset := 1, value := INT_TO_BYTE(#COUNTER));
        POKE(area := 16#84, dbNumber := $tx_db, byteOffset := 2, value := #LAYOUT);
""")


def _block(name, size):
    if not size:
        return ""
    return ("\nDATA_BLOCK \"%s\"\n{ S7_Optimized_Access := 'FALSE' }\nVERSION : 0.1\nSTRUCT\n"
            "    Data : ARRAY [0..%d] OF BYTE;\nEND_STRUCT;\nBEGIN\nEND_DATA_BLOCK\n"
            % (name, size - 1))


def _area(a):
    return "16#%02X" % AREAS[a.area]


def _copy(source, target, count, names):
    """One row of the pointer table: POKE_BLK takes the same fields."""
    return ("    POKE_BLK(area_src := %s, dbNumber_src := %d, byteOffset_src := %d,\n"
            "             area_dest := %s, dbNumber_dest := %d, byteOffset_dest := %d, "
            "count := %d);  // %s\n" % (source + target + (count, names)))


def _end(a, byte=None):
    return (_area(a), a.db, a.byte if byte is None else byte)


def _peek(area, db, byte, bit, size):
    if bit is not None:
        return "PEEK_BOOL(area := %s, dbNumber := %d, byteOffset := %d, bitOffset := %d)" % (
            area, db, byte, bit)
    return "PEEK_%s(area := %s, dbNumber := %d, byteOffset := %d)" % (SIZES[size], area, db, byte)


def _poke(area, db, byte, bit, value):
    if bit is not None:
        return "POKE_BOOL(area := %s, dbNumber := %d, byteOffset := %d, bitOffset := %d, " \
            "value := %s);" % (area, db, byte, bit, value)
    return "POKE(area := %s, dbNumber := %d, byteOffset := %d, value := %s);" % (
        area, db, byte, value)


def _theirs(e, to_bits=True):
    """What the PLC holds, as bits."""
    a = e.memory
    if a.area:
        return _peek(_area(a), a.db, a.byte, a.bit if e.bit is not None else None, e.size)
    return _bits(e.leaf, symbol(a.symbol)) if to_bits else symbol(a.symbol)


def _bits(leaf, value):
    kind = leaf.type
    if not isinstance(kind, Elementary) or kind.kind in ("bool", "bits"):
        return value
    return "%s_TO_%s(%s)" % (kind.name, SIZES[kind.size], value)


def _transfer(map_, e, side):
    """The line of an explicit transfer."""
    db = map_.number(side + "_db")
    if e.bit is None and e.size not in SIZES:
        return "    // %s (%s, %d bytes): by hand\n" % (e.leaf.symbol, e.leaf.type, e.size)
    if side == "tx":
        line = _poke("16#84", db, e.offset, e.bit, _theirs(e))
    elif e.memory.area:
        line = _poke(_area(e.memory), e.memory.db, e.memory.byte,
                     e.memory.bit if e.bit is not None else None,
                     _peek("16#84", db, e.offset, e.bit, e.size))
    else:
        bits = _peek("16#84", db, e.offset, e.bit, e.size)
        kind = e.leaf.type
        if kind.kind not in ("bool", "bits"):
            bits = "%s_TO_%s(%s)" % (SIZES[kind.size], kind.name, bits)
        line = "%s := %s;" % (symbol(e.memory.symbol), bits)
    return "    %s  // %s\n" % (line, e.leaf.symbol)


def _function(name, body, kind="VOID", inputs=""):
    return "\nFUNCTION \"%s\" : %s\n{ S7_Optimized_Access := 'FALSE' }\nVERSION : 0.1\n%sBEGIN\n%s" \
        "END_FUNCTION\n" % (name, kind, inputs, body or "    ;\n")


def _moves(map_, found, side):
    db = map_.number(side + "_db")
    body = ""
    for span in found.spans:
        names = ", ".join(span.names[:3]) + (" ..." if len(span.names) > 3 else "")
        there, here = _end(span.memory), ("16#84", db, span.offset)
        ends = (there, here) if side == "tx" else (here, there)
        body += _copy(ends[0], ends[1], span.length, names)
    body += "".join(_transfer(map_, e, side) for e in found.explicit)
    return body + "".join("    // %s: no place in the PLC is known\n" % l.symbol
                          for l in found.unmoved)


def _checksync(found):
    body = "    #CHECKSYNC := TRUE;\n"
    for span in found.spans:
        body += "    IF NOT \"SAME_BYTES\"(Db := #BLOCK, From := %d, Area := %s, OtherDb := %d, " \
            "OtherFrom := %d, Count := %d) THEN #CHECKSYNC := FALSE; END_IF;\n" % (
                (span.offset,) + _end(span.memory) + (span.length,))
    for e in found.explicit:
        if e.compared and (e.bit is not None or e.size in SIZES):
            body += "    IF %s <> %s THEN #CHECKSYNC := FALSE; END_IF;\n" % (
                _peek("16#84", 0, e.offset, e.bit, e.size).replace("dbNumber := 0",
                                                                  "dbNumber := #BLOCK"),
                _theirs(e))
    return _function("CHECKSYNC", body, "BOOL", "VAR_INPUT\n    BLOCK : INT;\nEND_VAR\n")


def program(map_, head, crc):
    tx, rx = transfers(map_, "tx"), transfers(map_, "rx")
    sizes = map_.block_size("tx"), map_.block_size("rx")
    sync = map_.on("sync")
    keys = {k: map_.plc[k] for k in ("tx_db", "rx_db", "acc_db", "period", "watchdog")}
    keys.update(head=head, in_size=sizes[0], out_size=sizes[1], layout="%04X" % layout_id(crc))
    text = HEAD.substitute(keys) + _block("IE_TX", sizes[0]) + _block("IE_RX", sizes[1])
    body = _moves(map_, tx, "tx")
    if map_.number("layout_at") is not None:
        body += "    POKE(area := 16#84, dbNumber := %s, byteOffset := %s, value := 16#%04X);\n" % (
            map_.plc["tx_db"], map_.plc["layout_at"], layout_id(crc))
    text += _function("PACK_TX_DB", body)
    receive, header = "", "        \"PACK_TX_DB\"();\n"
    if sizes[1]:
        text += _function("UNPACK_RX_DB", _moves(map_, rx, "rx"))
        receive = (SYNC_RECEIVE if sync else PLAIN_RECEIVE).substitute(keys)
    if sizes[1] and sync:
        text += _block("IE_ACC", sizes[1]) + SAME + _checksync(rx)
    if sync:
        check = "        IF #SYNC THEN #SYNC := \"CHECKSYNC\"(BLOCK := %s); END_IF;\n" \
            % map_.plc["acc_db"] if sizes[1] else ""
        header = SYNC_HEADER.substitute(keys, check=check)
    return text + COMMS.substitute(keys, receive=receive, header=header)
