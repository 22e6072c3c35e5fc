"""The pages, for all tests of them."""

from pathlib import Path

REPOSITORY = Path(__file__).resolve().parents[2]
DOCS = sorted((REPOSITORY / "docs").glob("*.md"))
PAGES = [REPOSITORY / "README.md", REPOSITORY / "CONTRIBUTING.md", *DOCS]


def text_of(page: Path) -> str:
    return page.read_text(encoding="utf-8")
