"""A display as a .ui of Qt: for caQtDM, and for PyDM. Both build on Qt's own file format and
differ in their widgets. A lamp is a pile of words on colours of which one is seen.
"""
import json
import re
from xml.sax.saxutils import escape

from .adl import on
from .layout import BACKGROUND, BLACK, PURPLE

BUTTON = (215, 225, 240)


def _property(name, kind, value, std=False):
    inner = value if kind in ("rect", "color", "stringlist", "font") else escape(str(value))
    return (f'<property name="{name}"{" stdset=" + chr(34) + "0" + chr(34) if std else ""}>'
            f"<{kind}>{inner}</{kind}></property>")


def _rect(x, y, w, h):
    return _property("geometry", "rect",
                     f"<x>{x}</x><y>{y}</y><width>{w}</width><height>{h}</height>")


def _css(c):
    return "rgb(%d, %d, %d)" % c


class Writer:
    """What both have in common: a tree of widgets with properties."""

    def __init__(self, ending):
        self.ending = ending

    def widget(self, kind, place, properties, inside=""):
        self.count += 1
        return (f'<widget class="{kind}" name="w{self.count}">{_rect(*place)}'
                f'{"".join(properties)}{inside}</widget>')

    def write(self, display):
        self.count = 0
        body = "\n".join(getattr(self, i.kind)(i) for i in display.items)
        return self.frame(display, body)


class CaQtDM(Writer):
    ENUMS = {"align": {False: "Qt::AlignLeft|Qt::AlignVCenter",
                       True: "Qt::AlignRight|Qt::AlignVCenter"}}

    def colour(self, name, c):
        return _property(name, "color", f'<red>{c[0]}</red><green>{c[1]}</green>'
                         f"<blue>{c[2]}</blue>", True)

    def alignment(self, right):
        return _property("alignment", "set", self.ENUMS["align"][bool(right)])

    def font(self, size, bold):
        return _property("font", "font", f"<pointsize>{round(size * 0.75)}</pointsize>"
                         f'<weight>{75 if bold else 50}</weight><bold>{str(bold).lower()}</bold>')

    def words(self, text, place, size, bold, colour, back, alignment, seen=()):
        return self.widget("caLabel", place, [
            self.font(size, bold), _property("text", "string", text), alignment,
            _property("fontScaleMode", "enum", "ESimpleLabel::None", True),
            self.colour("foreground", colour), self.colour("background", back), *seen])

    def label(self, i):
        return self.words(i.text, (i.x, i.y, i.w, i.h), i.size, i.bold, i.colour, BACKGROUND,
                          self.alignment(i.right))

    def value(self, i):
        pv = i.pv + ".VAL$" if i.long else i.pv
        return self.widget("caLineEdit", (i.x, i.y, i.w, i.h), [
            self.font(i.size, i.bold), _property("channel", "string", pv, True),
            self.alignment(i.right),
            _property("fontScaleMode", "enum", "caLineEdit::None", True),
            _property("colorMode", "enum", "caLineEdit::Alarm_Default", True),
            _property("unitsEnabled", "bool", str(not i.long).lower(), True),
            _property("formatType", "enum", "caLineEdit::string" if i.long
                      else "caLineEdit::decimal", True),
            self.colour("foreground", BLACK), self.colour("background", BACKGROUND)])

    def lamp(self, i):
        place, centre = (i.x, i.y, i.w, i.h), _property("alignment", "set", "Qt::AlignCenter")
        out = [self.words("?", place, i.size, True, on(PURPLE), PURPLE, centre)]
        for value, word, colour in i.states:
            seen = [_property("visibility", "enum", "caLabel::Calc", True),
                    _property("visibilityCalc", "string", f"A={value}", True),
                    _property("channel", "string", i.pv, True)]
            out.append(self.words(word, place, i.size, True, on(colour), colour, centre, seen))
        return "".join(out)

    def open(self, i):
        args = ",".join(f"{k}={v}" for k, v in i.macros.items())
        return self.widget("caRelatedDisplay", (i.x, i.y, i.w, i.h), [
            _property("label", "string", "-" + i.text, True),
            _property("labels", "string", i.text, True),
            _property("files", "string", i.display + ".ui", True),
            _property("args", "string", args, True),
            self.colour("foreground", BLACK), self.colour("background", BUTTON)])

    def order(self, i):
        """caQtDM asks no question: what needs one is a menu, two clicks, with its name above."""
        common = [_property("channel", "string", i.pv, True),
                  self.colour("foreground", BLACK), self.colour("background", BUTTON)]
        if i.ask:
            name = self.words(i.text, (i.x, i.y - 12, i.w, 14), 11, False, BLACK, BACKGROUND,
                              _property("alignment", "set", "Qt::AlignCenter"))
            return name + self.widget("caMenu", (i.x, i.y + 4, i.w, i.h - 4), common)
        return self.widget("caMessageButton", (i.x, i.y, i.w, i.h), [
            *common, _property("label", "string", i.text, True),
            _property("pressMessage", "string", i.value, True)])

    def plot(self, i):
        return self.widget("caCartesianPlot", (i.x, i.y, i.w, i.h), [
            _property("Title", "string", i.title, True), _property("TitleX", "string", "ms", True),
            _property("TitleY", "string", i.y_title, True),
            _property("channels_1", "string", f"{i.x_pv};{i.y_pv}", True),
            _property("XaxisType", "enum", "caCartesianPlot::log10", True),
            _property("XaxisScaling", "enum", "caCartesianPlot::User", True),
            _property("XaxisLimits", "string", "0.01;10000", True)])

    def frame(self, d, body):
        style = f"QWidget#centralWidget {{background: {_css(BACKGROUND)};}}"
        return (f'<?xml version="1.0" encoding="UTF-8"?>\n<!-- {escape(d.about)} -->\n'
                f'<ui version="4.0"><class>MainWindow</class>'
                f'<widget class="QMainWindow" name="MainWindow">{_rect(0, 0, d.w, d.h)}'
                f'{_property("windowTitle", "string", d.title)}'
                f'<widget class="QWidget" name="centralWidget">'
                f'{_property("styleSheet", "string", style)}'
                f"\n{body}\n</widget></widget></ui>\n")


class PyDM(Writer):
    def style(self, *rules):
        return _property("styleSheet", "string", " ".join(rules))

    def alignment(self, right):
        return _property("alignment", "set", "Qt::AlignRight|Qt::AlignVCenter" if right
                         else "Qt::AlignLeft|Qt::AlignVCenter")

    def font(self, size, bold):
        return f"font-family: 'Liberation Sans'; font-size: {size}px; " \
               f"font-weight: {'bold' if bold else 'normal'};"

    def label(self, i):
        return self.widget("QLabel", (i.x, i.y, i.w, i.h), [
            self.style(f"color: {_css(i.colour)}; {self.font(i.size, i.bold)}"),
            _property("text", "string", self.macros(i.text)), self.alignment(i.right)])

    def macros(self, text):
        return re.sub(r"\$\((\w+)\)", r"${\1}", text)

    def channel(self, pv):
        return _property("channel", "string", "ca://" + self.macros(pv), True)

    def value(self, i):
        pv = i.pv + ".VAL$" if i.long else i.pv
        more = [_property("displayFormat", "enum", "PyDMLabel::String", True)] if i.long else \
            [_property("showUnits", "bool", "true", True)]
        return self.widget("PyDMLabel", (i.x, i.y, i.w, i.h), [
            self.style(self.font(i.size, i.bold)), self.channel(pv), self.alignment(i.right),
            _property("precisionFromPV", "bool", "true", True), *more])

    def seen(self, pv, condition):
        return _property("rules", "string", json.dumps([{
            "name": "seen", "property": "Visible", "expression": condition,
            "initial_value": "False", "channels": [{"channel": "ca://" + self.macros(pv),
                                                    "trigger": True, "use_enum": False}]}]), True)

    def lamp(self, i):
        """Not connected, the frame is disabled, and all in it purple."""
        unknown = f"QLabel:disabled {{ background: {_css(PURPLE)}; color: {_css(PURPLE)}; }}"
        inside = self.widget("QLabel", (0, 0, i.w, i.h), [
            self.style(f"background: {_css(PURPLE)}; color: white; {self.font(i.size, True)}"),
            _property("text", "string", "?"), _property("alignment", "set", "Qt::AlignCenter")])
        for value, word, colour in i.states:
            style = (f"PyDMLabel {{ background: {_css(colour)}; color: {_css(on(colour))}; "
                     f"{self.font(i.size, True)} }} PyDMLabel:disabled {{ background: "
                     f"{_css(PURPLE)}; color: {_css(PURPLE)}; }}")
            inside += self.widget("PyDMLabel", (0, 0, i.w, i.h), [
                self.style(style), _property("text", "string", word),
                _property("alignment", "set", "Qt::AlignCenter"),
                self.seen(i.pv, f"ch[0] == {value}")])
        return self.widget("PyDMFrame", (i.x, i.y, i.w, i.h), [
            self.style(unknown), self.channel(i.pv), *self.part(i),
            _property("disableOnDisconnect", "bool", "true", True),
            _property("alarmSensitiveBorder", "bool", "false", True)], inside)

    def part(self, i):
        return [self.seen("$(P)State", f"'${{HAS_{i.part}}}' == '1'")] if i.part else []

    def open(self, i):
        macros = json.dumps({k: self.macros(v) for k, v in i.macros.items()})
        return self.widget("PyDMRelatedDisplayButton", (i.x, i.y, i.w, i.h), [
            self.style(self.font(13, False)), _property("text", "string", i.text), *self.part(i),
            _property("showIcon", "bool", "false", True),
            _property("filenames", "stringlist", f"<string>{i.display}.ui</string>", True),
            _property("macros", "stringlist", f"<string>{escape(macros)}</string>", True)])

    def order(self, i):
        ask = [_property("showConfirmDialog", "bool", "true", True),
               _property("confirmMessage", "string", self.macros(i.ask), True)] if i.ask else []
        return self.widget("PyDMPushButton", (i.x, i.y, i.w, i.h), [
            self.style(self.font(13, False)), _property("text", "string", i.text),
            self.channel(i.pv), _property("pressValue", "string", i.value, True), *ask])

    def plot(self, i):
        """Over the number of the bin: PyDM has no logarithmic x axis, and bins are one."""
        curve = json.dumps({"name": "", "x_channel": None,
                            "y_channel": "ca://" + self.macros(i.y_pv),
                            "color": "#005aa0", "lineWidth": 3, "symbol": None})
        title = self.widget("QLabel", (i.x, i.y, i.w, 20), [
            self.style(self.font(14, True)),
            _property("text", "string", f"{i.title}: {i.y_title} in each bin"),
            _property("alignment", "set", "Qt::AlignCenter")])
        return title + self.widget("PyDMWaveformPlot", (i.x, i.y + 20, i.w, i.h - 20), [
            _property("curves", "stringlist", f"<string>{escape(curve)}</string>", True),
            _property("showLegend", "bool", "false", True),
            _property("backgroundColor", "color", "<red>255</red><green>255</green>"
                      "<blue>255</blue>", True),
            _property("autoRangeX", "bool", "false", True),
            _property("minXRange", "double", 0, True),
            _property("maxXRange", "double", 64, True)])

    def frame(self, d, body):
        kinds = {"PyDMLabel": "QLabel", "PyDMFrame": "QFrame",
                 "PyDMRelatedDisplayButton": "QPushButton", "PyDMPushButton": "QPushButton",
                 "PyDMWaveformPlot": "QGraphicsView"}
        modules = {"PyDMLabel": "label", "PyDMFrame": "frame",
                   "PyDMRelatedDisplayButton": "related_display_button",
                   "PyDMPushButton": "pushbutton", "PyDMWaveformPlot": "waveformplot"}
        custom = "".join(
            f"<customwidget><class>{k}</class><extends>{v}</extends>"
            f"<header>pydm.widgets.{modules[k]}</header></customwidget>" for k, v in kinds.items())
        return (f'<?xml version="1.0" encoding="UTF-8"?>\n<!-- {escape(d.about)} -->\n'
                f'<ui version="4.0"><class>Form</class><widget class="QWidget" name="Form">'
                f'{_rect(0, 0, d.w, d.h)}{_property("windowTitle", "string", self.macros(d.title))}'
                f'{self.style(f"QWidget#Form {{ background: {_css(BACKGROUND)}; }}")}'
                f"\n{body}\n</widget><customwidgets>{custom}</customwidgets></ui>\n")
