"""Meshes and tools as people have them, and what is said of those that cannot be used."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import pyvista
from conftest import CUTTER, box, write_obj

import imf

CUBE = box((0, 0, 0), (20, 20, 20))
SHIFT = np.eye(4)
SHIFT[:3, 3] = [100, 0, -20]
SHEAR = np.eye(4)
SHEAR[:3, 1] = [0.6, 0.8, 0]


def unaligned(array: np.ndarray) -> np.ndarray:
    """The same numbers from an odd place on, as in a packed record."""
    moved = np.frombuffer(b"\0" + array.tobytes(), dtype=array.dtype, offset=1).reshape(array.shape)
    assert not moved.flags.aligned
    return moved


def test_numbers_may_lie_anywhere_and_other_shapes_are_refused(mill: imf.Tool, block: imf.Scene) -> None:
    down = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 1.0]])
    np.testing.assert_array_equal(block.imf(unaligned(down)).values, block.imf(down).values)
    poses = imf.poses([10, 10, 25], down)
    np.testing.assert_array_equal(imf.Checker(block).is_free(unaligned(poses)), imf.Checker(block).is_free(poses))
    moved = imf.Scene(CUBE, mill, pitch=0.5, transform=unaligned(SHIFT))
    np.testing.assert_array_equal(moved.solid, imf.Scene(CUBE, mill, pitch=0.5, transform=SHIFT).solid)
    with pytest.raises(ValueError, match="shape"):
        block.imf(np.ones((1, 2, 3)))
    with pytest.raises(ValueError, match="4 × 4"):
        imf.Scene(CUBE, mill, pitch=0.5, transform=np.ones((1, 4, 4)))
    for origin in [(0, 0), (np.nan, 0, 0)]:
        with pytest.raises(ValueError, match="origin"):
            imf.voxel_mesh(np.ones((2, 2, 2), bool), origin=origin)


def test_every_kind_of_mesh_is_the_same_part(mill: imf.Tool, block: imf.Scene, tmp_path: Path) -> None:
    quads = pyvista.Box(bounds=(0, 20, 0, 20, 0, 20), quads=True)
    assert not quads.is_all_triangles
    path = tmp_path / "cube.obj"
    write_obj(path, *CUBE)
    vertices, faces = CUBE
    for mesh in [
        path,
        str(path),
        SimpleNamespace(vertices=vertices, faces=faces),
        (vertices.astype(np.float32), faces.astype(np.uint16)),
        (vertices.tolist(), faces.tolist()),
        quads,
        quads.triangulate(),
        # Not contiguous.
        (np.asfortranarray(vertices), np.asfortranarray(faces)),
        (unaligned(vertices), unaligned(faces)),
    ]:
        scene = imf.Scene(mesh, mill, pitch=0.5)
        np.testing.assert_array_equal(scene.solid, block.solid)
        assert scene.mesh[0].shape == (8, 3) and scene.mesh[1].shape == (12, 3)


def test_voxels_come_back_as_they_were(mill: imf.Tool) -> None:
    # At random: with cavities, pieces that meet in an edge or a corner, and the box's ends.
    solid = np.random.default_rng(1).random((12, 9, 7)) < 0.5
    solid[0, 0, 0] = solid[-1, -1, -1] = True
    scene = imf.Scene(imf.voxel_mesh(solid, origin=(1.5, -2, 5), pitch=2.0), mill, pitch=2.0)
    np.testing.assert_array_equal(scene.solid, solid)
    np.testing.assert_allclose(scene.grid.origin, [1.5, -2, 5])


def test_a_set_up_moves_the_part(mill: imf.Tool) -> None:
    scene = imf.Scene(CUBE, mill, pitch=1.0, transform=SHIFT)
    np.testing.assert_allclose(scene.grid.origin, [100, 0, -20], atol=1e-9)
    np.testing.assert_allclose(scene.mesh[0].min(axis=0), [100, 0, -20], atol=1e-9)


def test_warnings_are_warnings(mill: imf.Tool) -> None:
    vertices, faces = CUBE
    with pytest.warns(imf.SceneWarning, match="12 of 12 triangles faced the wrong way"):
        imf.Scene((vertices, faces[:, ::-1]), mill, pitch=1.0, name="cube")
    shank = imf.Tool({"shape": "flat", "diameter": 8, "length": 20}, shank={"diameter": 9, "length": 20})
    with pytest.warns(imf.SceneWarning, match="the shank .* is 0.5 mm a side wider than the cutter.*conservative=True"):
        imf.Scene(CUBE, shank, pitch=1.0)


def test_a_tool_is_described_as_in_its_file(tmp_path: Path) -> None:
    tool = imf.Tool({"shape": "ball", "diameter": 10, "length": 35}, holder=[{"diameter": 29, "length": 48}], name="paper")
    assert (tool.length, tool.stick_out) == (83.0, 35.0)
    assert tool.volume == pytest.approx(imf.Tool.paper().volume)
    np.testing.assert_allclose(tool.radius([[0.0, 5.0], [40.0, 90.0]]), [[0.0, 5.0], [14.5, 0.0]])
    path = tmp_path / "mill.toml"
    path.write_text('name = "mill"\n[cutter]\nshape = "flat"\ndiameter = 8.0\nlength = 30.0\n')
    assert imf.Tool.read(path).name == "mill" and [one.name for one in imf.Tool.library(path)] == ["mill"]
    assert imf.Tool(CUTTER | {"back_cutting": True}, name="T-slot cutter").name == "T-slot cutter"
    points = imf.Tool(CUTTER, sharp_points=[[4.0, 0, 0], [-4.0, 0, 0]], name="two points")
    assert imf.Tool(CUTTER, sharp_points=np.int64(8)).reach == points.reach
    assert points.reach == pytest.approx(np.hypot(4, 30))
    assert imf.Tool(CUTTER, sharp_points=[0, 0, 0]).reach == imf.Tool(CUTTER).reach


@pytest.mark.parametrize(
    ("make", "error", "words"),
    [
        (lambda mill: imf.Scene(CUBE), ValueError, "there is no tool for the part 'part'"),
        (lambda mill: imf.Scene("none.obj", mill), FileNotFoundError, "none.obj: there is no mesh file"),
        (lambda mill: imf.Scene(42, mill), ValueError, "int is not a mesh"),
        (lambda mill: imf.Scene((CUBE[0], CUBE[1] + 1), mill), ValueError, "names the vertex 8, and there are 8"),
        (lambda mill: imf.Scene((CUBE[0][:, :2], CUBE[1]), mill), ValueError, r"\(n, 3\), not \(n, 2\)"),
        (lambda mill: imf.Scene((CUBE[0], CUBE[1] * 1.0), mill), ValueError, "whole numbers"),
        (lambda mill: imf.Scene((CUBE[0] * np.nan, CUBE[1]), mill), ValueError, "not a finite number"),
        (lambda mill: imf.Scene(CUBE, mill, unit="furlong"), ValueError, "furlong"),
        (lambda mill: imf.Scene(CUBE, mill, pitch=-1.0), ValueError, "the pitch must be a positive finite number"),
        (lambda mill: imf.Scene(CUBE, mill, pitch=1.0, dims=(3, 3, 3)), ValueError, "pitch or dims"),
        (lambda mill: imf.Scene(CUBE, mill, pitch=8.0), ValueError, "or allow it.*allow_coarse=True"),
        (lambda mill: imf.Scene(CUBE, mill, pitch=1.0, clearance={"tip": 1}), ValueError, "not of tip"),
        (lambda mill: imf.Scene(CUBE, mill, pitch=1.0, transform=np.eye(3)), ValueError, "4 × 4"),
        (lambda mill: imf.Scene(CUBE, mill, pitch=1.0, transform=SHIFT.T), ValueError, "of 'part': .* it is transposed"),
        (lambda mill: imf.Scene(CUBE, mill, pitch=1.0, transform=2 * SHIFT), ValueError, "last row 0 0 0 2"),
        (lambda mill: imf.Scene(CUBE, mill, pitch=1.0, transform=SHIFT * np.nan), ValueError, "finite numbers"),
        (lambda mill: imf.Scene(CUBE, mill, transform=np.diag([1, 1, 2, 1])), ValueError, "'part': the matrix scales by 1, 1 and 2"),
        (lambda mill: imf.Scene(CUBE, mill, transform=np.diag([0, 0, 0, 1])), ValueError, "the matrix scales by 0, 0 and 0"),
        (lambda mill: imf.Scene(CUBE, mill, transform=np.diag([1, -1, 1, 1])), ValueError, "the matrix mirrors"),
        (lambda mill: imf.Scene(CUBE, mill, transform=SHEAR), ValueError, "the matrix shears"),
        (lambda mill: imf.Scene(CUBE, mill, pitch=1.0, fixtures=[(CUBE, SHEAR)]), ValueError, "fixture 1.* the matrix shears"),
        (lambda mill: imf.Scene(CUBE, mill, pitch=1.0, fixtures=[(CUBE, SHIFT.T)]), ValueError, "fixture 1.* transposed"),
        (lambda mill: imf.Scene(CUBE, mill, pitch=1.0, fixtures=[(CUBE, SHIFT[:3])]), ValueError, "4 × 4"),
        (lambda mill: imf.Scene(CUBE, mill, pitch=1.0, fixtures="clamp.stl"), ValueError, "are a list: give .'clamp.stl'"),
        (lambda mill: imf.Scene((CUBE[0] + 1e16, CUBE[1]), mill, pitch=1.0), ValueError, "too far from the origin"),
        (lambda mill: imf.Scene((CUBE[0], CUBE[1][:0]), mill, pitch=1.0), ValueError, "no triangle"),
        (lambda mill: imf.Scene(CUBE, "mill.toml"), ValueError, "'mill.toml' is not an imf.Tool"),
        (lambda mill: imf.Scene(CUBE, mill, dims=[9.5, 9, 9]), ValueError, "dims must be a whole number of at least 1, not 9.5"),
        (lambda mill: imf.Scene(CUBE, mill, pitch=1.0, margin=-1), ValueError, "margin must be a whole number"),
        (lambda mill: imf.Scene(CUBE, mill, dims=7), ValueError, "dims must be 3 whole numbers .*, not 7"),
        (lambda mill: imf.Scene(CUBE, mill, pitch=1.0, clearance=None), ValueError, "a clearance, .* must be a number, not None"),
        (lambda mill: imf.Scene(CUBE, mill, pitch=1.0).section("axes"), ValueError, "for several use sections"),
        (lambda mill: imf.Scene(CUBE, mill, pitch=1.0).section([[0, 0, 1], [1, 0, 0]]), ValueError, "for several use sections"),
        (lambda mill: imf.Scene(CUBE, mill, pitch=1.0).removable(True), ValueError, "bool is not a mesh"),
        (lambda mill: imf.Scene(CUBE, mill, pitch=1.0).directions("none.csv"), FileNotFoundError, "none.csv"),
        (lambda mill: imf.Scene(CUBE, mill, pitch=1.0).crib([CUTTER]), ValueError, "is not an imf.Tool"),
        (lambda mill: imf.Tool(CUTTER, holder={"diameter": 20, "length": 9}), ValueError, "a list of parts"),
        (lambda mill: imf.Tool({"shape": "flat", "diameter": 8}), ValueError, "length"),
        (lambda mill: imf.Tool(CUTTER | {"flutes": 3}), ValueError, "flutes"),
        (lambda mill: imf.Tool(CUTTER | {"diameter": None}), ValueError, "diameter of .cutter. must be a number, not None"),
        (lambda mill: imf.Tool("paper"), ValueError, "not by 'paper'; Tool.read.path. reads a file"),
        (lambda mill: imf.Tool(CUTTER, sharp_points=3.0), ValueError, "sharp_points must be 'tip', .*, not 3.0"),
        (lambda mill: imf.Tool(CUTTER, sharp_points=[1, 2]), ValueError, "sharp_points must be 'tip'"),
        (lambda mill: imf.Checker("bracket"), ValueError, "'bracket' is not an imf.Scene"),
        (lambda mill: imf.voxel_mesh(np.ones((3, 3, 3))), ValueError, "must be booleans .* not float64 of the shape"),
        (lambda mill: imf.voxel_mesh(np.ones((3, 3, 3), bool), pitch=-1), ValueError, "pitch must be a positive length, not -1"),
        (lambda mill: imf.set_threads(10**6), ValueError, "a whole number from 0, .*, not 1000000"),
        (lambda mill: imf.set_threads(-1), ValueError, "a whole number from 0, .*, not -1"),
        (lambda mill: imf.set_threads(1.5), ValueError, "a whole number from 0, .*, not 1.5"),
        (lambda mill: imf.Tool.read("none.toml"), FileNotFoundError, "none.toml"),
        (lambda mill: imf.Scene(CUBE, mill, pitch=1.0).imf("spiral:9"), ValueError, "spiral:9"),
        (lambda mill: imf.Scene(CUBE, mill, pitch=1.0).imf([[0, 0, 0]]), ValueError, "direction 0 has no length"),
        (lambda mill: imf.poses([[0, 0, 0]] * 2, [[0, 0, 1]] * 3), ValueError, "2 positions and 3 directions"),
        (lambda mill: imf.Checker(imf.Scene(CUBE, mill, pitch=1.0)).is_free(np.zeros((2, 5))), ValueError, r"\(2, 5\)"),
    ],
)
def test_what_cannot_be_used_is_said(make: object, error: type[Exception], words: str, mill: imf.Tool) -> None:
    with pytest.raises(error, match=words):
        make(mill)  # type: ignore[operator]


def test_more_than_memory_holds_is_refused(bracket: imf.Scene) -> None:
    with pytest.raises(MemoryError, match="966.* GB of memory, and .* 10000000 sections of 24157 voxels"):
        bracket.sections("fibonacci:10000000")
    with pytest.raises(MemoryError, match="8000000 samples, 1000000 directions"):
        bracket.access("fibonacci:1000000", samples=1_000_000)
    with pytest.raises(MemoryError, match="samples"):
        bracket.access("axes", samples=2**62)
    for family in ("siren5", "factored"):
        with pytest.raises(MemoryError, match="64 hidden layers of 8192 neurons"):
            imf.train(bracket, family, layers=(64, 8192), steps=1, calibrate=False)
    with pytest.raises(MemoryError, match="voxels; use a larger pitch"):
        imf.Scene(CUBE, imf.Tool(CUTTER), pitch=1e-4)
