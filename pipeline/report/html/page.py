"""One HTML file with styles, script and data inside it."""

from __future__ import annotations

import html
import json
from importlib.resources import files
from pathlib import Path
from typing import Any

from wiclosure import __version__
from wiclosure.errors import OutputError

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
<header><h1>{title}</h1></header>
<nav aria-label="Sections"><ul></ul></nav>
<main><p>This page needs JavaScript, and no network.</p></main>
<footer><p>Written by wiclosure {version}.</p><details><summary>Licences of what draws this page</summary>\
<pre>{licences}</pre></details></footer>
<script type="application/json" id="report-data">{data}</script>
<script>{script}</script>
</body>
</html>
"""


def write_page(path: Path, title: str, report: dict[str, Any]) -> None:
    """Writes a page that shows `report`.

    Args:
        path: of the HTML file.
        title: of the page.
        report: `verdict`, `numbers`, `comparison` and `runs`, as `source/src/main.js` reads them.

    Raises:
        OutputError: it cannot be written.
    """
    assets = files("wiclosure.pipeline.report.html") / "assets"
    script = (assets / "report.js").read_text(encoding="utf-8")
    page = _PAGE.format(
        title=html.escape(title),
        version=html.escape(__version__),
        style=(assets / "report.css").read_text(encoding="utf-8"),
        licences=html.escape((assets / "LICENSES.txt").read_text(encoding="utf-8")),
        data=embedded(report),
        script=script.replace("</script", "<\\/script"),
    )
    try:
        path.write_text(page, encoding="utf-8")
    except OSError as error:
        raise OutputError(f"{path} cannot be written: {error.strerror}") from error


def embedded(report: dict[str, Any]) -> str:
    """JSON that no text inside it can end: names in recordings may hold anything."""
    text = json.dumps(report, ensure_ascii=False, allow_nan=False, separators=(",", ":"))
    return text.replace("<", "\\u003c").replace("\u2028", "\\u2028").replace("\u2029", "\\u2029")
