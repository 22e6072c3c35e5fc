"""How sources are written: `-w log.csv,preset=miluv,unit=mm`, `-w mapping.yaml`, and the entries of a data set file."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path

from pydantic import ValidationError

from wiclosure.errors import InputError
from wiclosure.formats.structured_text import read_yaml
from wiclosure.pipeline.radio.presets import preset_settings
from wiclosure.pipeline.radio.source import RadioSource, keys
from wiclosure.pipeline.runtime.paths import exists, expanded, is_endless, is_file
from wiclosure.pipeline.runtime.settings_text import nested_words
from wiclosure.suggestions import did_you_mean


def sources_of_words(words: Iterable[str]) -> tuple[RadioSource, ...]:
    """The sources that words of a command line name.

    A word is a path, with settings behind commas where it needs some (`uwb.csv,unit=mm,robots.7=alpha`), or a YAML file
    that holds one source or a list of them (its paths are relative to it).

    Raises:
        InputError: a file does not exist.
        ConfigError: unknown settings, or impossible values; names the word.
    """
    return tuple(source for word in words for source in _of_word(word))


def sources_of_entries(entries: object, folder: Path, where: str) -> tuple[RadioSource, ...]:
    """The sources of a YAML list (or of a single entry), each a path or a mapping.

    Args:
        entries: as YAML gives them.
        folder: that paths are relative to.
        where: the file, in messages.

    Raises:
        InputError: not of that form, or a file does not exist; names the file and the key.
    """
    listed = entries if isinstance(entries, list) else [entries]
    return tuple(_of_entry(entry, folder, where) for entry in listed if entry is not None)


def _of_word(word: str) -> tuple[RadioSource, ...]:
    whole = expanded(word)
    if exists(whole) or "," not in word:
        if whole.suffix.lower() in {".yaml", ".yml"} and is_file(whole):
            return sources_of_entries(read_yaml(whole), whole.parent, str(whole))
        return (_of_entry(word, Path(), f"--wireless {word}"),)
    path, *settings = word.split(",")
    stated = nested_words(settings, f"--wireless {word}:")
    return (_of_entry({"path": path, **stated} if path else stated, Path(), f"--wireless {word}"),)


def _of_entry(entry: object, folder: Path, where: str) -> RadioSource:
    if isinstance(entry, str):
        entry = {"path": entry}
    if not isinstance(entry, Mapping):
        raise InputError(f"{where}: a wireless source is {str(entry)[:60]!r}; expected a path, or keys with values")
    stated = {str(key): value for key, value in entry.items()}
    if isinstance(stated.get("path"), str):
        path = folder / expanded(stated["path"])
        if not exists(path):
            raise InputError(
                f"{where}: wireless log names {path}, which does not exist; paths are relative to where they are named"
            )
        if is_endless(path):
            raise InputError(f"{where}: wireless log names {path}, which is neither a file nor a folder; name one")
        stated["path"] = path
    try:
        if isinstance(name := stated.pop("preset", None), str):
            stated = {**preset_settings(name, folder), **stated}
        return RadioSource.model_validate(stated)
    except InputError as error:
        raise InputError(f"{where}: {error}") from None
    except ValidationError as error:
        raise InputError(f"{where}: {_problem(error)}") from None


def _problem(error: ValidationError) -> str:
    """The first problem as one sentence; unknown keys with a near one."""
    problem = error.errors()[0]
    key = ".".join(str(part) for part in problem["loc"][:2])
    if problem["type"] == "extra_forbidden":
        hint = did_you_mean(key, keys()) or f"known: {', '.join(keys())}"
        return f"wireless source with unknown key {key!r}; {hint}".rstrip()
    message = problem["msg"].removeprefix("Value error, ")
    named = f"{key} is {str(problem['input'])[:60]!r}: " if key else ""
    return f"{named}{message[0].lower()}{message[1:]}"
