"""The rivals of `imf-bench query` on one core: Coal and FCL on meshes of tool and part, vamp with the tool as balls among points.

Reads scene.json from the folder given as the first argument
  part, tool   {"vertices": [[x, y, z], …], "triangles": [[a, b, c], …]}, the tool in its own frame
  centres      [[x, y, z], …] of the part's solid voxels
  balls        [[height, radius], …] on the tool's axis, which together hold it
  poses        [[x, y, z, qx, qy, qz, qw], …]: tip, and rotation from the tool's frame to the world
and prints one line of JSON: a list of {name, question, seconds, overhead, colliding, how}, one entry for each library and
question, which is asked for one pose a call. `seconds` is the sum over batches of the best of three rounds; `overhead` that of
collision for tools so far away that the first boxes decide, which is what Python and the call itself cost. `colliding` has the
answer for each pose. Transforms are made before the clock starts.
"""

import ctypes
import json
import pathlib
import subprocess
import sys
import time

import numpy as np

ROUNDS = 3
BATCH = 20
FAR = 1e6


def rotation(quaternion: np.ndarray) -> np.ndarray:
    x, y, z, w = quaternion / np.linalg.norm(quaternion)
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )


def best(ask, transforms) -> tuple[float, list]:
    seconds, answers = 0.0, []
    for begin in range(0, len(transforms), BATCH):
        batch, least = transforms[begin : begin + BATCH], float("inf")
        for _ in range(ROUNDS):
            start = time.perf_counter()
            found = [ask(transform) for transform in batch]
            least = min(least, time.perf_counter() - start)
        seconds += least
        answers += found
    return seconds, answers


def by_coal(scene, near, far) -> list[dict]:
    import coal

    def model(mesh):
        bvh = coal.BVHModelOBBRSS()
        vertices = np.asarray(mesh["vertices"], float)
        bvh.beginModel(len(mesh["triangles"]), len(vertices))
        for a, b, c in mesh["triangles"]:
            bvh.addTriangle(vertices[a], vertices[b], vertices[c])
        bvh.endModel()
        return bvh

    part, tool, still = model(scene["part"]), model(scene["tool"]), coal.Transform3s.Identity()
    request, result = coal.CollisionRequest(), coal.CollisionResult()
    far_request, distance = coal.DistanceRequest(), coal.DistanceResult()

    def collide(transform):
        result.clear()
        return coal.collide(part, still, tool, transform, request, result) > 0

    def away(transform):
        distance.clear()
        return coal.distance(part, still, tool, transform, far_request, distance)

    make = lambda poses: [coal.Transform3s(r, t) for r, t in poses]
    near = make(near)
    how = f"Coal {coal.__version__}, BVHModelOBBRSS, {meshes(scene)}"
    overhead, _ = best(collide, make(far))
    found = []
    for question, ask in [("surfaces", collide), ("distance", away)]:
        seconds, answers = best(ask, near)
        colliding = [bool(a) for a in answers] if ask is collide else [bool(a <= 0) for a in answers]
        found.append(entry("Coal", question, seconds, overhead, colliding, how))
    return found


def by_fcl(scene, near, far) -> list[dict]:
    import fcl
    from importlib.metadata import version

    def model(mesh):
        bvh = fcl.BVHModel()
        vertices = np.asarray(mesh["vertices"], float)
        triangles = np.asarray(mesh["triangles"], int)
        bvh.beginModel(len(triangles), len(vertices))
        bvh.addSubModel(vertices, triangles)
        bvh.endModel()
        return bvh

    still = fcl.CollisionObject(model(scene["part"]), fcl.Transform())
    moving = fcl.CollisionObject(model(scene["tool"]), fcl.Transform())
    request = fcl.CollisionRequest()

    def collide(transform):
        moving.setTransform(transform)
        return fcl.collide(still, moving, request, fcl.CollisionResult()) > 0

    make = lambda poses: [fcl.Transform(r, t) for r, t in poses]
    seconds, answers = best(collide, make(near))
    overhead, _ = best(collide, make(far))
    how = f"python-fcl {version('python-fcl')}, BVHModel (OBBRSS), {meshes(scene)}"
    return [entry("FCL", "surfaces", seconds, overhead, [bool(a) for a in answers], how)]


def by_vamp(scene, near, far) -> list[dict]:
    """By the C++ headers that vamp-planner installs: see vamp_rival.cc, which lies in the folder."""
    from importlib.metadata import distribution

    if not scene["balls"]:
        raise ImportError("the tool is not a solid of revolution")
    vamp = distribution("vamp-planner")
    folder = pathlib.Path(sys.argv[1]).resolve()
    # The one header that it leaves out; its sort serves only to make the tree.
    sort = "template <class I, class L> void pdqsort_branchless(I from, I to, L less) { std::sort(from, to, less); }"
    (folder / "pdqsort.h").write_text(f"#include <algorithm>\n{sort}\n")
    include = [folder, vamp.locate_file("include"), "/usr/include/eigen3", pathlib.Path(sys.prefix) / "include/eigen3"]
    # As the package compiles itself.
    fast = "-fno-math-errno -fno-signed-zeros -fno-trapping-math -fno-rounding-math -ffp-contract=fast -fassociative-math"
    build = ["c++", "-std=c++17", "-O3", "-march=native", "-mavx2", *fast.split(), "-w", "-shared", "-fPIC"]
    build += [f"-I{path}" for path in include]
    library = folder / "vamp_rival.so"
    subprocess.run([*build, "-o", library, folder / "vamp_rival.cc"], check=True)
    ask = ctypes.CDLL(library).ask
    ask.restype = ctypes.c_double
    balls = np.array(sorted(scene["balls"], key=lambda ball: -ball[1]), np.float32)
    tips_and_axes = np.array([[*tip, *rotation[:, 2]] for rotation, tip in near], np.float32)
    centres, colliding = np.array(scene["centres"], np.float32), np.zeros(len(near), bool)
    lists = [(values.ctypes.data_as(ctypes.c_void_p), ctypes.c_size_t(len(values))) for values in (centres, balls, tips_and_axes)]
    seconds = ask(*[argument for both in lists for argument in both], colliding.ctypes.data_as(ctypes.c_void_p))
    how = f"vamp-planner {vamp.version}, its C++ check of {len(balls)} balls around the axis in a cloud of {len(centres)} points (CAPT)"
    return [entry("vamp", "balls", seconds, 0.0, colliding.tolist(), how)]


def meshes(scene) -> str:
    return f"meshes of {len(scene['part']['triangles'])} and {len(scene['tool']['triangles'])} triangles"


def entry(name, question, seconds, overhead, colliding, how) -> dict:
    return {
        "name": name,
        "question": question,
        "seconds": seconds,
        "overhead": overhead,
        "colliding": colliding,
        "how": how,
    }


def main() -> None:
    scene = json.loads((pathlib.Path(sys.argv[1]) / "scene.json").read_text())
    poses = np.asarray(scene["poses"], float)
    near = [(rotation(pose[3:]), pose[:3].copy()) for pose in poses]
    far = [(r, t + FAR) for r, t in near]
    found, missing = [], []
    for name, measure in [("coal", by_coal), ("python-fcl", by_fcl), ("vamp-planner", by_vamp)]:
        try:
            found.extend(measure(scene, near, far))
        except (ImportError, OSError, subprocess.CalledProcessError) as error:
            missing.append(f"{name}: {error}")
    print(json.dumps({"found": found, "missing": missing, "python": sys.version.split()[0]}))


if __name__ == "__main__":
    main()
