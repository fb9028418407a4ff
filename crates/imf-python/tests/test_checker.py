"""Poses against a direct count of voxels, motions against closed forms."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from conftest import Floats, box, head, inside_paper_tool, paper_radius

import imf


def test_poses_collide_where_a_voxels_centre_is_in_the_tool(bracket: imf.Scene, poses: Floats) -> None:
    solid = bracket.grid.centres()[bracket.solid.ravel()]
    pitch = bracket.grid.pitch
    expected = np.array([inside_paper_tool(solid, row[:3], row[3:], pitch).sum() for row in poses])
    checker = imf.Checker(bracket)
    free = checker.is_free(poses)
    assert isinstance(free, np.ndarray) and free.dtype == np.bool_
    assert 50 < free.sum() < 250
    np.testing.assert_array_equal(free, expected == 0)
    np.testing.assert_array_equal(checker.classify(poses), expected > 0)
    # The tool's own count depends on its rotation by a few voxels.
    overlap = checker.overlap(poses)
    whole = imf.Tool.paper().volume / pitch**3
    np.testing.assert_allclose(overlap * whole, expected, rtol=0.03)


def test_one_pose_alone_is_one_of_many(bracket: imf.Scene, poses: Floats) -> None:
    checker = imf.Checker(bracket)
    alone = [checker.is_free(row) for row in poses[:40]]
    assert all(type(answer) is bool for answer in alone)
    np.testing.assert_array_equal(alone, checker.is_free(poses[:40]))


def test_a_quaternion_is_its_axis(bracket: imf.Scene, poses: Floats) -> None:
    # Half a turn about the middle of z and the axis brings z to the axis.
    middle = poses[:, 3:] + [0.0, 0.0, 1.0]
    middle /= np.linalg.norm(middle, axis=1, keepdims=True)
    turned = np.column_stack([poses[:, :3], middle, np.zeros(len(poses))])
    checker = imf.Checker(bracket)
    np.testing.assert_array_equal(checker.is_free(turned), checker.is_free(poses))


def test_axes_of_any_length_and_side_are_directions(bracket: imf.Scene, poses: Floats) -> None:
    checker = imf.Checker(bracket)
    longer = poses * [1, 1, 1, 1e3, 1e3, 1e3]
    np.testing.assert_array_equal(checker.is_free(longer), checker.is_free(poses))
    solid = bracket.grid.centres()[bracket.solid.ravel()]
    down = imf.poses(poses[:, :3], [0.0, 0.0, -1.0])
    expected = [not inside_paper_tool(solid, row[:3], row[3:], bracket.grid.pitch).any() for row in down]
    np.testing.assert_array_equal(checker.is_free(down), expected)
    assert 0 < sum(expected) < len(expected)


def test_what_is_no_pose_is_never_free(bracket: imf.Scene) -> None:
    bad = np.array([[0, 0, np.nan, 0, 0, 1], [0, 0, 500, 0, 0, 0], [np.inf, 0, 0, 0, 0, 1]])
    checker = imf.Checker(bracket)
    assert not np.any(checker.is_free(bad)) and np.isnan(checker.overlap(bad)).all()
    masked = np.ma.masked_array([[0.0, 0, 500, 0, 0, 1]], mask=[[False, False, True, False, False, False]])
    for ask in (checker.is_free, checker.overlap, lambda rows: imf.poses(rows[:, :3], [0, 0, 1])):
        with pytest.raises(ValueError, match="masked"):
            ask(masked)
    assert checker.is_free(np.ma.masked_array(masked.data))


def test_clearances_are_proven_lengths(block: imf.Scene) -> None:
    # Over the block's top, by so much.
    heights = np.array([22.0, 25.0, 40.0])
    tips = np.column_stack([np.full(3, 10.0), np.full(3, 10.0), heights])
    proven = imf.Checker(block).clearance(imf.poses(tips, [0, 0, 1]))
    # Solid centres begin half a pitch below the surface; balls around a flat end reach beyond it, by less than its radius.
    true = heights - 20.0 + 0.25
    assert np.all(proven <= true) and np.all(proven >= true - 4.0), proven
    assert proven[2] > proven[1] > 0 and imf.Checker(block).clearance([[10, 10, 10, 0, 0, 1]])[0] < 0


def test_distances_of_a_block_are_closed_forms(block: imf.Scene) -> None:
    # Centres lie 0.25 within the faces. Over the top, beside a face by the holder and by the flank, over a corner, and 3 deep in the top.
    tips = [[10, 10, 22], [10.25, -30, -20], [-9, 10.25, 5], [-7, -7, 23], [10, 10, 17]]
    found = imf.Checker(block).distance(imf.poses(np.array(tips, float), [0, 0, 1]))
    # The holder, 20 in radius, is at the block's height; upright and over the corner the flat end's rim is nearest.
    corner = np.hypot(np.hypot(7.25, 7.25) - 4.0, 23.0 - 19.75)
    expected = [22.0 - 19.75, 30.25 - 20.0, 9.25 - 4.0, corner]
    np.testing.assert_allclose(found.lower[:4], expected, atol=1e-9)
    np.testing.assert_array_equal(found.lower[:4], found.upper[:4])
    assert found.element == ["cutter", "holder 1", "cutter", "cutter", "cutter"]
    np.testing.assert_allclose(found.obstacle_point[3], [0.25, 0.25, 19.75])
    apart = np.linalg.norm(found.tool_point - found.obstacle_point, axis=1)
    np.testing.assert_allclose(apart[:4], expected, atol=1e-9)
    # Upwards is the shortest way out: to the last plane of centres.
    assert found.lower[4] <= -2.75 <= found.upper[4] < 0.0 and found.lower[4] > -2.76


def test_distances_are_those_of_all_voxels(bracket: imf.Scene, poses: Floats) -> None:
    checker = imf.Checker(bracket)
    found = checker.distance(poses)
    free = checker.is_free(poses)
    np.testing.assert_array_equal(found.lower > 0, free)
    # At contact 0, not −0.
    assert not np.signbit(found.upper[found.upper == 0]).any()
    assert np.all(found.lower <= found.upper) and np.all(checker.clearance(poses)[free] <= found.lower[free] + 1e-9)
    # The nearest point of a revolved outline, drawn by points 0.01 apart, to the centres.
    heights = np.arange(0.0, 83.0, 0.01)
    outline = np.column_stack([heights, paper_radius(heights)])
    radii = np.arange(0.0, 14.5, 0.01)
    ends = [np.column_stack([np.full_like(radii, height), radii]) for height in (35.0, 83.0)]
    outline = np.vstack([outline, ends[0][radii >= 5.0], ends[1]])
    solid = bracket.grid.centres()[bracket.solid.ravel()]
    for row, lower in list(zip(poses[free], found.lower[free]))[:12]:
        along = (solid - row[:3]) @ row[3:]
        across = np.sqrt(np.maximum(((solid - row[:3]) ** 2).sum(axis=1) - along**2, 0.0))
        # Only centres that may be nearest are compared with all of the outline.
        near = np.argsort(np.hypot(across - 5.0, along - np.clip(along, 0.0, 83.0)))[:400]
        apart = np.hypot(along[near, None] - outline[:, 0], across[near, None] - outline[:, 1]).min()
        np.testing.assert_allclose(lower, apart, atol=0.02)


def test_what_is_no_pose_has_no_distance(bracket: imf.Scene) -> None:
    found = imf.Checker(bracket).distance([[0, 0, np.nan, 0, 0, 1], [0, 0, 500, 0, 0, 1]])
    assert np.isnan(found.lower[0]) and np.isnan(found.tool_point[0]).all() and found.element[0] == ""
    assert found.lower[1] == found.upper[1] > 400


def test_distances_are_of_fixtures_too_and_clearances_take_their_room(mill: imf.Tool) -> None:
    # The wall's first centres lie at x = 40.25, 4.25 beyond the flank at 36; the block's last ones, at 19.75, are farther.
    wall = box((40, 0, 0), (44, 20, 20))
    scene = imf.Scene(box((0, 0, 0), (20, 20, 20)), mill, pitch=0.5, fixtures=[wall], around="all", name="block")
    pose = imf.poses([[32.0, 10.25, 5.0]], [0, 0, 1])
    found = imf.Checker(scene).distance(pose)
    np.testing.assert_allclose([found.lower[0], found.obstacle_point[0, 0]], [40.25 - 32.0 - 4.0, 40.25])
    roomy = imf.Checker(scene, clearance={"cutter": 1.5}).distance(pose)
    np.testing.assert_allclose([roomy.lower[0], roomy.tool_point[0, 0]], [4.25 - 1.5, 32.0 + 4.0 + 1.5])
    assert roomy.element == ["cutter"] and roomy.lower[0] == roomy.upper[0]


def test_no_poses_have_no_distances(bracket: imf.Scene) -> None:
    found = imf.Checker(bracket).distance(np.empty((0, 6)))
    assert found.lower.shape == found.upper.shape == (0,) and found.element == []
    assert found.tool_point.shape == found.obstacle_point.shape == (0, 3)


def test_a_mesh_tool_has_no_distance(tmp_path: Path) -> None:
    scene = imf.Scene(box((0, 0, 0), (20, 20, 20)), head(tmp_path, (-3, -3, 0), (3, 3, 20)), pitch=1.0, name="block")
    checker = imf.Checker(scene)
    assert checker.is_free([10, 10, 25, 0, 0, 1])
    for poses in ([[10, 10, 25, 0, 0, 1]], np.empty((0, 6))):
        for ask in (checker.distance, checker.clearance):
            with pytest.raises(ValueError, match="distances are of tools of revolution"):
                ask(poses)


def test_motions_collide_when_the_flank_meets_the_face(block: imf.Scene) -> None:
    # A cutter of radius 4 comes along x to the face at x = 0, and another passes above the top at z = 20.
    start = imf.poses([[-24.0, 10.0, 5.0], [-24.0, 10.0, 21.0]], [0, 0, 1])
    end = imf.poses([[-3.0, 10.0, 5.0], [44.0, 10.0, 21.0]], [0, 0, 1])
    found = imf.Checker(block).check_motion(start, end)
    assert found.decision.tolist() == [imf.Decision.COLLIDING, imf.Decision.FREE]
    # The holder, 20 in radius from 30 above the tip, is above the block all the time. The first centres lie at x = 0.25.
    expected = (20.0 + 0.25) / 21.0
    np.testing.assert_allclose(found.at[0], expected, atol=0.01)
    assert found.free_until[0] <= found.at[0] and np.isnan(found.at[1]) and found.free_until[1] == 1.0


def test_a_clearance_keeps_the_holder_away(block: imf.Scene) -> None:
    # The holder's face is 30 above the tip, a millimetre above the top.
    pose = [10.0, -10.0, -9.0, 0.0, 0.0, 1.0]
    assert imf.Checker(block).is_free(pose)
    assert not imf.Checker(block, clearance=2.0).is_free(pose)
    assert imf.Checker(block, clearance={"holder": 0.5}).is_free(pose)
