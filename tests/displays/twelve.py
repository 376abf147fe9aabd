"""Makes pictures of the displays with live PVs in twelve states of six simulated PLCs.

    twelve.py FOLDER            with PyDM
    twelve.py FOLDER PHOEBUS    with the Phoebus in the folder PHOEBUS (its jars), JDK 21 or newer

tests/displays/run calls it. Each picture is there a second time, small: as seen from three
metres away; all the small ones are in twelve.png. The status is 1 when a PV was not connected,
or words did not fit, while the IOC lived.
"""
import atexit
import os
import subprocess
import sys
import tempfile
from pathlib import Path

HERE = Path(__file__).resolve().parent
sys.path[:0] = [str(HERE.parent / "system"), str(HERE), str(HERE.parents[1] / "s7plcApp/op")]

from client import SECOND_IOC, TOP  # noqa: E402  (sets the environment of CA)
from ioc import Ioc  # noqa: E402
from plcdisplays import displays  # noqa: E402
from sheet import sheet  # noqa: E402
from sim import Sim  # noqa: E402
from waiting import until  # noqa: E402

PARTS = {"PRESS": ["MODBUS"], "OVEN": ["SYNC"], "PAIR": ["PAIR"], "LINE": ["SYNC", "MAP"],
         "CTRL": ["EIP"]}
NAMES = ("PLC1", "PRESS", "OVEN", "PAIR", "LINE", "CTRL")
TABLE = "layout 0x1201\ntx P#DB11.DBX0.0 BYTE 8 -> 16\n"
PLC1 = """name = PLC1
in = 64
out = 32
byteorder = big
period = 100 ms
signal 0 UINT32 counter
"""
OVERVIEW = ("Overview", "PLC1")


class Plant:
    """Six PLCs of plcSim and the IOCs that have them: a pair is in phoenixIoc, EtherNet/IP in
    s7plcIoc."""

    ioc = second = None

    def __init__(self, folder):
        atexit.register(self.close)  # also when a state is not reached
        demos = TOP / "iocBoot"
        self.PLC1 = Sim(folder, PLC1)
        self.PRESS = Sim(folder, (demos / "iocModbus/press.plc").read_text()
                         .replace("modbus_port = 1502", "modbus_port = 0"))
        self.folder = folder
        self.OVEN = Sim(folder, self.oven("0x1201"))
        self.PAIR = Sim(folder, (demos / "iocPhoenix/plc-a.plc").read_text())
        self.LINE = Sim(folder, (demos / "iocTables/tables.plc").read_text())
        self.CTRL = Sim(folder, (demos / "iocEtherIP/controller.plc").read_text()
                        .replace("etherip_port = 44818", "etherip_port = 0"))
        table = folder / "line.ptr"
        table.write_text(TABLE)
        configure = f"""
s7plcConfigure(PLC1, 127.0.0.1, {self.PLC1.port}, 64, 32, 1, 2000, 100)
s7plcSetOption PLC1, alive, 2
s7plcConfigure(PRESS, 127.0.0.1, {self.PRESS.port}, 64, 32, 1, 2000, 100)
s7plcModbusOutput(PRESS, "", {self.PRESS.modbus_port}, 1, 1000)
s7plcConfigure(OVEN, 127.0.0.1, {self.OVEN.port}, 32, 12, 1, 2000, 100)
s7plcSetOption OVEN, sync, on
s7plcSetOption OVEN, layout, 0x1201
s7plcSetOption OVEN, readback, 0
s7plcConfigure(LINE, 127.0.0.1, {self.LINE.port}, 64, 32, 1, 2000, 100)
s7plcSetOption LINE, sync, on
s7plcSetOption LINE, map, download
s7plcTables LINE "{table}"
phoenixplcConfigure(PAIR, "127.0.0.2", {self.PAIR.port}, 64, 32, 1, 2000, 100, 1)
"""
        records = """
record(ao, "$(P)press") { field(DTYP, "S7plc") field(OUT, "@PRESS/0 T=FLOAT") }
record(ao, "$(P)oven")  { field(DTYP, "S7plc") field(OUT, "@OVEN/4 T=FLOAT") }
"""
        loads = [("s7plcStation.db", n) for n in NAMES[:-1]] + [
            ("s7plcModbus.db", "PRESS"), ("s7plcSync.db", "OVEN"), ("s7plcSync.db", "LINE"),
            ("s7plcTables.db", "LINE"), ("phoenixplcStatus.db", "PAIR")]
        self.ioc = Ioc(folder, configure, records, program="phoenixIoc",
                       templates=[(f, f"P=$(P){n}:,PLC={n}") for f, n in loads]).start()
        self.second = self.tags_ioc(folder).start()
        self.plcs = [(n, self.prefix(n), PARTS.get(n, [])) for n in NAMES]
        for name in NAMES:
            self.ioc_of(name).wait_value(name + ":State", 3)

    def tags_ioc(self, folder):
        loads = [("eip_stat.db", "IOC=$(P)CTRL,PLC=CTRL,TAG=BOOLs S 0.1"),
                 ("s7plcStation.db", "P=$(P)CTRL:,PLC=CTRL"),
                 ("s7plcModbus.db", "P=$(P)CTRL:,PLC=CTRL")]
        return Ioc(folder, f'drvEtherIP_define_PLC(CTRL, "127.0.0.1:{self.CTRL.etherip_port}", 0)',
                   'record(ao, "$(P)tag") { field(DTYP, "EtherIP") field(OUT, "@CTRL Setpoint") }\n',
                   env={**os.environ, "EPICS_CAS_INTF_ADDR_LIST": SECOND_IOC}, templates=loads)

    def ioc_of(self, plc):
        return self.second if plc == "CTRL" else self.ioc

    def prefix(self, plc):
        return f"{self.ioc_of(plc).P}{plc}:"

    def oven(self, layout):
        return (TOP / "iocBoot/iocSync/sync.plc").read_text().replace("0x1201", layout)

    def exchange_oven(self, layout):
        """The same PLC, whose program was made from another map."""
        port = self.OVEN.port
        self.OVEN.close()
        self.OVEN = Sim(self.folder, self.oven(layout), "-p", str(port))

    def is_state(self, plc, *values, pv="State"):
        ioc, name = self.ioc_of(plc), f"{plc}:{pv}"
        until(lambda: ioc.get(name) in values,
              lambda: f"{name} has {ioc.text(name)}, wanted {values}")

    def close(self):
        """All IOCs die, and the PLCs end: what of them was started."""
        for ioc in (self.ioc, self.second):
            if ioc and ioc.process:
                ioc.process.kill()
                ioc.drop_clients()
        for sim in [getattr(self, name) for name in NAMES if hasattr(self, name)]:
            sim.close()
        atexit.unregister(self.close)


def station(plc):
    return "Station", plc


# State: what brings it, what to wait for, which displays, what ends it
STATES = [
    ("01-normal", lambda p: p.ioc.put("press", 20.5),
     lambda p: p.is_state("PRESS", 1, pv="Setpoints"),
     [OVERVIEW, station("PLC1"), ("Modbus", "PRESS"), ("Sync", "OVEN"), ("Pair", "PAIR"), ("Tables", "LINE"),
      ("EtherIP", "CTRL")], lambda p: None),
    ("02-lost", lambda p: (p.PLC1.command("unplug"), p.CTRL.command("unplug")),
     lambda p: (p.is_state("PLC1", 1), p.is_state("CTRL", 1)),
     [OVERVIEW, station("PLC1"), ("EtherIP", "CTRL")],
     lambda p: (p.PLC1.command("plug"), p.CTRL.command("plug"), p.is_state("CTRL", 3))),
    ("03-silent", lambda p: p.PLC1.command("silence"), lambda p: p.is_state("PLC1", 1, 2),
     [OVERVIEW, station("PLC1")], lambda p: p.PLC1.command("silence off")),
    ("04-size", lambda p: p.PLC1.command("truncate 48"), lambda p: p.is_state("PLC1", 4),
     [OVERVIEW, station("PLC1")], lambda p: p.PLC1.command("truncate off")),
    ("05-frozen", lambda p: p.PLC1.command("freeze all"), lambda p: p.is_state("PLC1", 5),
     [OVERVIEW, station("PLC1")], lambda p: p.PLC1.command("unfreeze")),
    ("06-layout", lambda p: p.exchange_oven("0x1202"), lambda p: p.is_state("OVEN", 5, pv="Sync"),
     [OVERVIEW, station("OVEN"), ("Sync", "OVEN")],
     lambda p: (p.exchange_oven("0x1201"), p.is_state("OVEN", 3, pv="Sync"))),
    ("07-output", lambda p: (p.PRESS.command("modbus silent"), p.ioc.put("press", 33, wait=False)),
     lambda p: p.is_state("PRESS", 0, pv="Setpoints"),
     [OVERVIEW, station("PRESS"), ("Modbus", "PRESS")],
     lambda p: (p.PRESS.command("modbus normal"), p.is_state("PRESS", 1, pv="Setpoints"))),
    ("08-refused", lambda p: (p.PRESS.command("modbus exception 2 holding 1000 write"),
                              p.ioc.put("press", 44, wait=False)),
     lambda p: p.is_state("PRESS", 5, pv="Setpoints"),
     [OVERVIEW, station("PRESS"), ("Modbus", "PRESS")],
     lambda p: (p.PRESS.command("modbus normal"), p.ioc.put("press", 20, wait=False))),
    ("09-local", lambda p: (p.OVEN.command("local"), p.is_state("OVEN", 4, pv="Sync"),
                            p.ioc.put("oven", 5, wait=False)),
     lambda p: p.is_state("OVEN", 1, pv="Refused"),
     [OVERVIEW, station("OVEN"), ("Sync", "OVEN")], lambda p: p.OVEN.command("remote")),
    ("10-switched", lambda p: p.PAIR.command("unplug 1"),
     lambda p: p.is_state("PAIR", 5, pv="Pair"),
     [OVERVIEW, station("PAIR"), ("Pair", "PAIR")], lambda p: p.PAIR.command("plug 1")),
    ("11-two", lambda p: p.PAIR.command("twoprimaries"), lambda p: p.is_state("PAIR", 3, pv="Pair"),
     [OVERVIEW, ("Pair", "PAIR")], lambda p: p.PAIR.command("twoprimaries off")),
]


def macros(plant, plc):
    return {"P": plant.prefix(plc), "NAME": plc,
            **{"HAS_" + part: "1" if part in PARTS.get(plc, ()) else "0"
               for part in displays.PARTS}}


def main(folder, phoebus=None):
    if phoebus:
        from phoebus import Viewer
    else:
        from pydmviewer import Viewer
    folder = Path(folder).resolve()
    folder.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory() as temporary:
        plant = Plant(Path(temporary))
        plcs = Path(temporary) / "plcs"
        plcs.write_text("".join(f"{n} {p} {' '.join(has)}\n" for n, p, has in plant.plcs))
        for argument in ([], ["--plcs", str(plcs)]):
            subprocess.run([sys.executable, TOP / "s7plcApp/op/generate.py", "-o", temporary,
                            *argument], check=True)
        viewer = Viewer(Path(temporary), TOP, folder, phoebus)
        for state, begin, reached, shown, end in STATES:
            begin(plant)
            reached(plant)
            for name, plc in shown:
                viewer.picture(name, macros(plant, plc), f"{state}-{name}")
            end(plant)
            plant.is_state("PLC1", 3)
        for name, plc in (OVERVIEW, station("PLC1")):  # open while the IOC dies
            viewer.open(name, macros(plant, plc))
        plant.close()
        for name in ("Overview", "Station"):
            viewer.shoot(name, f"12-died-{name}", checked=False)
        faults = viewer.close()
    sheet(folder, folder / "twelve.png")
    for line in sorted(set(faults)):
        print(line)
    print(f"{len(list(folder.glob('*.png')))} pictures in {folder}, {len(set(faults))} faults")
    return bool(faults)


if __name__ == "__main__":
    if len(sys.argv) not in (2, 3):
        sys.exit(__doc__)
    # PyDM and pyepics have threads that do not end by themselves
    status = main(*sys.argv[1:])
    sys.stdout.flush()
    os._exit(status)
