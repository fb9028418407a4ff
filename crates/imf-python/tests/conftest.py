"""Parts whose answers are known in closed form, and NumPy's definitions of what the library computes."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

import imf

Floats = NDArray[np.float64]

CUTTER = {"shape": "flat", "diameter": 8, "length": 30}
HOLDER = [{"diameter": 40, "length": 30}]


def box(lower: tuple[float, float, float], upper: tuple[float, float, float]) -> tuple[Floats, NDArray[np.int64]]:
    """A cuboid that faces outwards."""
    corners = np.array([[(lower, upper)[i >> axis & 1][axis] for axis in range(3)] for i in range(8)])
    quads = [(0, 2, 3, 1), (4, 5, 7, 6), (0, 1, 5, 4), (2, 6, 7, 3), (0, 4, 6, 2), (1, 3, 7, 5)]
    faces = [triangle for a, b, c, d in quads for triangle in ((a, b, c), (a, c, d))]
    return corners.astype(float), np.array(faces)


def write_obj(path: Path, vertices: Floats, faces: NDArray[np.int64]) -> None:
    lines = [f"v {x} {y} {z}" for x, y, z in vertices] + [f"f {a + 1} {b + 1} {c + 1}" for a, b, c in faces]
    path.write_text("\n".join(lines))


def head(folder: Path, lower: tuple[float, float, float], upper: tuple[float, float, float]) -> imf.Tool:
    """A tool that is a cuboid's mesh, of files in a folder."""
    write_obj(folder / "head.obj", *box(lower, upper))
    (folder / "head.toml").write_text('unit = "mm"\nmesh = "head.obj"\n')
    return imf.Tool.read(folder / "head.toml")


def slotted_block(width: float, depth: float) -> tuple[Floats, NDArray[np.int64]]:
    """A block of 30 × 30 × 20 with a slot along x, open at both ends and above."""
    w, floor = width / 2, 20 - depth
    outline = [(-15, 0), (15, 0), (15, floor), (15, 20), (w, 20), (w, floor), (-w, floor), (-w, 20), (-15, 20), (-15, floor)]
    cap = [(0, 1, 2), (0, 2, 5), (0, 5, 6), (0, 6, 9), (5, 2, 3), (5, 3, 4), (9, 6, 7), (9, 7, 8)]
    count = len(outline)
    vertices = [(x, y, z) for x in (-15.0, 15.0) for y, z in outline]
    faces = [(c, b, a) for a, b, c in cap] + [(a + count, b + count, c + count) for a, b, c in cap]
    for a in range(count):
        b = (a + 1) % count
        faces += [(a, b, b + count), (a, b + count, a + count)]
    return np.array(vertices), np.array(faces)


def paper_radius(height: Floats) -> Floats:
    """Outline of the paper's tool: a ball of radius 5, a cylinder up to 35, a holder of 14.5 up to 83; −1 where there is none."""
    ball = np.sqrt(np.maximum(25.0 - (5.0 - height) ** 2, 0.0))
    radius = np.where(height < 5.0, ball, np.where(height < 35.0, 5.0, 14.5))
    return np.where((height >= 0.0) & (height < 83.0), radius, -1.0)


def inside_paper_tool(points: Floats, tip: Floats, axis: Floats, pitch: float) -> NDArray[np.bool_]:
    """Which points lie in the paper's tool at a pose."""
    along = (points - tip) @ axis
    squared = ((points - tip) ** 2).sum(axis=-1) - along**2
    radius = paper_radius(along)
    found: NDArray[np.bool_] = (radius >= 0.0) & (squared <= radius**2 + 1e-9 * pitch**2)
    return found


@pytest.fixture(scope="session")
def bracket() -> imf.Scene:
    """A built-in part with the paper's tool, 17 × 49 × 29 voxels."""
    return imf.Scene("bracket", pitch=3.0)


@pytest.fixture(scope="session")
def mill() -> imf.Tool:
    """A flat end mill of 8 mm in a holder of 40 mm."""
    return imf.Tool(CUTTER, holder=HOLDER, name="mill")


@pytest.fixture(scope="session")
def block(mill: imf.Tool) -> imf.Scene:
    """A block of 20 mm, its corner at the origin."""
    return imf.Scene(box((0, 0, 0), (20, 20, 20)), mill, pitch=0.5, name="block")


@pytest.fixture
def poses() -> Floats:
    """A few hundred poses around the bracket, many of which collide."""
    random = np.random.default_rng(1)
    directions = random.normal(size=(300, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    return imf.poses(random.uniform([0, 0, 0], [50, 147, 87], (300, 3)), directions)
