"""Plain values as TOML, which the compiled half reads and checks."""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any

import numpy as np


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


def lines(table: Mapping[str, Any]) -> list[str]:
    """``KEY = VALUE`` of what is not None."""
    return [f"{key} = {as_toml(value)}" for key, value in table.items() if value is not None]
