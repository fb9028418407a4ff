"""What a check of a toolpath found."""

from __future__ import annotations

import json
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .results import optional
from .stock import StockLeft


@dataclass(frozen=True, eq=False)
class Collision:
    """One element that collides with one body on the way to a line, at its deepest.

    Lengths are in the scene's unit; points and axes are in the path's frame, which is the part's own where ``frame`` says nothing else.
    """

    line: int
    """Of the path's file, from 1; of an array of poses the row + 1."""
    row: int | None
    """Of an array of poses, from 0; None for a file."""
    tool: int | None
    """The tool's number, where the file names one."""
    kind: str
    """How the tool comes there: start, rapid or feed."""
    element: str
    """Of the tool."""
    against: str
    """What it hits: the part, a fixture by its name, the machine's solids by theirs, or stock."""
    depth: float
    """No shorter translation parts the element, offset by its clearance, from the body, short of a pitch or so."""
    clearance: float
    """Room that the element was to keep."""
    position: NDArray[np.float64]
    """``(3,)``: the tip at that pose."""
    axis: NDArray[np.float64]
    """``(3,)``: the tool's axis there, from tip to holder."""
    contact: NDArray[np.float64]
    """``(3,)``: the solid voxel's centre, or the point of a surface, that is so deep."""
    joints: dict[str, Any] | None
    """Where a machine's axes stand there (``linear`` x, y, z; ``rotary`` in degrees), on a path that says so."""
    fraction: float
    """How far on the way that pose is, from 0 to 1."""
    volume: float
    """Of the solid voxels in the element there."""


@dataclass(frozen=True)
class TravelFault:
    """Where an axis of the machine leaves its range, in the scene's unit or in degrees; ``line`` and ``row`` as of a collision."""

    line: int
    row: int | None
    axis: str
    value: float
    farthest: float
    range: tuple[float | None, float | None]
    fraction: float


@dataclass(frozen=True, eq=False)
class CheckReport:
    """The answer for a whole toolpath."""

    collisions: list[Collision]
    """In the order of the lines."""
    out_of_travel: list[TravelFault]
    locations: int
    """Lines that lead somewhere."""
    poses: int
    """Poses that were checked."""
    sure_depth: float
    """Diameter of the smallest ball whose overlap is certain to be detected."""
    sure_gouge: float | None
    """How deep a cutter must be in the part's surface to be certain to be detected; None where nothing may touch the part."""
    sure_overlap: float | None
    """How deep shank and holder must be in part or fixtures, and a cutter in fixtures, to be certain to be detected; None where nothing
    may touch. With a machine's head and table it is `sure_depth`."""
    contact: float
    """How deep the part might lie in the cutter, and points of any surface in shank and holder."""
    step: float
    """Farthest that any point of the tool moved between two poses that were checked."""
    stock: StockLeft | None
    """What is left of the stock, where one was given."""
    stick_outs: list[dict[str, Any]]
    """By tool, where they were asked for."""
    remarks: list[str]
    """What was taken for granted, with its line."""
    guarantee: str
    """What "no collision" guarantees, in a sentence."""
    unit: str

    @classmethod
    def of(cls, text: str, remarks: list[str], stock: StockLeft | None, unit: str, of_rows: bool) -> CheckReport:
        """From the library's report, of a file or of rows of poses."""
        found = json.loads(text)
        report = found["report"]
        hits = ((line, hit) for line in report["colliding"] for hit in line["collisions"])
        return cls(
            collisions=[_collision(line | _row(line, of_rows), hit) for line, hit in hits],
            out_of_travel=[
                TravelFault(**(fault | _row(fault, of_rows) | {"range": tuple(fault["range"])}))
                for fault in report["out_of_travel"]
            ],
            locations=report["locations"],
            poses=report["poses"],
            sure_depth=report["sure_depth"],
            sure_gouge=report["sure_gouge"],
            sure_overlap=report["sure_overlap"],
            contact=report["settings"]["contact"],
            step=report["settings"]["step"],
            stock=stock,
            stick_outs=found["stick_outs"],
            remarks=remarks,
            guarantee=found["guarantee"],
            unit=unit,
        )

    @property
    def collides(self) -> bool:
        """True where anything collides."""
        return bool(self.collisions)

    @property
    def passes(self) -> bool:
        """True where nothing collides and no axis leaves its travel."""
        return not (self.collisions or self.out_of_travel)

    @property
    def lines(self) -> list[int]:
        """The lines with a collision."""
        return sorted({hit.line for hit in self.collisions})

    def to_pyvista(self) -> Any:
        """A ``pyvista.PolyData`` of the deepest contact points, with the point values ``depth`` and ``line``."""
        pyvista = optional("pyvista", "to_pyvista()")
        points = pyvista.PolyData(np.array([hit.contact for hit in self.collisions]).reshape(-1, 3))
        points.point_data["depth"] = np.array([hit.depth for hit in self.collisions])
        points.point_data["line"] = np.array([hit.line for hit in self.collisions], dtype=np.int64)
        return points

    def to_xarray(self) -> Any:
        """A ``xarray.Dataset`` over collision and component."""
        xarray = optional("xarray", "to_xarray()")
        columns: dict[str, Any] = {
            name: ("collision", [getattr(hit, name) for hit in self.collisions])
            for name in ("line", "kind", "element", "against", "depth", "fraction", "volume")
        }
        for name in ("position", "axis", "contact"):
            rows = np.array([getattr(hit, name) for hit in self.collisions]).reshape(-1, 3)
            columns[name] = (("collision", "component"), rows)
        return xarray.Dataset(columns, coords={"component": ["x", "y", "z"]}, attrs={"unit": self.unit})


def _row(line: dict[str, Any], of_rows: bool) -> dict[str, Any]:
    return {"row": line["line"] - 1 if of_rows else None}


def _collision(line: dict[str, Any], hit: dict[str, Any]) -> Collision:
    against = hit["against"]
    if isinstance(against, dict):
        ((kind, name),) = against.items()
        against = f"machine's {name}" if kind == "machine" else name
    own: dict[str, Any] = {name: line[name] for name in ("line", "row", "tool", "kind")}
    own |= {name: hit[name] for name in ("element", "depth", "clearance", "fraction", "volume")}
    own |= {name: np.array(hit[name]) for name in ("position", "axis", "contact")}
    return Collision(against=against, joints=hit.get("joints"), **own)
