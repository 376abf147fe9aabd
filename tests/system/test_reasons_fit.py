"""Each reason that becomes AMSG fits into its 39 characters, with the largest numbers that can be in it."""
import re

from client import TOP

SETS = re.compile(r"""(?:plcModbusLost\(x,|lostByTime\(x,|plcLineLost\(\w+,[^";]*?,|plcInputInvalidate\([^";]*?,
                      |epicsSnprintf\((?:why|reason|x\.why),\s*(?:PLC_REASON_SIZE|sizeof\([\w.]+\)),)\s*
                      ((?:"(?:[^"\\]|\\.)*"\s*)+)""", re.VERBOSE)
LARGEST = {"%u": "65535", "%d": "65535", "%.0f": "999", "%.1f": "3600.0", "%.34s": "x" * 34}
SAID_OTHERWISE = {"PLC sends %u bytes, inSize is %u"}  # where it does not fit: the next one
SIZES = {"PLC sends %u, inSize is %u"}


def longest(text):
    text = text.replace("function %u", "function 127").replace("instead of %u", "instead of 22")
    for form, value in LARGEST.items():
        text = text.replace(form, "16777216" if form == "%u" and text in SIZES else value)
    return text


def test_reasons_fit():
    """every text that is given as a reason is at most 39 characters long with its largest numbers"""
    found = []
    for folder in ("modbus", "src/station", "src/tcp"):
        for path in sorted((TOP / "s7plcApp" / folder).glob("*.c")):
            for match in SETS.finditer(path.read_text()):
                text = "".join(re.findall(r'"((?:[^"\\]|\\.)*)"', match.group(1)))
                if text not in SAID_OTHERWISE and text not in ("%s", "%s %.0f ms", "%s %.1f s"):
                    found.append((path.name, text))
    assert len(found) >= 25, found
    by_time = [("time", f"{what} {time}") for _, what in found if what.endswith((" for", " after"))
               for time in ("999 ms", "60.0 s")]
    long = [(name, longest(text)) for name, text in found + by_time
            if len(longest(text).replace("%s", "EtherNet/IP")) > 39]
    assert not long, long
