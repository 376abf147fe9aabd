"""A display as an .adl of MEDM. A lamp is a pile of rectangles with words, of which one is
seen (calc). MEDM asks no questions before a put, so an order is a menu, two clicks, with its
name above. MEDM shows no units of PVs: they stand beside the values. Its fonts follow the height
of a widget, and are wider than those of others: what has words is made less high.
"""
from .layout import (BACKGROUND, BLACK, BLUE, GREEN, GREY, HEADING, ORANGE, PURPLE, RED, WHITE)

ENDING = "adl"
COLOURS = [WHITE, BLACK, BACKGROUND, GREY, HEADING, RED, ORANGE, GREEN, BLUE, PURPLE,
           (215, 225, 240), (0, 90, 160)]
BUTTON, TRACE = 10, 11
UNIT_ROOM = {"": 0, "s": 14, "ms": 26, "%": 18, "bytes": 42}  # pixels
NAME = 12  # pixels: the name above a menu


def _number(colour):
    return COLOURS.index(colour)


def on(colour):
    """The colour of words on this one."""
    return BLACK if colour in (ORANGE, GREY) else WHITE


def _block(name, *lines):
    return [name + " {", *("\t" + line for line in lines), "}"]


def _object(x, y, w, h):
    return _block("object", f"x={x}", f"y={y}", f"width={w}", f"height={h}")


def _basic(colour):
    return _block('"basic attribute"', f"clr={_number(colour)}")


def _seen(pv, condition):
    return _block('"dynamic attribute"', 'vis="calc"', f'calc="{condition}"', f'chan="{pv}"') \
        if condition else []


def _words(text, x, y, w, size, colour, align, height, pv="", condition=""):
    h = min(size, height)
    return _block("text", *_object(x, y + (height - h) // 2, w, h), *_basic(colour),
                  *_seen(pv, condition), f'textix="{text}"', f'align="{align}"')


def _label(i):
    return _words(i.text, i.x, i.y, i.w, i.size, i.colour,
                  "horiz. right" if i.right else "horiz. left", i.h)


def _value(i):
    pv = i.pv + ".VAL$" if i.long else i.pv
    h = min(i.size + 1, i.h)
    unit = i.longest.split()[-1] if i.longest and i.longest[-1] not in "0123456789" else ""
    room = UNIT_ROOM[unit]
    wide = i.w if i.right or not unit else min(i.w, 10 * len(i.longest))
    beside = _words(unit, i.x + wide - room + 3, i.y, room - 3, i.size, BLACK, "horiz. left", i.h) \
        if unit else []
    return beside + _block('"text update"', *_object(i.x, i.y + (i.h - h) // 2, wide - room, h),
                  *_block("monitor", f'chan="{pv}"', f"clr={_number(BLACK)}",
                          f"bclr={_number(BACKGROUND)}"),
                  f'align="horiz. {"right" if i.right or unit else "left"}"',
                  *(['format="string"'] if i.long else []), "limits {", "}")


def _lamp(i):
    if i.part:  # MEDM cannot leave it out, and would show it white
        return []
    out = []
    for condition, word, colour in [("", "?", PURPLE)] + [(f"A={v}", w, c)
                                                          for v, w, c in i.states]:
        out += _block("rectangle", *_object(i.x, i.y, i.w, i.h), *_basic(colour),
                      *_seen(i.pv, condition))
        out += _words(word, i.x, i.y, i.w, i.size, on(colour), "horiz. centered", i.h, i.pv,
                      condition)
    return out


def _button(i):
    """Less high than elsewhere: place in x, y, width, height."""
    h = min(22, i.h)
    return i.x, i.y + (i.h - h) // 2, i.w, h


def _open(i):
    args = ",".join(f"{k}={v}" for k, v in i.macros.items())
    return _block('"related display"', *_object(*_button(i)),
                  *_block("display[0]", f'label="{i.text}"', f'name="{i.display}.adl"',
                          f'args="{args}"'),
                  f"clr={_number(BLACK)}", f"bclr={BUTTON}", f'label="-{i.text}"')


def _order(i):
    control = _block("control", f'chan="{i.pv}"', f"clr={_number(BLACK)}", f"bclr={BUTTON}")
    if i.ask:
        return _words(i.text, i.x, i.y - NAME, i.w, NAME, BLACK, "horiz. centered", NAME) + \
            _block("menu", *_object(i.x, i.y + 4, i.w, i.h - 4), *control)
    return _block('"message button"', *_object(*_button(i)), *control,
                  f'label="{i.text}"', f'press_msg="{i.value}"')


def _plot(i):
    return _block('"cartesian plot"', *_object(i.x, i.y, i.w, i.h),
                  *_block("plotcom", f'title="{i.title}"', 'xlabel="ms"',
                          f'ylabel="{i.y_title}"', f"clr={_number(BLACK)}",
                          f"bclr={_number(BACKGROUND)}"),
                  *_block("trace[0]", f'xdata="{i.x_pv}"', f'ydata="{i.y_pv}"',
                          f"data_clr={TRACE}"),
                  *_block("x_axis", 'axisStyle="log10"', 'rangeStyle="user-specified"',
                          "minRange=0.010000", "maxRange=10000.000000"),
                  *_block("y1_axis", 'rangeStyle="auto-scale"'))


WRITERS = {"label": _label, "value": _value, "lamp": _lamp, "open": _open, "order": _order,
           "plot": _plot}


def write(display):
    colours = [("%02x%02x%02x," % c) for c in COLOURS]
    out = ["", *_block("file", f'name="{display.name}.adl"', "version=030107"),
           *_block("display", *_object(40, 40, display.w, display.h), f"clr={_number(BLACK)}",
                   f"bclr={_number(BACKGROUND)}", 'cmap=""', "gridSpacing=5", "gridOn=0",
                   "snapToGrid=0"),
           *_block('"color map"', f"ncolors={len(COLOURS)}", *_block("colors", *colours))]
    for i in display.items:
        out += WRITERS[i.kind](i)
    return "\n".join(out) + "\n"
