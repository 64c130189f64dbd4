"""Plain values as TOML, which the compiled half reads and checks."""

from __future__ import annotations

import json
import math
import operator
from collections.abc import Mapping
from typing import Any, TypeVar

import numpy as np

_T = TypeVar("_T")


def as_toml(value: Any) -> str:
    """A number, text, truth value, list or table; numpy's scalars and arrays included."""
    if isinstance(value, (np.generic, np.ndarray)):
        value = value.tolist()
    if isinstance(value, Mapping):
        return "{ " + ", ".join(lines(value)) + " }"
    if isinstance(value, (list, tuple)):
        return "[" + ", ".join(map(as_toml, value)) + "]"
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, (int, float)):
        return repr(value)
    if isinstance(value, str):
        return json.dumps(value)
    raise TypeError(f"a {type(value).__name__} is no number, text, list or table")


def whole(name: str, value: Any, least: int = 0) -> int:
    """A whole number from ``least`` to 2^32 - 1."""
    number = operator.index(value)
    if not least <= number < 2**32:
        raise ValueError(f"{name} = {number}: a whole number from {least} to 2^32 - 1")
    return number


def positive(name: str, value: float | None) -> float | None:
    """A finite number above 0, or None."""
    if value is not None and not (value > 0 and math.isfinite(value)):
        raise ValueError(f"{name} = {value!r}: a number above 0")
    return value


def instance(name: str, value: Any, of: type[_T]) -> _T:
    """A value of this class."""
    if not isinstance(value, of):
        raise TypeError(f"{name}: a {of.__name__}, not a {type(value).__name__}")
    return value


def lines(table: Mapping[str, Any]) -> list[str]:
    """``KEY = VALUE`` of what is not None."""
    return [f"{key} = {as_toml(value)}" for key, value in table.items() if value is not None]
