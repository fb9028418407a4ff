"""Many poses classified from Python, to be compared with `batch.rs`, which classifies the same ones in Rust.

    python batch.py [POSES]
"""

import sys
import time

import numpy as np

import imf

# Multiples of these spread evenly over [0, 1): powers of the real root of x⁶ = x + 1.
STEPS = [0.8812716166, 0.7766396622, 0.6844304927, 0.6031691183, 0.5315558245]

count = int(sys.argv[1]) if len(sys.argv) > 1 else 100_000
checker = imf.Checker(imf.Scene("bracket", pitch=1.0))
x, y, z, a, b = np.modf(np.outer(STEPS, np.arange(count)))[0]
up = 1 - 2 * b
across = np.sqrt(1 - up**2)
axes = np.column_stack([across * np.cos(2 * np.pi * a), across * np.sin(2 * np.pi * a), up])
tips = np.column_stack([49 * x, 147 * y, 87 * z])
# The shortest turn of z to the axis, as a quaternion.
turns = np.column_stack([-axes[:, 1], axes[:, 0], np.zeros(count), 1 + up])
turns /= np.linalg.norm(turns, axis=1, keepdims=True)
for name, rows in [("directions", imf.poses(tips, axes)), ("quaternions", imf.poses(tips, turns))]:
    seconds = []
    for _ in range(7):
        begun = time.perf_counter()
        decisions = checker.classify(rows)
        seconds.append(time.perf_counter() - begun)
    best, free = min(seconds), int((decisions == imf.Decision.FREE).sum())
    print(f"Python, {name}: {count} poses, {free} free, {1e3 * best:.1f} ms, {1e6 * best / count:.3f} µs a pose")
