"""The stock that a part is cut from."""

from __future__ import annotations

from dataclasses import dataclass
from numbers import Real
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from ._mesh import Mesh, Native, mesh_input
from .results import Grid

Stock: TypeAlias = "float | Mesh"
"""Room around the part's box, in the scene's unit (0 is the box), or a mesh in the part's frame, which is set up as the part is."""


def stock_input(stock: Stock) -> float | Native:
    """What the native module reads."""
    if isinstance(stock, Real) and not isinstance(stock, (bool, np.bool_)):
        return float(stock)
    return mesh_input(stock, "stock")


@dataclass(frozen=True, eq=False)
class RemovableStock:
    """What a cutter removes of a stock, from any of the directions, in whatever order. Arrays are ``(nx, ny, nz)``, the grid in the
    world."""

    stock: NDArray[np.bool_]
    """The voxels that neither part nor fixtures hold."""
    covered: NDArray[np.bool_]
    """Those that the cutter covers at a free pose with its tip on a voxel's centre."""
    possible: NDArray[np.bool_]
    """Those, and what it may cover with its tip elsewhere; all others stay, whatever the pitch."""
    grid: Grid
    unit: str

    @classmethod
    def of(cls, found: dict[str, Any], unit: str) -> RemovableStock:
        """From the native module's arrays."""
        voxels = {name: found[name].view(np.bool_) for name in ("stock", "covered", "possible")}
        return cls(**voxels, grid=Grid.of(found["grid"]), unit=unit)

    @property
    def fraction(self) -> tuple[float, float]:
        """The smallest and the largest fraction of the stock that goes; both tend to what goes as the pitch falls."""
        whole = max(int(self.stock.sum()), 1)
        return float(self.covered.sum() / whole), float(self.possible.sum() / whole)


@dataclass(frozen=True, eq=False)
class StockLeft:
    """What a toolpath leaves of a stock; volumes in the scene's unit cubed, the grid in the world."""

    lines: NDArray[np.int64]
    """``(m,)``: every line of the path's file that leads somewhere; of an array of poses the row + 1."""
    kinds: list[str]
    """How the tool comes there: start, rapid or feed."""
    removed: NDArray[np.float64]
    """``(m,)``: the volume that each line takes away."""
    removed_of_part: NDArray[np.float64]
    """``(m,)``: what of that is the part's."""
    volume: float
    """Of the stock at first."""
    left_beside_part: float
    """What is still to be cut."""
    farthest_from_part: float | None
    """How far from the part the farthest of it is."""
    remaining: NDArray[np.bool_]
    """``(nx, ny, nz)``: what of the stock is left, the part in it included."""
    removed_by_line: NDArray[np.uint32]
    """``(nx, ny, nz)``: the line, as in ``lines``, that took each voxel; 0 of others."""
    grid: Grid

    @classmethod
    def of(cls, found: dict[str, Any]) -> StockLeft:
        """From the native module's numbers."""
        own = found | {name: np.array(found[name]) for name in ("removed", "removed_of_part")}
        own["lines"] = np.array(found["lines"], dtype=np.int64)
        own |= {"remaining": found["remaining"].view(np.bool_), "grid": Grid.of(found["grid"])}
        return cls(**own)
