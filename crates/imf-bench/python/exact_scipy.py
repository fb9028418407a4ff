"""The rival of `imf-bench exact`: sections by scipy's real FFTs in float32, as one would write them.

Reads from the folder given as the first argument
  obstacle.npy       uint8 [x, y, z], 1 where solid
  scene.json         {"lower": [q0 offsets of each tool box], "reach": voxels, "workers": threads}
  tool_0.npy, …      uint8 boxes of the rotated tool, whose first voxel is at lower[i] from the tip
  counts_0.npy, …    uint32 [x, y, z], what imf counted
and prints one line of JSON: seconds of each section, and whether all counts are equal.
The obstacle's spectrum is computed once and not timed. Each section is timed with `workers` threads.
"""

import json
import pathlib
import sys
import time

import numpy as np
import scipy
from scipy import fft


def main() -> None:
    folder = pathlib.Path(sys.argv[1])
    scene = json.loads((folder / "scene.json").read_text())
    workers = scene["workers"]
    obstacle = np.load(folder / "obstacle.npy").astype(np.float32)
    # Circular: offsets up to the tool's reach must not wrap into the grid.
    size = [fft.next_fast_len(n + scene["reach"], real=True) for n in obstacle.shape]
    spectrum = fft.rfftn(obstacle, size, workers=workers)
    nx, ny, nz = obstacle.shape

    def section(tool: np.ndarray, lower: list[int]) -> np.ndarray:
        padded = np.zeros(size, np.float32)
        places = [(np.arange(d) + low) % n for d, low, n in zip(tool.shape, lower, size)]
        padded[np.ix_(*places)] = tool
        product = fft.rfftn(padded, workers=workers)
        np.conj(product, out=product)
        product *= spectrum
        overlap = fft.irfftn(product, size, workers=workers, overwrite_x=True)
        return np.rint(overlap[:nx, :ny, :nz]).astype(np.uint32)

    seconds, equal = [], True
    for index, lower in enumerate(scene["lower"]):
        tool = np.load(folder / f"tool_{index}.npy")
        expected = np.load(folder / f"counts_{index}.npy")
        if index == 0:
            section(tool, lower)  # scipy plans its transforms at the first call
        start = time.perf_counter()
        counts = section(tool, lower)
        seconds.append(time.perf_counter() - start)
        equal = equal and bool(np.array_equal(counts, expected))
    versions = f"scipy {scipy.__version__}, numpy {np.__version__}, Python {sys.version.split()[0]}"
    print(json.dumps({"seconds": seconds, "equal": equal, "size": size, "versions": versions}))


if __name__ == "__main__":
    main()
