"""Trains the paper's network, small, on exact sections of a built-in part, and holds it against directions that it never saw."""

# %% Training
import numpy as np

import imf

steps = 600
scene = imf.Scene("teapot", dims=(15, 19, 31), allow_coarse=True)
field = imf.train(scene, "siren5", steps=steps, layers=(5, 64), directions="fibonacci:100", calibrate=False)

# %% Directions that it never saw
unseen = scene.directions("random:16:1")
exact = scene.sections(unseen).values
learnt = np.stack([field(imf.poses(scene.grid.centres(), axis)) for axis in unseen]).reshape(exact.shape)
error = ((learnt - exact) ** 2).mean()
assert error < 0.1 * exact.var(), "it has not learnt"
print(f"{steps} steps: mean squared error {error:.1e} at unseen directions, the field's variance {exact.var():.1e}")

# %% Its file
field.save("siren5.safetensors")
print(imf.load("siren5.safetensors"))
