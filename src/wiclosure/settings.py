"""Base class of every configuration model."""

from types import UnionType
from typing import Any, Union, get_args, get_origin

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
        kind = cls.model_fields[info.field_name or ""].annotation
        kinds = set(get_args(kind)) if get_origin(kind) in {Union, UnionType} else {kind}
        if isinstance(value, bool) and kinds & _NUMBERS and bool not in kinds:
            raise ValueError("expected a number")
        return value
