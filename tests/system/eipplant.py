"""An IOC with nothing but ether_ip.dbd, and plcSim as its controller, for tests of DTYP "EtherIP"."""
import re

from waiting import until, until_equal


def rec(kind, name, link, *fields):
    """A record; inputs have I/O Intr."""
    out = kind in ("ao", "bo", "mbbo", "mbboDirect", "longout", "int64out", "stringout", "lso",
                   "aao", "calcout")
    text = [f'field({"OUT" if out else "INP"}, "@P {link}")']
    if not out:
        text.append('field(SCAN, "I/O Intr")')
    for field in fields:
        key, value = field.split("=", 1)
        text.append(f'field({key}, "{value}")')
    return f'record({kind}, "$(P){name}") {{ field(DTYP, "EtherIP") {" ".join(text)} }}\n'


class Plant:
    """plcSim with some tags, and an IOC with some records."""

    def __init__(self, new_sim, new_ioc):
        self.new_sim, self.new_ioc = new_sim, new_ioc
        self.ioc = None

    def tags(self, *lines, **keys):
        text = "name = S\nbyteorder = little\netherip_port = 0\n"
        text += "".join(f"etherip_{key} = {value}\n" for key, value in keys.items())
        self.sim = self.new_sim(text + "\n".join(lines) + "\n")
        self.port = until(self.find_port, "plcSim with EtherNet/IP")
        return self

    def find_port(self):
        for line in self.sim.lines:
            found = re.search(r"EtherNet/IP listening on .*:(\d+)$", line)
            if found:
                return int(found.group(1))
        return None

    def records(self, *records, before="", slot=0, configure="", **kw):
        self.ioc = self.new_ioc(
            f'{before}\ndrvEtherIP_init\ndrvEtherIP_define_PLC("P", "127.0.0.1:{self.port}", '
            f'{slot})\n{configure.format(port=self.port)}', "".join(records), program="eipIoc", **kw)
        return self

    def tag(self, name):
        """The value of a tag as plcSim has it."""
        return self.sim.command(f"etherip get {name}").split(" = ")[-1].strip()

    def wait_tag(self, name, value):
        until_equal(lambda: self.tag(name), value)

    def set(self, name, *values):
        self.sim.command(f"etherip set {name} {' '.join(str(v) for v in values)}")

    def total(self):
        return int(re.search(r"requests: total=(\d+)", self.sim.command("etherip")).group(1))

    def requests(self):
        return int(re.search(r"(\d+) requests", self.sim.command("etherip")).group(1))
