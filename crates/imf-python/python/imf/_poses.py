"""Poses as arrays of rows."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ._numbers import unmasked


def poses(positions: ArrayLike, directions: ArrayLike) -> NDArray[np.float64]:
    """Rows of poses ``(n, 6)`` or ``(n, 7)`` from tips and directions, one of either for all of the other.

    positions: ``(3,)`` or ``(n, 3)``, in the scene's unit; directions: ``(3,)`` or ``(n, 3)`` from tip to holder, or quaternions
    ``x, y, z, w``, ``(4,)`` or ``(n, 4)``.
    """
    tips, turns = np.atleast_2d(numbers(positions)), np.atleast_2d(numbers(directions))
    if tips.ndim != 2 or tips.shape[1] != 3:
        raise ValueError(f"positions must have the shape (n, 3), not {np.shape(positions)}")
    if turns.ndim != 2 or turns.shape[1] not in (3, 4):
        raise ValueError(f"directions must have the shape (n, 3) or (n, 4), not {np.shape(directions)}")
    count = len(turns) if len(tips) == 1 else len(tips)
    if len(tips) not in (1, count) or len(turns) not in (1, count):
        raise ValueError(f"{len(tips)} positions and {len(turns)} directions: give as many of both, or one of either")
    rows = np.empty((count, 3 + turns.shape[1]))
    rows[:, :3], rows[:, 3:] = tips, turns
    return rows


def numbers(given: ArrayLike) -> NDArray[np.float64]:
    """Numbers as the native module reads them, in place where they are so: in rows, and aligned."""
    return np.require(unmasked(given), np.float64, ["C_CONTIGUOUS", "ALIGNED"])


def rows_of(given: ArrayLike) -> tuple[NDArray[np.float64], bool]:
    """Poses as contiguous rows, in place where they are so, and whether one pose was given alone."""
    rows = numbers(given)
    alone = np.ndim(given) == 1
    if alone:
        rows = rows.reshape(1, -1)
    if rows.ndim != 2:
        raise ValueError(f"poses must have the shape (n, 6) or (n, 7), not {np.shape(given)}")
    return rows, alone
