"""imf's models in PyTorch: weights, scaling of the inputs and all from the safetensors file that `imf train` wrote.

    from imf_torch import load
    field = load("model/field.safetensors")             # a torch.nn.Module, differentiable in its inputs
    overlap = field(position, angles)                   # [n, 3] in the scene's unit, [n, 2] of (theta, phi) in degrees

    field = load("small/field.safetensors")             # what `imf train PART` wrote
    overlap = field(position, direction)                # [n, 3] of the tool's axis from tip to holder, of any length

`overlap` is the share of the tool's volume inside the part, at the tip's position. A field of depth (`field.depth` is true)
answers depths instead: how far the tool must be moved to be free, below zero how far it may be moved, in the scene's unit,
held within 7.5 pitches. Outside the box of the voxel centres both answer as at the nearest point inside, as `imf query`
does. Needs torch and safetensors.
"""

import json
import math

import torch
from safetensors import safe_open
from torch.nn.functional import linear


def load(path):
    """The field in a file of the family `siren5` or of a factored field."""
    with safe_open(path, framework="pt") as file:
        about = json.loads(file.metadata()["imf"])
        tensors = {name: file.get_tensor(name) for name in file.keys()}
    kinds = {"imf-model": Siren5, "imf-factored": Factored}
    if about["format"] not in kinds:
        raise ValueError(f"{path} is of the format {about['format']}, not one of {', '.join(kinds)}")
    return kinds[about["format"]](about, tensors)


def box_of_centres(grid):
    """The corners of the box of the voxel centres."""
    dims, origin = (torch.tensor(grid[name], dtype=torch.float64) for name in ("dims", "origin"))
    return origin + 0.5 * grid["pitch"], origin + grid["pitch"] * (dims - 0.5)


class Siren5(torch.nn.Module):
    """The paper's network: sines of five inputs in [-1, 1], the inputs again behind one layer, a sigmoid at the end that reaches
    a little below 0, where it is clamped."""

    depth = False

    def __init__(self, about, tensors):
        super().__init__()
        network, grid = about["network"], about["scene"]["grid"]
        self.omega, self.skip_after = network["omega"], network["skip_after"]
        self.weights = torch.nn.ParameterList(tensors[f"layers.{i}.weight"] for i in range(network["hidden"] + 1))
        self.biases = torch.nn.ParameterList(tensors[f"layers.{i}.bias"] for i in range(network["hidden"] + 1))
        self.register_buffer("origin", torch.tensor(grid["origin"], dtype=torch.float64))
        self.register_buffer("size", torch.tensor([grid["pitch"] * n for n in grid["dims"]], dtype=torch.float64))
        for name, corner in zip(("lower", "upper"), box_of_centres(grid)):
            self.register_buffer(name, corner)

    def forward(self, position, angles):
        unit = (position.double().clamp(self.lower, self.upper) - self.origin) / self.size
        theta, phi = (angles.double() / angles.new_tensor([180.0, 90.0]) - 1.0).unbind(1)
        # A vertical direction has every theta: the middle one is asked.
        theta = torch.where((angles[:, 1].float() / 90.0 - 1.0).abs() < 1.0, theta, 0.0)
        inputs = torch.cat([2.0 * unit - 1.0, torch.stack([theta, phi], dim=1)], dim=1)
        inputs = inputs.to(self.weights[0].dtype)
        signal = inputs
        for layer, (weight, bias) in enumerate(zip(self.weights, self.biases)):
            # A network of two layers or fewer has no layer of sines behind that takes them again.
            if layer == self.skip_after and 0 < layer < len(self.weights) - 1:
                signal = torch.cat([signal, inputs], dim=1)
            signal = linear(signal, weight, bias)
            if layer + 1 < len(self.weights):
                signal = torch.sin(self.omega * signal)
        return (1.01 * torch.sigmoid(signal[:, 0]) - 0.01).clamp(min=0.0)


class Factored(torch.nn.Module):
    """A sine network from the point to coefficients, times harmonics of the tool's direction: where the network is told of
    the part's symmetry, of the direction in the frame of the point."""

    def __init__(self, about, tensors):
        super().__init__()
        if about["domain"] != "directions":
            raise ValueError("the field is one of rotations, not of directions")
        settings, grid = about["settings"], about["scene"]["grid"]
        self.omega, self.scale = settings["omega"], about["scale"]
        self.depth = about["fit"].get("quantity", "overlap") == "depth"
        # Depths are clamped within 7.5 pitches.
        self.bounds = (-7.5 * grid["pitch"], 7.5 * grid["pitch"]) if self.depth else (0.0, 1.0)
        self.register_buffer("components", tensors["components"].float())
        self.register_buffer("mean", tensors["mean"])
        # Of a folded network the last sines are the coefficients.
        self.folded = about.get("folded", False)
        symmetry = settings.get("symmetry", {})
        self.mirrors, self.axis = symmetry.get("mirrors", [None] * 3), symmetry.get("axis")
        sizes = [5 if self.axis else 3] + [settings["width"]] * settings["hidden"] + ([] if self.folded else [self.components.shape[1]])
        flat, self.weights, self.biases = tensors["parameters"].float(), torch.nn.ParameterList(), torch.nn.ParameterList()
        for inputs, outputs in zip(sizes, sizes[1:]):
            weight, bias, flat = flat.split([inputs * outputs, outputs, len(flat) - (inputs + 1) * outputs])
            self.weights.append(weight.reshape(outputs, inputs).clone())
            self.biases.append(bias.clone())
        size = torch.tensor([grid["pitch"] * n for n in grid["dims"]], dtype=torch.float64)
        self.register_buffer("middle", torch.tensor(grid["origin"], dtype=torch.float64) + 0.5 * size)
        self.inverse_length = 2.0 / size.max().item()
        for name, corner in zip(("lower", "upper"), box_of_centres(grid)):
            self.register_buffer(name, corner)

    def place(self, position, direction):
        """The position on the far side of every mirror plane, the network's inputs behind it, and the local direction."""
        position, direction, angle = list(position.unbind(1)), list(direction.unbind(1)), []
        for i, plane in enumerate(self.mirrors):
            if plane is not None:
                near = position[i] < plane
                position[i] = torch.where(near, 2.0 * plane - position[i], position[i])
                direction[i] = torch.where(near, -direction[i], direction[i])
        if self.axis:
            i, j, k = ((self.axis["along"] + 1) % 3, (self.axis["along"] + 2) % 3, self.axis["along"])
            x, y = position[i] - self.axis["through"][i], position[j] - self.axis["through"][j]
            on = (x == 0) & (y == 0)
            x = torch.where(on, torch.ones_like(x), x)
            cosine, sine = x / torch.hypot(x, y), y / torch.hypot(x, y)
            x, y, z = direction[i], direction[j], direction[k]
            direction, angle = [cosine * x + sine * y, cosine * y - sine * x, z], [0.5 * cosine, 0.5 * sine]
        return torch.stack(position, 1), angle, torch.stack(direction, 1)

    def forward(self, position, direction):
        held = position.double().clamp(self.lower, self.upper)
        position, angle, direction = self.place(held, direction.double())
        signal = (position - self.middle) * self.inverse_length
        signal = torch.cat([signal] + [a[:, None] for a in angle], 1).to(self.components.dtype)
        sines = len(self.weights) - (0 if self.folded else 1)
        for layer, (weight, bias) in enumerate(zip(self.weights, self.biases)):
            signal = linear(signal, weight, bias)
            if layer < sines:
                signal = torch.sin(self.omega * signal)
        along = self.scale * signal
        functions = harmonics(direction, math.isqrt(len(self.mean)) - 1).to(self.components.dtype)
        values = (along * (functions @ self.components)).sum(dim=1) + functions @ self.mean
        return values.clamp(*self.bounds)


def harmonics(direction, degree):
    """Real spherical harmonics of mean square 1 up to a degree: [n, (degree + 1)^2], function l^2 + l + m."""
    x, y, z = (direction.double() / direction.double().norm(dim=1, keepdim=True)).unbind(dim=1)
    places = [None] * (degree + 1) ** 2
    cosine, sine, sectoral = torch.ones_like(z), torch.zeros_like(z), 1.0
    for m in range(degree + 1):
        if m > 0:
            cosine, sine = x * cosine - y * sine, x * sine + y * cosine
            sectoral *= math.sqrt((2 * m + 1) / (2 * m))
        before, value = torch.zeros_like(z), torch.full_like(z, sectoral * (math.sqrt(2.0) if m else 1.0))
        for l in range(m, degree + 1):
            if l > m:
                a = math.sqrt((4 * l * l - 1) / (l * l - m * m))
                b = math.sqrt(max((l - 1) ** 2 - m * m, 0) / abs(4 * (l - 1) ** 2 - 1))
                before, value = value, a * (z * value - b * before)
            places[l * l + l + m], places[l * l + l - m] = value * cosine, value * sine if m else value
    return torch.stack(places, dim=1)
