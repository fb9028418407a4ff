"""Fields: near the exact one, saved and loaded, with slopes that are those of their values."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from conftest import Floats, box, head
from numpy.typing import NDArray

import imf


@pytest.fixture(scope="module")
def harmonic(bracket: imf.Scene) -> imf.Field:
    return imf.train(bracket, "harmonic", degree=8, calibrate=False)


def test_a_fit_is_close_to_exact_sections(bracket: imf.Scene, harmonic: imf.Field) -> None:
    assert (harmonic.family, harmonic.quantity, harmonic.verdict) == ("harmonic", "overlap", None)
    axis = np.array([0.36, -0.48, 0.8])
    learnt = harmonic(imf.poses(bracket.grid.centres(), axis)).reshape(bracket.grid.dims)
    exact = bracket.section(axis).values
    # What degree 8 leaves of steps; more harmonics leave less.
    error = np.sqrt(np.mean((learnt - exact) ** 2))
    assert error < 0.25 * exact.std(), error
    coarser = imf.train(bracket, "harmonic", degree=4, calibrate=False)
    rough = coarser(imf.poses(bracket.grid.centres(), axis)).reshape(bracket.grid.dims)
    assert error < 0.7 * np.sqrt(np.mean((rough - exact) ** 2))


def test_gradients_are_differences_of_values(harmonic: imf.Field, poses: Floats) -> None:
    # Where values are not clipped, inside the box.
    values = harmonic(poses)
    low, high = harmonic.bounds
    inside = np.all((poses[:, :3] > low + 1) & (poses[:, :3] < high - 1), axis=1)
    chosen = poses[(values > 0.01) & (values < 0.9) & inside][:60]
    assert len(chosen) > 20
    found = harmonic.gradient(chosen)
    np.testing.assert_allclose(found.value, harmonic(chosen), atol=1e-6)
    pitch, faults = harmonic.grid.pitch, []
    for axis in range(3):
        # Tangents of the sphere, by a step of a hundredth of a radian either way.
        tangent = np.eye(3)[axis] - chosen[:, 3:] * chosen[:, 3 + axis : 4 + axis]
        step = np.hstack([np.zeros((len(chosen), 3)), 0.01 * tangent])
        slope = (harmonic(chosen + step) - harmonic(chosen - step)) / 0.02
        faults.append(np.abs(slope - (found.direction * tangent).sum(axis=1)).max())
        step = np.zeros(6)
        step[axis] = 0.01 * pitch
        slope = (harmonic(chosen + step) - harmonic(chosen - step)) / (0.02 * pitch)
        # Trilinear between centres: where a difference does not cross one, it is the slope.
        centre = (chosen[:, axis] - low[axis]) / pitch
        smooth = np.abs(centre - np.round(centre)) > 0.02
        faults.append(np.abs(slope - found.position[:, axis])[smooth].max())
    scale = np.abs(found.direction).max()
    # Single precision over the steps, and the square of the turn.
    assert max(faults) < 2e-3 * max(scale, 1.0), faults


def test_the_best_direction_is_the_least_value(harmonic: imf.Field, poses: Floats) -> None:
    directions = np.array([[0, 0, 1.0], [1, 0, 0], [0, -1, 0], [0.36, -0.48, 0.8]])
    found = harmonic.best(poses[:50, :3], directions)
    values = np.stack([harmonic(imf.poses(poses[:50, :3], axis)) for axis in directions])
    np.testing.assert_allclose(found.value, values.min(axis=0), atol=1e-6)
    chosen = values[found.direction, np.arange(50)]
    np.testing.assert_allclose(chosen, values.min(axis=0), atol=1e-6)
    np.testing.assert_array_equal(harmonic.best(poses[:50, :3], "0,0;30,40").direction < 2, True)


OPTIONS: dict[str, dict[str, Any]] = {
    "harmonic": {"degree": 3},
    "factored": {"degree": 3, "steps": 40, "layers": (2, 16)},
    "siren5": {"steps": 40, "layers": [2, 16], "directions": np.eye(3)},
}


@pytest.mark.parametrize("family", OPTIONS)
def test_every_family_comes_back_from_its_file(bracket: imf.Scene, poses: Floats, family: str, tmp_path: Path) -> None:
    field = imf.train(bracket, family, calibrate=False, **OPTIONS[family])
    path = tmp_path / "field.safetensors"
    field.save(path)
    again = imf.load(path)
    assert (again.family, again.part, again.quantity) == (family, "bracket", "overlap")
    np.testing.assert_allclose(again(poses), field(poses), atol=1e-3)
    assert isinstance(float(again(poses[0])), float) and np.isnan(again([0, 0, 0, 0, 0, 0]))
    assert set(again.classify(poses)) == {imf.Decision.UNDECIDED}


def test_tools_that_are_not_round_have_the_degree_of_the_command(tmp_path: Path) -> None:
    tool = head(tmp_path, (-3, -3, 0), (3, 3, 20))
    scene = imf.Scene(box((0, 0, 0), (20, 20, 20)), tool, pitch=4.0, margin=1, name="block")
    path = tmp_path / "field.safetensors"
    imf.train(scene, "harmonic", quantity="overlap", calibrate=False).save(path)
    assert b'\\"degree\\":8,' in path.read_bytes()
    # Directions without roll are said to be so, of poses once.
    pose = [10, 10, 30, 0, 0, 1]
    unrolled: list[Callable[[imf.Field], object]] = [
        lambda field: (field(pose), field([pose])),
        lambda field: field.gradient([pose]),
        lambda field: field.classify([pose]),
        lambda field: field.best(pose[:3], "axes"),
        lambda field: field.to_xarray([0, 0, 1]),
    ]
    for ask in unrolled:
        field = imf.load(path)
        with pytest.warns(imf.SceneWarning, match="not round, .* quaternions") as said:
            ask(field)
        assert len(said) == 1 and said[0].filename == __file__
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        imf.load(path)([10, 10, 30, 0, 0, 0, 1])
        imf.load(path).best(pose[:3], [0, 0, 0, 1])


def test_a_field_knows_its_scene(mill: imf.Tool) -> None:
    solid = np.ones((10, 10, 10), dtype=np.bool_)
    pocket = solid.copy()
    pocket[3:7, 3:7, 6:] = False

    def scene(of: NDArray[np.bool_], tool: imf.Tool = mill, **options: Any) -> imf.Scene:
        return imf.Scene(imf.voxel_mesh(of, pitch=2.0), tool, pitch=2.0, margin=2, **options)

    block, slim = scene(solid), imf.Tool({"shape": "flat", "diameter": 6, "length": 30}, name="mill")
    held = scene(solid, contact=2.0, fixtures=[box((0, 0, 20), (20, 20, 22))])
    others = [scene(pocket), scene(solid, slim), scene(solid, clearance=1.0), held]
    for quantity in ("overlap", "depth"):
        field = imf.train(block, "harmonic", quantity=quantity, degree=3, calibrate=False)
        assert field.is_of(block) and field.is_of(scene(solid, name="again"))
        assert [field.grid == other.grid and field.is_of(other) for other in others] == [False] * 4
    assert (field.contact, field.fixtures, block.contact) == (None, [], None)
    field = imf.train(held, "harmonic", quantity="overlap", degree=3, calibrate=False)
    assert (field.contact, field.fixtures, held.contact) == (2.0, ["fixture 1"], 2.0) and field.is_of(held)


def test_a_distilled_network_learns(bracket: imf.Scene) -> None:
    axis = np.array([0.0, 0.6, 0.8])
    rows = imf.poses(bracket.grid.centres(), axis)
    exact = bracket.section(axis).values.ravel()
    errors = []
    for steps in (10, 400):
        field = imf.train(bracket, "factored", degree=8, steps=steps, layers=(3, 48), calibrate=False)
        errors.append(np.mean((field(rows) - exact) ** 2))
    assert errors[1] < 0.5 * errors[0] and errors[1] < 0.06 * exact.var(), errors


def test_a_network_is_reduced_by_its_parts_symmetry_unless_told_not_to(mill: imf.Tool) -> None:
    scene = imf.Scene(box((0, 0, 0), (20, 16, 12)), mill, pitch=2.0, margin=3, name="block")
    small = {"degree": 3, "steps": 5, "layers": (2, 16), "calibrate": False}
    reduced, whole = (imf.train(scene, "factored", symmetry=symmetry, **small) for symmetry in (None, False))
    assert reduced.symmetry is not None and "mirrored across x and y" in reduced.symmetry
    assert whole.symmetry is None


def test_depths_decide_and_say_what_that_is_worth(mill: imf.Tool) -> None:
    scene = imf.Scene(box((0, 0, 0), (20, 20, 20)), mill, pitch=2.0, margin=6, name="block")
    field = imf.train(scene, "harmonic", degree=10)
    assert field.quantity == "depth" and field.verdict
    # Two voxels of room make depths decide; 7.5 are told apart.
    assert field.clearance == {"holder": 4.0, "shank": 4.0, "cutter": 0.0} and field.range == (-15.0, 15.0)
    assert field.tool.name == "mill" and field.fit_error is not None and 0 < field.fit_error < 2.0
    # Another part with the same name, tool and grid is another scene.
    notched = np.ones((20, 20, 20), bool)
    notched[10:12, 10:12, 18:] = False
    changed = imf.Scene(imf.voxel_mesh(notched), mill, pitch=2.0, margin=6, name="block")
    assert field.is_of(scene) and not field.is_of(changed)
    # High above, and in the middle.
    assert field.classify(imf.poses([[10, 10, 29], [10, 10, 10]], [0, 0, 1])).tolist() == [0, 1]
    assert field([10, 10, 29, 0, 0, 1]) < 0 < field([10, 10, 10, 0, 0, 1])


def test_what_a_family_cannot_have_is_refused(bracket: imf.Scene, mill: imf.Tool, tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="'harmonic', 'factored' or 'siren5', not 'linear'"):
        imf.train(bracket, "linear")
    with pytest.raises(ValueError, match="learns overlaps alone"):
        imf.train(bracket, "siren5", quantity="depth")
    with pytest.raises(ValueError, match="degree of 99"):
        imf.train(bracket, "harmonic", degree=99)
    with pytest.raises(ValueError, match="1099511627776"):
        imf.train(bracket, "harmonic", degree=2**40)
    for family, unknown in [("harmonic", "steps"), ("factored", "directions"), ("siren5", "degree")]:
        with pytest.raises(ValueError, match=f"{family} has no {unknown}: it takes"):
            imf.train(bracket, family, **{unknown: 3})
    with pytest.raises(ValueError, match="seed must be a whole number of at least 0, not -1"):
        imf.train(bracket, "siren5", seed=-1)
    with pytest.raises(ValueError, match="layers must be 2 whole numbers .hidden layers, neurons of each., not 64"):
        imf.train(bracket, "siren5", layers=64)  # type: ignore[arg-type]
    with pytest.raises(ValueError, match="'bracket' is not an imf.Scene"):
        imf.train("bracket")  # type: ignore[arg-type]
    with pytest.raises(FileNotFoundError, match="none.safetensors"):
        imf.load(tmp_path / "none.safetensors")
    (tmp_path / "other.safetensors").write_bytes(b"no field")
    with pytest.raises(ValueError, match="other.safetensors"):
        imf.load(tmp_path / "other.safetensors")
