"""The direction that keeps the tool freest at a point, by SciPy's optimiser with the slopes of a field; then checked exactly."""

# %% A field with slopes
import numpy as np
from scipy.optimize import minimize

import imf

# A tool's depth in the part: how far it must be moved to be free, below 0 how far it may be.
tool = imf.Tool({"shape": "ball", "diameter": 10, "length": 35}, holder=[{"diameter": 29, "length": 48}])
scene = imf.Scene("bracket", tool, pitch=3.0, margin=6)
field = imf.train(scene, "harmonic", degree=10, calibrate=False)
checker = imf.Checker(scene)


# %% What is minimised
def direction(angles):
    """(θ, φ) in radians as a vector, and its derivatives by either."""
    (st, ct), (sp, cp) = ((np.sin(a), np.cos(a)) for a in angles)
    return np.array([sp * ct, sp * st, cp]), np.array([[-sp * st, sp * ct, 0.0], [cp * ct, cp * st, -sp]])


def depth(angles, tip):
    """The field's value and its gradient by the angles."""
    axis, slopes = direction(angles)
    found = field.gradient(imf.poses(tip, axis))
    return float(found.value[0]), slopes @ found.direction[0].astype(float)


# %% Points that the upright tool cannot reach
# Tips a little above the surface that the upright tool cannot reach.
access = scene.access([[0.0, 0.0, 1.0]], samples=500)
tips = access.points + 7.0 * access.normals
blocked = tips[np.isin(access.verdict, [imf.Verdict.OBSTRUCTED, imf.Verdict.GOUGED, imf.Verdict.NOT_FACED])]
blocked = blocked[~checker.is_free(imf.poses(blocked, [0, 0, 1]))][::400][:40]

# %% From several beginnings each
freed = 0
for tip in blocked:
    starts = [(theta, phi) for theta in (0.0, 2.0, 4.0) for phi in (0.5, 1.5, 2.5)]
    found = min((minimize(depth, start, args=(tip,), jac=True, method="BFGS") for start in starts), key=lambda r: r.fun)
    freed += bool(checker.is_free(np.concatenate([tip, direction(found.x)[0]])))
print(f"{freed} of {len(blocked)} tips at which the upright tool collides are free from the direction that was found")
assert len(blocked) > 5 and freed > 0.8 * len(blocked)
