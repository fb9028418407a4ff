"""Numbers, and what is said of other things in their place."""

from __future__ import annotations

import operator
from typing import Any

import numpy as np


def whole(name: str, value: Any, least: int = 0) -> int:
    """A whole number of at least ``least``."""
    try:
        number = operator.index(value)
    except TypeError:
        number = None
    if number is None or isinstance(value, bool) or not least <= number < 2**63:
        raise ValueError(f"{name} must be a whole number of at least {least}, not {value!r}")
    return number


def wholes(name: str, values: Any, *words: str) -> list[int]:
    """Whole numbers of at least 1, one for each of the words."""
    if np.shape(values) != (len(words),):
        raise ValueError(f"{name} must be {len(words)} whole numbers ({', '.join(words)}), not {values!r}")
    return [whole(name, value, 1) for value in values]


def number(name: str, value: Any) -> float:
    """Any number."""
    try:
        return float(value)
    except (TypeError, ValueError):
        raise ValueError(f"{name} must be a number, not {value!r}") from None
