"""A catalogue of parts against a crib of tools, in many processes by Dask: what share of each part does each tool reach?

    python screen_catalogue.py [SCHEDULER]

SCHEDULER is the address of a running cluster (tcp://host:8786), on whose machines the wheel is installed and the parts' files are found
under the same names; without it, processes of this machine do the work.
"""

import os
import sys

import numpy as np
from dask.distributed import Client, LocalCluster, get_worker

import imf

PARTS = ["bracket", "bracket-raw", "screw-gear"]
HOLDER = [{"diameter": 29, "length": 48}]
TOOLS = {
    f"{diameter} mm {shape}": {"cutter": {"shape": shape, "diameter": diameter, "length": 35}, "holder": HOLDER}
    for shape in ("ball", "flat")
    for diameter in (8, 16)
}


def share(part, tool):
    """In a worker: what share of the part's surface the tool reaches. Descriptions travel, not scenes."""
    # As many threads as the worker was given, which its tasks share.
    imf.set_threads(get_worker().state.nthreads)
    scene = imf.Scene(part, imf.Tool(**TOOLS[tool], name=tool), pitch=4.0)
    return scene.access("axes+normals", samples=1_000).reached


def main():
    if len(sys.argv) > 1:
        cluster, client = None, Client(sys.argv[1])
    else:
        threads = max(1, (os.cpu_count() or 2) // 2)
        cluster = LocalCluster(n_workers=2, threads_per_worker=threads, dashboard_address=None)
        client = Client(cluster)
    pairs = [(part, tool) for part in PARTS for tool in TOOLS]
    shares = client.gather([client.submit(share, *pair, pure=False) for pair in pairs])
    table = np.reshape(shares, (len(PARTS), len(TOOLS)))
    print(f"{'':12}" + "".join(f"{tool:>12}" for tool in TOOLS))
    for part, row in zip(PARTS, table):
        print(f"{part:12}" + "".join(f"{100 * own:10.1f} %" for own in row))
    client.close()
    if cluster is not None:
        cluster.close()
    # A thicker cutter of a shape reaches no more than the thinner one, but for what voxels of this size leave open.
    assert (table[:, 0] >= table[:, 1] - 0.02).all() and (table[:, 2] >= table[:, 3] - 0.02).all(), table


if __name__ == "__main__":
    main()
