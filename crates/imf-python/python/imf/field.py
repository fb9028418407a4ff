"""Fields of every direction: trained of a scene, or read from a file."""

from __future__ import annotations

import os
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from . import _imf
from ._numbers import whole, wholes
from ._poses import numbers
from ._progress import Progress, listener
from .results import Grid
from .scene import Directions, PoseReader, Scene, directions_input, native_scene, rolled
from .tool import Tool


class Gradient(NamedTuple):
    """Values and how they change.

    In a network that is reduced by a symmetry about an axis (:attr:`Field.symmetry`) the error of gradients grows towards that axis.
    Within half a voxel of it they are clamped, and not to be trusted.
    """

    value: NDArray[np.float32]
    """``(n,)``, not clipped."""
    position: NDArray[np.float32]
    """``(n, 3)``: change for a move of the tip by one unit of length."""
    direction: NDArray[np.float32]
    """``(n, 3)``: change for a turn of the tool's axis by a radian, tangent to the sphere at the axis."""
    rotation: NDArray[np.float32]
    """``(n, 3)``: change for a turn of the whole tool by a radian, as a vector in the world's frame."""


class Best(NamedTuple):
    """The best of some directions at points."""

    value: NDArray[np.float32]
    """``(n,)``: the minimum, of an overlap within [0, 1]."""
    direction: NDArray[np.uint32]
    """``(n,)``: the row of the lowest value before it is brought into [0, 1], so that of many that are free it is the one most so."""
    decision: NDArray[np.uint8]
    """``(n,)`` of :class:`Decision`."""


class Field:
    """A field of every position and direction; ``field(poses)`` are its values.

    Of ``quantity`` "overlap" a value is the fraction of the tool inside the obstacle, of "depth" how far the tool must be moved to
    be free, in ``unit``, below 0 how far it may be moved; depths beyond 7.5 pitches, the ends of ``range``, are not told apart.
    Outside ``bounds`` values are those of the nearest point inside. Of a tool that is not round poses ``(n, 7)`` say the roll; those of
    six numbers are without roll, which a :class:`SceneWarning` says once.
    """

    def __init__(self, native: _imf.Field) -> None:
        self._native = native
        self._reader = PoseReader(native.is_round)

    @property
    def family(self) -> str:
        """harmonic, factored or siren5."""
        return self._native.family

    @property
    def quantity(self) -> str:
        """overlap or depth."""
        return self._native.quantity

    @property
    def part(self) -> str:
        """The part's name."""
        return self._native.part

    @property
    def unit(self) -> str:
        """Unit of lengths."""
        return self._native.unit

    @property
    def grid(self) -> Grid:
        """The voxels that it was made of."""
        return Grid.of(self._native.grid)

    @property
    def bounds(self) -> NDArray[np.float64] | None:
        """Lower and upper corner of its box, ``(2, 3)``."""
        bounds = self._native.bounds
        return None if bounds is None else np.array(bounds)

    @property
    def range(self) -> tuple[float, float]:
        """Lower and upper bound of the values: 0 and 1 of an overlap, 7.5 pitches to either side of a depth."""
        lower, upper = self._native.range
        return lower, upper

    @property
    def tool(self) -> Tool:
        """The tool that it was made for, without clearance."""
        return Tool._of(self._native.tool)

    @property
    def clearance(self) -> dict[str, float]:
        """Room that holder, shank and cutter keep in it: the values are those of the tool with this room around it."""
        return dict(zip(("holder", "shank", "cutter"), self._native.clearance))

    @property
    def contact(self) -> float | None:
        """How deep below the part's surface the cutter may reach; None without contact."""
        return self._native.contact

    @property
    def fixtures(self) -> list[str]:
        """The fixtures' names."""
        return self._native.fixtures

    def is_of(self, scene: Scene) -> bool:
        """Whether it is of exactly this scene: its grid and solid voxels, its tool, clearance and contact. A scene without clearance also
        has the fields of depth that :func:`train` makes of it."""
        return self._native.is_of(native_scene(scene))

    @property
    def fit_error(self) -> float | None:
        """Root mean square error of the harmonic fit at directions that were not fitted, in the values' unit; of a factored field that
        of the fit that it was distilled from. None for siren5."""
        return self._native.fit_error

    @property
    def symmetry(self) -> str | None:
        """The part's symmetry that a factored network is reduced by, such as "mirrored across y"; None where there is none. Across a
        mirror plane values and gradients may jump, at the most by several times the mean error; near an axis nothing is decided,
        and within half a voxel of it gradients are clamped, and not to be trusted."""
        return self._native.symmetry

    @property
    def verdict(self) -> str | None:
        """What its decisions are worth, in a sentence; None where that was not measured, and it decides nothing then."""
        return self._native.verdict

    def save(self, path: str | os.PathLike[str]) -> None:
        """Writes it to one ``.safetensors`` file, whole or not at all. Raises ``OSError``."""
        self._native.save(os.fspath(path))

    def __call__(self, poses: ArrayLike, *, progress: Progress = None) -> NDArray[np.float32] | np.float32:
        """Values of poses ``(n, 6)`` or ``(n, 7)``: ``(n,)``; of one pose a number. NaN for an invalid pose."""
        rows, alone = self._reader.rows(poses)
        values = self._native.values(rows, listener(progress))
        return values[0] if alone else values

    def gradient(self, poses: ArrayLike, *, progress: Progress = None) -> Gradient:
        """Values of poses ``(n, 6)`` or ``(n, 7)`` with their derivatives."""
        return Gradient(*self._native.gradients(self._reader.rows(poses)[0], listener(progress)))

    def classify(self, poses: ArrayLike, *, progress: Progress = None) -> NDArray[np.uint8]:
        """By pose a :class:`Decision` as a number, ``(n,)``, by the field's calibration."""
        return self._native.classify(self._reader.rows(poses)[0], listener(progress))

    def best(self, points: ArrayLike, directions: Directions, *, progress: Progress = None) -> Best:
        """The minimum over directions (:data:`Directions`, of a text those that name no part) at points ``(n, 3)``."""
        tips = numbers(np.atleast_2d(points))
        return Best(*self._native.best(tips, rolled(self._native, directions), listener(progress)))

    def to_xarray(self, direction: ArrayLike) -> Any:
        """The values of one direction at every voxel centre, as a ``xarray.DataArray``."""
        rows, _ = self._reader.rows(self._at_centres(direction))
        return self.grid.to_xarray(self._section(rows), self.quantity, {"direction": numbers(direction), "unit": self.unit})

    def to_pyvista(self, direction: ArrayLike) -> Any:
        """The values of one direction at every voxel centre, as a ``pyvista.ImageData``."""
        rows, _ = self._reader.rows(self._at_centres(direction))
        return self.grid.to_pyvista(**{self.quantity: self._section(rows)})

    def _at_centres(self, direction: ArrayLike) -> NDArray[np.float64]:
        from ._poses import poses

        return poses(self.grid.centres(), numbers(direction))

    def _section(self, rows: NDArray[np.float64]) -> NDArray[np.float32]:
        return self._native.values(rows, None).reshape(self.grid.dims)

    def __repr__(self) -> str:
        return f"<imf.Field of {self.part}: {self.family}, {self.quantity}>"


def load(path: str | os.PathLike[str]) -> Field:
    """Reads a field of any family. Raises ``FileNotFoundError``, ``OSError``, or ``ValueError`` for a file that is not a field."""
    return Field(_imf.Field.load(os.fspath(path)))


_OPTIONS = {
    "harmonic": ("degree",),
    "factored": ("degree", "steps", "layers", "omega", "symmetry"),
    "siren5": ("steps", "layers", "omega", "directions"),
}


def train(
    scene: Scene,
    family: str = "factored",
    *,
    quantity: str | None = None,
    degree: int | None = None,
    steps: int | None = None,
    layers: tuple[int, int] | None = None,
    omega: float | None = None,
    symmetry: bool | None = None,
    directions: Directions | None = None,
    seed: int = 0,
    calibrate: bool = True,
    progress: Progress = None,
) -> Field:
    """Makes a field of a scene.

    family: "harmonic", fitted to exact sections in seconds; "factored", a network of a megabyte that is distilled from such a fit;
    "siren5", the paper's network, which learns from samples of the exact sections of ``directions`` (by default axes+fibonacci:225).
    quantity: "depth", or "overlap"; by default depth, and overlap for siren5 and for a built-in part with the paper's tool. For
    depths shank and holder keep two voxels of room where the scene has no clearance.
    degree: of the harmonics. steps: of the training. layers: hidden layers and neurons of each. omega: frequency of the sines.
    symmetry: whether a factored network is reduced by that of its part, as it is by default (:attr:`Field.symmetry`).
    calibrate: also measures what the field's decisions are worth (a minute or so); without, it leaves every decision undecided.

    Raises ``ValueError`` for what a family cannot have, :class:`ImfError` for a training that diverged.
    """
    given = {"degree": degree, "steps": steps, "layers": layers, "omega": omega, "symmetry": symmetry, "directions": directions}
    for name, value in given.items():
        if value is not None and family in _OPTIONS and name not in _OPTIONS[family]:
            raise ValueError(f"{family} has no {name}: it takes {', '.join(_OPTIONS[family])}")
    shape = None if layers is None else wholes("layers", layers, "hidden layers", "neurons of each")
    native = _imf.train(
        native_scene(scene),
        family,
        quantity,
        None if degree is None else whole("degree", degree),
        None if steps is None else whole("steps", steps, 1),
        None if shape is None else (shape[0], shape[1]),
        omega,
        symmetry is not False,
        "axes+fibonacci:225" if directions is None else directions_input(directions),
        whole("seed", seed),
        calibrate,
        listener(progress),
    )
    return Field(native)
