"""Whether other programs read what imf writes: onnxruntime, PyTorch, VTK, each value beside imf's own.

    python crates/imf-bench/python/interchange.py IMF [FOLDER]

IMF is the command to test. In FOLDER (a temporary one unless given) a few small fields are made of the built-in bracket:
a trained network, a harmonic and a factored field, of overlaps and of signed depths; sections as .vti and .npy. Then
  onnxruntime  runs `imf export`'s graphs, after onnx's checker has passed them,
  PyTorch      runs the models as docs/imf_torch.py loads them, also its gradients (against differences of imf's values),
  NumPy        evaluates a harmonic field from its arrays, at voxel centres,
  VTK          reads the .vti and must have every value of the .npy of the same name.
The poses are random: in the box of the voxel centres, in the half voxel around it, and outside, up to the box's own size
away. Values are compared with those that `imf query` prints. Prints Markdown; ends with 1 where a difference is above
TOLERANCE of the largest value that the field's quantity can have.
"""

import csv
import io
import json
import pathlib
import subprocess
import sys
import tempfile

import numpy as np
import onnx
import onnxruntime
import torch
import vtk
from safetensors import safe_open
from vtk.util.numpy_support import vtk_to_numpy

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[3] / "docs"))
import imf_torch

POSES = 20_000
# Single precision: networks are sums of hundreds of products inside sines of thirty times their argument.
TOLERANCE = 1e-4
SCENE = ["bracket", "--dims", "13,37,22"]


def main() -> None:
    imf, folder = sys.argv[1], sys.argv[2] if len(sys.argv) > 2 else None
    with tempfile.TemporaryDirectory() as temporary:
        work = pathlib.Path(folder or temporary)
        work.mkdir(parents=True, exist_ok=True)
        print(f"onnx {onnx.__version__}, onnxruntime {onnxruntime.__version__}, PyTorch {torch.__version__}, "
              f"VTK {vtk.vtkVersion.GetVTKVersion()}; {run(imf, '--version').strip()}\n")
        fields = make(imf, work)
        print("| field | read by | poses | where | largest difference | mean | largest value |\n|---|---|---|---|---|---|---|")
        worst = max(compare(imf, name, path, work) for name, path in fields.items())
        print()
        worst = max(worst, gradients(imf, fields["siren5"], work))
        same = volumes(work / "sections")
    if worst > TOLERANCE or not same:
        sys.exit(f"a difference of {worst:.1e} is above {TOLERANCE:.0e}, or VTK reads other values")


def run(imf: str, *arguments: str, text: str | None = None) -> str:
    done = subprocess.run([imf, *map(str, arguments)], check=True, stdout=subprocess.PIPE, stderr=subprocess.PIPE,
                          text=True, input=text)
    return done.stdout


def make(imf: str, work: pathlib.Path) -> dict[str, pathlib.Path]:
    """A field of each family, and sections."""
    fit = ["train", "harmonic", *SCENE, "--degree", "8"]
    run(imf, *fit, "--out", work / "harmonic.safetensors")
    run(imf, "field", work / "harmonic.safetensors", "--orientations", "0,0;40,70", "--out", work / "sections")
    run(imf, "train", "factored", work / "harmonic.safetensors", "--out", work / "factored")
    run(imf, "dataset", *SCENE, "--orientations", "fibonacci:20", "--out", work / "samples")
    run(imf, "train", "siren5", work / "samples", "--out", work / "model", "--steps", "200", "--device", "cpu")
    deep = [*fit, "--quantity", "depth"]
    run(imf, *deep, "--no-calibrate", "--out", work / "harmonic-depth.safetensors")
    run(imf, "train", "factored", work / "harmonic-depth.safetensors", "--out", work / "factored-depth")
    return {
        "siren5": work / "model/field.safetensors",
        "harmonic": work / "harmonic.safetensors",
        "factored": work / "factored/field.safetensors",
        "harmonic-depth": work / "harmonic-depth.safetensors",
        "factored-depth": work / "factored-depth/field.safetensors",
    }


def random_poses(box: np.ndarray, seed: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Positions in the box, (theta, phi), directions; as f32 in f64, so that all programs are asked the same."""
    random = np.random.default_rng(seed)
    position = (box[0] + random.random((POSES, 3)) * (box[1] - box[0])).astype(np.float32).astype(float)
    return position, *random_turns(random)


def poses_around(box: np.ndarray, room: np.ndarray | float, seed: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """As random_poses, but outside the box, at most `room` away along each axis."""
    random = np.random.default_rng(seed)
    position = box[0] - room + random.random((20 * POSES, 3)) * (box[1] - box[0] + 2 * room)
    position = position[((position < box[0]) | (position > box[1])).any(axis=1)][:POSES]
    assert len(position) == POSES, "too few of the positions are outside"
    return position.astype(np.float32).astype(float), *random_turns(random)


def random_turns(random: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """(theta, phi) in degrees, some of them vertical, and the same as directions."""
    angles = np.stack([random.random(POSES) * 360, np.degrees(np.arccos(2 * random.random(POSES) - 1))], axis=1)
    angles[:4, 1] = [0, 180, 0, 180]
    angles = angles.astype(np.float32).astype(float)
    theta, phi = np.radians(angles).T
    direction = np.stack([np.sin(phi) * np.cos(theta), np.sin(phi) * np.sin(theta), np.cos(phi)], axis=1)
    return angles, direction.astype(np.float32).astype(float)


def query(imf: str, field: pathlib.Path, position: np.ndarray, turned: np.ndarray) -> np.ndarray:
    """What `imf query` prints for positions and angles or directions."""
    columns = ["x", "y", "z"] + (["theta", "phi"] if turned.shape[1] == 2 else ["i", "j", "k"])
    text = io.StringIO()
    lines = csv.writer(text)
    lines.writerow(columns)
    lines.writerows([repr(float(v)) for v in row] for row in np.hstack([position, turned]))
    answers = run(imf, "query", field, "-", "--device", "cpu", "--quiet", text=text.getvalue())
    return np.array([float(list(row.values())[-1]) for row in csv.DictReader(io.StringIO(answers))])


def compare(imf: str, name: str, field: pathlib.Path, work: pathlib.Path) -> float:
    graph = work / f"{name}.onnx"
    run(imf, "export", field, "--out", graph)
    model = onnx.load(graph)
    onnx.checker.check_model(model, full_check=True)
    about = {entry.key: entry.value for entry in model.metadata_props}
    box = np.array([[float(v) for v in about[f"imf.box_{end}"].split()] for end in ("lower", "upper")])
    origin = np.array([float(v) for v in about["imf.origin"].split()])
    session = onnxruntime.InferenceSession(graph, providers=["CPUExecutionProvider"])
    # A depth is a length: 7.5 pitches at most.
    depth, pitch = about["imf.quantity"] == "depth", float(about["imf.pitch"])
    unit = 7.5 * pitch if depth else 1.0
    places = {
        "inside": random_poses(box, 1),
        "half a voxel around": poses_around(box, 0.5 * pitch, 4),
        "outside": poses_around(box, box[1] - box[0], 5),
    }
    worst = 0.0
    for where, (position, angles, direction) in places.items():
        turned = angles if "angles" in [value.name for value in session.get_inputs()] else direction
        expected = query(imf, field, position, turned)
        inputs = {"position": position - origin, ("angles" if turned is angles else "direction"): turned}
        inputs = {key: value.astype(np.float32) for key, value in inputs.items()}
        found = session.run([about["imf.quantity"]], inputs)[0]
        worst = max(worst, report(name, "onnxruntime", where, found, expected) / unit)
        if not name.startswith("harmonic"):
            with torch.no_grad():
                loaded = imf_torch.load(field)
                assert loaded.depth == depth, "a field of depth is not known as one"
                found = loaded(torch.tensor(position), torch.tensor(turned)).numpy()
            worst = max(worst, report(name, "PyTorch", where, found, expected) / unit)
        elif where == "inside":
            worst = max(worst, arrays(imf, name, field, depth, direction) / unit)
    return worst


def arrays(imf: str, name: str, field: pathlib.Path, depth: bool, direction: np.ndarray) -> float:
    """A harmonic field by its arrays, at random voxel centres."""
    with safe_open(field, framework="np") as file:
        about = json.loads(file.metadata()["imf"])
        saved = {name: file.get_tensor(name).astype(np.float64) for name in ("coefficients", "components", "mean")}
    settings, grid = about["settings"], about["scene"]["grid"]
    assert (settings.get("quantity") == "depth") == depth, "the file does not say what it is of"
    dims = grid["dims"]
    voxel = np.stack([np.random.default_rng(3).integers(0, n, POSES) for n in dims], axis=1)
    functions = imf_torch.harmonics(torch.tensor(direction), settings["degree"]).numpy()
    along = saved["coefficients"][tuple(voxel.T)]
    found = np.sum(functions * (saved["mean"] + along @ saved["components"].T), axis=1)
    found = found if depth else found.clip(0, 1)
    position = np.array(grid["origin"]) + (voxel + 0.5) * grid["pitch"]
    return report(name, "NumPy", "voxel centres", found, query(imf, field, position, direction))


def report(name: str, reader: str, where: str, found: np.ndarray, expected: np.ndarray) -> float:
    off = np.abs(found - expected)
    print(f"| {name} | {reader} | {len(off)} | {where} | {off.max():.1e} | {off.mean():.1e} | {expected.max():.3f} |")
    return float(off.max())


def gradients(imf: str, field: pathlib.Path, work: pathlib.Path) -> float:
    """PyTorch's gradient along one direction of motion against differences of imf's values over some thousandths of a pitch."""
    about = {entry.key: entry.value for entry in onnx.load(work / "siren5.onnx").metadata_props}
    box = np.array([[float(v) for v in about[f"imf.box_{end}"].split()] for end in ("lower", "upper")])
    step = 0.002 * float(about["imf.pitch"])
    # Outside the box values are those of the nearest point inside.
    position, angles, _ = random_poses(box + step * np.array([[1.0], [-1.0]]), 2)
    model = imf_torch.load(field).double()
    at = torch.tensor(position, requires_grad=True)
    model(at, torch.tensor(angles)).sum().backward()
    along = np.array([0.6, 0.0, 0.8])
    difference = query(imf, field, position + step * along, angles) - query(imf, field, position - step * along, angles)
    off = np.abs(at.grad.numpy() @ along * 2 * step - difference)
    print(f"siren5's gradient in PyTorch times a step of {2 * step:.3f} against imf's differences: largest difference "
          f"{off.max():.1e}, largest change {np.abs(difference).max():.1e}\n")
    return float(off.max())


def volumes(folder: pathlib.Path) -> bool:
    """Whether VTK has of every .vti what the .npy beside it has."""
    same = True
    print("| .vti | cells | arrays | equal to .npy |\n|---|---|---|---|")
    for path in sorted(folder.glob("*.vti")):
        reader = vtk.vtkXMLImageDataReader()
        reader.SetFileName(str(path))
        reader.Update()
        image = reader.GetOutput()
        cells = [n - 1 for n in image.GetDimensions()]
        data = image.GetCellData()
        names, equal = [], []
        for index in range(data.GetNumberOfArrays()):
            array = data.GetArray(index)
            values = vtk_to_numpy(array).reshape(cells[::-1]).transpose(2, 1, 0)
            names.append(array.GetName())
            twin = folder / f"{array.GetName()}.npy"
            if not twin.exists():
                equal.append("no .npy")
                continue
            equal.append("yes" if np.array_equal(np.load(twin), values) else "NO")
            same = same and equal[-1] == "yes"
        print(f"| {path.name} | {'×'.join(map(str, cells))} | {', '.join(names)} | {'; '.join(equal)} |")
    return same and bool(list(folder.glob("*.vti")))


if __name__ == "__main__":
    main()
