"""Plain values, as the compiled half takes them."""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any

import numpy as np


def _of_numpy(value: Any) -> Any:
    if isinstance(value, (np.generic, np.ndarray)):
        return value.tolist()
    raise TypeError(f"a {type(value).__name__} is no number, text, list or table")


def as_json(value: Any) -> str:
    """JSON of plain values, numpy's scalars and arrays included."""
    return json.dumps(value, default=_of_numpy, allow_nan=True)


def changes(keys: Mapping[str, Any]) -> list[str]:
    """``KEY=VALUE`` of keys of a camera file: JSON's numbers, texts and lists are TOML's."""
    return [f"{key}={as_json(value)}" for key, value in keys.items()]
