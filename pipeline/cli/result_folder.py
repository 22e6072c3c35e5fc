"""The folder that a command writes: whole or not at all, with its log."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

from wiclosure.pipeline.runtime.log import json_log, warnings_on_terminal
from wiclosure.pipeline.runtime.output import default_folder, point_latest, require_apart, whole_folder

if TYPE_CHECKING:
    from wiclosure.pipeline.cli.options import Result


@contextmanager
def result_folder(result: Result, data: Sequence[str] = ()) -> Iterator[tuple[Path, Path]]:
    """The folder as it will be, and as it is until then; logs into it, and `latest` points to it at the end.

    Args:
        result: where it is wanted.
        data: words that name what is read, which must not lie in it.

    Raises:
        OutputError: see `wiclosure.pipeline.runtime.output.whole_folder` and `require_apart`.
    """
    folder = result.out if result.out is not None else default_folder()
    require_apart(folder, (Path(word.partition("=")[2] or word) for word in data))
    with (
        whole_folder(folder, overwrite=result.overwrite) as scratch,
        json_log(scratch / "log.jsonl"),
        warnings_on_terminal(),
    ):
        yield folder, scratch
    if result.out is None:
        point_latest(folder)
