"""YAML whose ids stay what is written: `0010`, `0x1A`, `1_1` and `12:30` are text, no numbers to bases 8, 16 and 60.

YAML 1.1, which PyYAML reads, makes 8, 26, 11 and 750 of them; tags of radios have such ids.
"""

from __future__ import annotations

import re
from typing import Any

import yaml

_INT, _FLOAT = "tag:yaml.org,2002:int", "tag:yaml.org,2002:float"
_WHOLE = re.compile(r"[-+]?(?:0|[1-9][0-9]*)$")
_DECIMAL = re.compile(
    r"[-+]?(?:[0-9]+\.[0-9]*|\.[0-9]+)(?:[eE][-+]?[0-9]+)?$|[-+]?\.(?:inf|Inf|INF)$|\.(?:nan|NaN|NAN)$"
)


class PlainLoader(yaml.SafeLoader):
    """PyYAML's safe loader with decimal numbers alone."""


PlainLoader.yaml_implicit_resolvers = {
    first: [(tag, pattern) for tag, pattern in resolvers if tag not in {_INT, _FLOAT}]
    for first, resolvers in yaml.SafeLoader.yaml_implicit_resolvers.items()
}
PlainLoader.add_implicit_resolver(_FLOAT, _DECIMAL, list("-+0123456789."))
PlainLoader.add_implicit_resolver(_INT, _WHOLE, list("-+0123456789"))


def load_yaml(text: str) -> Any:
    """What the text holds.

    Raises:
        yaml.YAMLError: it is no YAML.
    """
    return yaml.load(text, PlainLoader)
