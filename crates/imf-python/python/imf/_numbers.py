"""Numbers, and what is said of other things in their place."""

from __future__ import annotations

import operator
from typing import Any

import numpy as np


def unmasked(given: Any) -> Any:
    """What is no masked array, or one in which nothing is masked."""
    if np.ma.is_masked(given):
        raise ValueError("a masked array has no number where it is masked: take these rows out, or fill them (numpy.ma.filled)")
    return given


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
