"""Whether imf's voxels are those of other voxelisers: trimesh and Open3D at the same voxel centres.

    python crates/imf-bench/python/voxels_agree.py IMF [MESH …]

IMF is the command to test; beside the reference parts (`imf parts`) it is run on every mesh file given. Prints Markdown.

A voxel is solid by
  imf      `imf voxelize`: |winding number| > ½
  trimesh  crossings of a ray along z through each column of centres, in f64: their parity, and their sum with signs,
           which is the winding number (`contains` counts the parity too, with a ray for every point: hours)
  Open3D   `RaycastingScene.compute_occupancy`: parity of the crossings in f32, majority of 5 rays for every point
Near the surface rounding decides. Farther from it than half a voxel's diagonal (√3/2 pitch) no voxel holds a piece of
the surface, and all must agree where parity is the winding number's: closed meshes, and not where parts of the mesh
overlap (winding number 2, parity 0). So wherever a voxel beyond that distance differs, its winding number is summed
here by its definition, every triangle's solid angle. A difference is explained where the mesh is open or the winding
number is no 0 and no ±1, and imf has what the definition says. Any other difference ends the script with 1.
The definition is also asked at random voxels, wherever they are.
"""

import json
import pathlib
import subprocess
import sys
import tempfile

import numpy as np
import open3d
import trimesh

# Voxels along x, y, z of the reference parts.
PARTS = {"teapot": (58, 76, 121), "bracket": (49, 147, 87), "screw-gear": (99, 98, 63)}
# Voxels along the longest side of any other mesh.
LONGEST = 120
# Points and rays that are handed over at once: bounds the memory.
BLOCK = 20_000
RAYS = 1_000
# How far trimesh's rays stand off the column of centres, in pitch, so that none runs along an edge of the mesh, where
# crossings would count twice. Moves a voxel only where the surface is as near.
ASIDE = np.array([1.3e-4, 0.7e-4])
# Voxels of each mesh where the definition is asked beside the differing ones.
SAMPLE = 500


def voxelize(imf: str, mesh: pathlib.Path, size: list[str], out: pathlib.Path) -> tuple[np.ndarray, dict]:
    unit = ["--unit", "mm"] if mesh.suffix.lower() == ".stl" else []
    command = [imf, "voxelize", str(mesh), *size, *unit, "--out", str(out), "--json"]
    # What imf has to say against a mesh stands on the terminal.
    answer = json.loads(subprocess.run(command, check=True, stdout=subprocess.PIPE, text=True).stdout)
    return np.load(out / "solid.npy").astype(bool), answer


def centres(grid: dict) -> np.ndarray:
    axes = [grid["origin"][a] + grid["pitch"] * (np.arange(grid["dims"][a]) + 0.5) for a in range(3)]
    return np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)


def in_blocks(ask, points: np.ndarray) -> np.ndarray:
    return np.concatenate([ask(points[i : i + BLOCK]) for i in range(0, len(points), BLOCK)])


def crossings(mesh: trimesh.Trimesh, grid: dict) -> tuple[np.ndarray, np.ndarray]:
    """Crossings below every centre, and their sum with signs: -1 where the ray leaves, 1 where it enters, C-ordered."""
    nx, ny, nz = grid["dims"]
    below = [min(grid["origin"][2], mesh.bounds[0][2]) - grid["pitch"]]
    starts = np.stack(np.meshgrid(np.arange(nx), np.arange(ny), indexing="ij"), axis=-1).reshape(-1, 2)
    starts = np.array(grid["origin"][:2]) + grid["pitch"] * (starts + 0.5 + ASIDE)
    starts = np.column_stack([starts, np.full(len(starts), below)])
    steps = np.zeros((2, nx * ny, nz + 1), np.int32)
    for first in range(0, len(starts), RAYS):
        origins = starts[first : first + RAYS]
        places, rays, faces = mesh.ray.intersects_location(origins, np.tile([0.0, 0.0, 1.0], (len(origins), 1)))
        # No array of places where a whole block of rays meets nothing.
        places = np.asarray(places).reshape(-1, 3)
        # The first centre above the crossing.
        z = np.ceil((places[:, 2] - grid["origin"][2]) / grid["pitch"] - 0.5).clip(0, nz).astype(int)
        np.add.at(steps[0], (first + rays, z), 1)
        np.add.at(steps[1], (first + rays, z), -np.sign(mesh.face_normals[faces, 2]).astype(np.int32))
    passed, sums = np.cumsum(steps, axis=2)[:, :, :nz].reshape(2, -1)
    return passed, sums


def winding(triangles: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Van Oosterom and Strackee (1983): tan(Ω/2) = det(a, b, c) / (abc + (a·b)c + (b·c)a + (c·a)b)."""
    found = np.empty(len(points))
    for i, point in enumerate(points):
        a, b, c = (triangles[:, corner] - point for corner in range(3))
        la, lb, lc = (np.linalg.norm(v, axis=1) for v in (a, b, c))
        dot = lambda u, v: np.einsum("ij,ij->i", u, v)
        above = dot(a, np.cross(b, c))
        below = la * lb * lc + dot(a, b) * lc + dot(b, c) * la + dot(c, a) * lb
        found[i] = np.arctan2(above, below).sum() / (2 * np.pi)
    return found


def judge(name: str, imf: str, path: pathlib.Path, size: list[str], work: pathlib.Path) -> tuple[list, str, bool]:
    ours, answer = voxelize(imf, path, size, work / f"{name}-voxels")
    grid, closed = answer["grid"], answer["mesh"]["closed"]
    ours, points = ours.reshape(-1), centres(grid)
    # Vertices at one place are one vertex; nothing else is repaired.
    mesh = trimesh.load(path, force="mesh", process=False)
    mesh.merge_vertices(merge_tex=True, merge_norm=True)
    triangles = np.asarray(mesh.triangles)
    scene = open3d.t.geometry.RaycastingScene()
    scene.add_triangles(mesh.vertices.astype(np.float32), mesh.faces.astype(np.uint32))
    passed, sums = crossings(mesh, grid)
    rivals = {
        "trimesh, signed crossings": sums != 0,
        "trimesh, parity": passed % 2 == 1,
        "Open3D, parity": in_blocks(
            lambda p: scene.compute_occupancy(p.astype(np.float32), nsamples=5).numpy() > 0.5, points
        ),
    }
    differs = {rival: np.flatnonzero(ours != solid) for rival, solid in rivals.items()}
    every = np.unique(np.concatenate(list(differs.values())))
    distance = np.full(len(points), np.inf)
    if len(every):
        near = lambda p: scene.compute_distance(p.astype(np.float32)).numpy()
        distance[every] = in_blocks(near, points[every])
    beyond = {rival: d[distance[d] > np.sqrt(3) / 2 * grid["pitch"]] for rival, d in differs.items()}

    far = np.unique(np.concatenate(list(beyond.values())))
    w = np.full(len(points), np.nan)
    w[far] = winding(triangles, points[far])
    right = (np.abs(w[far]) > 0.5) == ours[far]
    whole = np.rint(w[far])
    # Parity is the winding number's own answer only where that is 0 or ±1.
    unexplained = {
        rival: int(np.sum(~right[np.isin(far, b)] | (closed & (np.abs(whole[np.isin(far, b)]) <= 1))))
        for rival, b in beyond.items()
    }
    sample = np.random.default_rng(0).choice(len(points), SAMPLE, replace=False)
    sampled = np.abs(winding(triangles, points[sample]))
    # Where an open mesh's winding number is ½ to rounding, either answer is right.
    clear = np.abs(sampled - 0.5) > 1e-9
    wrong = int(np.sum(((sampled > 0.5) != ours[sample]) & clear))

    dims = "×".join(map(str, grid["dims"]))
    rows = []
    for rival, solid in rivals.items():
        rows.append(
            f"| {name} | {dims} | {len(mesh.faces):,} | {'closed' if closed else 'open'} | {ours.sum():,} "
            f"| {rival} | {solid.sum():,} | {len(differs[rival]):,} | {len(beyond[rival]):,} | {unexplained[rival]} |"
        )
    note = f"- {name}: of {SAMPLE} random voxels {wrong} are not what the summed winding number says."
    if len(far):
        values, counts = np.unique(whole if closed else np.round(w[far], 1), return_counts=True)
        said = ", ".join(f"{v:g}: {n:,}" for v, n in zip(values, counts))
        note += (
            f" Differing voxels beyond the boundary layer by their winding number: {said}; "
            f"imf has what it says at {right.sum():,} of {len(far):,}."
        )
    return rows, note, wrong == 0 and not any(unexplained.values())


def main() -> int:
    if len(sys.argv) < 2:
        print(__doc__.split("\n\n")[1].strip(), file=sys.stderr)
        return 2
    imf, files = sys.argv[1], [pathlib.Path(f) for f in sys.argv[2:]]
    rows, notes, good = [], [], True
    with tempfile.TemporaryDirectory() as folder:
        work = pathlib.Path(folder)
        subprocess.run([imf, "parts", str(work)], check=True, capture_output=True)
        cases = [(name, work / f"{name}.obj", ["--dims", ",".join(map(str, d))]) for name, d in PARTS.items()]
        for path in files:
            extents = trimesh.load(path, force="mesh", process=False).extents
            cases.append((path.name, path, ["--pitch", repr(float(extents.max()) / LONGEST)]))
        for case in cases:
            print(f"{case[0]} …", file=sys.stderr, flush=True)
            more, note, fine = judge(case[0], imf, case[1], case[2], work)
            rows, notes, good = rows + more, [*notes, note], good and fine
    version = subprocess.run([imf, "--version"], check=True, capture_output=True, text=True).stdout.strip()
    print(f"{version}, trimesh {trimesh.__version__}, Open3D {open3d.__version__}, numpy {np.__version__}, "
          f"Python {sys.version.split()[0]}\n")
    print("| mesh | grid | triangles | surface | solid, imf | against | solid there | differ | of these beyond "
          "√3/2 pitch | unexplained |")
    print("| --- " * 10 + "|")
    print("\n".join(rows), "\n", sep="")
    print("\n".join(notes))
    return 0 if good else 1


if __name__ == "__main__":
    sys.exit(main())
