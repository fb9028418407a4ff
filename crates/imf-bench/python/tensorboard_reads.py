"""Whether TensorBoard reads the event files of `imf train --tensorboard`.

    python crates/imf-bench/python/tensorboard_reads.py IMF

IMF is the command to test. A small training writes event files and, beside them, JSON lines; it is killed without warning
on its way and resumed, so that some steps are repeated. TensorBoard's own reader (EventAccumulator) must then hold every
number of the JSON lines at its step, in f32, and nothing else: what the killed run wrote of steps that were repeated is to
be forgotten. Prints what was compared; ends with 1 at the first difference.
"""

import json
import pathlib
import signal
import subprocess
import sys
import tempfile
import time

import numpy as np
from tensorboard.backend.event_processing.event_accumulator import EventAccumulator

DATASET = "dataset bracket --dims 7,21,12 --orientations fibonacci:16 --out data"
TRAIN = (
    "train data --out out --device cpu --width 24 --layers 3 --omega 10 --batch 256 --steps 6000 --threads 1"
    " --held-out 200 --held-out-every 500 --checkpoint-every 0.2 --log log.jsonl --tensorboard"
)
# What the columns of a line are called in the event files.
TAGS = {
    "loss": "loss/training",
    "held_out_mse": "held_out/mse",
    "held_out_mae": "held_out/mae",
    "rate": "progress/learning_rate",
    "samples_per_second": "progress/samples_per_second",
}


def rows(path: pathlib.Path) -> list[dict]:
    """Whole lines only: the last may be half written."""
    return [json.loads(line) for line in path.read_text().splitlines(keepends=True) if line.endswith("\n")]


def train(imf: str, folder: pathlib.Path) -> int:
    """The training with one violent end; the step of the last row that the killed run wrote."""
    subprocess.run([imf, *DATASET.split()], cwd=folder, check=True, capture_output=True)
    log, checkpoint = folder / "log.jsonl", folder / "out" / "checkpoint.safetensors"
    process = subprocess.Popen([imf, *TRAIN.split()], cwd=folder, stderr=subprocess.DEVNULL, stdout=subprocess.DEVNULL)
    while process.poll() is None:
        written = rows(log) if log.exists() else []
        if checkpoint.exists() and len(written) > 30:
            # Some rows beyond the checkpoint.
            time.sleep(0.1)
            break
    process.send_signal(signal.SIGKILL)
    assert process.wait() == -signal.SIGKILL, "it had ended before it was killed"
    last = rows(log)[-1]["step"]
    subprocess.run([imf, *TRAIN.split(), "--resume"], cwd=folder, check=True, capture_output=True)
    return last


def main():
    imf = str(pathlib.Path(sys.argv[1]).resolve())
    with tempfile.TemporaryDirectory() as name:
        folder = pathlib.Path(name)
        killed_at = train(imf, folder)
        files = sorted((folder / "out" / "tensorboard").iterdir())
        assert len(files) == 2, files
        board = EventAccumulator(str(folder / "out" / "tensorboard"), size_guidance={"scalars": 0})
        board.Reload()
        lines = rows(folder / "log.jsonl")
        assert sorted(board.Tags()["scalars"]) == sorted(TAGS.values()), board.Tags()
        compared = 0
        for column, tag in TAGS.items():
            expected = [(line["step"], np.float32(line[column])) for line in lines if line.get(column) is not None]
            found = [(event.step, np.float32(event.value)) for event in board.Scalars(tag)]
            assert found == expected, f"{tag}: {found} is not {expected}"
            compared += len(found)
        print(f"{len(files)} event files, killed after step {killed_at} and resumed, {lines[-1]['step']} steps:")
        print(f"TensorBoard reads {compared} numbers under {len(TAGS)} tags, all those of the JSON lines and no others")


if __name__ == "__main__":
    main()
