"""The package itself: types, stubs, docstrings, examples."""

from __future__ import annotations

import doctest
import inspect
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

import imf

HERE = Path(__file__).resolve().parent.parent


def python(*arguments: str, cwd: Path) -> None:
    """Runs Python in a folder, where caches stay too."""
    environment = os.environ | {"MYPY_CACHE_DIR": str(cwd / "types"), "MPLBACKEND": "agg"}
    done = subprocess.run([sys.executable, *arguments], cwd=cwd, capture_output=True, text=True, env=environment)
    assert done.returncode == 0, done.stdout + done.stderr


def test_types_are_strict(tmp_path: Path) -> None:
    sources = str(HERE / "python" / "imf")
    python("-m", "mypy", "--config-file", str(HERE / "pyproject.toml"), sources, cwd=tmp_path)


def test_the_stubs_are_those_of_the_native_module(tmp_path: Path) -> None:
    python("-m", "mypy.stubtest", "imf._imf", "--mypy-config-file", str(HERE / "pyproject.toml"), cwd=tmp_path)


def test_the_package_says_that_it_is_typed_and_its_version() -> None:
    assert (Path(imf.__file__).parent / "py.typed").is_file()
    manifest = (HERE.parent.parent / "Cargo.toml").read_text()
    assert f'\nversion = "{imf.__version__}"\n' in manifest


def test_everything_public_is_documented() -> None:
    missing = []
    for name in imf.__all__:
        item = getattr(imf, name)
        if not (inspect.isclass(item) or callable(item)):
            continue
        members = vars(item).items() if inspect.isclass(item) and item.__module__.startswith("imf") else ()
        own = [(f"{name}.{member}", value) for member, value in members if not member.startswith("_")]
        own = [(path, value) for path, value in own if callable(value) or isinstance(value, (property, classmethod))]
        missing += [path for path, value in [(name, item), *own] if not inspect.getdoc(value)]
    assert not missing, missing


def test_the_docstring_of_the_package_is_true() -> None:
    assert doctest.testmod(imf).failed == 0


def blocks(page: str) -> list[tuple[str, str]]:
    """Language and text of every code block of a page that has no comment before it."""
    found = re.findall(r"(?:^|\n)(<!--[^\n]*-->\n)?```(\w+)\n(.*?)```", page, re.DOTALL)
    return [(language, text) for comment, language, text in found if not comment]


def test_the_guides_chapter_prints_what_it_shows(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    names: dict[str, object] = {}
    page = (HERE.parent.parent / "docs" / "guide" / "python.md").read_text()
    ran = 0
    for language, text in blocks(page):
        if language == "python":
            exec(compile(text, "python.md", "exec"), names)
            ran += 1
        elif language == "text":
            shown = "".join(".*" if part == "…" else re.escape(part) for part in re.split("(…)", text))
            printed = capsys.readouterr().out
            assert re.fullmatch(shown, printed), f"shown:\n{text}printed:\n{printed}"
    assert ran == 11


def test_the_readme_runs(capsys: pytest.CaptureFixture[str]) -> None:
    for language, text in blocks((HERE / "README.md").read_text()):
        assert language == "python"
        exec(compile(text, "README.md", "exec"), {})
    share, free = capsys.readouterr().out.split()
    assert 0.9 < float(share) < 1 and free == "True"


EXAMPLES = sorted((HERE / "examples").glob("*.py"))


@pytest.mark.parametrize("script", EXAMPLES, ids=lambda path: path.stem)
def test_examples_run(script: Path, tmp_path: Path) -> None:
    python(str(script), cwd=tmp_path)
