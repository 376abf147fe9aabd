"""Displays in PyDM, as pictures. Needs an X server; `xvfb-run` is one."""
import time

from pydm import PyDMApplication
from pydm.display import load_file
from pydm.widgets import PyDMLabel
from qtpy.QtCore import Qt
from qtpy.QtWidgets import QLabel

from plcdisplays import displays, layout

SETTLE = 2  # s that a picture waits at least, for what comes once a second
LIMIT = 15  # s for the PVs to connect
# PyDM 1.29 looks whether a PV is connected and then says that it is not; where it connects in
# between, its widget is never told. Opened again, the display finds it connected.
OPENINGS = 3

# Texts of any length, which are cut by design
ANY = {i.pv.split(")")[-1] for d in displays.all_displays([("X", "$(P)", displays.PARTS)])
       for i in d.items if i.kind == "value" and i.longest is layout.TEXT}


def name_of(widget):
    return (getattr(widget, "channel", None) or "").removesuffix(".VAL$").rsplit(":", 1)[-1]


class Viewer:
    def __init__(self, own, top, pictures, _):
        """own: folder with an overview of its own; top: of the tree; both have pydm/."""
        self.app = PyDMApplication(use_main_window=False, command_line_args=[])
        self.own, self.top, self.pictures = own, top, pictures
        self.shown, self.all, self.faults = {}, [], []

    def _spin(self, seconds, until=lambda: False):
        end = time.monotonic() + seconds
        while time.monotonic() < end and not until():
            self.app.processEvents()
            time.sleep(0.01)  # the pace of the looks

    def open(self, name, macros):
        file = f"pydm/plclink{name}.ui"
        base = self.own if (self.own / file).exists() else self.top / "s7plcApp/op"
        for _ in range(OPENINGS):
            display = load_file(str(base / file), macros=macros, target=None)
            display.show()
            self.all.append(display)  # PyDM's rules outlive a display that is deleted
            self._spin(LIMIT, lambda: not self._unconnected(display))
            if not self._unconnected(display):
                break
            display.hide()
        self.shown[name] = display
        self._spin(SETTLE)

    def _unconnected(self, display):
        return [w.channel for w in display.findChildren(PyDMLabel)
                if w.channel and not w._connected]

    def _cut(self, display):
        for w in display.findChildren(QLabel):
            wide = w.fontMetrics().horizontalAdvance(w.text())
            if w.isVisible() and name_of(w) not in ANY and wide > w.width():
                yield f'"{w.text()}" needs {wide} pixels, has {w.width()}'

    def shoot(self, name, file, checked=True):
        display = self.shown.pop(name)
        if checked:
            self.faults += [f"{name}: not connected: {c}" for c in self._unconnected(display)]
            self.faults += [f"{name}: {line}" for line in self._cut(display)]
        else:
            self._spin(LIMIT, lambda: bool(self._unconnected(display)))
            self._spin(SETTLE)
        picture = display.grab()
        picture.save(str(self.pictures / f"{file}.png"))
        picture.scaled(picture.width() // 4, picture.height() // 4, Qt.KeepAspectRatio,
                       Qt.SmoothTransformation).save(str(self.pictures / f"{file}-small.png"))
        display.hide()

    def picture(self, name, macros, file):
        self.open(name, macros)
        self.shoot(name, file)

    def close(self):
        return self.faults
