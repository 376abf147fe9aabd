"""Sphinx: the documents of this folder as a site. `make docs` builds it into docs/O.site."""
import re
from pathlib import Path

from pygments.lexers.special import TextLexer

here = Path(__file__).parent
numbers = re.findall(r"^PLCLINK_\w+_VERSION = (\d+)$",
                     (here.parent / "configure/CONFIG_PLCLINK_VERSION").read_text(), re.MULTILINE)

project = "plclink"
copyright = "the authors of plclink, BSD-3-Clause"
release = ".".join(numbers)
version = ".".join(numbers[:2])

extensions = ["myst_parser"]
exclude_patterns = ["O.*"]
html_theme = "sphinx_rtd_theme"
html_title = f"plclink {release}"
html_static_path = ["static"]
html_css_files = ["site.css"]
html_extra_path = ["plc-tables.scl"]

# Links to headings of other pages, as a forge makes them; definition lists for the glossary.
myst_heading_anchors = 4
myst_enable_extensions = ["deflist"]

# Blocks without a language are commands, databases or printed text: nothing to colour.
highlight_language = "text"


def setup(app):
    """Languages that Pygments does not know stand as plain text."""
    for name in ("csv", "iocsh"):
        app.add_lexer(name, TextLexer)
