"""Sections and their minimum against direct sums over voxels."""

from __future__ import annotations

import multiprocessing
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from conftest import Floats, box, head, inside_paper_tool
from numpy.typing import NDArray

import imf


def direct_sum(scene: imf.Scene, axis: Floats) -> NDArray[np.float64]:
    """The definition: at every voxel the solid voxels in the tool whose tip is there, over the tool's own."""
    pitch, dims = scene.grid.pitch, np.array(scene.grid.dims)
    most = int(np.ceil(85.0 / pitch))
    span = [np.arange(-min(most, n), min(most, n) + 1) for n in dims]
    # Those beyond the grid count in the tool alone.
    reach = np.arange(-most, most + 1)
    whole = np.stack(np.meshgrid(reach, reach, reach, indexing="ij"), -1).reshape(-1, 3)
    count = inside_paper_tool(whole * pitch, np.zeros(3), axis, pitch).sum()
    offsets = np.stack(np.meshgrid(*span, indexing="ij"), -1).reshape(-1, 3)
    offsets = offsets[inside_paper_tool(offsets * pitch, np.zeros(3), axis, pitch)]
    solid = np.pad(scene.solid.astype(np.int64), [(n, n) for n in dims])
    total = np.zeros(dims, dtype=np.int64)
    for dx, dy, dz in offsets + dims:
        total += solid[dx : dx + dims[0], dy : dy + dims[1], dz : dz + dims[2]]
    return total / count


DIRECTIONS = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.36, -0.48, 0.8]])


@pytest.mark.parametrize("axis", DIRECTIONS, ids=["up", "across", "leaning"])
def test_a_section_is_the_direct_sum(bracket: imf.Scene, axis: Floats) -> None:
    section = bracket.section(axis)
    assert section.values.shape == bracket.grid.dims and section.values.dtype == np.float32
    np.testing.assert_allclose(section.direction, axis, atol=1e-12)
    expected = direct_sum(bracket, axis)
    assert expected.max() > 0.1
    # Whole numbers over the same number, rounded once.
    np.testing.assert_allclose(section.values, expected, rtol=1e-6)


def test_the_minimum_is_that_of_the_sections(bracket: imf.Scene) -> None:
    sections = bracket.sections("fibonacci:12")
    assert sections.values.shape == (12, *bracket.grid.dims) and len(sections) == 12
    found = bracket.imf("fibonacci:12")
    np.testing.assert_array_equal(found.values, sections.values.min(axis=0))
    np.testing.assert_array_equal(found.best, sections.values.argmin(axis=0))
    np.testing.assert_array_equal(found.directions, sections.directions)
    np.testing.assert_array_equal(bracket.imf(sections.directions).values, found.values)
    np.testing.assert_allclose(bracket.directions(2 * sections.directions), sections.directions, atol=1e-12)


def test_a_rotation_is_its_direction(bracket: imf.Scene) -> None:
    # A quarter turn about y brings z to x.
    quaternion = [0.0, np.sqrt(0.5), 0.0, np.sqrt(0.5)]
    np.testing.assert_array_equal(bracket.section(quaternion).values, bracket.section([1.0, 0.0, 0.0]).values)


def test_the_number_of_threads_changes_nothing(bracket: imf.Scene) -> None:
    usual = bracket.imf("fibonacci:7").values
    imf.set_threads(1)
    try:
        np.testing.assert_array_equal(bracket.imf("fibonacci:7").values, usual)
    finally:
        imf.set_threads(0)


def test_a_process_that_is_forked_computes_on_threads_of_its_own(bracket: imf.Scene, poses: Floats) -> None:
    if "fork" not in multiprocessing.get_all_start_methods():
        pytest.skip("this system does not fork")
    checker = imf.Checker(bracket)

    def answers() -> tuple[NDArray[Any], NDArray[Any]]:
        return bracket.imf("fibonacci:7").values, checker.is_free(poses)

    usual = answers()
    for threads in (0, 1):
        imf.set_threads(threads)
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore", DeprecationWarning)
                reader, writer = multiprocessing.Pipe(duplex=False)
                child = multiprocessing.get_context("fork").Process(target=lambda: writer.send(answers()), daemon=True)
                child.start()
            # Without it the end of a child that fails is seen at once.
            writer.close()
            assert reader.poll(120), "the child does not end"
            for found, expected in zip(reader.recv(), usual):
                np.testing.assert_array_equal(found, expected)
            child.join()
        finally:
            imf.set_threads(0)


def test_the_solid_voxels_are_those_whose_centres_are_inside(block: imf.Scene) -> None:
    assert block.grid.dims == (40, 40, 40) and block.solid.all()
    np.testing.assert_allclose(block.grid.origin, 0.0, atol=1e-12)
    np.testing.assert_allclose(block.grid.axes()[0][:2], [0.25, 0.75])
    assert block.grid.centres().shape == (64_000, 3)


def test_the_best_rotation_of_a_tool_that_is_not_round_is_free(tmp_path: Path) -> None:
    part = box((0, 0, 0), (20, 20, 20))
    scene = imf.Scene(part, head(tmp_path, (-3, -3, 0), (9, 3, 12)), pitch=1.0, margin=3)
    found = scene.imf("so3:40")
    places = np.argwhere(found.values == 0)
    tips = np.stack([axis[places[:, k]] for k, axis in enumerate(scene.grid.axes())], -1)
    best = found.best[tuple(places.T)]
    checker = imf.Checker(scene)
    assert len(places) > 1000 and not checker.classify(imf.poses(tips, found.rotations[best])).any()
    # A direction does not say how the tool is rolled, which is said once of a checker.
    with pytest.warns(imf.SceneWarning, match=r"not round, .* poses \(n, 7\)") as said:
        assert checker.classify(imf.poses(tips, found.directions[best])).any()
        checker.is_free([0, 0, 50, 0, 0, 1])
    assert len(said) == 1 and said[0].filename == __file__
    unrolled: list[Callable[[], object]] = [
        lambda: scene.section([0, 0, 1]),
        lambda: scene.sections("axes"),
        lambda: scene.imf(DIRECTIONS),
        lambda: scene.access("axes", samples=50),
    ]
    for ask in unrolled:
        with pytest.warns(imf.SceneWarning, match="not round, .* so3:N") as said:
            ask()
        assert said[0].filename == __file__
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        scene.section([0, 0, 0, 1])
        scene.imf("so3:3")
    np.testing.assert_array_equal(scene.rotations("so3:40"), found.rotations)
