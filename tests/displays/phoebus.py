"""Displays in the real Phoebus, as pictures: PhoebusShot.java does it, in Phoebus's own runtime.

Phoebus is in no package registry: its folder of jars is given. JDK 21 or newer.
"""
import os
import subprocess
from pathlib import Path

HERE = Path(__file__).resolve().parent


class Viewer:
    def __init__(self, own, top, pictures, folder):
        self.own, self.top, self.pictures, self.faults = own, top, pictures, []
        settings = own / "settings.ini"
        settings.write_text("org.phoebus.pv/default=ca\n"
                            "org.phoebus.pv.ca/auto_addr_list=false\n"
                            f"org.phoebus.pv.ca/addr_list={os.environ['EPICS_CA_ADDR_LIST']}\n"
                            f"org.phoebus.pv.ca/server_port={os.environ['EPICS_CA_SERVER_PORT']}\n")
        java = Path(os.environ["JAVA_HOME"], "bin/java") if "JAVA_HOME" in os.environ else "java"
        self.log = open(pictures / "phoebus.log", "w")
        self.java = subprocess.Popen(
            [java, "-Dprism.order=sw", f"-Duser.home={own}", "-cp", f"{folder}/*:{folder}/lib/*",
             HERE / "PhoebusShot.java", settings],
            stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=self.log, text=True)

    def _order(self, *words):
        """Gives an order; returns the lines before "done"."""
        self.java.stdin.write("\t".join(map(str, words)) + "\n")
        self.java.stdin.flush()
        lines = []
        for line in self.java.stdout:
            if line.rstrip() == "done":
                return lines
            lines.append(line.rstrip())
        raise SystemExit(f"Phoebus ended; see {self.log.name}")

    def open(self, name, macros):
        file = f"bob/plclink{name}.bob"
        base = self.own if (self.own / file).exists() else self.top / "s7plcApp/op"
        macros = {k: {"0": "false", "1": "true"}[v] if k.startswith("HAS_") else v
                  for k, v in macros.items()}
        self._order("open", name, base / file, *(f"{k}={v}" for k, v in macros.items()))

    def shoot(self, name, file, checked=True):
        faults = self._order("check" if checked else "wait", name)
        self.faults += [f"{name}: {line}" for line in faults] if checked else []
        self._order("shot", name, self.pictures / f"{file}.png",
                    self.pictures / f"{file}-small.png")
        self._order("close", name)

    def picture(self, name, macros, file):
        self.open(name, macros)
        self.shoot(name, file)

    def close(self):
        self.java.stdin.close()
        self.java.wait()
        return self.faults
