"""STEP files as meshes: ``python -m imf.step part.step part.stl``. Needs ``pip install cadquery-ocp`` (Open CASCADE)."""

from __future__ import annotations

import argparse
import sys
import warnings
from collections.abc import Iterator
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray


def read_step(
    path: str | Path, deflection: float = 0.02, angle: float = 0.2
) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Vertices ``(n, 3)`` in millimetres and triangles ``(m, 3)`` of all solids of a file; surfaces beside them are left out, with a
    warning.

    deflection: largest distance between the mesh and the surface, in millimetres. angle: largest angle between neighbouring facets,
    in radians. Raises ``ValueError`` for a file that holds no solid, or a body that Open CASCADE cannot read.
    """

    def of(module: str) -> Any:
        try:
            return import_module(f"OCP.{module}")
        except ImportError as error:
            raise ImportError("reading STEP files needs Open CASCADE: pip install cadquery-ocp") from error

    def static(owner: Any, name: str) -> Any:
        # Older versions have static functions under a name of their own.
        return getattr(owner, f"{name}_s", None) or getattr(owner, name)

    if not Path(path).is_file():
        raise FileNotFoundError(f"{path}: there is no such file")
    reader = of("STEPControl").STEPControl_Reader()
    if reader.ReadFile(str(path)) != of("IFSelect").IFSelect_ReturnStatus.IFSelect_RetDone:
        raise ValueError(f"{path}: this is not a STEP file that can be read")
    # Open CASCADE gives millimetres, whatever the file's unit.
    roots, read = reader.NbRootsForTransfer(), reader.TransferRoots()
    if read < roots:
        raise ValueError(f"{path}: {roots - read} of its {roots} bodies cannot be read; export it again, or each body alone")
    shape = reader.OneShape()
    of("BRepMesh").BRepMesh_IncrementalMesh(shape, deflection, False, angle, True)
    abs_, explorer_of = of("TopAbs"), of("TopExp").TopExp_Explorer
    as_face, location_of = static(of("TopoDS").TopoDS, "Face"), of("TopLoc").TopLoc_Location
    triangulation = static(of("BRep").BRep_Tool, "Triangulation")
    solid, face_kind = abs_.TopAbs_ShapeEnum.TopAbs_SOLID, abs_.TopAbs_ShapeEnum.TopAbs_FACE

    def all_of(explorer: Any) -> Iterator[Any]:
        while explorer.More():
            yield explorer.Current()
            explorer.Next()

    solids = list(all_of(explorer_of(shape, solid)))
    if not solids:
        raise ValueError(f"{path}: the file holds no solid, only surfaces or curves")
    if loose := sum(1 for _ in all_of(explorer_of(shape, face_kind, solid))):
        warnings.warn(f"{path}: {loose} faces that belong to no solid are left out", stacklevel=2)
    vertices: list[tuple[float, float, float]] = []
    triangles: list[tuple[int, int, int]] = []
    for current in (face for own in solids for face in all_of(explorer_of(own, face_kind))):
        face = as_face(current)
        place = location_of()
        mesh = triangulation(face, place)
        if mesh is None:
            raise ValueError(f"{path}: a face could not be meshed")
        first = len(vertices)
        transform = place.Transformation()
        for node in range(1, mesh.NbNodes() + 1):
            point = mesh.Node(node).Transformed(transform)
            vertices.append((point.X(), point.Y(), point.Z()))
        turned = face.Orientation() == abs_.TopAbs_Orientation.TopAbs_REVERSED
        for index in range(1, mesh.NbTriangles() + 1):
            a, b, c = (first + corner - 1 for corner in mesh.Triangle(index).Get())
            triangles.append((a, c, b) if turned else (a, b, c))
    # Faces share their edges' points.
    points, places = np.unique(np.round(np.array(vertices), 9), axis=0, return_inverse=True)
    corners = places.reshape(-1)[np.array(triangles)]
    whole = (corners[:, 0] != corners[:, 1]) & (corners[:, 1] != corners[:, 2]) & (corners[:, 2] != corners[:, 0])
    return points, corners[whole].astype(np.int64)


def write_stl(path: str | Path, vertices: NDArray[np.float64], faces: NDArray[np.int64]) -> None:
    """A binary STL file."""
    corners = vertices[faces]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), np.finfo(float).tiny)
    rows = np.zeros(len(faces), dtype=[("numbers", "<f4", (12,)), ("attribute", "<u2")])
    rows["numbers"] = np.concatenate([normals[:, None], corners], axis=1).reshape(-1, 12)
    header = b"imf: from STEP, in mm".ljust(80) + np.uint32(len(faces)).tobytes()
    Path(path).write_bytes(header + rows.tobytes())


def main(arguments: list[str] | None = None) -> int:
    """The command."""
    parser = argparse.ArgumentParser(prog="python -m imf.step", description="A STEP file as an STL mesh in millimetres.")
    parser.add_argument("step", type=Path)
    parser.add_argument("stl", type=Path)
    parser.add_argument("--deflection", type=float, default=0.02, metavar="MM", help="largest distance from the surface; 0.02 by default")
    given = parser.parse_args(arguments)
    try:
        vertices, faces = read_step(given.step, given.deflection)
        write_stl(given.stl, vertices, faces)
    except (ImportError, OSError, ValueError) as error:
        print(f"imf.step: error: {error}", file=sys.stderr)
        return 2
    print(f"{given.stl}: {len(faces)} triangles, in mm")
    return 0


if __name__ == "__main__":
    sys.exit(main())
