"""Voxels as a mesh: parts that a program holds as arrays."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ._numbers import unmasked


def _pieces(code: int) -> list[int]:
    """Of eight voxels around a corner, bits of ``code``, the first of those that each is joined to across faces."""
    piece = list(range(8))
    joined = [(a, a ^ bit) for a in range(8) for bit in (1, 2, 4) if code >> a & code >> (a ^ bit) & 1]
    # No way around the corner has more steps.
    for _ in range(7):
        for a, b in joined:
            piece[a] = min(piece[a], piece[b])
    return piece


def voxel_mesh(
    solid: NDArray[np.bool_], origin: ArrayLike = (0.0, 0.0, 0.0), pitch: float = 1.0
) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Vertices ``(n, 3)`` and triangles ``(m, 3)`` of the faces between solid and empty voxels: a part or a fixture of a scene.

    solid: booleans ``(nx, ny, nz)``; origin: the lower corner of voxel (0, 0, 0); pitch: the edge of a voxel. A scene of this pitch
    around such a part has the same voxels.
    """
    solid = np.asarray(unmasked(solid))
    if solid.ndim != 3 or solid.dtype != np.bool_ or not solid.any():
        raise ValueError(
            "solid must be booleans (nx, ny, nz), some of them True, such as densities > 0.5; "
            f"not {solid.dtype} of the shape {solid.shape}"
        )
    pitch = float(pitch)
    if not (np.isfinite(pitch) and pitch > 0):
        raise ValueError(f"pitch must be a positive length, not {pitch}")
    origin = np.asarray(unmasked(origin), dtype=np.float64)
    if origin.shape != (3,) or not np.isfinite(origin).all():
        raise ValueError(f"origin must be three finite numbers, not {origin}")
    padded = np.pad(solid, 1).astype(np.int8)
    dims = tuple(n + 1 for n in solid.shape)
    unit = np.eye(3, dtype=np.int64)
    # Voxels that meet in an edge or a corner alone have vertices of their own there, so that the mesh says which faces go together.
    codes = np.zeros(dims, dtype=np.int64)
    for cell in range(8):
        x, y, z = cell & 1, cell >> 1 & 1, cell >> 2
        codes |= padded[x : x + dims[0], y : y + dims[1], z : z + dims[2]].astype(np.int64) << cell
    pieces = np.array([_pieces(code) for code in range(256)])
    quads = []
    for axis in range(3):
        u, v = unit[(axis + 1) % 3], unit[(axis + 2) % 3]
        around = np.array([0 * u, u, u + v, v])
        step = np.diff(padded, axis=axis)
        # A face looks along the axis where solid ends, and back where it begins.
        for sign, order in ((-1, around), (1, around[::-1])):
            places = np.argwhere(step == sign)
            corners = (places - u - v)[:, None] + order
            cells = ((places + (sign > 0) * unit[axis])[:, None] - corners) @ [1, 2, 4]
            at = tuple(np.moveaxis(corners, 2, 0))
            quads.append(np.ravel_multi_index(at, dims) * 8 + pieces[codes[at], cells])
    used, quad = np.unique(np.concatenate(quads), return_inverse=True)
    vertices = origin + pitch * np.stack(np.unravel_index(used // 8, dims), axis=1)
    return vertices, quad.reshape(-1, 4)[:, [0, 1, 2, 0, 2, 3]].reshape(-1, 3).astype(np.int64)
