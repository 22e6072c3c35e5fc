"""Names that come in families: `/uwb/tof/n_{from}/n_{to}/distance` for topics, `range_{from}_{to}` for columns."""

from __future__ import annotations

import re
from dataclasses import dataclass
from functools import cached_property

from wiclosure.errors import ConfigError

_PLACE = re.compile(r"\{([A-Za-z_]\w*)(:d)?\}")


@dataclass(frozen=True)
class NamePattern:
    """A name with places `{from}` and `{to}` for the ids in it; `{to:d}` takes digits only.

    Places of other names stand for the one that measured, and then for the other: `n_{a}/n_{b}` is `n_{from}/n_{to}`,
    and a single `{id}` is the other.

    Raises:
        ConfigError: more than two places, or one of them twice.
    """

    text: str

    def __post_init__(self) -> None:
        names = [match[1] for match in _PLACE.finditer(self.text)]
        if len(names) > 2 or len(set(names)) != len(names):
            raise ConfigError(f"{self.text!r} has the places {', '.join(names)}; expected {{from}} and {{to}} at most")

    @property
    def is_family(self) -> bool:
        """Whether there is a place in it."""
        return _PLACE.search(self.text) is not None

    @cached_property
    def _roles(self) -> dict[str, str]:
        names = [match[1] for match in _PLACE.finditer(self.text)]
        free = [role for role in ("from", "to") if role not in names]
        if len(names) == 1 and names[0] not in {"from", "to"}:
            free = ["to"]
        return {name: name if name in {"from", "to"} else free.pop(0) for name in names}

    @property
    def roles(self) -> set[str]:
        """Which of `from` and `to` its places stand for."""
        return set(self._roles.values())

    @cached_property
    def _expression(self) -> re.Pattern[str]:
        parts: list[str] = []
        end = 0
        for match in _PLACE.finditer(self.text):
            allowed = "[0-9]+" if match[2] else "[^/]+?"
            parts += [re.escape(self.text[end : match.start()]), f"(?P<{match[1]}>{allowed})"]
            end = match.end()
        return re.compile("".join(parts) + re.escape(self.text[end:]))

    def match(self, name: str) -> dict[str, str] | None:
        """The ids in a name, under `from` and `to`; None where it is not of the family."""
        found = self._expression.fullmatch(name)
        return None if found is None else {self._roles[place]: text for place, text in found.groupdict().items()}

    def fits(self, name: str) -> bool:
        """Whether a name is of the family."""
        return self.match(name) is not None

    def filled(self, ids: dict[str, str]) -> str:
        """The name with those ids."""
        return _PLACE.sub(lambda match: ids.get(self._roles[match[1]], match[0]), self.text)
