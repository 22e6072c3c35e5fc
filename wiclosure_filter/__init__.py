"""Where can trajectories of different robots meet?  By radio, before any scan is compared.

`make_filter(name)` gives a candidate filter; `WiClosureFilter` lives in `wiclosure.wiclosure_filter.filter`.
"""

from wiclosure.wiclosure_filter.config import FilterSettings
from wiclosure.wiclosure_filter.registry import FILTERS, make_filter

__all__ = ["FILTERS", "FilterSettings", "make_filter"]
