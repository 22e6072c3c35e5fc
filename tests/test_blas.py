"""One thread of BLAS: while the work runs, and no longer."""

import os
import subprocess
import sys

import pytest
from threadpoolctl import threadpool_info, threadpool_limits

from wiclosure.blas import one_blas_thread


def threads() -> set[int]:
    return {library["num_threads"] for library in threadpool_info() if library["user_api"] == "blas"}


@one_blas_thread
def threads_at_work(fails: bool) -> set[int]:
    if fails:
        raise ValueError(threads())
    return threads()


def test_work_has_one_thread_and_the_caller_has_as_many_as_before() -> None:
    with threadpool_limits(2, "blas"):
        assert threads_at_work(False) == {1}
        with pytest.raises(ValueError, match=r"\{1\}"):
            threads_at_work(True)
        assert threads() == {2}


def test_libraries_loaded_between_two_calls_have_one_thread_too() -> None:
    code = (
        "from threadpoolctl import threadpool_info\n"
        "from wiclosure.blas import one_blas_thread\n"
        "threads = one_blas_thread(lambda: [library['num_threads'] for library in threadpool_info()])\n"
        "before = threads()\n"
        "import numpy\n"
        "print(before, {library['num_threads'] for library in threadpool_info()}, threads())"
    )
    environment = {**os.environ, "OPENBLAS_NUM_THREADS": "2"}
    done = subprocess.run([sys.executable, "-c", code], env=environment, capture_output=True, text=True, check=True)
    assert done.stdout.split() == ["[]", "{2}", "[1]"]


@pytest.mark.parametrize(("set_to", "there"), [(None, "1"), ("2", "2")])
def test_what_the_user_sets_for_a_process_stands(set_to: str | None, there: str) -> None:
    code = (
        "import os\n"
        f"os.environ.update({{}} if {set_to!r} is None else {{'OPENBLAS_NUM_THREADS': {set_to!r}}})\n"
        "from wiclosure.blas import one_blas_thread_from_here\n"
        "one_blas_thread_from_here()\n"
        "print(os.environ['OPENBLAS_NUM_THREADS'])"
    )
    environment = {name: value for name, value in os.environ.items() if name != "OPENBLAS_NUM_THREADS"}
    done = subprocess.run([sys.executable, "-c", code], env=environment, capture_output=True, text=True, check=True)
    assert done.stdout.split() == [there]
