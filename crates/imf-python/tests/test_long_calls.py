"""Calls that take long: ended by Ctrl-C, told by a callback, without the interpreter's lock."""

from __future__ import annotations

import os
import signal
import threading
import time
from collections.abc import Callable, Iterator
from functools import partial

import numpy as np
import pytest

import imf


@pytest.fixture(scope="module")
def long_scene() -> imf.Scene:
    """Sections of some milliseconds each."""
    return imf.Scene("bracket", pitch=1.5)


@pytest.fixture
def interrupts() -> Iterator[Callable[[], None]]:
    """Python's own handler, whatever started the tests."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield lambda: os.kill(os.getpid(), signal.SIGINT)
    signal.signal(signal.SIGINT, before)


def deep_poses(count: int) -> np.ndarray:
    """Deep in the bracket, whose ways out are long."""
    return imf.poses(np.tile([25.0, 75.0, 10.0], (count, 1)), [0, 0, 1])


def many_poses(count: int) -> np.ndarray:
    random = np.random.default_rng(2)
    return imf.poses(random.uniform([0, 0, 0], [50, 147, 87], (count, 3)), random.normal(size=(count, 3)))


#: Calls that would take minutes; what they are given is made before.
CALLS: dict[str, Callable[[imf.Scene], Callable[[], object]]] = {
    "imf": lambda scene: partial(scene.imf, "fibonacci:200000"),
    "access": lambda scene: partial(scene.access, "fibonacci:20000", samples=100_000),
    "classify": lambda scene: partial(imf.Checker(scene).overlap, np.tile(many_poses(1_000_000), (20, 1))),
    "clearance": lambda scene: partial(imf.Checker(scene).clearance, deep_poses(10_000_000)),
    "distance": lambda scene: partial(imf.Checker(scene).distance, deep_poses(1_000_000)),
    "train": lambda scene: partial(imf.train, scene, "factored", steps=1_000_000, calibrate=False),
    "siren5": lambda scene: partial(
        imf.train, scene, "siren5", steps=10_000_000, directions="fibonacci:20", calibrate=False
    ),
}


@pytest.mark.parametrize("name", CALLS)
def test_ctrl_c_ends_a_call_within_a_second(
    long_scene: imf.Scene, interrupts: Callable[[], None], name: str
) -> None:
    call = CALLS[name](long_scene)
    sent: list[float] = []

    def send() -> None:
        sent.append(time.process_time())
        interrupts()

    timer = threading.Timer(0.5, send)
    timer.start()
    with pytest.raises(KeyboardInterrupt):
        call()
    timer.join()
    # A second, and as much again, of every core: work of others on the machine does not count.
    assert time.process_time() - sent[0] < 2.0 * (os.cpu_count() or 1)


def test_progress_is_told_and_its_errors_end_the_call(bracket: imf.Scene, long_scene: imf.Scene) -> None:
    told: list[tuple[str, int, int]] = []
    bracket.imf("fibonacci:30", progress=lambda *row: told.append(row))
    assert told[-1] == ("sections", 30, 30)
    assert [row[1] for row in told] == sorted(row[1] for row in told)

    def fails(stage: str, done: int, total: int) -> None:
        raise RuntimeError(f"enough of {stage}")

    with pytest.raises(RuntimeError, match="enough of sections"):
        long_scene.imf("fibonacci:100000", progress=fails)


def test_bars_are_drawn_by_tqdm(bracket: imf.Scene, capfd: pytest.CaptureFixture[str]) -> None:
    bracket.imf("fibonacci:30", progress=True)
    assert "sections" in capfd.readouterr().err


def test_other_threads_go_on(long_scene: imf.Scene) -> None:
    counted, stop = [0], threading.Event()

    def count() -> None:
        while not stop.is_set():
            counted[0] += 1
            time.sleep(0.001)

    thread = threading.Thread(target=count)
    thread.start()
    begun = time.monotonic()
    long_scene.imf("fibonacci:600")
    seconds = time.monotonic() - begun
    stop.set()
    thread.join()
    # With the lock held it would count once or twice.
    assert counted[0] > 20 * seconds, (seconds, counted)


def test_many_threads_share_a_checker(bracket: imf.Scene) -> None:
    checker, rows = imf.Checker(bracket), many_poses(2_000)
    expected, found = checker.classify(rows), {}

    def work(index: int) -> None:
        found[index] = checker.classify(rows)

    threads = [threading.Thread(target=work, args=(index,)) for index in range(8)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert len(found) == 8 and all(np.array_equal(answer, expected) for answer in found.values())
