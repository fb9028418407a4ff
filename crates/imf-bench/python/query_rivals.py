"""The rivals of `imf-bench query`: does the tool's mesh meet the part's, by Coal and by FCL, on one core.

Reads scene.json from the folder given as the first argument
  part, tool   {"vertices": [[x, y, z], …], "triangles": [[a, b, c], …]}, the tool in its own frame
  poses        [[x, y, z, qx, qy, qz, qw], …]: tip, and rotation from the tool's frame to the world
and prints one line of JSON: a list of {name, seconds, overhead, colliding, how}, one entry for each library and question.
`seconds` is the best of three rounds over all poses; `overhead` that of collision for tools so far away that the first
boxes decide, which is what Python and the call itself cost. `colliding` has the answer for each pose, where the question has one.
Transforms are made before the clock starts.
"""

import json
import pathlib
import sys
import time

import numpy as np

ROUNDS = 3
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
    least = float("inf")
    for _ in range(ROUNDS):
        start = time.perf_counter()
        answers = [ask(transform) for transform in transforms]
        least = min(least, time.perf_counter() - start)
    return least, answers


def by_coal(part, tool, near, far) -> list[dict]:
    import coal

    def model(mesh):
        bvh = coal.BVHModelOBBRSS()
        vertices = np.asarray(mesh["vertices"], float)
        bvh.beginModel(len(mesh["triangles"]), len(vertices))
        for a, b, c in mesh["triangles"]:
            bvh.addTriangle(vertices[a], vertices[b], vertices[c])
        bvh.endModel()
        return bvh

    part, tool, still = model(part), model(tool), coal.Transform3s.Identity()
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
    how = f"Coal {coal.__version__}, BVHModelOBBRSS"
    overhead, _ = best(collide, make(far))
    found = []
    for question, ask in [("collide", collide), ("distance", away)]:
        seconds, answers = best(ask, near)
        colliding = [bool(a) for a in answers] if ask is collide else [bool(a <= 0) for a in answers]
        found.append(
            {"name": f"Coal {question}", "seconds": seconds, "overhead": overhead, "colliding": colliding, "how": how}
        )
    return found


def by_fcl(part, tool, near, far) -> list[dict]:
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

    still = fcl.CollisionObject(model(part), fcl.Transform())
    moving = fcl.CollisionObject(model(tool), fcl.Transform())
    request = fcl.CollisionRequest()

    def collide(transform):
        moving.setTransform(transform)
        return fcl.collide(still, moving, request, fcl.CollisionResult()) > 0

    make = lambda poses: [fcl.Transform(r, t) for r, t in poses]
    seconds, answers = best(collide, make(near))
    overhead, _ = best(collide, make(far))
    how = f"python-fcl {version('python-fcl')}, BVHModel (OBBRSS)"
    return [
        {
            "name": "FCL collide",
            "seconds": seconds,
            "overhead": overhead,
            "colliding": [bool(a) for a in answers],
            "how": how,
        }
    ]


def main() -> None:
    scene = json.loads((pathlib.Path(sys.argv[1]) / "scene.json").read_text())
    poses = np.asarray(scene["poses"], float)
    near = [(rotation(pose[3:]), pose[:3].copy()) for pose in poses]
    far = [(r, t + FAR) for r, t in near]
    found, missing = [], []
    for name, measure in [("coal", by_coal), ("python-fcl", by_fcl)]:
        try:
            found.extend(measure(scene["part"], scene["tool"], near, far))
        except ImportError as error:
            missing.append(f"{name}: {error}")
    print(json.dumps({"found": found, "missing": missing, "python": sys.version.split()[0]}))


if __name__ == "__main__":
    main()
