"""One thread for linear algebra: matrices here are small, and more threads only wait for each other."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable
from functools import lru_cache, wraps
from typing import TYPE_CHECKING, ParamSpec, TypeVar

if TYPE_CHECKING:
    from threadpoolctl import ThreadpoolController

_Given = ParamSpec("_Given")
_Result = TypeVar("_Result")


def one_blas_thread(work: Callable[_Given, _Result]) -> Callable[_Given, _Result]:
    """`work`, which has one thread of BLAS while it runs; then the caller has as many as before.

    Beside other work, threads that wait for one another make the back end ten times as slow; alone they gain nothing.
    """

    @wraps(work)
    def limited(*args: _Given.args, **kwargs: _Given.kwargs) -> _Result:
        with _loaded_libraries(len(sys.modules)).limit(limits=1, user_api="blas"):
            return work(*args, **kwargs)

    return limited


@lru_cache(maxsize=1)
def _loaded_libraries(_modules: int) -> ThreadpoolController:
    """Looked for again when modules have been imported, which is how libraries are loaded: it takes milliseconds."""
    from threadpoolctl import ThreadpoolController

    return ThreadpoolController()


def one_blas_thread_from_here() -> None:
    """The same for all of a process that has not loaded numpy yet; what the user has set stands."""
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
