"""Exact answers for planners: is this pose free, is this motion?"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from . import _imf
from ._progress import Progress, listener
from .scene import Clearance, PoseReader, Scene, clearance_input, native_scene


class Motions(NamedTuple):
    """What is known of motions; times run from 0 at the beginning of one to 1 at its end."""

    decision: NDArray[np.uint8]
    """``(n,)`` of :class:`Decision`: free is proven for all poses between."""
    free_until: NDArray[np.float64]
    """``(n,)``: before this time no pose collides."""
    at: NDArray[np.float64]
    """``(n,)``: time of the first pose that was found to collide; NaN where none was."""


class Distances(NamedTuple):
    """How far a tool is from the part and fixtures, or how deep in them; lengths in the scene's unit."""

    lower: NDArray[np.float64]
    """``(n,)``: the distance is at least this. Above 0 between the tool, with its clearance, and the nearest solid voxel's centre; below 0
    minus the shortest translation that frees the tool."""
    upper: NDArray[np.float64]
    """``(n,)``: it is at most this, equal to ``lower`` where the tool is free."""
    element: list[str]
    """The element that is nearest; where the tool collides, the one whose stretch of the tool, with all clearances, holds the deepest
    voxel; empty where there is none."""
    tool_point: NDArray[np.float64]
    """``(n, 3)``: the point of that element's surface, with its clearance, nearest to ``obstacle_point``."""
    obstacle_point: NDArray[np.float64]
    """``(n, 3)``: the nearest voxel's centre; where the tool collides, the one deepest in its element."""


class Checker:
    """The tool of a scene around its part and fixtures, exactly: solid voxel centres in the analytic tool. Needs no model.

    clearance: room that the elements keep; by default the scene's. A pose with a number that is not finite is never free. Of a tool
    that is not round poses ``(n, 7)`` say the roll; those of six numbers are without roll, which a :class:`SceneWarning` says once.
    """

    def __init__(self, scene: Scene, clearance: Clearance | None = None) -> None:
        room = None if clearance is None else clearance_input(clearance)
        self._native = _imf.Checker(native_scene(scene), room)
        self._reader = PoseReader(self._native.is_round)

    def is_free(self, poses: ArrayLike, *, progress: Progress = None) -> bool | NDArray[np.bool_]:
        """True where the tool touches nothing: of one pose ``(6,)`` or ``(7,)`` a ``bool``, of many ``(n, 6)`` an array ``(n,)``."""
        rows, alone = self._reader.rows(poses)
        if alone:
            return self._native.is_free(rows)
        free: NDArray[np.bool_] = self._native.classify(rows, listener(progress)) == 0
        return free

    def classify(self, poses: ArrayLike, *, progress: Progress = None) -> NDArray[np.uint8]:
        """By pose a :class:`Decision` as a number, ``(n,)``: free or colliding."""
        return self._native.classify(self._reader.rows(poses)[0], listener(progress))

    def overlap(self, poses: ArrayLike, *, progress: Progress = None) -> NDArray[np.float32]:
        """By pose the fraction of the tool inside the obstacle, ``(n,)`` in [0, 1]; NaN for an invalid pose."""
        return self._native.values(self._reader.rows(poses)[0], listener(progress))

    def clearance(self, poses: ArrayLike, *, progress: Progress = None) -> NDArray[np.float64]:
        """By pose the signed clearance as far as it is proven, ``(n,)``, in the scene's unit.

        Above 0 the tool is free, and no solid centre is nearer to it; below 0 no shorter translation parts it from their centres; 0 where neither is
        proven, which :meth:`is_free` decides. Sooner found than :meth:`distance`. Raises ``ValueError`` for a mesh tool.
        """
        return self._native.clearance(self._reader.rows(poses)[0], listener(progress))

    def distance(self, poses: ArrayLike, *, progress: Progress = None) -> Distances:
        """How far the tool is from the nearest solid voxel, or how deep it is in part or fixtures, by pose; exact where it is free.

        Infinite where nothing is solid, NaN for an invalid pose. Raises ``ValueError`` for a mesh tool.
        """
        return Distances(*self._native.distance(self._reader.rows(poses)[0], listener(progress)))

    def check_motion(self, start: ArrayLike, end: ArrayLike, *, progress: Progress = None) -> Motions:
        """Whether the tool may move from each pose of ``start`` to that of ``end``, both ``(n, 6)`` or ``(n, 7)``: the tip along the
        line, the axis along the great circle.

        Raises ``ValueError`` for ends that are invalid poses or have opposite axes, and for a mesh tool.
        """
        return Motions(*self._native.check_motion(self._reader.rows(start)[0], self._reader.rows(end)[0], listener(progress)))
