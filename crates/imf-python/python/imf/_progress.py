"""Progress: a callback, or bars by tqdm."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeAlias

Progress: TypeAlias = bool | Callable[[str, int, int], object] | None
"""None for none, True for bars by ``tqdm``, or a function of a stage's name, the units that are done, and their number."""


def listener(progress: Progress) -> Callable[[str, int, int], object] | None:
    """What the native module calls."""
    if progress is None or progress is False:
        return None
    if progress is not True:
        return progress
    try:
        from tqdm.auto import tqdm
    except ImportError as error:
        raise ImportError("progress=True draws bars by tqdm, which is not installed: pip install tqdm") from error
    bars: dict[str, Any] = {}

    def draw(stage: str, done: int, total: int) -> None:
        if stage not in bars:
            bars[stage] = tqdm(desc=stage, total=total)
        bars[stage].update(done - bars[stage].n)
        if done == total:
            bars.pop(stage).close()

    return draw
