"""The native module: what `python/imf` calls."""

from collections.abc import Callable, Sequence
from typing import Any, TypeAlias, final

import numpy as np
from numpy.typing import NDArray

_Floats: TypeAlias = NDArray[np.float64]
_Singles: TypeAlias = NDArray[np.float32]
_Codes: TypeAlias = NDArray[np.uint8]
_Places: TypeAlias = NDArray[np.uint32]
_Progress: TypeAlias = Callable[[str, int, int], object] | None
_Triple: TypeAlias = Sequence[float]
_Mesh: TypeAlias = str | tuple[_Floats, NDArray[np.int64], str]
_Grid: TypeAlias = tuple[list[float], float, list[int]]

__all__ = [
    "DIRECTIONS",
    "Checker",
    "Field",
    "ImfError",
    "Scene",
    "Surface",
    "Tool",
    "__version__",
    "access",
    "check",
    "crib",
    "fewest_sets",
    "minimum",
    "removable_stock",
    "sections",
    "set_threads",
    "train",
]

__version__: str
DIRECTIONS: str

class ImfError(Exception): ...

def set_threads(threads: int) -> None:
    """Computes on so many threads from now on; on all cores with 0.

    Raises ValueError for what is no whole number from 0 to 1,024 (or to eight times the cores, where that is more), and where the
    system does not give so many.
    """

def sections(scene: Scene, directions: str | _Floats, progress: _Progress) -> tuple[_Singles, tuple[_Floats, _Floats]]: ...
def minimum(scene: Scene, directions: str | _Floats, progress: _Progress) -> tuple[
    _Singles, _Places, tuple[_Floats, _Floats]
]: ...
def access(
    scene: Scene, directions: str | _Floats | None, samples: int, tolerance: float | None, progress: _Progress
) -> Surface: ...
def check(
    scene: Scene,
    path: str | _Floats,
    tools: Sequence[tuple[int | None, Tool]],
    machine: str | None,
    clearance: _Triple | None,
    contact: float | None,
    step: float | None,
    in_world: bool | None,
    stick_out: bool,
    stock: float | _Mesh | None,
    progress: _Progress,
) -> tuple[str, list[str], dict[str, Any] | None]: ...
def removable_stock(
    scene: Scene, stock: float | _Mesh, directions: str | _Floats | None, progress: _Progress
) -> dict[str, Any]: ...
def crib(
    scene: Scene,
    tools: Sequence[Tool],
    directions: str | _Floats | None,
    samples: int,
    tolerance: float | None,
    progress: _Progress,
) -> dict[str, Any]: ...
def fewest_sets(holds: NDArray[np.bool_], weights: _Floats, fraction: float) -> tuple[list[int], int]: ...
def train(
    scene: Scene,
    family: str,
    quantity: str | None,
    degree: int | None,
    steps: int | None,
    layers: tuple[int, int] | None,
    omega: float | None,
    symmetry: bool,
    directions: str | _Floats,
    seed: int,
    wants_calibration: bool,
    progress: _Progress,
) -> Field: ...
@final
class Tool:
    @staticmethod
    def read(path: str) -> Tool: ...
    @staticmethod
    def read_all(path: str) -> tuple[list[Tool], list[str]]: ...
    @staticmethod
    def parse(text: str, name: str) -> Tool: ...
    @staticmethod
    def paper() -> Tool: ...
    @property
    def name(self) -> str: ...
    @property
    def unit(self) -> str: ...
    @property
    def length(self) -> float: ...
    @property
    def reach(self) -> float: ...
    @property
    def volume(self) -> float: ...
    @property
    def stick_out(self) -> float | None: ...
    def radius(self, heights: Sequence[float]) -> list[float] | None: ...

@final
class Scene:
    def __new__(
        cls,
        part: _Mesh,
        tool: Tool | None,
        *,
        unit: str | None,
        pitch: float | None,
        dims: Sequence[int] | None,
        margin: int,
        transform: _Floats,
        fixtures: Sequence[tuple[_Mesh, _Floats]],
        clearance: _Triple,
        contact: float | None,
        conservative: bool,
        allow_coarse: bool,
        around_all: bool,
        progress: _Progress,
    ) -> Scene: ...
    @property
    def part(self) -> str: ...
    @property
    def unit(self) -> str: ...
    @property
    def grid(self) -> _Grid: ...
    @property
    def warnings(self) -> list[str]: ...
    @property
    def tool(self) -> Tool: ...
    @property
    def clearance(self) -> list[float]: ...
    @property
    def guarantee(self) -> str: ...
    @property
    def solid(self) -> _Codes: ...
    @property
    def mesh(self) -> tuple[_Floats, _Places]: ...
    @property
    def usual_directions(self) -> str: ...
    def lacks_roll(self, directions: str | _Floats) -> bool: ...
    def orientations(self, directions: str | _Floats) -> tuple[_Floats, _Floats]: ...

@final
class Checker:
    def __new__(cls, scene: Scene, clearance: _Triple | None) -> Checker: ...
    @property
    def is_round(self) -> bool: ...
    def is_free(self, poses: _Floats) -> bool: ...
    def classify(self, poses: _Floats, progress: _Progress) -> _Codes: ...
    def values(self, poses: _Floats, progress: _Progress) -> _Singles: ...
    def clearance(self, poses: _Floats, progress: _Progress) -> _Floats: ...
    def distance(
        self, poses: _Floats, progress: _Progress
    ) -> tuple[_Floats, _Floats, list[str], _Floats, _Floats]: ...
    def check_motion(self, start: _Floats, end: _Floats, progress: _Progress) -> tuple[_Codes, _Floats, _Floats]: ...

@final
class Surface:
    def arrays(self) -> dict[str, NDArray[Any]]: ...
    def obstructed_by(self) -> list[tuple[str, str, float]]: ...
    @property
    def tolerance(self) -> float: ...
    @property
    def hidden_area(self) -> float: ...
    @property
    def reached_at_twice_the_pitch(self) -> float: ...
    def setups(self, limits: str, fraction: float, every_direction: bool, progress: _Progress) -> dict[str, Any]: ...
    def stick_outs(self, progress: _Progress) -> tuple[_Floats, NDArray[np.int64], _Codes, list[float]]: ...

@final
class Field:
    @staticmethod
    def load(path: str) -> Field: ...
    def save(self, path: str) -> None: ...
    @property
    def family(self) -> str: ...
    @property
    def quantity(self) -> str: ...
    @property
    def part(self) -> str: ...
    @property
    def unit(self) -> str: ...
    @property
    def grid(self) -> _Grid: ...
    @property
    def bounds(self) -> list[list[float]] | None: ...
    @property
    def verdict(self) -> str | None: ...
    @property
    def range(self) -> list[float]: ...
    @property
    def tool(self) -> Tool: ...
    @property
    def clearance(self) -> list[float]: ...
    @property
    def fit_error(self) -> float | None: ...
    @property
    def symmetry(self) -> str | None: ...
    def values(self, poses: _Floats, progress: _Progress) -> _Singles: ...
    def gradients(self, poses: _Floats, progress: _Progress) -> tuple[_Singles, _Singles, _Singles, _Singles]: ...
    def classify(self, poses: _Floats, progress: _Progress) -> _Codes: ...
    def best(self, points: _Floats, directions: str | _Floats, progress: _Progress) -> tuple[_Singles, _Places, _Codes]: ...
