"""Writes the parts of pages that are made of the code: every setting, every command.

python docs/reference.py
"""

from __future__ import annotations

import re
import types
import typing
from pathlib import Path
from typing import Any, Literal

import typer.main
import yaml
from pydantic import BaseModel
from pydantic.fields import FieldInfo
from typer.cli import get_docs_for_click

from wiclosure.pipeline.cli.commands import app
from wiclosure.pipeline.config import Config

DOCS = Path(__file__).resolve().parent
BOUNDS = {"gt": "> {}", "ge": ">= {}", "lt": "< {}", "le": "<= {}"}

MARK = "<!-- generated from here on: python docs/reference.py -->\n"


def settings_page() -> str:
    """The settings of a run, section by section."""
    return "\n".join(_sections(Config(), "", 2)).rstrip() + "\n"


def _sections(model: BaseModel, path: str, level: int) -> list[str]:
    own = [name for name in type(model).model_fields if not isinstance(getattr(model, name), BaseModel)]
    lines = []
    if own:
        lines += ["| setting | default | values | unit and meaning |", "|---|---|---|---|"]
        lines += [_row(model, name) for name in own]
        lines.append("")
    for name in type(model).model_fields:
        inner = getattr(model, name)
        if isinstance(inner, BaseModel):
            lines += [f"{'#' * min(level, 4)} `{path}{name}`", "", _summary(inner), ""]
            lines += _sections(inner, f"{path}{name}.", level + 1)
    return lines


def _row(model: BaseModel, name: str) -> str:
    field = type(model).model_fields[name]
    plain = model.model_dump(mode="json", include={name})[name]
    value = yaml.safe_dump(plain, default_flow_style=True, width=10_000).removesuffix("...\n").strip()
    return f"| `{name}` | `{value}` | {_values(field)} | {_cell(field.description or '')} |"


def _summary(model: BaseModel) -> str:
    return " ".join((type(model).__doc__ or "").split("\n\n")[0].split())


def _values(field: FieldInfo) -> str:
    bounds = [
        text.format(getattr(rule, key)) for rule in field.metadata for key, text in BOUNDS.items() if hasattr(rule, key)
    ]
    return ", ".join([*_kinds(field.annotation), *bounds])


def _kinds(annotation: Any) -> list[str]:
    if typing.get_origin(annotation) is Literal:
        return [f"`{value}`" for value in typing.get_args(annotation)]
    if typing.get_origin(annotation) in (typing.Union, types.UnionType):
        return [kind for part in typing.get_args(annotation) for kind in _kinds(part)]
    names = {bool: "`true`, `false`", int: "integer", float: "number", str: "text", type(None): "`null`"}
    return [names.get(annotation, "list")]


def _plain(text: str) -> str:
    return text.replace("<", "&lt;").replace("*", "\\*")


def _cell(text: str) -> str:
    return text.replace("|", "\\|")


def commands_page() -> str:
    """The command line, as `--help` has it."""
    command = typer.main.get_command(app)
    text = get_docs_for_click(obj=command, ctx=command.make_context("wiclosure", [], resilient_parsing=True))
    text = re.sub(r"\[/?bold\]", "", text)
    text = re.sub(r"\n\*\*Commands\*\*:\n.*?\n(?=\n#)", "\n", text, flags=re.DOTALL)  # their headings say it
    text = re.sub(r"^  (wiclosure .*)$", r"```sh\n\1\n```", text, flags=re.MULTILINE).replace("```\n\n```sh\n", "")
    text = re.sub(r"\n\* `--help`: Show this message and exit\.", "", text).replace("**Options**:\n\n\n", "")
    text = re.sub(r"```console\n\$ (.*?)\n```", r"```text\n\1\n```", text)
    text = re.sub(r"^# `wiclosure`\n", "", text)
    text = re.sub(r"^(\* `[^`]*`: )(.*)$", lambda found: found[1] + _plain(found[2]), text, flags=re.MULTILINE)
    return text.strip() + "\n"


PAGES = {"settings.md": settings_page, "commands.md": commands_page}


def page(name: str) -> str:
    """A page as it should be: what is written by hand, and below the mark what is made."""
    head, mark, _ = (DOCS / name).read_text(encoding="utf-8").partition(MARK)
    return f"{head}{mark}\n{PAGES[name]()}"


if __name__ == "__main__":
    for name in PAGES:
        (DOCS / name).write_text(page(name), encoding="utf-8")
