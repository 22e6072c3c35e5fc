"""Names for the arrays that pass between functions, and how nouns take them in; shapes stand in the docstrings."""

from __future__ import annotations

from typing import TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from wiclosure.errors import InputError

FloatArray: TypeAlias = NDArray[np.float64]
Float32Array: TypeAlias = NDArray[np.float32]
IntArray: TypeAlias = NDArray[np.int64]
BoolArray: TypeAlias = NDArray[np.bool_]

_HOW_TO_NS = "give integer nanoseconds, for example np.rint(seconds * 1e9).astype(np.int64)"


def float_array(values: ArrayLike, name: str) -> FloatArray:
    """The values as float64: lists are converted, arrays of that type are taken as they are.

    Raises:
        InputError: they are no rectangular array of numbers.
    """
    try:
        array = np.asarray(values)
        if array.dtype.kind in "fiu":
            return np.asarray(array, np.float64)
    except ValueError:  # rows of different lengths
        pass
    raise InputError(f"{name}: expected an array of numbers, got {_described(values)}")


def stamp_array(values: ArrayLike, name: str) -> IntArray:
    """Stamps in nanoseconds as int64; floats, which are seconds or have lost digits, are refused.

    Raises:
        InputError: they are no integers.
    """
    array = np.asarray(values)
    if array.dtype.kind == "f" and array.size:
        raise InputError(f"{name} are floats, the first {array.flat[0]!s}; {_HOW_TO_NS}")
    if array.dtype.kind not in "iu" and array.size:
        raise InputError(f"{name}: expected integers, got {_described(values)}; {_HOW_TO_NS}")
    return np.asarray(array, np.int64)


def stamp(value: object, name: str) -> int:
    """One stamp in nanoseconds as an int.

    Raises:
        InputError: it is no integer.
    """
    if isinstance(value, (int, np.integer)) and not isinstance(value, bool):
        return int(value)
    raise InputError(f"{name} is {value!s}, a {type(value).__name__}; give integer nanoseconds: round(seconds * 1e9)")


def _described(values: object) -> str:
    shape = f" of shape {values.shape} and type {values.dtype}" if isinstance(values, np.ndarray) else ""
    return f"a {type(values).__name__}{shape}"
