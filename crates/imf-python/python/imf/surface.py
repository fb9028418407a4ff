"""What a tool reaches of a part's surface."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from . import _imf
from ._progress import Progress, listener
from .results import Verdict, optional

COLOURS = np.array([[120, 190, 110], [235, 140, 40], [170, 40, 130], [90, 90, 95]], dtype=np.uint8)
"""Red, green and blue of each :class:`Verdict`: told apart by brightness as well."""


class Obstruction(NamedTuple):
    """What keeps a fraction of the surface from being reached; several may at once."""

    element: str
    """Of the tool."""
    against: str
    """The part, or a fixture by its name."""
    fraction: float
    """Of the area."""


class Access:
    """The surface in small triangles, one sample in the middle of each, and what the tool reaches.

    Lengths are in ``unit``; points and directions are the world's, where the scene's transform sets the part up.
    """

    points: NDArray[np.float64]
    """``(n, 3)``: where the tool was tried for each face; small faces nearby that face alike share a place."""
    normals: NDArray[np.float64]
    """``(n, 3)``: outward unit normals."""
    areas: NDArray[np.float64]
    """``(n,)``."""
    verdict: NDArray[np.uint8]
    """``(n,)`` of :class:`Verdict`."""
    free: NDArray[np.bool_]
    """``(n, m)``: which samples are reached from which directions."""
    directions: NDArray[np.float64]
    """``(m, 3)``, from tip to holder."""
    rotations: NDArray[np.float64]
    """``(m, 4)``: the same as quaternions ``x, y, z, w``, which say the roll too; :func:`poses` takes them."""
    vertices: NDArray[np.float64]
    """``(3 n, 3)``: the triangles' own corners."""
    faces: NDArray[np.uint32]
    """``(n, 3)``: the triangle of each sample."""

    def __init__(self, native: _imf.Surface, unit: str) -> None:
        self._native = native
        self.unit = unit
        for name, array in native.arrays().items():
            setattr(self, name, array)

    def fraction(self, verdict: Verdict) -> float:
        """The fraction of the area that has a verdict."""
        return float(self.areas[self.verdict == verdict].sum() / self.areas.sum())

    @property
    def reached(self) -> float:
        """The fraction of the area that is reached."""
        return self.fraction(Verdict.REACHED)

    @property
    def reached_at_twice_the_pitch(self) -> float:
        """The same with voxels twice as large, and their tolerance unless one is given: a difference says that the answer has not converged."""
        return self._native.reached_at_twice_the_pitch

    @property
    def tolerance(self) -> float:
        """How deep the cutter may cut below the surface."""
        return self._native.tolerance

    @property
    def hidden_area(self) -> float:
        """Area inside the part or flush, where bodies of the mesh cross or touch each other: it counts for no sample."""
        return self._native.hidden_area

    @property
    def by_direction(self) -> NDArray[np.float64]:
        """``(m,)``: the fraction of the area that each direction reaches."""
        fractions: NDArray[np.float64] = self.areas @ self.free / self.areas.sum()
        return fractions

    @property
    def obstructed_by(self) -> list[Obstruction]:
        """What obstructs samples, with its fraction of the area."""
        return [Obstruction(*row) for row in self._native.obstructed_by()]

    def setups(
        self,
        limits: str | None = None,
        *,
        cover: float = 1.0,
        every_direction: bool = False,
        progress: Progress = None,
    ) -> SetupPlan:
        """The fewest set-ups of those that axes and part suggest, or of every direction, in which ``cover`` of what all of them reach
        is reached. The face that the part stands on is not reached in that set-up.

        limits: which directions the machine gives the tool in one set-up, its z axis up, such as ``ac:0:110:0:360`` or
        ``cone:0,0,1:30``; by default three axes. Raises ``ValueError`` for a scene with fixtures.
        """
        found = self._native.setups(limits or "cone:0,0,1:0", cover, every_direction, listener(progress))
        found["setups"] = [PartSetup(**setup) for setup in found["setups"]]
        return SetupPlan(**found)

    def stickout(self, *, progress: Progress = None) -> StickOuts:
        """The shortest stick-out for each sample. Raises ``ValueError`` for a tool without a holder."""
        length, direction, verdict, (given, shortest, longest) = self._native.stick_outs(listener(progress))
        return StickOuts(length, direction, verdict, self.areas, given, shortest, longest)

    def to_pyvista(self) -> Any:
        """A ``pyvista.PolyData`` of the triangles, with the cell values ``verdict``, ``directions`` (how many reach it) and ``rgb``."""
        pyvista = optional("pyvista", "to_pyvista()")
        mesh = pyvista.PolyData.from_regular_faces(self.vertices, self.faces.astype(np.int64))
        mesh.cell_data["verdict"] = self.verdict
        mesh.cell_data["directions"] = self.free.sum(axis=1)
        mesh.cell_data["rgb"] = COLOURS[self.verdict]
        return mesh

    def to_xarray(self) -> Any:
        """A ``xarray.Dataset`` over sample, direction and component."""
        xarray = optional("xarray", "to_xarray()")
        return xarray.Dataset(
            {
                "point": (("sample", "component"), self.points),
                "normal": (("sample", "component"), self.normals),
                "area": ("sample", self.areas),
                "verdict": ("sample", self.verdict),
                "free": (("sample", "direction"), self.free),
                "directions": (("direction", "component"), self.directions),
            },
            coords={"component": ["x", "y", "z"]},
            attrs={"unit": self.unit, "tolerance": self.tolerance},
        )


@dataclass(frozen=True, eq=False)
class Crib:
    """What each of many tools reaches of a surface."""

    names: list[str]
    """Of the tools."""
    verdict: NDArray[np.uint8]
    """``(tools, n)`` of :class:`Verdict`."""
    areas: NDArray[np.float64]
    """``(n,)``: the samples' areas."""
    vertices: NDArray[np.float64]
    """``(3 n, 3)``: the triangles' own corners."""
    faces: NDArray[np.uint32]
    """``(n, 3)``: the triangle of each sample."""

    @property
    def reached(self) -> NDArray[np.float64]:
        """``(tools,)``: the fraction of the area that each tool reaches."""
        fractions: NDArray[np.float64] = (self.verdict == Verdict.REACHED) @ self.areas / self.areas.sum()
        return fractions

    def fewest(self, cover: float = 1.0) -> FewestTools:
        """The fewest tools that reach ``cover`` of what all of them reach.

        Where as few do in several ways, those whose last is as early in the crib as possible: give the most rigid first.
        """
        holds = np.ascontiguousarray(self.verdict == Verdict.REACHED)
        chosen, at_least = _imf.fewest_sets(holds, self.areas, cover)
        fraction = float(self.areas[holds[chosen].any(axis=0)].sum() / self.areas.sum())
        return FewestTools(chosen, at_least, fraction)


class FewestTools(NamedTuple):
    """The fewest tools of a crib."""

    tools: list[int]
    """Their places in the crib; each adds the most to those before it."""
    at_least: int
    """No fewer reach as much: a proof where that is as many."""
    reached: float
    """The fraction of the area that they reach together."""


@dataclass(frozen=True, eq=False)
class PartSetup:
    """One way to put the part on the machine."""

    up: Sequence[float]
    """What of the part points along the machine's +z: a unit vector."""
    rotation: NDArray[np.float64]
    """``(3, 3)``: from the part's frame to the machine's."""
    rests: bool
    """The part stands so by itself."""
    floor_area: float
    """Area that it stands on."""
    directions: Sequence[int]
    """Rows of the directions that the machine gives the tool there."""
    reached: float
    """The fraction of the surface's area that it reaches."""
    alone: float
    """The fraction that no other chosen set-up reaches."""


@dataclass(frozen=True, eq=False)
class SetupPlan:
    """The fewest set-ups; fractions are of the surface's area."""

    setups: list[PartSetup]
    """Each adds the most to those before it."""
    by_sample: NDArray[np.int64]
    """``(n,)``: the first set-up that reaches the sample, counted from 0; -1 for none."""
    candidates: int
    """Set-ups that were compared."""
    at_least: int
    """No fewer of the candidates reach as much."""
    reached: float
    """What the set-ups reach together."""
    reachable: float
    """What all candidates reach together."""

    @property
    def is_proven(self) -> bool:
        """True where no fewer do."""
        return self.at_least == len(self.setups)


@dataclass(frozen=True, eq=False)
class StickOuts:
    """The shortest stick-out with which a tool reaches each sample of a surface, in the scene's unit."""

    length: NDArray[np.float64]
    """``(n,)``: the shortest; infinite where none helps. It may be more than the tool has."""
    direction: NDArray[np.int64]
    """``(n,)``: the first direction that allows it, -1 for none."""
    verdict: NDArray[np.uint8]
    """``(n,)`` of :class:`Verdict`, at the best stick-out."""
    areas: NDArray[np.float64]
    """``(n,)``: the samples' areas."""
    given: float
    """What the tool is set to."""
    shortest: float
    """The shortest that it can be set to."""
    longest: float
    """Its overall length; infinite where that is not known."""

    def fraction(self, length: float) -> float:
        """The fraction of the area that is reached with a length; with ``np.inf`` all that any length reaches."""
        # Infinite are those that no length helps.
        reached = np.isfinite(self.length) & (self.length <= length)
        return float(self.areas[reached].sum() / self.areas.sum())
