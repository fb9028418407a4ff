"""The paper's network trained by PyTorch, measured by turns with imf's own engine.

Started by `imf-bench train`, which writes one request a line to standard input and reads one answer a line:
{"mode": "eager" | "compiled", "batch": 1024, "seconds": 0.5} gives {"samples_per_second": ..}. The first line answers
with the version and the device. Same network as siren5 (five hidden layers of sines, the five inputs again after the second, one
stretched sigmoid), same loss (L1), same optimiser (Adam with coupled weight decay), f32 or, with --precision bf16 or f16, products under
autocast; on the CPU with the threads given by --threads, or on CUDA.
"""

import argparse
import json
import sys
import time

import torch


class Siren5(torch.nn.Module):
    def __init__(self, width: int, omega: float = 30.0):
        super().__init__()
        # The first layer, then one that follows the inputs' return after hidden layer 2.
        self.hidden = torch.nn.ModuleList(torch.nn.Linear(n, width) for n in [5, width, width + 5, width, width])
        self.out = torch.nn.Linear(width, 1)
        self.omega = omega
        for index, layer in enumerate(self.hidden):
            bound = 1 / 5 if index == 0 else (6 / layer.in_features) ** 0.5 / omega
            torch.nn.init.uniform_(layer.weight, -bound, bound)

    def forward(self, x):
        h = x
        for index, layer in enumerate(self.hidden):
            if index == 2:
                h = torch.cat([h, x], dim=1)
            h = torch.sin(self.omega * layer(h))
        return (1.01 * torch.sigmoid(self.out(h)) - 0.01)[:, 0]


class Trainer:
    def __init__(self, width: int, compiled: bool, precision: str, device: str):
        torch.manual_seed(0)
        self.device = device
        self.model = Siren5(width).to(device)
        self.rounded = {"bf16": torch.bfloat16, "f16": torch.float16}.get(precision)
        # Gradients of a mean over a batch are below the smallest f16.
        self.scaler = torch.amp.GradScaler(device, enabled=precision == "f16")
        self.forward = torch.compile(self.model) if compiled else self.model
        self.adam = torch.optim.Adam(self.model.parameters(), lr=1e-5, weight_decay=1e-6, foreach=True)

    def step(self, x, y):
        self.adam.zero_grad(set_to_none=True)
        with torch.autocast(self.device, self.rounded, enabled=self.rounded is not None):
            values = self.forward(x)
        self.scaler.scale(torch.nn.functional.l1_loss(values.float(), y)).backward()
        self.scaler.step(self.adam)
        self.scaler.update()

    def finish(self):
        if self.device == "cuda":
            torch.cuda.synchronize()


def rate(trainer, x, y, seconds: float) -> float:
    trainer.finish()
    steps, start = 0, time.perf_counter()
    while steps < 3 or time.perf_counter() - start < seconds:
        trainer.step(x, y)
        steps += 1
        # A queue of some steps keeps a GPU busy; one without end would not be timed.
        if steps % 16 == 0:
            trainer.finish()
    trainer.finish()
    return steps * len(y) / (time.perf_counter() - start)


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--threads", type=int, required=True)
    parser.add_argument("--width", type=int, default=512)
    parser.add_argument("--precision", choices=["f32", "bf16", "f16"], default="f32")
    parser.add_argument("--device", choices=["cpu", "cuda"], default="cpu")
    arguments = parser.parse_args()
    torch.set_num_threads(arguments.threads)
    name = torch.cuda.get_device_name() if arguments.device == "cuda" else f"{arguments.threads} threads"
    print(json.dumps({"version": torch.__version__, "device": name}), flush=True)
    trainers, batches = {}, {}
    for line in sys.stdin:
        request = json.loads(line)
        mode, batch = request["mode"], request["batch"]
        try:
            if mode not in trainers:
                trainers[mode] = Trainer(arguments.width, mode == "compiled", arguments.precision, arguments.device)
            if batch not in batches:
                generator = torch.Generator().manual_seed(1)
                batches[batch] = (
                    (torch.rand(batch, 5, generator=generator) * 2 - 1).to(arguments.device),
                    torch.rand(batch, generator=generator).to(arguments.device),
                )
            x, y = batches[batch]
            # The first steps compile and allocate.
            trainers[mode].step(x, y)
            answer = {"samples_per_second": rate(trainers[mode], x, y, request["seconds"])}
        except Exception as error:  # torch.compile needs a C++ compiler
            answer = {"failed": f"{type(error).__name__}: {str(error).strip().splitlines()[0]}"}
        print(json.dumps(answer), flush=True)


if __name__ == "__main__":
    main()
