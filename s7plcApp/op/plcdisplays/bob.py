"""A display as a .bob of Phoebus. Only widgets: no rules, no scripts."""
from xml.sax.saxutils import escape

from .layout import BACKGROUND, PURPLE

ENDING = "bob"


def _colour(tag, c):
    return f'<{tag}><color red="{c[0]}" green="{c[1]}" blue="{c[2]}"/></{tag}>'


def _font(size, bold=False):
    style = "BOLD" if bold else "REGULAR"
    return f'<font><font family="Liberation Sans" style="{style}" size="{size:.1f}"/></font>'


def _tags(**values):
    return "".join(f"<{k}>{escape(str(v))}</{k}>" for k, v in values.items())


def _label(i):
    return "label", "2.0.0", (_tags(text=i.text) + _font(i.size, i.bold) +
                              _colour("foreground_color", i.colour) +
                              _tags(vertical_alignment=1, horizontal_alignment=2 * i.right,
                                    wrap_words="false"))


def _value(i):
    # Phoebus takes a bare $ for a macro that is missing, and logs that; in the name of the PV
    # that its tooltip would show, too.
    pv = i.pv + ".VAL\\$" if i.long else i.pv
    return "textupdate", "2.0.0", (
        _tags(pv_name=pv) + _font(i.size, i.bold) + (_tags(format=6, tooltip=i.pv) if i.long else "") +
        _tags(horizontal_alignment=2 * i.right, vertical_alignment=1, wrap_words="false"))


def _lamp(i):
    states = "".join(f"<state>{_tags(value=v, label=word)}{_colour('color', c)}</state>"
                     for v, word, c in i.states)
    return "multi_state_led", "2.0.0", _visible(i) + (
        _tags(pv_name=i.pv) + f"<states>{states}</states>" + _tags(fallback_label="?") +
        _colour("fallback_color", PURPLE) + _font(i.size, True) + _tags(square="true"))


def _visible(i):
    return _tags(visible=f"$(HAS_{i.part}=false)") if i.part else ""


def _open(i):
    # A part is a number elsewhere; Phoebus takes true and false.
    macros = "".join(
        _tags(**{k: v if not k.startswith("HAS_") else
                 {"0": "false", "1": "true"}.get(v, f"$({k}=false)")})
        for k, v in i.macros.items())
    return "action_button", "3.0.0", (
        f'<actions><action type="open_display"><file>{i.display}.bob</file><macros>{macros}'
        f"</macros><target>tab</target>{_tags(description=i.text)}</action></actions>" +
        _tags(text=i.text) + _visible(i))


def _order(i):
    ask = _tags(confirm_message=i.ask, show_confirm_dialog="true") if i.ask else ""
    return "action_button", "3.0.0", (
        f'<actions><action type="write_pv">{_tags(pv_name=i.pv, value=i.value)}'
        f"{_tags(description=i.text)}</action></actions>" + _tags(text=i.text, pv_name=i.pv) +
        ask)


def _plot(i):
    # Fixed, since a logarithmic axis without data would begin at 1E-323.
    x = _tags(title="ms", autoscale="false", log_scale="true", minimum="0.01",
              maximum="10000.0", show_grid="true")
    y = _tags(title=i.y_title, autoscale="true", log_scale="false", minimum="0.0",
              maximum="100.0", show_grid="true")
    trace = (_tags(name="", x_pv=i.x_pv, y_pv=i.y_pv, axis=0, trace_type=5) +
             _colour("color", (0, 90, 160)) + _tags(line_width=3, visible="true"))
    return "xyplot", "3.0.0", (
        _tags(title=i.title, show_legend="false", show_toolbar="false") +
        _colour("background_color", BACKGROUND) + f"<x_axis>{x}</x_axis><y_axes><y_axis>{y}"
        f"</y_axis></y_axes><traces><trace>{trace}</trace></traces>")


WRITERS = {"label": _label, "value": _value, "lamp": _lamp, "open": _open, "order": _order,
           "plot": _plot}


def write(display):
    out = ['<?xml version="1.0" encoding="UTF-8"?>', f"<!-- {escape(display.about)} -->",
           '<display version="2.0.0">', "  " + _tags(name=display.title, width=display.w,
                                                      height=display.h),
           "  " + _colour("background_color", BACKGROUND)]
    for n, i in enumerate(display.items):
        kind, version, body = WRITERS[i.kind](i)
        out += [f'  <widget type="{kind}" version="{version}">',
                "    " + _tags(name=f"{i.kind} {n}", x=i.x, y=i.y, width=i.w, height=i.h),
                "    " + body, "  </widget>"]
    return "\n".join(out + ["</display>"]) + "\n"
