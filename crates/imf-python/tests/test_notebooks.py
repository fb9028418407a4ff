"""The notebooks are the examples, cell by cell: ``IMF_WRITE_NOTEBOOKS=1 pytest tests/test_notebooks.py`` writes them anew."""

from __future__ import annotations

import ast
import json
import os
from pathlib import Path
from typing import Any

import pytest

FOLDER = Path(__file__).parent.parent / "examples"
SCRIPTS = sorted(path for path in FOLDER.glob("*.py") if "# %%" in path.read_text())


def notebook(script: Path) -> dict[str, Any]:
    """The docstring as text, then a heading and a cell of code for each ``# %%``."""
    text = script.read_text()
    cells: list[dict[str, Any]] = []

    def add(kind: str, source: str) -> None:
        cell: dict[str, Any] = {"cell_type": kind, "id": f"cell-{len(cells)}", "metadata": {}}
        cell["source"] = source.strip("\n").splitlines(keepends=True)
        if kind == "code":
            cell |= {"execution_count": None, "outputs": []}
        cells.append(cell)

    head, *rest = text.split("# %%")
    title = script.stem.replace("_", " ").capitalize()
    add("markdown", f"# {title}\n\n{ast.get_docstring(ast.parse(head))}")
    for part in rest:
        heading, _, code = part.partition("\n")
        add("markdown", f"## {heading.strip()}")
        add("code", code)
    kernel = {"display_name": "Python 3", "language": "python", "name": "python3"}
    return {"cells": cells, "metadata": {"kernelspec": kernel}, "nbformat": 4, "nbformat_minor": 5}


def test_there_are_four_scripts() -> None:
    assert [path.stem for path in SCRIPTS] == ["access_picture", "check_gcode", "optimise_axis", "train_siren5"]


@pytest.mark.parametrize("script", SCRIPTS, ids=lambda path: path.stem)
def test_a_notebook_is_its_script(script: Path) -> None:
    expected, path = notebook(script), script.with_suffix(".ipynb")
    if os.environ.get("IMF_WRITE_NOTEBOOKS") == "1":
        path.write_text(json.dumps(expected, indent=1, ensure_ascii=False) + "\n")
    assert json.loads(path.read_text()) == expected
    # What a notebook runs is the script, line by line.
    lines = [line for cell in expected["cells"] if cell["cell_type"] == "code" for line in "".join(cell["source"]).splitlines()]
    own = [line for line in script.read_text().split("# %%", 1)[1].splitlines() if not line.startswith("# %%")]
    assert [line for line in lines if line.strip()] == [line for line in own[1:] if line.strip()]
