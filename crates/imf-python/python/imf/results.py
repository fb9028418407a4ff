"""Results over a grid, and the words that arrays hold as numbers."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum
from importlib import import_module
from typing import Any, overload

import numpy as np
from numpy.typing import NDArray


class Decision(IntEnum):
    """Whether the tool collides at a pose, or on a motion."""

    FREE = 0
    COLLIDING = 1
    UNDECIDED = 2
    """Too close to tell: by a field, an exact check must decide; on a motion, the tool passes by closer than is proven."""


class Verdict(IntEnum):
    """What becomes of a sample of a surface, the better ones first."""

    REACHED = 0
    """Reached from some direction."""
    OBSTRUCTED = 1
    """The cutter fits, but something of the tool collides."""
    GOUGED = 2
    """The cutter does not fit: it would cut deeper than the tolerance."""
    NOT_FACED = 3
    """No direction faces it."""


def optional(module: str, what: str) -> Any:
    """A library that is needed for one conversion alone."""
    try:
        return import_module(module)
    except ImportError as error:
        raise ImportError(f"{what} needs {module}, which is not installed: pip install {module}") from error


@dataclass(frozen=True, eq=False)
class Grid:
    """Cubic voxels in the world, in the scene's unit."""

    origin: NDArray[np.float64]
    """Lower corner of voxel (0, 0, 0), ``(3,)``."""
    pitch: float
    """Edge of a voxel."""
    dims: tuple[int, int, int]
    """Voxels along x, y and z."""

    @classmethod
    def of(cls, native: tuple[list[float], float, list[int]]) -> Grid:
        """From the native module's numbers."""
        origin, pitch, (x, y, z) = native
        return cls(np.array(origin), pitch, (x, y, z))

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Grid) and self._key() == other._key()

    def __hash__(self) -> int:
        return hash(self._key())

    def _key(self) -> tuple[Any, ...]:
        return (*self.origin.tolist(), self.pitch, self.dims)

    def axes(self) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
        """The centres' coordinates along x, y and z: arrays of ``dims`` numbers."""
        x, y, z = (self.origin[axis] + self.pitch * (np.arange(self.dims[axis]) + 0.5) for axis in range(3))
        return x, y, z

    def centres(self) -> NDArray[np.float64]:
        """The centres of all voxels, ``(nx * ny * nz, 3)``, in the order of arrays over the grid."""
        return np.stack(np.meshgrid(*self.axes(), indexing="ij"), axis=-1).reshape(-1, 3)

    def to_pyvista(self, **values: NDArray[Any]) -> Any:
        """A ``pyvista.ImageData`` of the voxels, with values of the shape ``dims`` by name."""
        pyvista = optional("pyvista", "to_pyvista()")
        image = pyvista.ImageData(
            dimensions=[n + 1 for n in self.dims], origin=self.origin, spacing=[self.pitch] * 3
        )
        for name, array in values.items():
            image.cell_data[name] = array.ravel(order="F")
        return image

    def to_xarray(self, values: NDArray[Any], name: str, attributes: dict[str, Any]) -> Any:
        """A ``xarray.DataArray`` of values of the shape ``dims``, by the coordinates of the voxels' centres."""
        xarray = optional("xarray", "to_xarray()")
        coordinates = dict(zip(("x", "y", "z"), self.axes()))
        return xarray.DataArray(values, dims=("x", "y", "z"), coords=coordinates, name=name, attrs=attributes)


@dataclass(frozen=True, eq=False)
class Section:
    """The exact collision measure of one direction at every voxel."""

    values: NDArray[np.float32]
    """``(nx, ny, nz)``, in [0, 1]: the smallest fraction of the tool inside the obstacle with one of its sharp points there. Of a
    point that is not the tip the mean of the eight overlaps around its place, which may lie above 0 where the tool is free."""
    direction: NDArray[np.float64]
    """Unit vector from tip to holder, ``(3,)``."""
    rotation: NDArray[np.float64]
    """The same as a quaternion ``x, y, z, w``, ``(4,)``, which says the roll too."""
    grid: Grid
    unit: str

    def to_pyvista(self) -> Any:
        """A ``pyvista.ImageData`` with the cell values ``cmf``."""
        return self.grid.to_pyvista(cmf=self.values)

    def to_xarray(self) -> Any:
        """A ``xarray.DataArray`` called ``cmf`` over x, y and z."""
        return self.grid.to_xarray(self.values, "cmf", {"direction": self.direction, "unit": self.unit})


@dataclass(frozen=True, eq=False)
class Sections:
    """The exact collision measure of several directions at every voxel."""

    values: NDArray[np.float32]
    """``(n, nx, ny, nz)``, in [0, 1]."""
    directions: NDArray[np.float64]
    """``(n, 3)``, from tip to holder."""
    rotations: NDArray[np.float64]
    """``(n, 4)``: the same as quaternions ``x, y, z, w``, which say the roll too; :func:`poses` takes them."""
    grid: Grid
    unit: str

    def __len__(self) -> int:
        return len(self.values)

    @overload
    def __getitem__(self, index: int) -> Section: ...
    @overload
    def __getitem__(self, index: slice) -> Sections: ...
    def __getitem__(self, index: int | slice) -> Section | Sections:
        some = Sections if isinstance(index, slice) else Section
        return some(self.values[index], self.directions[index], self.rotations[index], self.grid, self.unit)

    def to_xarray(self) -> Any:
        """A ``xarray.DataArray`` called ``cmf`` over direction, x, y and z."""
        xarray = optional("xarray", "to_xarray()")
        coordinates: dict[str, Any] = dict(zip(("x", "y", "z"), self.grid.axes()))
        for axis, name in enumerate("ijk"):
            coordinates[name] = ("direction", self.directions[:, axis])
        dims = ("direction", "x", "y", "z")
        return xarray.DataArray(self.values, dims=dims, coords=coordinates, name="cmf", attrs={"unit": self.unit})

    def to_pyvista(self) -> Any:
        """A ``pyvista.ImageData`` with the cell values ``cmf_0``, ``cmf_1``, … of the directions."""
        return self.grid.to_pyvista(**{f"cmf_{index}": values for index, values in enumerate(self.values)})


@dataclass(frozen=True, eq=False)
class Inaccessibility:
    """The inaccessibility measure: the minimum of the collision measure over directions at every voxel."""

    values: NDArray[np.float32]
    """``(nx, ny, nz)``, in [0, 1]; 0 where the tool gets."""
    best: NDArray[np.uint32]
    """``(nx, ny, nz)``: the row of ``directions`` and of ``rotations`` that has the minimum, the first of equals."""
    directions: NDArray[np.float64]
    """``(n, 3)``, from tip to holder."""
    rotations: NDArray[np.float64]
    """``(n, 4)``: the same as quaternions ``x, y, z, w``, which say the roll too; :func:`poses` takes them."""
    grid: Grid
    unit: str

    def to_pyvista(self) -> Any:
        """A ``pyvista.ImageData`` with the cell values ``imf`` and ``best``."""
        return self.grid.to_pyvista(imf=self.values, best=self.best)

    def to_xarray(self) -> Any:
        """A ``xarray.Dataset`` of ``imf``, ``best``, the ``directions`` and the ``rotations``."""
        xarray = optional("xarray", "to_xarray()")
        attributes = {"unit": self.unit}
        values = self.grid.to_xarray(self.values, "imf", attributes)
        best = self.grid.to_xarray(self.best, "best", {})
        directions = (("direction", "component"), self.directions)
        rotations = (("direction", "quaternion"), self.rotations)
        fields = {"imf": values, "best": best, "directions": directions, "rotations": rotations}
        return xarray.Dataset(fields, attrs=attributes)
