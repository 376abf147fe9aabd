"""The file of plcSim: a PLC with the blocks, data blocks and transfers of the map.

Where the map names symbols and no addresses, the simulated PLC has a data block of its own for
them; where values travel over Modbus, one for the registers.
"""
from ..address import Address
from ..transfer import layout_id, transfers
from .records import quoted

TABLES = 20        # of the three data blocks for tables that the IOC brings
OWN = 6            # data blocks of the simulated PLC's own
SYMBOLS = 1000     # number of the first data block that is free for symbols


def _first_free(map_):
    used = {l.address.db for l in map_.leaves() if l.address is not None and l.address.area == "DB"}
    number = SYMBOLS
    while used & set(range(number, number + OWN)):
        number += 1
    return number


class Memory:
    """Where each value lies in the simulated PLC."""

    def __init__(self, map_):
        self.map = map_
        self.symbols = _first_free(map_)
        self.registers = self.symbols + 1
        self.inputs = self.symbols + 2
        self.end = 0
        self.own = {}
        for leaf in map_.leaves():
            self.own[id(leaf)] = self._place(leaf)

    def _place(self, leaf):
        wire = self.map.plc["wire"]
        if wire in ("modbus", "block-modbus") and leaf.rx is not None:
            return Address("DB", self.registers, leaf.rx[0], leaf.rx[1])
        if wire == "modbus":
            return Address("DB", self.inputs, leaf.tx[0], leaf.tx[1])
        if leaf.address is not None and leaf.address.area:
            return leaf.address
        place = Address("DB", self.symbols, self.end, 0 if leaf.is_bit() else None)
        self.end += leaf.size() + (leaf.size() & 1)
        return place

    def of(self, leaf):
        return self.own[id(leaf)]

    def blocks(self):
        """{number: bytes} of all data blocks."""
        sizes = {}
        for leaf in self.map.leaves():
            a = self.of(leaf)
            if a.area == "DB":
                sizes[a.db] = max(sizes.get(a.db, 0), a.byte + leaf.size())
        for side in ("tx", "rx"):  # pointer rows may end behind the last value
            for span in transfers(self.map, side).spans:
                if span.memory.area == "DB":
                    sizes[span.memory.db] = max(sizes.get(span.memory.db, 0),
                                                span.memory.byte + span.length)
        if self.map.plc["wire"] in ("modbus", "block-modbus") and self.map.block_size("rx"):
            sizes[self.registers] = self.map.block_size("rx")
        if self.map.plc["wire"] == "modbus" and self.map.block_size("tx"):
            sizes[self.inputs] = self.map.block_size("tx")
        return {n: s + (s & 1) for n, s in sizes.items()}


def pointer(address, count):
    return "P#%s BYTE %d" % (address.text(1, 0), count)


def _moves(map_, memory):
    """Lines tx and rx."""
    lines = []
    wire = map_.plc["wire"]
    for side in ("tx", "rx"):
        if wire == "modbus" or (wire == "block-modbus" and side == "rx"):
            continue
        block = Address("DB", map_.number(side + "_db"), 0)
        found = transfers(map_, side)
        for span in found.spans:
            if wire == "block" or side == "tx":
                lines.append(_move(side, pointer(span.memory, span.length),
                                   pointer(block.plus(span.offset), span.length)))
        for leaf in [e.leaf for e in found.explicit] + found.unmoved:
            lines.append(_single(side, leaf, memory.of(leaf), block))
    if wire == "block-modbus":
        lines = [l for l in lines if l]
        for leaf in map_.leaves():
            if leaf.dir == "out" and leaf.tx is not None:
                lines.append(_single("tx", leaf, memory.of(leaf),
                                     Address("DB", map_.number("tx_db"), 0)))
    return lines


def _allowed(map_):
    """Memory that the tables of the IOC may reach: that of the rows, no more."""
    read = {span.memory.block() for span in transfers(map_, "tx").spans}
    write = {span.memory.block() for span in transfers(map_, "rx").spans}
    return ["allow %s %s" % ("write" if block in write else "read", block)
            for block in sorted(read | write)]


def _move(side, memory, block):
    return "%s %s -> %s" % ((side, memory, block) if side == "tx" else (side, block, memory))


def _single(side, leaf, memory, block):
    byte, bit = getattr(leaf, side)
    size = leaf.size()
    if leaf.is_bit() or size in (1, 2, 4):
        there = block.plus(byte, bit)
        return _move(side, memory.text(size), there.text(size))
    return _move(side, pointer(memory, size), pointer(block.plus(byte), size))


def simulator(map_, head, crc):
    """Text of the file."""
    plc = map_.plc
    memory = Memory(map_)
    wire = plc["wire"]
    sizes = map_.block_size("tx"), map_.block_size("rx")
    lines = [head, "name      = %s" % quoted(plc["name"])]
    if plc["second"]:  # FIRST is 127.0.0.2, SECOND 127.0.0.3
        lines += ["role      = pair", "address   = 127.0.0.2"]
    if wire != "modbus":
        lines += ["port      = %s" % (plc["port"] or "2000"), "in        = %d" % sizes[0]]
        if wire == "block":
            lines.append("out       = %d" % sizes[1])
    lines += ["byteorder = %s" % plc["byteorder"], "period    = %s ms" % plc["period"],
              "ie_tx     = %s" % plc["tx_db"], "ie_rx     = %s" % plc["rx_db"],
              "tx_ptrs   = %s" % plc["tx_ptrs"], "rx_ptrs   = %s" % plc["rx_ptrs"]]
    if map_.on("sync"):
        lines += ["sync      = on", "layout    = %d" % layout_id(crc),
                  "watchdog  = %s ms" % plc["watchdog"]]
    if map_.on("download"):
        lines.append("map       = on")
        first = TABLES if not set(memory.blocks()) & set(range(TABLES, TABLES + 3)) \
            else memory.symbols + 3
        lines.append("map_db    = %d" % first)
    if wire != "block":
        lines += ["modbus_port = %s" % (plc["port"] or "502" if wire == "modbus" else "502"),
                  "modbus_unit = %s" % plc["unit"]]
    lines.append("")
    lines += ["db %d %d" % (number, size) for number, size in sorted(memory.blocks().items())
              if number not in (map_.number("tx_db"), map_.number("rx_db"))]
    if map_.number("layout_at") is not None and wire != "modbus":
        lines.append("signal %s UINT16 constant %d" % (plc["layout_at"], layout_id(crc)))
    if wire == "modbus" and sizes[0]:
        lines.append("modbus holding %s %d -> DB%d.0" % (plc["in_register"], sizes[0] // 2,
                                                         memory.inputs))
        if map_.number("layout_at") is not None:
            lines.append("init DB%d.%s UINT16 %d" % (memory.inputs, plc["layout_at"],
                                                    layout_id(crc)))
    if wire != "block" and sizes[1]:
        lines.append("modbus holding %s %d -> DB%d.0" % (plc["out_register"], sizes[1] // 2,
                                                         memory.registers))
    if map_.on("download"):
        lines += _allowed(map_)
    lines += _moves(map_, memory)
    return "\n".join(lines) + "\n"
