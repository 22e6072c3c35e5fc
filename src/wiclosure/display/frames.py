"""Data frames, where pandas is installed."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

from wiclosure.errors import ConfigError

if TYPE_CHECKING:
    import pandas as pd


def data_frame(columns: Mapping[str, Sequence[Any]]) -> pd.DataFrame:
    """A data frame of columns of equal length.

    Raises:
        ConfigError: pandas is not installed.
    """
    try:
        import pandas as pd
    except ImportError as error:
        raise ConfigError("to_dataframe needs pandas, which is not installed; pip install pandas") from error
    return pd.DataFrame(dict(columns))
