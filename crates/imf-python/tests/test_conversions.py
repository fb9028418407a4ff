"""Results in PyVista and xarray."""

from __future__ import annotations

import sys

import numpy as np
import pytest

import imf


def test_sections_are_images_and_labelled_arrays(bracket: imf.Scene) -> None:
    section = bracket.section([0, 0, 1])
    image = section.to_pyvista()
    assert image.n_cells == section.values.size
    # The cell around a point is the voxel around it.
    x, y, z = (axis[3] for axis in bracket.grid.axes())
    cell = image.find_containing_cell([x, y, z])
    assert image.cell_data["cmf"][cell] == section.values[3, 3, 3]
    array = section.to_xarray()
    assert array.dims == ("x", "y", "z") and array.attrs["unit"] == "mm"
    assert float(array.sel(x=x, y=y, z=z, method="nearest")) == section.values[3, 3, 3]
    both = bracket.sections("axes")
    assert both.to_xarray().dims == ("direction", "x", "y", "z")
    assert both.to_pyvista().cell_data["cmf_5"].sum() == pytest.approx(both.values[5].sum(), rel=1e-5)


def test_the_minimum_is_a_dataset(bracket: imf.Scene) -> None:
    found = bracket.imf("axes")
    dataset = found.to_xarray()
    np.testing.assert_array_equal(dataset["imf"], found.values)
    assert dataset["directions"].shape == (6, 3)
    assert set(found.to_pyvista().cell_data) == {"imf", "best"}


def test_surfaces_are_coloured_meshes(block: imf.Scene) -> None:
    found = block.access("axes", samples=500)
    mesh = found.to_pyvista()
    assert mesh.n_cells == len(found.points) and mesh.area == pytest.approx(found.areas.sum())
    np.testing.assert_allclose(mesh.cell_centers().points, found.points, atol=1e-5)
    assert mesh.cell_data["rgb"].shape == (mesh.n_cells, 3)
    dataset = found.to_xarray()
    assert dataset.sizes == {"sample": mesh.n_cells, "direction": 6, "component": 3}


def test_reports_and_fields_convert(block: imf.Scene, bracket: imf.Scene) -> None:
    report = block.check(imf.poses([[10, 10, 25], [10, 10, 17]], [0, 0, 1]))
    assert report.to_pyvista().n_points == 1 and report.to_xarray().sizes["collision"] == 1
    assert block.check(imf.poses([[10, 10, 25]], [0, 0, 1])).to_xarray().sizes["collision"] == 0
    field = imf.train(bracket, "harmonic", degree=2, calibrate=False)
    assert field.to_xarray([0, 0, 1]).shape == bracket.grid.dims
    assert field.to_pyvista([0, 0, 1]).n_cells == bracket.solid.size


@pytest.mark.parametrize("module", ["pyvista", "xarray"])
def test_what_is_not_installed_is_named(bracket: imf.Scene, module: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, module, None)
    with pytest.raises(ImportError, match=f"to_{module}.. needs {module}, which is not installed: pip install {module}"):
        getattr(bracket.section([0, 0, 1]), f"to_{module}")()


def test_bars_without_tqdm_say_what_is_missing(bracket: imf.Scene, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "tqdm.auto", None)
    with pytest.raises(ImportError, match="pip install tqdm"):
        bracket.imf("axes", progress=True)
