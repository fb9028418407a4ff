"""Toolpaths that collide at known places, from arrays and from files."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from conftest import CUTTER, HOLDER, box, head, slotted_block

import imf


def test_a_plunge_is_as_deep_as_it_goes(block: imf.Scene) -> None:
    report = block.check(imf.poses([[10, 10, 25], [10, 10, 20], [10, 10, 17]], [0, 0, 1]))
    assert report.collides and report.lines == [3] and report.locations == 3
    assert report == report and report != block.check(imf.poses([10, 10, 25], [0, 0, 1]))
    (hit,) = report.collisions
    assert (hit.line, hit.row) == (3, 2)
    assert (hit.element, hit.against, hit.kind) == ("cutter", "part", "feed")
    assert hit.depth == pytest.approx(3.0, abs=0.6)
    np.testing.assert_allclose(hit.position, [10, 10, 17], atol=0.2)
    # As deep as the part may lie in the cutter, nothing collides.
    deep = block.check(imf.poses([[10, 10, 25], [10, 10, 17]], [0, 0, 1]), contact=3.1)
    assert deep.passes and not deep.collides and not report.passes


def test_a_holder_hits_the_side(block: imf.Scene) -> None:
    # The holder's face is 30 above the tip, and the top 20: 5 below it.
    report = block.check(imf.poses([[10, -12, 40], [10, -12, -15]], [0, 0, 1]))
    assert [(hit.element, hit.against) for hit in report.collisions] == [("holder 1", "part")]


PROGRAM = """%
G21 G90 G17
T1 M6
G0 X-20 Y10 Z30
G1 X-6 Y10 Z10 F500
G1 X-1 Y10 Z10
G0 Z40
M30
%
"""


def test_a_program_in_g_code_collides_on_its_own_line(block: imf.Scene, tmp_path: Path) -> None:
    path = tmp_path / "path.nc"
    path.write_text(PROGRAM)
    report = block.check(path, tools={1: block.tool})
    # A cutter of radius 4 beside the face at x = 0 reaches 3 mm into it, going there and going up.
    assert report.lines == [6, 7]
    assert report.collisions[0].depth == pytest.approx(3.0, abs=0.6)
    assert report.collisions[0].tool == 1 and report.collisions[0].row is None


def test_the_least_stick_out_of_a_path() -> None:
    tool = imf.Tool(CUTTER | {"length": 10}, {"diameter": 8, "length": 40}, HOLDER, stick_out=12)
    scene = imf.Scene(slotted_block(12.0, 16.0), tool, pitch=0.5, name="block")
    report = scene.check(imf.poses([[0, 0, 30], [0, 0, 4.2]], [0, 0, 1]), stick_out=True)
    assert report.collides
    (row,) = report.stick_outs
    assert row["given"] == 12.0 and row["minimum"] == pytest.approx(15.8, abs=0.6)


def test_faults_of_a_path_name_its_line(block: imf.Scene, tmp_path: Path) -> None:
    path = tmp_path / "path.csv"
    path.write_text("x,y,z,i,j,k\n0,0,30,0,0,1\n0,0,thirty,0,0,1\n")
    with pytest.raises(ValueError, match="path.csv, line 3"):
        block.check(path)
    with pytest.raises(FileNotFoundError, match="none.csv"):
        block.check(tmp_path / "none.csv")
    with pytest.raises(ValueError, match=r"\(n, 6\).*not \(2, 5\)"):
        block.check(np.zeros((2, 5)))
    with pytest.raises(ValueError, match="poses, line 2: a pose must be of finite numbers, its axis or quaternion not zero"):
        block.check([[10, 10, 30, 0, 0, 1], [10, 10, 30, 0, 0, 0]])


def test_a_tool_that_is_not_round_is_rolled_by_its_quaternions(tmp_path: Path) -> None:
    # Long along its x: beside the cube it hits unless that is turned away.
    part, tool = box((0, 0, 0), (20, 20, 20)), head(tmp_path, (-3, -3, 0), (9, 3, 12))
    scene = imf.Scene(part, tool, pitch=1.0, name="block")
    half = np.sqrt(0.5)
    rows = imf.poses([[-5, 10, 30], [-5, 10, 5]], [0, 0, half, half])
    assert scene.check(rows).passes
    unturned = scene.check(imf.poses([[-5, 10, 30], [-5, 10, 5]], [0, 0, 0, 1]))
    assert [hit.row for hit in unturned.collisions] == [1]
    (tmp_path / "path.csv").write_text("x,y,z,i,j,k,roll\n-5,10,30,0,0,1,90\n-5,10,5,0,0,1,90\n")
    assert scene.check(tmp_path / "path.csv").passes
    with pytest.raises(ValueError, match=r"does not say how it is rolled .*or poses with quaternions, \(n, 7\)"):
        scene.check(imf.poses([[-5, 10, 30], [-5, 10, 5]], [0, 0, 1]))


def test_a_tool_that_voxels_do_not_show_is_refused(block: imf.Scene) -> None:
    needle = imf.Tool({"shape": "flat", "diameter": 0.5, "length": 30}, holder=HOLDER, name="needle")
    path = imf.poses([[10, 10, 25], [10, 10, 5]], [0, 0, 1])
    with pytest.raises(ValueError, match="needle"):
        block.check(path, tools={1: needle})


def test_what_an_answer_guarantees_is_said(mill: imf.Tool, block: imf.Scene) -> None:
    path = imf.poses([[10, 10, 25], [10, 10, 24]], [0, 0, 1])
    usual = block.check(path).guarantee
    assert "voxel" in block.guarantee and usual
    strict = imf.Scene(box((0, 0, 0), (20, 20, 20)), mill, pitch=0.5, conservative=True, clearance={"holder": 1, "shank": 1, "cutter": 1})
    assert strict.guarantee != block.guarantee
    assert strict.check(path, contact=0).guarantee != usual
