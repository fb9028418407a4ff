"""The scene: a part in its set-up, among fixtures, on a grid of voxels, with the tool that is to reach it."""

from __future__ import annotations

import os
import warnings
from collections.abc import Iterable, Mapping, Sequence
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from . import _imf
from ._mesh import Mesh, mesh_input
from ._numbers import number, whole, wholes
from ._poses import numbers, rows_of
from ._progress import Progress, listener
from .results import Grid, Inaccessibility, Section, Sections
from .stock import RemovableStock, Stock, StockLeft, stock_input
from .surface import Access, Crib, SetupPlan, StickOuts
from .tool import Tool, native
from .toolpath import CheckReport

Directions: TypeAlias = "str | ArrayLike"
"""The text of a set (``imf.DIRECTIONS`` has the grammar), vectors ``(n, 3)`` from tip to holder, or quaternions ``(n, 4)``."""

Clearance: TypeAlias = float | Mapping[str, float]
"""Room that shank and holder keep, or of ``holder``, ``shank`` and ``cutter`` by name; in the scene's unit."""


class SceneWarning(UserWarning):
    """What should be known of a scene that can be used all the same."""


def clearance_input(clearance: Clearance) -> list[float]:
    """Of holder, shank and cutter."""
    if not isinstance(clearance, Mapping):
        room = number("a clearance, of shank and holder or of elements by name,", clearance)
        return [room, room, 0.0]
    names = ("holder", "shank", "cutter")
    unknown = set(clearance) - set(names)
    if unknown:
        raise ValueError(f"a clearance is of holder, shank and cutter, not of {', '.join(sorted(unknown))}")
    return [number(f"the clearance of the {name}", clearance.get(name, 0.0)) for name in names]


def directions_input(directions: Directions) -> str | NDArray[np.float64]:
    """As the native module reads them."""
    if isinstance(directions, str):
        return directions
    rows = np.atleast_2d(numbers(directions))
    if rows.ndim != 2:
        raise ValueError(f"directions must have the shape (n, 3) or (n, 4), not {np.shape(directions)}")
    return rows


def warn_of_roll(remedy: str) -> None:
    """Of a tool that is not round, to whoever called what calls this function's caller."""
    text = f"the tool is not round, and is taken without roll about its axis: {remedy}"
    warnings.warn(text, SceneWarning, stacklevel=4)


class PoseReader:
    """Reads poses for a tool. Of one that is not round it says once that some do not say its roll, to whoever called what calls it."""

    def __init__(self, is_round: bool) -> None:
        self._warns = not is_round

    def rows(self, poses: ArrayLike) -> tuple[NDArray[np.float64], bool]:
        """:func:`rows_of` for this tool."""
        rows, alone = rows_of(poses)
        if self._warns and rows.shape[1] == 6:
            self._warns = False
            warn_of_roll("these poses do not say its roll: give poses (n, 7), with quaternions")
        return rows, alone


def rolled(native: _imf.Scene | _imf.Field, directions: Directions) -> str | NDArray[np.float64]:
    """As the native module reads them, with a warning where they do not say the roll of a tool that is not round."""
    given = directions_input(directions)
    if native.lacks_roll(given):
        warn_of_roll("for its rolls give so3:N, or quaternions (n, 4)")
    return given


def native_scene(scene: Scene) -> _imf.Scene:
    """What the native module reads."""
    if not isinstance(scene, Scene):
        raise ValueError(f"{scene!r} is not an imf.Scene: make one, by imf.Scene(part, tool)")
    return scene._native


def one_direction(direction: ArrayLike) -> NDArray[np.float64]:
    """Of a question about a single one."""
    if isinstance(direction, str) or np.ndim(direction) != 1:
        raise ValueError("a direction is a vector (3,) or a quaternion (4,); for several use sections() or imf()")
    return numbers(direction)


def _placed(fixture: Any) -> tuple[Any, ArrayLike | None]:
    """A fixture's mesh, and its transform where it has one."""
    if not (isinstance(fixture, (tuple, list)) and len(fixture) == 2):
        return fixture, None
    mesh, at = fixture
    is_mesh = isinstance(mesh, (str, os.PathLike)) or hasattr(mesh, "faces")
    if is_mesh or (isinstance(mesh, (tuple, list)) and len(mesh) == 2) or np.shape(at) == (4, 4):
        return mesh, at
    return fixture, None


def _matrix(transform: ArrayLike | None) -> NDArray[np.float64]:
    matrix = numbers(np.eye(4) if transform is None else transform)
    if matrix.shape != (4, 4):
        raise ValueError(f"a transform is a matrix of 4 × 4, not of the shape {matrix.shape}")
    return matrix


class Scene:
    """A part on its grid, and a tool.

    part: a path (OBJ, STL, PLY, 3MF), a built-in part (``teapot``, ``bracket``, ``bracket-raw``, ``screw-gear``), an object with
    ``vertices`` and ``faces`` (as of trimesh) or ``points`` and ``faces`` (as of PyVista), or a pair of vertices ``(n, 3)`` and
    triangles ``(m, 3)``.
    tool: every part but a built-in one needs one.
    pitch, dims: the edge of a voxel, or voxels along x, y and z; by default the pitch follows from tool and part.
    margin: empty voxels on each side. A field that is to be trained of a part wants some six.
    unit: mm, cm, m or inch, of files and arrays that do not state theirs; STL files need it.
    transform: ``(4, 4)``, where the part's own coordinates stand in the world: it turns, moves, and may scale by one factor. Poses,
    directions, ``grid``, ``mesh`` and what is computed of them are the world's; a path of :meth:`check` is the part's.
    fixtures: meshes that the tool must not touch either, or pairs of a mesh and its transform, into the world. Arrays, and files that
    do not state their unit, are in the part's unit; a transform may scale them (from inch to mm by 25.4).
    clearance: room that shank and holder keep (:data:`Clearance`), in the scene's unit.
    contact: how deep below the part's surface the cutter may reach: in sections, :meth:`imf`, :meth:`removable`, a :class:`Checker`
    and fields that are trained. :meth:`check` has its own, and what is asked of the surface a ``tolerance``.
    conservative: every voxel that the surface touches is solid, not those alone whose centre is inside.
    allow_coarse: a tool that passes between the voxels' centres is a warning, not an error.
    around: what the grid is chosen around: "part" or "all", the fixtures too.
    name: what messages call a part that is not a file.

    Raises ``ValueError`` for what cannot be a scene, with the remedy, and ``OSError`` for files.
    """

    def __init__(
        self,
        part: Mesh,
        tool: Tool | None = None,
        *,
        pitch: float | None = None,
        dims: Sequence[int] | None = None,
        margin: int = 0,
        unit: str | None = None,
        transform: ArrayLike | None = None,
        fixtures: Iterable[Any] = (),
        clearance: Clearance = 0.0,
        contact: float | None = None,
        conservative: bool = False,
        allow_coarse: bool = False,
        around: str = "part",
        name: str | None = None,
        progress: Progress = None,
    ) -> None:
        if around not in ("part", "all"):
            raise ValueError(f"around must be 'part' or 'all', not {around!r}")
        if pitch is not None and dims is not None:
            raise ValueError("give pitch or dims, not both")
        if isinstance(fixtures, (str, os.PathLike)):
            raise ValueError(f"fixtures are a list: give [{str(fixtures)!r}]")
        held = []
        for index, fixture in enumerate(fixtures):
            mesh, at = _placed(fixture)
            held.append((mesh_input(mesh, f"fixture {index + 1}"), _matrix(at)))
        self._native = _imf.Scene(
            mesh_input(part, name or "part"),
            None if tool is None else native(tool),
            unit=unit,
            pitch=None if pitch is None else float(pitch),
            dims=None if dims is None else wholes("dims", dims, "voxels along x", "along y", "along z"),
            margin=whole("margin", margin),
            transform=_matrix(transform),
            fixtures=held,
            clearance=clearance_input(clearance),
            contact=contact,
            conservative=conservative,
            allow_coarse=allow_coarse,
            around_all=around == "all",
            progress=listener(progress),
        )
        for text in self._native.warnings:
            warnings.warn(text, SceneWarning, stacklevel=2)

    @property
    def part(self) -> str:
        """The part's name."""
        return self._native.part

    @property
    def unit(self) -> str:
        """Unit of every length."""
        return self._native.unit

    @property
    def grid(self) -> Grid:
        """The voxels."""
        return Grid.of(self._native.grid)

    @property
    def tool(self) -> Tool:
        """The tool as it is, in the scene's unit."""
        return Tool._of(self._native.tool)

    @property
    def clearance(self) -> dict[str, float]:
        """Room that holder, shank and cutter keep."""
        return dict(zip(("holder", "shank", "cutter"), self._native.clearance))

    @property
    def guarantee(self) -> str:
        """What exact answers guarantee, in a sentence: of the voxels' centres, or of the mesh itself."""
        return self._native.guarantee

    @property
    def contact(self) -> float | None:
        """How deep below the part's surface the cutter may reach; None without contact."""
        return self._native.contact

    @property
    def solid(self) -> NDArray[np.bool_]:
        """Voxels of part and fixtures where they stand in the world, ``(nx, ny, nz)``: a copy."""
        return self._native.solid.view(np.bool_)

    @property
    def mesh(self) -> tuple[NDArray[np.float64], NDArray[np.uint32]]:
        """Vertices ``(n, 3)`` and triangles ``(m, 3)`` of the part where it stands in the world, facing outwards: copies."""
        return self._native.mesh

    def directions(self, directions: Directions | None = None) -> NDArray[np.float64]:
        """The directions of a set as unit vectors, ``(n, 3)``; by default those that questions about this part are asked with."""
        return self._native.orientations(self._usual(directions))[0]

    def rotations(self, directions: Directions | None = None) -> NDArray[np.float64]:
        """The same as quaternions ``x, y, z, w``, ``(n, 4)``: with the roll, which counts for tools that are not round."""
        return self._native.orientations(self._usual(directions))[1]

    def _usual(self, directions: Directions | None) -> str | NDArray[np.float64]:
        return self._native.usual_directions if directions is None else directions_input(directions)

    def _sections(self, directions: str | NDArray[np.float64], progress: Progress) -> Sections:
        values, found = _imf.sections(self._native, directions, listener(progress))
        return Sections(values, *found, self.grid, self.unit)

    def section(self, direction: ArrayLike, *, progress: Progress = None) -> Section:
        """The exact collision measure of one direction ``(3,)`` (or rotation ``(4,)``) at every voxel."""
        return self._sections(rolled(self._native, one_direction(direction)), progress)[0]

    def sections(self, directions: Directions, *, progress: Progress = None) -> Sections:
        """The exact collision measure of several directions at every voxel: 4 bytes a voxel and direction."""
        return self._sections(rolled(self._native, directions), progress)

    def imf(self, directions: Directions | None = None, *, progress: Progress = None) -> Inaccessibility:
        """The inaccessibility measure: the minimum over directions at every voxel, which holds no section."""
        asked = self._native.usual_directions if directions is None else rolled(self._native, directions)
        values, best, found = _imf.minimum(self._native, asked, listener(progress))
        return Inaccessibility(values, best, *found, self.grid, self.unit)

    def access(
        self,
        directions: Directions | None = None,
        *,
        samples: int = 8_000,
        tolerance: float | None = None,
        progress: Progress = None,
    ) -> Access:
        """What of the part's surface the tool reaches, from which directions.

        samples: the surface is cut into at least about so many. tolerance: how deep the cutter may cut below the surface, and a shank
        stand in it, by default 0.05 mm, but no less than a tenth of the pitch and no more than a quarter of it.
        """
        asked = None if directions is None else rolled(self._native, directions)
        count = whole("samples", samples, 1)
        return Access(_imf.access(self._native, asked, count, tolerance, listener(progress)), self.unit)

    def setups(
        self,
        directions: Directions | None = None,
        *,
        limits: str | None = None,
        cover: float = 1.0,
        progress: Progress = None,
    ) -> SetupPlan:
        """The fewest set-ups in which the tool reaches what it can: :meth:`access`, then :meth:`Access.setups`."""
        access = self.access(directions, progress=progress)
        return access.setups(limits, cover=cover, every_direction=directions is not None, progress=progress)

    def stickout(self, directions: Directions | None = None, *, progress: Progress = None) -> StickOuts:
        """The shortest stick-out with which the tool reaches each sample: :meth:`access`, then :meth:`Access.stickout`."""
        return self.access(directions, progress=progress).stickout(progress=progress)

    def check(
        self,
        path: str | os.PathLike[str] | ArrayLike,
        *,
        tools: Mapping[int, Tool] | None = None,
        machine: str | os.PathLike[str] | None = None,
        clearance: Clearance | None = None,
        contact: float | None = None,
        step: float | None = None,
        frame: str | None = None,
        stick_out: bool = False,
        stock: Stock | None = None,
        progress: Progress = None,
    ) -> CheckReport:
        """Checks every motion of a five-axis toolpath, exactly, element by element.

        path: a file (CSV, APT/CL or G-code), or poses ``(n, 6)``, or ``(n, 7)`` for a tool that is not round, whose roll counts; the
        tool follows them at feed rate. tools: by number, where the path changes them; else the scene's. machine: its file, for paths
        that need one; poses are ``(n, 6)`` then, as its axes decide the roll. clearance: by default the scene's. contact: how deep the part
        may lie in the cutter, and points of any surface in shank and holder, 0.05 mm by default. step: farthest that any point of the tool moves between two poses that are looked at, by default a
        quarter of the pitch. frame: "part" or "world", of the path: by default the part's, with a machine the world's, where its G54 is.
        stick_out: also finds the shortest stick-out of every tool. stock: what the path cuts (:data:`Stock`): nothing but the cutter may
        touch it, no rapid may cut it, and no drill aside.
        """
        if frame not in (None, "part", "world"):
            raise ValueError(f"frame must be 'part' or 'world', not {frame!r}")
        given = os.fspath(path) if isinstance(path, (str, os.PathLike)) else rows_of(path)[0]
        text, remarks, left = _imf.check(
            self._native,
            given,
            [(whole("a tool's number", number), native(tool)) for number, tool in (tools or {}).items()],
            None if machine is None else os.fspath(machine),
            None if clearance is None else clearance_input(clearance),
            contact,
            step,
            None if frame is None else frame == "world",
            stick_out,
            None if stock is None else stock_input(stock),
            listener(progress),
        )
        left_over = None if left is None else StockLeft.of(left)
        return CheckReport.of(text, remarks, left_over, self.unit, of_rows=not isinstance(given, str))

    def removable(
        self, stock: Stock = 0.0, directions: Directions | None = None, *, progress: Progress = None
    ) -> RemovableStock:
        """What of a stock (:data:`Stock`) beside part and fixtures the cutter covers at free poses."""
        asked = None if directions is None else directions_input(directions)
        return RemovableStock.of(
            _imf.removable_stock(self._native, stock_input(stock), asked, listener(progress)), self.unit
        )

    def crib(
        self,
        tools: Iterable[Tool],
        directions: Directions | None = None,
        *,
        samples: int = 8_000,
        tolerance: float | None = None,
        progress: Progress = None,
    ) -> Crib:
        """Which of many tools reach which places of the surface: the same verdicts as one by one, many times sooner."""
        asked = None if directions is None else directions_input(directions)
        tools = list(tools)
        natives = [native(tool) for tool in tools]
        count = whole("samples", samples, 1)
        found = _imf.crib(self._native, natives, asked, count, tolerance, listener(progress))
        for text in found.pop("warnings"):
            warnings.warn(text, SceneWarning, stacklevel=2)
        return Crib(names=[tool.name for tool in tools], **found)

    def __repr__(self) -> str:
        x, y, z = self.grid.dims
        return f"<imf.Scene of {self.part}: {x}×{y}×{z} voxels of {self.grid.pitch:g} {self.unit}, tool {self.tool.name!r}>"
