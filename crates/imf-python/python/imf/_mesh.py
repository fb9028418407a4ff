"""Meshes as people have them: a file, an object of another library, or arrays. No other library is imported."""

from __future__ import annotations

import os
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from ._numbers import unmasked
from ._poses import numbers

Mesh: TypeAlias = Any
"""A path (OBJ, STL, PLY, 3MF) or the name of a built-in part; an object with ``vertices`` and ``faces`` (as of trimesh) or with
``points`` and ``faces`` (as of PyVista); or a pair of vertices ``(n, 3)`` and triangles ``(m, 3)``."""

Native: TypeAlias = "str | tuple[NDArray[np.float64], NDArray[np.int64], str]"


def mesh_input(mesh: Mesh, name: str | None = None) -> Native:
    """What the native module reads."""
    if isinstance(mesh, (str, os.PathLike)):
        return os.fspath(mesh)
    if isinstance(mesh, (tuple, list)) and len(mesh) == 2:
        return arrays(mesh[0], mesh[1], name or "mesh")
    if hasattr(mesh, "vertices") and hasattr(mesh, "faces"):
        return arrays(mesh.vertices, mesh.faces, name or "mesh")
    if hasattr(mesh, "points") and hasattr(mesh, "faces"):
        surface = mesh
        if not getattr(mesh, "is_all_triangles", True):
            surface = mesh.triangulate()
        return arrays(surface.points, padded(np.asarray(surface.faces)), name or "mesh")
    raise ValueError(
        f"{type(mesh).__name__} is not a mesh: give a path, vertices and faces, or an object with vertices and faces (as of trimesh) or "
        "points and faces (as of PyVista; of other grids extract_surface() first)"
    )


def padded(faces: NDArray[Any]) -> NDArray[Any]:
    """Triangles of PyVista's list of faces, each after its number of corners."""
    if faces.ndim == 2:
        return faces
    if faces.size % 4 or np.any(faces[::4] != 3):
        raise ValueError("the mesh has faces of more than three corners: triangulate() it first")
    return faces.reshape(-1, 4)[:, 1:]


def arrays(vertices: Any, faces: Any, name: str) -> Native:
    """Vertices and triangles, each as numbers in rows of three."""
    points = numbers(vertices)
    corners = np.asarray(unmasked(faces))
    if corners.dtype.kind not in "iu":
        raise ValueError(f"faces must be whole numbers, not {corners.dtype}")
    if points.ndim != 2 or corners.ndim != 2:
        raise ValueError(f"vertices and faces must have the shape (n, 3), not {points.shape} and {corners.shape}")
    return points, np.require(corners, np.int64, ["C_CONTIGUOUS", "ALIGNED"]), name
