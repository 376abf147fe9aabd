"""The table of pointers that the IOC compares with the PLC's, or brings: docs/plc-tables.md."""
from ..transfer import layout_id, transfers
from ..transfer import table as bytes_of
from .simulator import pointer


def table(map_, head, crc):
    """Text of the file, or None where nothing moves by pointers."""
    rows = transfers(map_, "tx"), transfers(map_, "rx")
    if not rows[0].spans and not rows[1].spans:
        return None
    lines = [head, "layout %d" % layout_id(crc), "crc 0x%08X" % _crc(map_, crc, *rows),
             "ie_tx %s" % map_.plc["tx_db"], "ie_rx %s" % map_.plc["rx_db"]]
    for span in rows[0].spans:
        lines.append("tx %s -> %d  %s" % (pointer(span.memory, span.length), span.offset,
                                          " ".join(span.names)))
    for span in rows[1].spans:
        lines.append("rx %d -> %s  %s" % (span.offset, pointer(span.memory, span.length),
                                          " ".join(span.names)))
    return "\n".join(lines) + "\n"


def _crc(map_, crc, tx, rx):
    return int.from_bytes(bytes_of(map_, layout_id(crc), tx, rx)[6:10], "big")
