"""The file of plcSim for EtherNet/IP: a controller with the tags of the map."""
import re

from ..tags import BITS, STRING, tree


class Types:
    """`udt` lines for the structures of a tree, each once."""

    def __init__(self):
        self.lines = []
        self.names = {}  # members' text -> name

    def of(self, node, name):
        """The type of a node as plcSim writes it, dimensions and all."""
        dims = list(node.dims)
        kind = node.kind
        if node.members:
            word = self._struct(node, name)
        elif isinstance(kind, tuple) and kind[0] == "bit":
            word = "DINT" if kind[1] < BITS else "LINT"
        elif isinstance(kind, tuple):
            word = "STRING" if kind[1] == STRING else self._named("STR%d" % kind[1],
                                                                   "string %d" % kind[1])
        else:
            word = kind
            if kind == "BOOL" and dims:
                dims = [(dims[0] + BITS - 1) // BITS * BITS]
        return word + ("[%s]" % ",".join(map(str, dims)) if dims else "")

    def _struct(self, node, name):
        text = " ".join("%s:%s" % (n, self.of(inner, n)) for n, inner in node.members.values())
        return self._named("T_" + re.sub(r"\W", "_", name)[-30:], text)

    def _named(self, wanted, text):
        if text not in self.names:
            name, number = wanted, 1
            while name.upper() in (n.upper() for n in self.names.values()):
                number += 1
                name = "%s_%d" % (wanted, number)
            self.names[text] = name
            self.lines.append("udt %s %s" % (name, text))
        return self.names[text]


def controller(map_, head):
    """The file of plcSim: a controller with the tags of the map."""
    types, tags = Types(), []
    for name, node in tree(map_.leaves()).values():
        tags.append("tag %s %s" % (name, types.of(node, name)))
    lines = [head, 'name         = "%s"' % map_.plc["name"], "port         = off",
             "etherip_port = %s" % (map_.plc["port"] or "44818"),
             "etherip_slot = %s" % map_.plc["slot"], "byteorder    = little",
             "period       = %s ms" % map_.plc["period"], ""]
    return "\n".join(lines + types.lines + tags) + "\n"
