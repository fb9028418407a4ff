"""Surfaces whose reachable area is known."""

from __future__ import annotations

import numpy as np
import pytest
from conftest import CUTTER, HOLDER, box, slotted_block

import imf

# The block's faces, in mm²: ends, bottom, sides, what is left of the top.
OUTSIDE = 2 * 20 * 30 + 30 * 30 + 2 * 20 * 30 + 30 * 30


def test_a_slot_that_is_too_narrow_is_gouged(mill: imf.Tool) -> None:
    width, depth = 6.0, 10.0
    scene = imf.Scene(slotted_block(width, depth), mill, pitch=0.5, name="block")
    found = scene.access("axes", samples=6_000)
    slot = 30 * (width + 2 * depth)
    total = OUTSIDE - 2 * width * depth - 30 * width + slot
    np.testing.assert_allclose(found.areas.sum(), total, rtol=1e-9)
    # But for samples next to the slot's edges, whose triangles are cut in two.
    assert abs(found.fraction(imf.Verdict.GOUGED) - slot / total) < 0.01
    assert abs(found.reached - (1 - slot / total)) < 0.01
    assert abs(found.reached_at_twice_the_pitch - found.reached) < 0.05
    inside = (np.abs(found.points[:, 1]) < width / 2 - 1e-6) & (found.points[:, 2] > 20 - depth - 1e-6)
    # At the slot's ends the cutter stands outside, and its flank reaches in by what it may cut.
    floor = inside & (found.normals[:, 2] > 0.5) & (np.abs(found.points[:, 0]) < 13)
    assert floor.sum() > 100 and not found.free[floor].any()
    # Every face is reached from its own side.
    top = (found.normals[:, 2] > 0.5) & ~inside
    up = int(np.argmax(found.directions @ [0, 0, 1]))
    assert found.free[top, up].all()
    np.testing.assert_allclose(found.by_direction[up], found.areas[found.free[:, up]].sum() / total)


def test_a_cube_needs_two_set_ups_on_three_axes(block: imf.Scene) -> None:
    # From above: the top, and the sides by the flank, as the cutter is longer than the cube is high.
    plan = block.setups("axes")
    assert len(plan.setups) == 2 and plan.is_proven and plan.candidates == 6
    assert plan.reached == pytest.approx(1.0) and plan.reachable == pytest.approx(1.0)
    for setup in plan.setups:
        np.testing.assert_allclose(setup.rotation @ setup.up, [0, 0, 1], atol=1e-12)
        assert setup.reached == pytest.approx(5 / 6, abs=0.01)
    assert set(np.unique(plan.by_sample)) == {0, 1}


def test_the_floor_of_a_slot_takes_the_stick_out_of_its_depth() -> None:
    shank = {"diameter": 8, "length": 40}
    tool = imf.Tool(CUTTER | {"length": 10}, shank, HOLDER, stick_out=12.0, name="short")
    scene = imf.Scene(slotted_block(12.0, 16.0), tool, pitch=0.5, name="block")
    found = scene.access([[0.0, 0.0, 1.0]], samples=1_500)
    floor = (found.normals[:, 2] > 0.5) & (found.points[:, 2] < 5)
    assert (found.verdict[floor] == imf.Verdict.OBSTRUCTED).all()
    # Beside a wall that the cutter may cut by the tolerance its shank is in the way as well.
    worst = max(found.obstructed_by, key=lambda obstruction: obstruction.fraction)
    assert (worst.element, worst.against) == ("holder 1", "part")
    stick_outs = found.stickout()
    assert (stick_outs.given, stick_outs.longest) == (12.0, 50.0)
    # The slot is 16 deep; voxels' centres begin half a pitch below the top.
    np.testing.assert_allclose(stick_outs.length[floor], 16.0, atol=0.5)
    # No stick-out helps the bottom.
    reachable = np.isfinite(stick_outs.length)
    assert 0 < reachable.mean() < 1
    assert stick_outs.fraction(np.inf) == pytest.approx(found.areas[reachable].sum() / found.areas.sum())
    longer = imf.Tool(CUTTER | {"length": 10}, shank, HOLDER, stick_out=16.5, name="long")
    again = imf.Scene(slotted_block(12.0, 16.0), longer, pitch=0.5, name="block").access([[0.0, 0.0, 1.0]], samples=1_500)
    assert (again.verdict[floor] == imf.Verdict.REACHED).all()


def test_a_fixture_is_named_and_set_ups_refuse_it(mill: imf.Tool) -> None:
    # A wall beside the cube, as high as the holder.
    wall = box((-26, -20, 0), (-6, 40, 60))
    scene = imf.Scene(box((0, 0, 0), (20, 20, 20)), mill, pitch=1.0, fixtures=[wall], around="all", name="block")
    found = scene.access("axes", samples=2_000)
    names = {obstruction.against for obstruction in found.obstructed_by}
    assert names == {"fixture 1"} and found.reached < 1
    with pytest.raises(ValueError, match="a fixture belongs to one set-up"):
        found.setups()
