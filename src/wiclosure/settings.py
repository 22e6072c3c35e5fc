"""Base class of every configuration model."""

from pydantic import BaseModel, ConfigDict


class Settings(BaseModel):
    """A frozen group of settings: unknown keys and values out of range are errors.

    Each field states its unit and the reason of its default in `Field(description=...)`; `wiclosure dump-config` prints
    them as comments.
    """

    model_config = ConfigDict(frozen=True, extra="forbid", validate_default=True, allow_inf_nan=False)
