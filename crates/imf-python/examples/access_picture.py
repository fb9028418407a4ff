"""From a mesh to a picture of what a tool reaches of it, coloured: green reached, orange obstructed, magenta gouged, grey not faced."""

# %% The part and the tool
import matplotlib.pyplot as plt
import numpy as np
from mpl_toolkits.mplot3d.art3d import Poly3DCollection

import imf
from imf.surface import COLOURS

tool = imf.Tool(
    cutter={"shape": "ball", "diameter": 10, "length": 35},
    holder=[{"diameter": 29, "length": 48}],
    name="10 mm ball end mill",
)
scene = imf.Scene("bracket", tool, pitch=3.0)  # or the name of a file, with its unit

# %% What is reached, and what is in the way
access = scene.access()
print(f"{100 * access.reached:.1f} % of the surface is reached, {100 * access.reached_at_twice_the_pitch:.1f} % at twice the pitch")
for element, against, share in access.obstructed_by:
    print(f"  {100 * share:.1f} % obstructed: {element} hits the {against}")
best = access.by_direction.argmax()
print(f"  from {access.directions[best].round(3)} alone {100 * access.by_direction[best]:.1f} %")

# %% The picture
triangles = access.vertices[access.faces]
light = np.array([0.4, -0.5, 0.75])
shade = 0.55 + 0.45 * np.clip(access.normals @ light / np.linalg.norm(light), 0.0, 1.0)
colours = COLOURS[access.verdict] / 255.0 * shade[:, None]
axes = plt.figure(figsize=(8, 7)).add_subplot(projection="3d", proj_type="ortho")
axes.add_collection3d(Poly3DCollection(triangles, facecolors=colours, edgecolors=colours, linewidths=0.2))
low, high = access.vertices.min(axis=0), access.vertices.max(axis=0)
axes.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), zlim=(low[2], high[2]), box_aspect=high - low)
axes.set(xlabel=f"x, {scene.unit}", title=f"{scene.part}: {100 * access.reached:.1f} % reached")
axes.view_init(elev=30, azim=-60)
plt.savefig("access.png", dpi=110)

# In PyVista the same is one line: access.to_pyvista().plot(scalars="rgb", rgb=True)
