"""One HTML file with styles, script and data inside it; and the data of such a file, read back."""

from __future__ import annotations

import html
import json
import math
from importlib.metadata import version
from importlib.resources import files
from pathlib import Path
from typing import Any

from wiclosure.errors import InputError, OutputError
from wiclosure.formats.structured_text import parse_json
from wiclosure.pipeline.report.html.packing import sharing, without_sharing

PAGE = "report.html"
_BEGIN, _END = '<script type="application/json" id="report-data">', "</script>"
_PAGE = """<!doctype html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<meta http-equiv="Content-Security-Policy" content="default-src 'none'; style-src 'unsafe-inline'; \
script-src 'unsafe-inline'; img-src data: blob:">
<title>{title}</title>
<style>{style}</style>
</head>
<body>
<a class="skip" href="#main">Skip to the result</a>
<header><h1>{title}</h1></header>
<nav aria-label="Sections"><ul></ul></nav>
<main id="main" tabindex="-1"><noscript><p>This page needs JavaScript, and no network.</p></noscript></main>
<footer><p>Written by wiclosure {version}.</p><details><summary>Licences of what draws this page</summary>\
<pre tabindex="0">{licences}</pre></details></footer>
{begin}{data}{end}
<script>{script}</script>
</body>
</html>
"""


def write_page(path: Path, report: dict[str, Any]) -> None:
    """Writes a page that shows `report`.

    Args:
        path: of the HTML file.
        report: `title`, `kind`, `verdict`, `numbers`, `tables` and `runs`, as `source/src/main.js` reads them.

    Raises:
        OutputError: it cannot be written.
    """
    assets = files("wiclosure.pipeline.report.html") / "assets"
    style, script, licences = (
        (assets / name).read_text(encoding="utf-8") for name in ("report.css", "report.js", "LICENSES.txt")
    )
    page = _PAGE.format(
        title=html.escape(report["title"]),
        version=html.escape(version("wiclosure")),
        style=style.replace("</style", "<\\/style"),
        licences=html.escape(licences),
        begin=_BEGIN,
        data=embedded(sharing(report)),
        end=_END,
        script=script.replace("</script", "<\\/script"),
    )
    try:
        path.write_text(page, encoding="utf-8")
    except OSError as error:
        raise OutputError(f"{path} cannot be written: {error.strerror}") from error


def read_page(path: Path) -> dict[str, Any]:
    """The report that a page shows.

    Raises:
        InputError: it cannot be read, or is not such a page.
    """
    try:
        page = path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        reason = error.strerror if isinstance(error, OSError) else "it is no text"
        raise InputError(f"{path} cannot be read: {reason}") from error
    _, begin, rest = page.partition(_BEGIN)
    try:
        report = without_sharing(parse_json(rest.partition(_END)[0]))
    except (InputError, ValueError, KeyError, IndexError, TypeError) as error:
        raise InputError(f"{path} holds no report of wiclosure, or is damaged; run again") from error
    if not begin or "title" not in report or "runs" not in report:
        raise InputError(f"{path} holds no report of wiclosure; run again")
    return report


def embedded(report: dict[str, Any]) -> str:
    """JSON that no text inside it can end: names in recordings may hold anything.  What is no number becomes null."""
    text = json.dumps(_plain(report), ensure_ascii=True, allow_nan=False, separators=(",", ":"))
    return text.replace("<", "\\u003c")


def _plain(node: Any) -> Any:
    if isinstance(node, float):
        return float(node) if math.isfinite(node) else None
    if isinstance(node, dict):
        return {str(key): _plain(value) for key, value in node.items()}
    return [_plain(value) for value in node] if isinstance(node, list | tuple) else node
