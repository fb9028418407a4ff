"""Where, and from which directions, a tool reaches a part without collision.

>>> import imf
>>> scene = imf.Scene("bracket", pitch=3.0)            # a built-in part, with the paper's tool
>>> section = scene.section([0.0, 0.0, 1.0])           # the tool upright, its tip at every voxel
>>> float(section.values.min())
0.0
>>> checker = imf.Checker(scene)
>>> checker.is_free([24.5, 73.5, 300.0, 0.0, 0.0, 1.0])
True

Conventions
-----------
- Lengths are in the scene's unit (``scene.unit``, millimetres unless told); angles are degrees.
- A *direction* is a vector from the tool's tip to its holder, of any length but 0.
- A *pose* is six numbers, ``x, y, z, i, j, k``: the tip and the direction, as lines of a five-axis path have them; or seven, the tip
  and a quaternion ``x, y, z, w`` from the tool's frame to the world. Many poses are an array of the shape ``(n, 6)`` or ``(n, 7)``.
- Arrays over a grid have the shape ``(nx, ny, nz)`` and C order; the centre of voxel ``i`` is ``origin + pitch * (i + 0.5)``.
- Arrays of ``float64`` in C order are read where they lie; results are NumPy arrays that nothing else holds.

Everything computes without the interpreter's lock, on all cores or on those of :func:`set_threads`, and ends within a second of
Ctrl-C, but for the distances of a :class:`Checker`, or of a scene with ``contact``, among tens of millions of voxels. ``progress`` is a function of a stage's name, the units that are done and their number, or True for bars by ``tqdm``.

Errors: ``ValueError`` for what makes no sense, ``OSError`` for files that cannot be read or written, ``MemoryError`` before voxels,
sections, surfaces, trainings or a stock that would not fit, :class:`ImfError` for a computation that failed; :class:`SceneWarning` for what should be known of a scene that can
be used all the same.
"""

from ._imf import DIRECTIONS, ImfError, __version__, set_threads
from ._poses import poses
from .checker import Checker, Distances, Motions
from .field import Best, Field, Gradient, load, train
from .results import Decision, Grid, Inaccessibility, Section, Sections, Verdict
from .scene import Scene, SceneWarning
from .stock import RemovableStock, StockLeft
from .surface import Access, Crib, FewestTools, PartSetup, SetupPlan, StickOuts
from .tool import Tool
from .toolpath import CheckReport, Collision, TravelFault
from .voxels import voxel_mesh

__all__ = [
    "DIRECTIONS",
    "Access",
    "Best",
    "CheckReport",
    "Checker",
    "Collision",
    "Crib",
    "Decision",
    "Distances",
    "FewestTools",
    "Field",
    "Gradient",
    "Grid",
    "ImfError",
    "Inaccessibility",
    "Motions",
    "PartSetup",
    "RemovableStock",
    "Scene",
    "SceneWarning",
    "Section",
    "Sections",
    "SetupPlan",
    "StickOuts",
    "StockLeft",
    "Tool",
    "TravelFault",
    "Verdict",
    "__version__",
    "load",
    "poses",
    "set_threads",
    "train",
    "voxel_mesh",
]
