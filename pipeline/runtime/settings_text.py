"""Settings as text: `key.path=value` words, layers laid over each other, and what is wrong with them as a sentence."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from pydantic import BaseModel, ValidationError

from wiclosure.errors import ConfigError, InputError
from wiclosure.formats.structured_text import DEEPEST, parse_yaml
from wiclosure.suggestions import nearest


def nested_words(words: Sequence[str], place: str) -> dict[str, Any]:
    """`key.path=value` words, values in YAML, as nested keys; `place` is where they stand, for messages.

    Raises:
        ConfigError: a word of another form.
    """
    nested: dict[str, Any] = {}
    for word in words:
        path, equals, value = word.partition("=")
        if not equals or not path:
            raise ConfigError(f"{place} {word}: expected key.path=value")
        nested = merged_settings(nested, nest(path.split("."), value))
    return nested


def nest(keys: Sequence[str], value: str) -> dict[str, Any]:
    """The value, read as YAML where it is some, below these keys.

    Raises:
        ConfigError: so many keys that no setting has them.
    """
    if len(keys) > DEEPEST:
        raise ConfigError(f"{'.'.join(keys)[:60]}...: {len(keys)} keys in each other; no setting is so deep")
    try:
        nested: Any = parse_yaml(value)
    except InputError:
        nested = value
    for key in reversed(keys):
        nested = {key: nested}
    assert isinstance(nested, dict)
    return nested


def merged_settings(below: dict[str, Any], above: dict[str, Any]) -> dict[str, Any]:
    """`above` laid over `below`, group by group."""
    merged = dict(below)
    for key, value in above.items():
        inner = merged.get(key)
        merged[key] = merged_settings(inner, value) if isinstance(inner, dict) and isinstance(value, dict) else value
    return merged


def explain(error: ValidationError, place: str, model: type[BaseModel]) -> str:
    """The first problem with the settings of that model as one sentence; unknown keys with a near one."""
    problem = error.errors()[0]
    location = [str(part) for part in problem["loc"]]
    key = ".".join(location)
    if problem["type"] == "extra_forbidden":
        known = _keys_at(model, location[:-1])
        near = nearest(location[-1], known)
        hint = f"did you mean {'.'.join([*location[:-1], near])}?" if near else f"known here: {', '.join(known)}"
        return f"unknown configuration key {key} in {place}; {hint}"
    message = problem["msg"].removeprefix("Value error, ")
    if problem["type"] in {"model_type", "dict_type"}:
        message = "expected keys with values (see wiclosure dump-config)"
    return f"configuration {key} = {_shown(problem['input'])} in {place}: {message[0].lower()}{message[1:]}"


def _shown(value: object) -> str:
    text = repr(value)
    return text if len(text) <= 200 else f"{text[:200]}..."


def _keys_at(model: type[BaseModel], path: list[str]) -> list[str]:
    """Known keys of the group at `path`."""
    for part in path:
        annotation = model.model_fields[part].annotation if part in model.model_fields else None
        if not (isinstance(annotation, type) and issubclass(annotation, BaseModel)):
            return []
        model = annotation
    return list(model.model_fields)
