"""The tool assembly: cutter, shank and holder."""

from __future__ import annotations

import json
import os
import warnings
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from . import _imf
from ._numbers import number, unmasked, whole


def _toml(name: str, value: Any) -> str:
    """A value as a tool file has it."""
    if isinstance(value, str):
        return json.dumps(value, ensure_ascii=False)
    if isinstance(value, (bool, np.bool_)):
        return "true" if value else "false"
    if isinstance(value, Mapping):
        return "{ " + ", ".join(f"{key} = {_toml(key, own)}" for key, own in value.items()) + " }"
    if isinstance(value, (Sequence, np.ndarray)):
        return "[" + ", ".join(_toml(name, own) for own in value) + "]"
    return repr(number(name, value))


def _points(given: Any) -> NDArray[np.float64]:
    """Sharp points as rows."""
    try:
        points = np.atleast_2d(np.asarray(unmasked(given), dtype=np.float64))
    except (TypeError, ValueError):
        points = np.empty(0)
    if points.ndim != 2 or points.shape[1] != 3:
        raise ValueError(
            "sharp_points must be 'tip', 'boundary', a whole number of points, or points (n, 3) in the tool's frame, not "
            f"{given!r}"
        )
    return points


class Tool:
    """A tool of revolution, stacked from its tip upwards, or a mesh. Tool frame: the tip at the origin, +z from tip to holder.

    cutter: ``shape`` ("flat", "ball", "bull", "tapered", "lollipop" or "drill"), ``diameter`` (at the tip of a tapered one) and
    ``length`` (not of a lollipop, a ball down to its shank);
    ``corner_radius`` of "bull" and "tapered", ``half_angle`` in degrees of "tapered", ``point_angle`` of "drill"; ``back_cutting``
    where its upper end cuts too, ``plunge_only`` where it cuts along its axis alone, as a drill does.
    shank: ``diameter`` and, where it is known, ``length``, with ``stick_out`` all of it, what is in the holder included.
    holder: parts from the tip upwards, each ``diameter`` and ``length``, and ``top_diameter`` of a cone.
    stick_out: from the tip to the holder's face; by default cutter and shank end to end.
    sharp_points: "tip", "boundary", a number of points on the cutter, or points ``(n, 3)`` or ``(3,)`` in the tool's frame.

    The keys are those of tool files, and so are the errors (``ValueError``).
    """

    __slots__ = ("_native",)

    def __init__(
        self,
        cutter: Mapping[str, Any],
        shank: Mapping[str, Any] | None = None,
        holder: Sequence[Mapping[str, Any]] = (),
        *,
        stick_out: float | None = None,
        sharp_points: str | int | ArrayLike = "tip",
        name: str = "tool",
        unit: str = "mm",
    ) -> None:
        lines = [f"name = {_toml('name', name)}", f"unit = {_toml('unit', unit)}"]
        if stick_out is not None:
            lines.append(f"stick_out = {_toml('stick_out', stick_out)}")
        if isinstance(sharp_points, (int, np.integer)):
            lines.append(f"sharp_points = {whole('sharp_points', sharp_points, 1)}")
        elif isinstance(sharp_points, str):
            lines.append(f"sharp_points = {_toml('sharp_points', sharp_points)}")
        else:
            lines.append(f"sharp_points = {_toml('sharp_points', _points(sharp_points))}")
        if isinstance(holder, Mapping):
            raise ValueError("a holder is a list of parts from the tip upwards: give [{...}]")
        tables = [("[cutter]", cutter), ("[shank]", shank), *(("[[holder]]", part) for part in holder)]
        for heading, table in tables:
            if table is None:
                continue
            if not isinstance(table, Mapping):
                raise ValueError(
                    f"{heading} is described by names and numbers, such as {{'diameter': 10, 'length': 35}}, not by {table!r}; "
                    "Tool.read(path) reads a file, Tool.paper() is the paper's tool"
                )
            lines += [heading, *(f"{key} = {_toml(f'{key} of {heading}', value)}" for key, value in table.items())]
        self._native = _imf.Tool.parse("\n".join(lines), name)

    @classmethod
    def _of(cls, native: _imf.Tool) -> Tool:
        tool = cls.__new__(cls)
        tool._native = native
        return tool

    @classmethod
    def read(cls, path: str | os.PathLike[str]) -> Tool:
        """Reads a tool file (TOML), FreeCAD's ``.fctb``, or a tool of Fusion's ``.json`` or ``.tools``: ``LIBRARY#TOOL``.

        Raises ``FileNotFoundError``, ``OSError``, or ``ValueError`` with file, line, cause and remedy.
        """
        return cls._of(_imf.Tool.read(os.fspath(path)))

    @classmethod
    def library(cls, path: str | os.PathLike[str]) -> list[Tool]:
        """Every tool of a library that can be used; of the others a ``UserWarning`` says why not."""
        tools, faults = _imf.Tool.read_all(os.fspath(path))
        for fault in faults:
            warnings.warn(fault, UserWarning, stacklevel=2)
        return [cls._of(tool) for tool in tools]

    @classmethod
    def paper(cls) -> Tool:
        """The paper's, in mm: a ball-end cutter of radius 5 and length 35 in a holder of radius 14.5 up to 83."""
        return cls._of(_imf.Tool.paper())

    @property
    def name(self) -> str:
        """Its display name."""
        return self._native.name

    @property
    def unit(self) -> str:
        """Unit of its lengths: mm, cm, m or inch."""
        return self._native.unit

    @property
    def length(self) -> float:
        """From the tip to its upper end, in ``unit``."""
        return self._native.length

    @property
    def reach(self) -> float:
        """From the tip to its farthest point, in ``unit``."""
        return self._native.reach

    @property
    def volume(self) -> float:
        """In ``unit`` cubed; of a mesh that of its closed bodies, added up where they overlap."""
        return self._native.volume

    @property
    def stick_out(self) -> float | None:
        """From the tip to the holder's face, in ``unit``; None without a holder."""
        return self._native.stick_out

    def radius(self, heights: ArrayLike) -> NDArray[np.float64]:
        """Radius of the outline at heights above the tip, of the same shape, 0 above and below the tool.

        Raises ``ValueError`` for a mesh.
        """
        given = np.asarray(unmasked(heights), dtype=np.float64)
        radii = self._native.radius(given.ravel().tolist())
        if radii is None:
            raise ValueError(f"the tool '{self.name}' is a mesh, which has no outline")
        return np.array(radii).reshape(given.shape)

    def __repr__(self) -> str:
        return f"<imf.Tool {self.name!r}, {self.length:g} {self.unit} long>"


def native(tool: Tool) -> _imf.Tool:
    """What the native module reads."""
    if not isinstance(tool, Tool):
        raise ValueError(f"{tool!r} is not an imf.Tool: describe it, or read it by Tool.read(path)")
    return tool._native
