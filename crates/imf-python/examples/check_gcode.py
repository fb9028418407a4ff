"""Checks a program in G-code against a part and what holds it, and says which lines collide, with what, how deep."""

# %% The part and its fixture
from pathlib import Path

import numpy as np

import imf


def box(lower, upper):
    """A cuboid as vertices and triangles."""
    corners = np.array([[(lower, upper)[i >> axis & 1][axis] for axis in range(3)] for i in range(8)], dtype=float)
    quads = [(0, 2, 3, 1), (4, 5, 7, 6), (0, 1, 5, 4), (2, 6, 7, 3), (0, 4, 6, 2), (1, 3, 7, 5)]
    return corners, np.array([face for a, b, c, d in quads for face in ((a, b, c), (a, c, d))])


mill = imf.Tool({"shape": "flat", "diameter": 8, "length": 20}, holder=[{"diameter": 40, "length": 40}], name="8 mm end mill")
scene = imf.Scene(
    box((0, 0, 0), (60, 40, 25)),
    mill,
    pitch=1.0,
    fixtures=[box((-20, 0, 0), (-1, 40, 30))],
    around="all",
    name="block",
)

# %% The program
Path("program.nc").write_text(
    """%
G21 G90 G17
T1 M6
G0 X64 Y0 Z50
G0 Z-2
G1 Y40 F800
G0 Z50
G0 X-5 Y20
G1 Z32 F300
G1 Z26
M30
%
"""
)

# %% What collides
report = scene.check("program.nc", tools={1: mill})
for hit in report.collisions:
    print(f"line {hit.line}: {hit.element} hits {hit.against}, {hit.depth:.1f} {report.unit} deep, tip at {hit.position.round(1)}")
print(f"{report.poses} poses checked; an overlap of {report.sure_overlap:.1f} {report.unit} is certain to be found")
assert {hit.against for hit in report.collisions} == {"part", "fixture 1"}
