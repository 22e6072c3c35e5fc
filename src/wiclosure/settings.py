"""Base class of every configuration model."""

from collections.abc import Mapping
from types import UnionType
from typing import Annotated, Any, Union, get_args, get_origin

from pydantic import BaseModel, ConfigDict, ValidationInfo, field_validator

_NUMBERS = {int, float}


class Settings(BaseModel):
    """A frozen group of settings: unknown keys and values out of range are errors.

    Each field states its unit and the reason of its default in `Field(description=...)`; `wiclosure dump-config` prints
    them as comments.
    """

    model_config = ConfigDict(frozen=True, extra="forbid", validate_default=True, allow_inf_nan=False)

    @field_validator("*", mode="before")
    @classmethod
    def _no_truth_for_a_number(cls, value: Any, info: ValidationInfo) -> Any:
        """YAML reads `yes` and `on` as true, which would pass for 1."""
        if _truth_for_a_number(value, [cls.model_fields[info.field_name or ""].annotation]):
            raise ValueError("expected a number")
        return value


def _truth_for_a_number(value: object, kinds: list[Any]) -> bool:
    """Whether a value of one of these kinds is, or holds, true or false where a number belongs."""
    kinds = [plain for kind in kinds for plain in _alternatives(kind)]
    if isinstance(value, bool):
        return not _NUMBERS.isdisjoint(kinds) and bool not in kinds
    if not isinstance(value, Mapping | list | tuple):
        return False
    within = [inner for kind in kinds for inner in get_args(kind)]
    entries = [*value, *value.values()] if isinstance(value, Mapping) else value
    return any(_truth_for_a_number(entry, within) for entry in entries)


def _alternatives(kind: Any) -> list[Any]:
    """The kinds that a union holds, without what is noted beside them."""
    if get_origin(kind) is Annotated:
        return _alternatives(get_args(kind)[0])
    if get_origin(kind) in {Union, UnionType}:
        return [plain for one in get_args(kind) for plain in _alternatives(one)]
    return [kind]
