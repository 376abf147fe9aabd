"""What a display is made of: words, values, lamps, buttons and plots at places in pixels.

Knows no tool that shows displays; the writers (bob, adl, ui) turn a Display into a file.
Texts may hold macros $(P), $(NAME). A lamp is a word on a colour for each value of a PV, and
purple while the PV is not connected: nothing is green that is not known to be good.
"""
RED, ORANGE, GREEN = (214, 30, 30), (255, 150, 30), (60, 180, 80)
GREY, BLUE, PURPLE = (190, 190, 190), (70, 130, 220), (200, 60, 200)
BACKGROUND, HEADING, BLACK, WHITE = (240, 240, 240), (90, 90, 90), (0, 0, 0), (255, 255, 255)

TIME = "2026-12-31 23:59:59.999"
TEXT = None  # any length: cut at the right, the whole text is in the PV


class Item:
    """Something at x, y with a width and a height. `kind` tells which of the rest it has."""

    def __init__(self, kind, x, y, w, h, **rest):
        self.kind, self.x, self.y, self.w, self.h = kind, x, y, w, h
        self.__dict__.update(rest)

    def texts(self):
        """Texts that must fit: (text, font size, bold)."""
        if self.kind == "label":
            return [(self.text, self.size, self.bold)]
        if self.kind == "value":
            return [(self.longest, self.size, self.bold)] if self.longest else []
        if self.kind == "lamp":
            return [(word, self.size, True) for _, word, _ in self.states]
        if self.kind in ("open", "order"):
            return [(self.text, 13, False)]
        return []

    def pvs(self):
        return [self.pv] if self.kind in ("value", "lamp", "order") else \
            [self.y_pv, self.x_pv] if self.kind == "plot" else []


class Display:
    """One display. `name` is that of its file, without the ending."""

    def __init__(self, name, title, w, h, about):
        self.name, self.title, self.w, self.h, self.about = name, title, w, h, about
        self.items = []

    def _add(self, *args, **rest):
        self.items.append(Item(*args, **rest))

    def label(self, text, x, y, w, h=20, size=14, bold=False, colour=BLACK, right=False):
        self._add("label", x, y, w, h, text=text, size=size, bold=bold, colour=colour,
                  right=right)

    def value(self, pv, x, y, w, h=20, size=14, bold=False, right=False, longest=TEXT,
              long=False, unit=True):
        """longest: what must fit. long: a long string, of which CA gives 40 characters."""
        self._add("value", x, y, w, h, pv=pv, size=size, bold=bold, right=right,
                  longest=longest, long=long, unit=unit)

    def lamp(self, pv, x, y, w, h, states, size=14, part=None):
        """states: (value, word, colour) ... part: as of open()."""
        self._add("lamp", x, y, w, h, pv=pv, states=states, size=size, part=part)

    def open(self, text, x, y, w, h, display, macros, part=None):
        """A button that opens a display. part: it is there only where this macro is 1."""
        self._add("open", x, y, w, h, text=text, display=display, macros=macros, part=part)

    def order(self, text, pv, x, y, w, h, value, ask):
        """A button that puts a value, after the question `ask` ("": at once)."""
        self._add("order", x, y, w, h, text=text, pv=pv, value=value, ask=ask)

    def plot(self, title, y_pv, x_pv, x, y, w, h, y_title):
        self._add("plot", x, y, w, h, title=title, y_pv=y_pv, x_pv=x_pv, y_title=y_title)

    def group(self, title, x, y, label_w, value_w, rows):
        """A heading, and below it lines of (words, PV, longest value)."""
        self.label(title, x, y, label_w + value_w, 20, 14, True, HEADING)
        for i, (words, pv, longest) in enumerate(rows):
            at = y + 24 + 24 * i
            self.label(words, x, at, label_w)
            number = longest not in (TEXT, TIME) and value_w < 200
            self.value("$(P)" + pv, x + label_w, at, value_w, right=number, longest=longest,
                       long=longest is TEXT)
