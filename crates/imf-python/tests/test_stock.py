"""Stock around a block: what a path takes of it, what a cutter can take at all; tools of a crib as one by one."""

from __future__ import annotations

import numpy as np
import pytest

from conftest import CUTTER, HOLDER, box, slotted_block

import imf


def test_a_path_takes_a_slot_of_the_stock_and_its_holder_is_told(block: imf.Scene) -> None:
    # Stock of 5 around a cube of 20: 4 high above z = 21, along a row of 30 in y = 10.
    path = imf.poses([[-20, 10, 40], [-20, 10, 21], [40, 10, 21]], [0, 0, 1])
    report = block.check(path, stock=5)
    assert not report.collides and report.stock is not None
    left = report.stock
    assert left.volume == pytest.approx(30**3)
    assert left.lines.tolist() == [1, 2, 3] and left.removed[:2].tolist() == [0, 0]
    assert left.removed[2] == pytest.approx(8 * 4 * 30, rel=0.03)
    assert left.removed_of_part.tolist() == [0, 0, 0]
    gone = left.removed_by_line == 3
    assert gone.sum() * left.grid.pitch**3 == pytest.approx(left.removed[2])
    assert not (gone & left.remaining).any()
    assert left.left_beside_part == pytest.approx(30**3 - 20**3 - left.removed[2])
    # The same stock as a mesh; a holder that comes down beside the slot, its face 30 above the tip.
    mesh = box((-5, -5, -5), (25, 25, 25))
    report = block.check(imf.poses([[-30, 10, 40], [-30, 10, -10], [-10, 10, -10]], [0, 0, 1]), stock=mesh)
    assert report.stock is not None and report.stock.volume == pytest.approx(30**3)
    assert [(hit.element, hit.against, hit.row) for hit in report.collisions] == [("holder 1", "stock", 2)]
    assert block.check(path).stock is None


def test_what_lies_below_the_block_stays(block: imf.Scene) -> None:
    found = block.removable(5, [[0, 0, 1]])
    assert found.stock.sum() * found.grid.pitch**3 == pytest.approx(30**3 - 20**3)
    least, most = found.fraction
    below = 20 * 20 * 5 / (30**3 - 20**3)
    assert least == pytest.approx(1 - below, abs=0.02) and least <= most <= 1
    assert not (found.covered & ~found.possible).any()
    # From all six sides but the corners and edges, which are too thin for nothing here, all goes.
    assert block.removable(5, "axes").fraction[0] == pytest.approx(1.0, abs=0.01)


def test_contact_lets_the_cutter_into_a_slot_as_wide_as_itself(mill: imf.Tool) -> None:
    # The slot is half a millimetre narrower than the cutter; stock fills it.
    fractions = []
    for contact in (None, 0.75):
        scene = imf.Scene(slotted_block(7.5, 10.0), mill, pitch=0.5, contact=contact, name="block")
        fractions.append(scene.removable(0.0, [[0, 0, 1]]).fraction[0])
    assert fractions[0] < 0.5 and fractions[1] > 0.9


@pytest.mark.parametrize("stock", [-1.0, float("nan")])
def test_room_that_is_no_length_is_refused(block: imf.Scene, stock: float) -> None:
    with pytest.raises(ValueError, match="length of at least 0"):
        block.removable(stock)


def test_a_crib_has_the_verdicts_of_its_tools_one_by_one(block: imf.Scene) -> None:
    tools = [
        imf.Tool(CUTTER | {"length": length, "diameter": diameter}, {"diameter": 6, "length": 8}, HOLDER)
        for length, diameter in [(6, 8), (25, 8), (25, 12)]
    ]
    def cube(tool: imf.Tool) -> imf.Scene:
        return imf.Scene(box((0, 0, 0), (20, 20, 20)), tool, pitch=2.0, name="block")

    crib = cube(tools[0]).crib((tool for tool in tools), "axes", samples=1_000)
    assert crib.names == [tool.name for tool in tools] and crib == crib
    for tool, verdict in zip(tools, crib.verdict):
        alone = cube(tool).access("axes", samples=1_000)
        np.testing.assert_array_equal(verdict, alone.verdict)
        np.testing.assert_allclose(crib.areas, alone.areas)
    shares = crib.reached
    plan = crib.fewest()
    assert plan.at_least == len(plan.tools) == 1
    assert plan.reached == pytest.approx(shares.max()) and shares[plan.tools[0]] == shares.max()
    wide = imf.Tool(CUTTER, {"diameter": 9, "length": 8}, HOLDER)
    with pytest.warns(imf.SceneWarning, match="a side wider than the cutter"):
        cube(tools[0]).crib([wide], "axes", samples=200)
    needle = imf.Tool({"shape": "tapered", "diameter": 0.5, "half_angle": 5, "length": 25}, holder=HOLDER)
    with pytest.raises(ValueError, match="slender tip"):
        cube(tools[0]).crib([needle], "axes", samples=200)
    with pytest.raises(ValueError, match="at least one tool"):
        block.crib([])
    with pytest.raises(ValueError, match="fraction"):
        crib.fewest(0.0)
