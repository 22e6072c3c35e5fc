"""Results appear whole or not at all: written aside, then renamed."""

from __future__ import annotations

import errno
import json
import shutil
import tempfile
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress
from datetime import datetime
from pathlib import Path

from wiclosure.errors import InputError, OutputError
from wiclosure.formats.structured_text import parse_json
from wiclosure.scratch import REPLACED, unfinished_file, unfinished_folder

MARK = ".wiclosure"
"""A file in every folder that is written here, which lists the others; no other folder is ever replaced."""
_SENTENCE = "written by wiclosure; --overwrite may replace this folder as long as it holds nothing else than\n"


def default_folder(results: Path = Path("results")) -> Path:
    """`results/<time>`, to the millisecond, so that runs started together do not meet."""
    return results / datetime.now().astimezone().strftime("%Y-%m-%d_%H-%M-%S.%f")[:-3]


def require_free(out: Path, *, overwrite: bool) -> None:
    """Fails before any work is done when `out` cannot become the result.

    Raises:
        OutputError: `out` exists and `overwrite` is false, or it is nothing that this program wrote, or its parent
            cannot be written.
    """
    here = Path.cwd().resolve()
    if out.is_symlink() and not out.exists():
        raise OutputError(f"{out} is a link to {out.readlink()}, which does not exist; choose another --out")
    if out.exists() and not overwrite:
        raise OutputError(f"{out} exists already; choose another --out, or replace it with --overwrite")
    if out.exists() and not out.is_dir():
        raise OutputError(f"{out} is a file, not a folder; choose another --out")
    if out.exists() and not (out / MARK).exists() and any(out.iterdir()):
        raise OutputError(f"{out} was not written by wiclosure and is not replaced; choose another --out")
    if out.exists() and out.resolve() in {here, *here.parents, Path.home().resolve()}:
        raise OutputError(f"{out} is where you are, or your home, and is not replaced; choose another --out")
    if out.exists() and (foreign := _foreign(out)):
        raise OutputError(
            f"{out} holds {foreign[0]!r}, which wiclosure did not write there, and is not replaced; move that away, or"
            " choose another --out"
        )
    if file := next((above for above in out.parents if above.is_file()), None):
        raise OutputError(f"{file} is a file, so nothing can be written below it; choose another --out")
    try:
        out.parent.mkdir(parents=True, exist_ok=True)
        tempfile.TemporaryFile(dir=out.parent).close()
    except OSError as error:
        raise OutputError(f"{out.parent} cannot be written ({_reason(error)}); choose another --out") from error


@contextmanager
def whole_folder(out: Path, *, overwrite: bool = False) -> Iterator[Path]:
    """Gives a scratch folder beside `out` that becomes `out` when the block ends well, and vanishes otherwise.

    Raises:
        OutputError: see `require_free`; also when the disk fills up inside the block.
    """
    require_free(out, overwrite=overwrite)
    try:
        scratch = unfinished_folder(out.parent.absolute())  # workers elsewhere may have another working folder
    except OSError as error:
        raise OutputError(f"{out.parent} cannot be written ({_reason(error)}); choose another --out") from error
    try:
        yield scratch
        (scratch / MARK).write_text(_SENTENCE + json.dumps(_content(scratch)) + "\n", encoding="utf-8")
        scratch.chmod(0o755)  # mkdtemp makes folders that nobody else can read
        require_free(out, overwrite=overwrite)  # again: another run may have been quicker
        _replace(out, scratch)
    except OSError as error:
        if error.errno in {errno.ENOSPC, errno.EDQUOT, errno.EFBIG}:
            raise OutputError(
                f"writing {out} failed ({_reason(error)}); make room or choose another --out; nothing unfinished stays"
            ) from error
        raise
    except OutputError as error:
        raise _about(out, scratch, error) from error
    finally:
        with suppress(FileNotFoundError):
            shutil.rmtree(scratch)


def require_apart(out: Path, inputs: Iterable[Path]) -> None:
    """Fails when writing `out` would touch what is read.

    Raises:
        OutputError: an input lies in `out`, or is `out`.
    """
    for path in inputs:
        if path.resolve().is_relative_to(out.resolve()):
            raise OutputError(f"writing {out} would replace {path}, which is read; choose another --out")


@contextmanager
def whole_file(path: Path, *, mode: int = 0o644) -> Iterator[Path]:
    """Gives a scratch path beside `path` that becomes `path` when the block ends well.

    Raises:
        OutputError: the file cannot be written.
    """
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        scratch = unfinished_file(path.parent)
    except OSError as error:
        raise OutputError(f"{path} cannot be written ({_reason(error)})") from error
    try:
        yield scratch
        scratch.chmod(mode)
        scratch.replace(path)
    except OSError as error:
        raise OutputError(f"writing {path} failed ({_reason(error)}); nothing half-written is left") from error
    except OutputError as error:
        raise _about(path, scratch, error) from error
    finally:
        scratch.unlink(missing_ok=True)


def write_json(path: Path, content: object) -> None:
    """Writes readable JSON."""
    path.write_text(json.dumps(content, indent=2, ensure_ascii=False, allow_nan=False) + "\n", encoding="utf-8")


def point_latest(out: Path) -> None:
    """Makes `latest` beside `out` a relative link to it; does nothing where a real folder has that name."""
    link = out.parent / "latest"
    if link.is_symlink() or not link.exists():
        scratch = out.parent / f".latest.{out.name}"
        scratch.unlink(missing_ok=True)
        scratch.symlink_to(out.name)
        scratch.replace(link)


def _content(folder: Path) -> list[str]:
    """All files and links in a folder, as they are called in it."""
    return sorted(str(path.relative_to(folder)) for path in folder.rglob("*") if path.is_symlink() or path.is_file())


def _foreign(out: Path) -> list[str]:
    """What lies in a result and was not written with it; nothing where the result does not say what was."""
    try:
        listed = parse_json((out / MARK).read_text(encoding="utf-8").removeprefix(_SENTENCE) or "null")
    except (OSError, UnicodeDecodeError, InputError):
        listed = None
    return sorted({*_content(out)} - {MARK, *listed}) if isinstance(listed, list) else []


def _replace(out: Path, scratch: Path) -> None:
    """Puts `scratch` where `out` is; the old folder is deleted only after the new one stands."""
    if not out.exists():
        scratch.rename(out)
        return
    old = unfinished_folder(out.parent, REPLACED)
    out.rename(old / out.name)
    scratch.rename(out)
    shutil.rmtree(old)


def _about(out: Path, scratch: Path, error: OutputError) -> OutputError:
    """The same, of the result's own place: the one aside is gone."""
    return OutputError(str(error).replace(str(scratch), str(out)))


def _reason(error: OSError) -> str:
    return error.strerror or str(error)
