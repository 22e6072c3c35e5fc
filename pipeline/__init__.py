"""Composes the packages: sources, runs, comparisons, evaluation, and the command line."""

from typing import TYPE_CHECKING

from wiclosure.lazy import offer

if TYPE_CHECKING:
    from wiclosure.pipeline.api import run as run
    from wiclosure.pipeline.config import Config as Config
    from wiclosure.pipeline.config import load_config as load_config
    from wiclosure.pipeline.sources.open import open_source as open_source
    from wiclosure.pipeline.stages.run_result import RunResult as RunResult
else:
    __getattr__, __dir__, __all__ = offer(
        __name__,
        {
            "wiclosure.pipeline.api": "run",
            "wiclosure.pipeline.config": "Config load_config",
            "wiclosure.pipeline.sources.open": "open_source",
            "wiclosure.pipeline.stages.run_result": "RunResult",
        },
    )
