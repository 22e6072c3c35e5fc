"""The site: `make docs` builds it strictly from these pages into build/docs, with nothing from the network."""

from __future__ import annotations

from pygments.lexers.special import TextLexer
from sphinx.application import Sphinx

from wiclosure import __version__

project = "wiclosure"
release = version = __version__
project_copyright = "the wiclosure contributors, BSD-3-Clause"
language = "en-GB"
smartquotes = False  # `--option` stays as it is

extensions = ["myst_nb", "sphinx.ext.autodoc", "sphinx.ext.napoleon"]
nitpicky = True
# Types of other projects are not looked up in their sites, and settings have pages of their own.
nitpick_ignore_regex = [("py:class", r"(?!wiclosure\.\w+$).*")]

autodoc_type_aliases = {name: name for name in ("FloatArray", "Float32Array", "IntArray", "BoolArray", "ArrayLike")}
autodoc_typehints_format = "short"
autodoc_member_order = "bysource"
napoleon_use_rtype = False
python_maximum_signature_line_length = 80

myst_heading_anchors = 4
myst_enable_extensions = ["deflist"]
nb_execution_mode = "off"  # a test runs the tutorial; its outputs are committed

html_theme = "furo"
html_title = "wiclosure"
html_static_path = ["_static"]
html_css_files = ["wide_tables.css"]
html_show_sphinx = False
html_copy_source = False
html_theme_options = {"navigation_with_keys": True}


def keep_colons(app: Sphinx, what: str, name: str, thing: object, options: object, lines: list[str]) -> None:
    """Napoleon takes the words before a colon in a property's first line for its type: an empty comment goes first."""
    if what in {"property", "attribute"}:
        lines[:0] = ["..", ""]


def known_defaults(
    app: Sphinx, what: str, name: str, thing: object, options: object, signature: str | None, returned: str | None
) -> tuple[str | None, str | None]:
    """Signatures with a default that is no Python (that of a field with a factory) would not be parsed."""
    return signature and signature.replace("<factory>", "..."), returned


def setup(app: Sphinx) -> None:
    """Tables are shown as they are."""
    app.add_lexer("csv", TextLexer)
    app.connect("autodoc-process-docstring", keep_colons, priority=400)
    app.connect("autodoc-process-signature", known_defaults)
