"""What else might teach a factored field better: optimisers, encodings, losses and starts, tried in PyTorch.

    python crates/imf-bench/python/tries.py optimisers|encodings|losses FIELD.npz
    python crates/imf-bench/python/tries.py starts FIELD.npz FIELD.npz NEW.npz

A FIELD is what `imf train harmonic PART --out FIELD.npz` writes, of overlaps over directions. Needs torch (as
in crates/imf-bench/python/requirements-torch.txt) and numpy. Prints a Markdown table, each row a teaching of its own from the same seed.

A row differs from the baseline in what it says and in nothing else. The baseline is `imf compress --optimiser muon --rate
1.5e-3`: sines 3→256³
with ω = 20 and a linear layer to the coefficients along the principal axes; batches of 1,024 voxels; Muon for the
matrices between hidden layers, Adam for all other weights; the rate 1.5e-3 after 10 steps of rise, by a cosine to 0;
the last layer solved by least squares every 25 steps and at the end.

MSE         squared error of the coefficients summed over axes, mean over all voxels: by Parseval that of the values over
            the whole sphere, before they are clipped
largest     error of the clipped values, at all voxels and 64 random directions
otherwise   share of these poses that come to stand on the other side of 0.01 than by the teacher
parameters  of the network, tables included
CPU, s      processor time of teaching, solving included, of all threads: compare it within one run of this script alone
"""

import argparse
import copy
import dataclasses
import math
import os
import pathlib
import sys
import time
from collections.abc import Callable, Iterator
from functools import partial

# Threads that wait for each other take no processor time that would be counted.
os.environ.setdefault("OMP_WAIT_POLICY", "PASSIVE")

import numpy as np
import torch
from torch import nn

OMEGA = 20.0
WIDTH, HIDDEN = 256, 3
# Of `imf train factored`: highest rate, steps of rise.
RATE, RISE = 1.5e-3, 10
# Voxels for each weight of an output: while teaching goes on, and at the end.
WHILE_TEACHING, AT_THE_END = 64, 512
GOLDEN = 0.6180339887498949
# Voxels that pass through a network together where no gradient is asked for.
BLOCK = 4096
# Poses of a smaller overlap count as free.
THRESHOLD = 0.01


# The teacher.


def harmonics(directions: np.ndarray, degree: int) -> np.ndarray:
    """√4π Y_lm at unit vectors [n, 3], place l² + l + m, without the Condon-Shortley sign: [n, (degree + 1)²]."""
    x, y, z = directions.T
    values = np.empty((len(directions), (degree + 1) ** 2))
    turned, sectoral = np.ones(len(z), complex), 1.0
    for m in range(degree + 1):
        if m > 0:
            turned = turned * (x + 1j * y)
            sectoral *= math.sqrt((2 * m + 1) / (2 * m))
        before, value = np.zeros_like(z), np.full_like(z, sectoral)
        for l in range(m, degree + 1):
            if l > m:
                a = math.sqrt((4 * l * l - 1) / (l * l - m * m))
                b = math.sqrt(max((l - 1) ** 2 - m * m, 0) / abs(4 * (l - 1) ** 2 - 1))
                before, value = value, a * (z * value - b * before)
            for place, part in ((l * l + l - m, turned.imag), (l * l + l + m, turned.real)):
                values[:, place] = value * part * (math.sqrt(2) if m > 0 else 1)
    return values


class Teacher:
    """A harmonic field: `inputs` [voxels, 3] and `targets` [voxels, axes] in units of `scale`."""

    def __init__(self, path: pathlib.Path):
        with np.load(path) as file:
            coefficients, axes, mean, degree = file["coefficients"], file["axes"], file["mean"], int(file["degree"][0])
            if bool(file["depth"][0]) or len(mean) != (degree + 1) ** 2:
                raise SystemExit(f"{path}: a field of overlaps over directions is needed")
        self.name = path.stem
        dims = np.array(coefficients.shape[:3])
        # Half the box's edges, and what the network sees of a position: the longest edge is [−1, 1].
        self.box = torch.tensor(dims / dims.max(), dtype=torch.float32)
        places = [(2 * np.arange(n) + 1 - n) / dims.max() for n in dims]
        inputs = np.stack(np.meshgrid(*places, indexing="ij"), axis=-1).reshape(-1, 3)
        self.inputs = torch.tensor(inputs, dtype=torch.float32)
        flat = torch.from_numpy(coefficients.reshape(-1, coefficients.shape[3]))
        self.scale = flat.double().square().mean().sqrt().item()
        self.targets, self.axes = flat / self.scale, flat.shape[1]
        directions = np.random.default_rng(64).normal(size=(64, 3))
        directions /= np.linalg.norm(directions, axis=1, keepdims=True)
        functions = harmonics(directions, degree)
        self.heads = torch.tensor(functions @ axes * self.scale, dtype=torch.float32).T.contiguous()
        self.offset = torch.tensor(functions @ mean, dtype=torch.float32)

    def values(self, outputs: torch.Tensor) -> torch.Tensor:
        """Clipped overlaps at the 64 directions: [n, 64]."""
        return (outputs @ self.heads + self.offset).clamp(0, 1)


# Networks.


class Grid(nn.Module):
    """Multiresolution tables of features, read trilinearly (Müller et al. 2022, "Instant neural graphics primitives").

    `cells` along the longest edge of each level. A level of more than `entries` nodes is hashed by the paper's
    equation 4; the others, and all without `entries`, have a row for each node of the box."""

    def __init__(self, box: torch.Tensor, cells: list[int], features: int, entries: int | None):
        super().__init__()
        self.box, self.features = box, len(cells) * features
        self.cells = torch.tensor(cells, dtype=torch.float32)
        self.nodes = (self.cells[:, None] * box - 1e-4).ceil().long() + 1
        count = self.nodes.prod(1)
        self.hashed = count > entries if entries else torch.zeros(len(cells), dtype=torch.bool)
        self.entries = entries or 1
        rows = torch.where(self.hashed, torch.full_like(count, self.entries), count)
        self.first = rows.cumsum(0) - rows
        self.table = nn.Parameter(torch.empty(int(rows.sum()), features).uniform_(-1e-4, 1e-4))
        self.corners = torch.tensor([[i >> 2, i >> 1 & 1, i & 1] for i in range(8)])

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        place = (x + self.box)[:, None] * (self.cells / 2)[:, None]
        low = torch.minimum(place.floor().long(), self.nodes - 2)
        share = (place - low)[:, :, None]
        weight = torch.where(self.corners.bool(), share, 1 - share).prod(3)
        i, j, k = (low[:, :, None] + self.corners).unbind(3)
        _, ny, nz = self.nodes[:, :, None].unbind(1)
        hashed = (i ^ j * 2654435761 ^ k * 805459861) % self.entries
        row = torch.where(self.hashed[:, None], hashed, (i * ny + j) * nz + k) + self.first[:, None]
        row, weight = row.view(-1, 8), weight.view(-1, 8)
        read = nn.functional.embedding_bag(row, self.table, mode="sum", per_sample_weights=weight)
        return read.view(len(x), self.features)


class Network(nn.Module):
    """The position, behind an encoding's features if there is one, through hidden layers and a linear one.

    In the sines' range √(6/n)/ω ReLU's layers begin as He et al. (2015) have them, and the sines' rates serve."""

    def __init__(self, axes: int, width=WIDTH, hidden=HIDDEN, encoding: Grid | None = None, act=torch.sin):
        super().__init__()
        self.encoding, self.act = encoding, act
        inputs = 3 + (encoding.features if encoding else 0)
        self.hidden = nn.ModuleList(nn.Linear(n, width) for n in [inputs] + [width] * (hidden - 1))
        self.last = nn.Linear(width, axes)
        for index, layer in enumerate([*self.hidden, self.last]):
            n = layer.in_features
            nn.init.uniform_(layer.weight, -1, 1)
            layer.weight.data *= 1 / n if index == 0 else math.sqrt(6 / n) / OMEGA
            nn.init.uniform_(layer.bias, -1 / math.sqrt(n), 1 / math.sqrt(n))

    def features(self, x: torch.Tensor) -> torch.Tensor:
        h = torch.cat([self.encoding(x), x], 1) if self.encoding else x
        for layer in self.hidden:
            h = self.act(OMEGA * layer(h))
        return h

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        return self.last(self.features(x))

    def matrices(self) -> list[nn.Parameter]:
        """Between hidden layers."""
        return [layer.weight for layer in self.hidden[1:]]

    def count(self) -> int:
        return sum(p.numel() for p in self.parameters())


# Optimisers of matrices. Like Adam they find their rate for each step in `param_groups`.


class OfMatrices(torch.optim.Optimizer):
    """Updates each matrix by itself: `update(weights, gradient, state, rate)`."""

    def __init__(self, matrices: list[nn.Parameter]):
        super().__init__(matrices, {"lr": 0.0})

    @torch.no_grad()
    def step(self) -> None:
        for w in self.param_groups[0]["params"]:
            self.update(w, w.grad, self.state[w], self.param_groups[0]["lr"])


class Muon(OfMatrices):
    """Jordan et al. 2024, steps as long as by Liu et al. 2025, arXiv 2502.16982; as crates/imf-core/src/siren/muon.rs."""

    def update(self, w: torch.Tensor, g: torch.Tensor, state: dict, rate: float) -> None:
        m = state.setdefault("m", torch.zeros_like(g)).lerp_(g, 0.05)
        x = m.lerp(g, 0.05)
        x /= x.norm() + 1e-30
        for _ in range(5):
            gram = x @ x.T
            x = 3.4445 * x + (-4.7750 * gram + 2.0315 * gram @ gram) @ x
        w.sub_(x, alpha=rate * 0.2 * math.sqrt(max(w.shape)))


# SOAP and Shampoo share these: what their means keep of a step, and the steps between two looks at their axes.
KEPT, LOOK = 0.95, 10


class Shampoo(OfMatrices):
    """Gupta, Koren and Singer 2018, algorithm 1: `L^(−1/4) G R^(−1/4)`.

    As in later practice (Anil et al. 2020, arXiv 2002.09018) L and R are decaying means where the paper has sums, and
    G is the gradient's momentum. Where a gradient repeats a step is as long as Muon's."""

    @staticmethod
    def root(mean: torch.Tensor) -> torch.Tensor:
        values, vectors = torch.linalg.eigh(mean)
        return vectors * values.clamp_min(1e-6 * values[-1]).pow(-0.25) @ vectors.T

    def update(self, w: torch.Tensor, g: torch.Tensor, state: dict, rate: float) -> None:
        squares = [g @ g.T, g.T @ g]
        if not state:
            state.update(t=0, m=torch.zeros_like(g), means=[torch.zeros_like(square) for square in squares])
        state["t"] += 1
        state["m"].lerp_(g, 0.1)
        for mean, square in zip(state["means"], squares):
            mean.lerp_(square, 1 - KEPT)
        if state["t"] % LOOK == 1:
            # Means are of as many steps as there were.
            state["roots"] = [self.root(mean / (1 - KEPT ** state["t"])) for mean in state["means"]]
        left, right = state["roots"]
        step = left @ (state["m"] / (1 - 0.9 ** state["t"])) @ right
        w.sub_(step, alpha=rate * 0.2 * math.sqrt(max(w.shape)))


class Soap(OfMatrices):
    """Vyas et al. 2024, arXiv 2409.11321, algorithm 3, as crates/imf-core/src/siren/soap.rs: Adam along the axes of
    Shampoo's means, which a step of power iteration and a QR decomposition bring up to date. The first gradient does
    nothing but begin the means."""

    def update(self, w: torch.Tensor, g: torch.Tensor, state: dict, rate: float) -> None:
        squares = [g @ g.T, g.T @ g]
        if not state:
            turns = [torch.linalg.eigh(square)[1].flip(1) for square in squares]
            state.update(t=0, m=torch.zeros_like(g), v=torch.zeros_like(g), means=squares, turns=turns)
            return
        state["t"] += 1
        left, right = state["turns"]
        m, v = state["m"].lerp_(g, 1 - KEPT), state["v"].lerp_((left.T @ g @ right).square(), 1 - KEPT)
        whole = 1 - KEPT ** state["t"]
        step = left.T @ m @ right / whole / ((v / whole).sqrt() + 1e-12)
        w.sub_(left @ step @ right.T, alpha=rate)
        for side, (mean, square) in enumerate(zip(state["means"], squares)):
            mean.lerp_(square, 1 - KEPT)
            if state["t"] % LOOK == 0:
                turned = mean @ state["turns"][side]
                # By falling eigenvalue, so that QR keeps the axes in order; the second moments follow.
                order = (state["turns"][side] * turned).sum(0).argsort(descending=True)
                state["turns"][side] = torch.linalg.qr(turned[:, order])[0]
                v.copy_(v.index_select(side, order))


MATRICES: dict[str, Callable] = {"Adam": torch.optim.Adam, "Muon": Muon, "SOAP": Soap, "Shampoo": Shampoo}


# Teaching.


@dataclasses.dataclass(frozen=True)
class Plan:
    """How a network is taught; the defaults are the baseline's."""

    steps: int = 1000
    batch: int = 1024
    optimiser: str = "Muon"
    rate: float = RATE
    # Of the matrices between hidden layers, and of an encoding's tables, where other than `rate`.
    matrix_rate: float | None = None
    table_rate: float = 1e-2
    # Exponent of the coefficients' errors: 2 or 1.
    power: int = 2
    # Weight of each voxel, mean 1; in the least squares too.
    weights: torch.Tensor | None = None
    solve_every: int = 25
    solve_first: bool = False
    seed: int = 0


def order(voxels: int, batch: int, seed: int) -> Iterator[torch.Tensor]:
    """Batches of voxels, every one once an epoch."""
    generator, rest = torch.Generator().manual_seed(seed), torch.empty(0, dtype=torch.long)
    while True:
        while len(rest) < batch:
            rest = torch.cat([rest, torch.randperm(voxels, generator=generator)])
        yield rest[:batch]
        rest = rest[batch:]


@torch.no_grad()
def solve(network: Network, teacher: Teacher, each: int, turn: float, weights: torch.Tensor | None) -> None:
    """The last layer by least squares, as crates/imf-core/src/factored/last_layer.rs."""
    columns, voxels = network.last.in_features + 1, len(teacher.inputs)
    count = min(voxels, each * columns)
    places = ((torch.arange(count, dtype=torch.float64) + turn) * (voxels / count)).long().clamp_max(voxels - 1)
    gram = torch.zeros(columns, columns, dtype=torch.float64)
    right = torch.zeros(columns, network.last.out_features, dtype=torch.float64)
    for rows in places.split(2048):
        h = network.features(teacher.inputs[rows])
        rest = teacher.targets[rows] - network.last(h)
        a = torch.cat([h, torch.ones(len(rows), 1)], 1)
        weighted = a if weights is None else a * weights[rows, None]
        gram += (weighted.T @ a).double()
        right += (weighted.T @ rest).double()
    gram += 1e-6 * gram.trace() / columns * torch.eye(columns, dtype=torch.float64)
    factor, failed = torch.linalg.cholesky_ex(gram)
    if failed:
        return
    change = torch.cholesky_solve(right, factor).float()
    network.last.weight += change[:-1].T
    network.last.bias += change[-1]


def teach(network: Network, teacher: Teacher, plan: Plan) -> float:
    """Teaches in place; the processor seconds that it took."""
    start = time.process_time()
    tables = list(network.encoding.parameters()) if network.encoding else []
    apart = {id(p) for p in [*network.matrices(), *tables]}
    rest = [p for p in network.parameters() if id(p) not in apart]
    rated = [(torch.optim.Adam(rest), plan.rate)]
    rated += [(MATRICES[plan.optimiser](network.matrices()), plan.matrix_rate or plan.rate)]
    # Müller et al.'s settings for tables: rows that are seldom read move as far as others.
    rated += [(torch.optim.Adam(tables, betas=(0.9, 0.99), eps=1e-15), plan.table_rate)] if tables else []
    batches = order(len(teacher.inputs), plan.batch, plan.seed)
    if plan.solve_first:
        solve(network, teacher, WHILE_TEACHING, 0.0, plan.weights)
    for step in range(plan.steps):
        rows = next(batches)
        errors = network(teacher.inputs[rows]) - teacher.targets[rows]
        errors = (errors.square() if plan.power == 2 else errors.abs()).sum(1)
        loss = (errors if plan.weights is None else errors * plan.weights[rows]).mean()
        network.zero_grad(set_to_none=True)
        loss.backward()
        for optimiser, rate in rated:
            fall = 0.5 * (1 + math.cos(math.pi * (step - RISE) / max(plan.steps - RISE, 1)))
            optimiser.param_groups[0]["lr"] = rate * ((step + 1) / RISE if step < RISE else fall)
            optimiser.step()
        done = step + 1
        if plan.solve_every and (done % plan.solve_every == 0 or done == plan.steps):
            each = AT_THE_END if done == plan.steps else WHILE_TEACHING
            solve(network, teacher, each, done * GOLDEN % 1, plan.weights)
    return time.process_time() - start


@torch.no_grad()
def judge(network: Network, teacher: Teacher) -> tuple[float, float, float]:
    """MSE over the sphere, largest error at the directions, share of poses decided otherwise than by the teacher."""
    square, largest, otherwise = 0.0, 0.0, 0
    for x, z in zip(teacher.inputs.split(BLOCK), teacher.targets.split(BLOCK)):
        out = network(x)
        square += (out - z).double().square().sum().item() * teacher.scale**2
        values, true = teacher.values(out), teacher.values(z)
        largest = max(largest, (values - true).abs().max().item())
        otherwise += ((values < THRESHOLD) != (true < THRESHOLD)).sum().item()
    voxels = len(teacher.inputs)
    return square / voxels, largest, otherwise / (voxels * len(teacher.offset))


# What is tried: groups of rows, of which the best at the first number of steps alone goes on to the others.

Rows = list[tuple[str, Callable[[], Network], Plan]]


def optimisers(teachers: list[Teacher], rates: list[float]) -> Iterator[Rows]:
    """The rates are of the matrices between hidden layers alone."""
    make = partial(Network, teachers[0].axes)
    for name in MATRICES:
        yield [(f"{name} at {rate:g}", make, Plan(optimiser=name, matrix_rate=rate)) for rate in rates]


def encodings(teachers: list[Teacher], rates: list[float]) -> Iterator[Rows]:
    """Two hidden layers behind tables, as wide as the baseline's parameters allow; the rates are the tables'."""
    axes, box = teachers[0].axes, teachers[0].box
    yield [("sines alone", partial(Network, axes), Plan())]
    # Cells of the longest edge by level, features of each, entries of a hashed level.
    for name, grid in {"dense grid": ([4, 8, 16, 32], 4, None), "hash": ([4, 6, 9, 13, 20, 30, 43, 64], 2, 4096)}.items():
        for kind, act in {"ReLU": torch.relu, "sines": torch.sin}.items():
            # The widest network that has no more parameters, tables included.
            width, budget = WIDTH, Network(axes).count()
            while Network(axes, width + 1, 2, Grid(box, *grid)).count() <= budget:
                width += 1
            make = lambda grid=grid, act=act, width=width: Network(axes, width, 2, Grid(box, *grid), act)
            yield [(f"{name}, {kind} {width}², tables at {rate:g}", make, Plan(table_rate=rate)) for rate in rates]


def losses(teachers: list[Teacher], _: list[float]) -> Iterator[Rows]:
    """What the gradient is of; weights are in the least squares too."""
    make = partial(Network, teachers[0].axes)
    values = torch.cat([teachers[0].values(z) for z in teachers[0].targets.split(BLOCK)])
    near = ((values > 0.2 * THRESHOLD) & (values < 3 * THRESHOLD)).float().mean(1)
    yield [("L2", make, Plan())]
    yield [("L1 of coefficients", make, Plan(power=1))]
    for name, weights in {
        "voxels of least value m by 1 + 4 exp(−(m/0.02)²)": 1 + 4 * torch.exp(-((values.amin(1) / 0.02) ** 2)),
        "voxels with a share s of values in 0.002 to 0.03 by 1 + 4 s/mean(s)": 1 + 4 * near / near.mean(),
    }.items():
        yield [(f"L2, {name}", make, Plan(weights=weights / weights.mean()))]
    yield [("L2, last layer by Adam", make, Plan(solve_every=0))]
    yield [("L1 of coefficients, last layer by Adam", make, Plan(power=1, solve_every=0))]


def reptile(teachers: list[Teacher], rounds: int = 20, inner: int = 100) -> Network:
    """Nichol, Achiam and Schulman 2018, arXiv 1803.02999: hidden layers go a share of the way to what each part in turn
    teaches them in `inner` steps. The share falls from 1 to 0; every part keeps a last layer of its own."""
    centre = Network(teachers[0].axes)
    lasts = [copy.deepcopy(centre.last) for _ in teachers]
    for turn in range(rounds):
        which = turn % len(teachers)
        student = copy.deepcopy(centre)
        student.last = lasts[which]
        teach(student, teachers[which], Plan(inner, solve_first=turn > 0, seed=turn))
        with torch.no_grad():
            for old, new in zip(centre.hidden.parameters(), student.hidden.parameters()):
                old.lerp_(new, 1 - turn / rounds)
    return centre


def starts(teachers: list[Teacher], rates: list[float]) -> Iterator[Rows]:
    """Hidden layers from other parts, their best last layer before the first step; the rates are of these starts."""
    *others, new = teachers
    yield [("random weights", partial(Network, new.axes), Plan())]
    plain = Network(new.axes)
    seconds = teach(plain, others[0], Plan())
    begun = time.process_time()
    made = {f"{others[0].name}'s network": plain, "Reptile": reptile(others)}
    took = f"{seconds:.0f} s for {others[0].name}'s network, {time.process_time() - begun:.0f} s for Reptile"
    print(f"CPU time: {took}", file=sys.stderr)
    for name, start in made.items():
        for rate in rates:
            make = partial(copy.deepcopy, start)
            yield [(f"{name}, rate {rate:g}", make, Plan(rate=rate, solve_first=True))]


def measure(name: str, teacher: Teacher, make: Callable[[], Network], plan: Plan) -> float:
    """Teaches what `make` makes and prints the row; the MSE."""
    torch.manual_seed(plan.seed)
    network = make()
    seconds = teach(network, teacher, plan)
    mse, largest, otherwise = judge(network, teacher)
    errors = f"{mse:.3g} | {largest:.3f} | {100 * otherwise:.2f} %"
    print(f"| {name} | {plan.steps:,} | {errors} | {network.count():,} | {seconds:.1f} |", flush=True)
    # A teaching that diverged is never the best.
    return mse if math.isfinite(mse) else math.inf


# How, numbers of steps, rates.
TRIES = {
    "optimisers": (optimisers, [300, 1000], [3.75e-4, 7.5e-4, 1.5e-3, 3e-3]),
    "encodings": (encodings, [300, 1000], [3e-2, 1e-1, 3e-1]),
    "losses": (losses, [300, 1000], []),
    "starts": (starts, [100, 300, 1000], [6e-4, RATE]),
}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("what", choices=TRIES)
    parser.add_argument("fields", nargs="+", type=pathlib.Path, metavar="FIELD.npz")
    parser.add_argument("--steps", type=int, nargs="+", help="numbers of steps; the first chooses the rate for all")
    parser.add_argument("--rates", type=float, nargs="+", help="rates of what is tried")
    parser.add_argument("--only", nargs="+", default=[""], help="rows that begin so, such as Muon SOAP")
    parser.add_argument("--optimiser", choices=MATRICES, help="of the matrices in every row, in place of Muon")
    parser.add_argument("--seed", type=int, default=0, help="of the weights and of the order of voxels")
    parser.add_argument("--threads", type=int, default=2)
    arguments = parser.parse_args()
    run, steps, rates = TRIES[arguments.what]
    if len(arguments.fields) < 3 if arguments.what == "starts" else len(arguments.fields) > 1:
        parser.error("starts takes three fields or more, the new one last; all others take one")
    torch.set_num_threads(arguments.threads)
    torch.manual_seed(arguments.seed)
    every = {"seed": arguments.seed} | ({"optimiser": arguments.optimiser} if arguments.optimiser else {})
    teachers = [Teacher(path) for path in arguments.fields]
    print("| what | steps | MSE | largest | otherwise | parameters | CPU, s |\n" + "| --- " * 7 + "|", flush=True)
    for rows in run(teachers, arguments.rates or rates):
        rows = [row for row in rows if row[0].startswith(tuple(arguments.only))]
        for count in arguments.steps or steps:
            planned = [(name, make, dataclasses.replace(plan, steps=count, **every)) for name, make, plan in rows]
            errors = [measure(name, teachers[-1], make, plan) for name, make, plan in planned]
            rows = [rows[errors.index(min(errors))]] if rows else []


if __name__ == "__main__":
    main()
