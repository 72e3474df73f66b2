"""What notebooks show of light fields and results."""

from __future__ import annotations

import base64
import re
from dataclasses import replace
from io import BytesIO
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

import lfdepth
from fields import light_field
from lfdepth.errors import LightFieldError
from lfdepth.lightfield import LightField
from lfdepth.pictures import disparity_colours


@pytest.fixture(scope="module")
def lf() -> LightField:
    made = light_field(np.random.default_rng(6), (3, 3), (40, 48), channels=3)
    return replace(made, name="a < b", disparity_range=(-1.0, 1.0))


@pytest.fixture(scope="module")
def result(lf: LightField) -> lfdepth.Result:
    return lfdepth.estimate(lf, "fbs", step=0.2, threads=1)


def picture_in(text: str) -> np.ndarray:
    found = re.search(r'src="data:image/png;base64,([^"]+)"', text)
    assert found
    return np.asarray(Image.open(BytesIO(base64.b64decode(found[1]))))


def test_a_light_field_shows_its_reference_view(lf: LightField) -> None:
    np.testing.assert_array_equal(np.asarray(Image.open(BytesIO(lf._repr_png_()))), lf.reference)
    text = lf._repr_html_()
    np.testing.assert_array_equal(picture_in(text), lf.reference)
    assert "a &lt; b" in text
    assert "3×3" in text
    assert "48×40 px" in text
    assert "-1 to 1 px per view step" in text


def test_a_result_shows_its_map_range_and_checks(result: lfdepth.Result) -> None:
    colours = disparity_colours(result.disparity)
    np.testing.assert_array_equal(np.asarray(Image.open(BytesIO(result._repr_png_()))), colours)
    text = result._repr_html_()
    np.testing.assert_array_equal(picture_in(text), colours)
    assert "fbs" in text
    assert "-1 to 1 px per view step" in text
    warned = replace(result, checks=result.checks and replace(result.checks, warnings=("mind the gap",)))
    assert "mind the gap" in warned._repr_html_()
    assert "not made" in replace(result, checks=None)._repr_html_()


def test_xarray_has_the_maps_and_their_units(result: lfdepth.Result) -> None:
    pytest.importorskip("xarray", reason="xarray is not installed")
    data = replace(result, sigma=result.confidence).to_xarray()
    assert data.disparity.dims == ("y", "x")
    np.testing.assert_array_equal(data.disparity.sel(y=3).values, result.disparity[3])
    np.testing.assert_array_equal(data.sigma, result.confidence)
    assert data.disparity.units == "px per view step"
    assert data.attrs["method"] == "fbs"
    assert "sigma" not in result.to_xarray()


def test_the_viewer_is_one_page_in_a_frame(lf: LightField, result: lfdepth.Result, tmp_path: Path) -> None:
    page = lfdepth.view(lf, result, result.disparity, names=("mine",))
    text = page._repr_html_()
    assert text.startswith("<iframe srcdoc=")
    assert text.count("<") == 2  # the frame's own; all of the page is escaped
    page.save(tmp_path / "page.html")
    assert (tmp_path / "page.html").read_text(encoding="utf-8") == page.text
    assert '"name":"mine"' in page.text
    assert '"name":"map 2"' in page.text
    with pytest.raises(LightFieldError, match="quality: found 0"):
        lfdepth.view(lf, quality=0)
    with pytest.raises(LightFieldError, match="expected 48x40"):
        lfdepth.view(lf, result.disparity[:-1])


def test_a_notebook_runs_and_shows_them() -> None:
    """An executed notebook has the pictures and the viewer among its outputs."""
    pytest.importorskip("ipykernel", reason="ipykernel is not installed")
    nbformat = pytest.importorskip("nbformat", reason="nbformat is not installed")
    nbclient = pytest.importorskip("nbclient", reason="nbclient is not installed")
    cells = [
        "import numpy as np, lfdepth\n"
        "views = np.random.default_rng(0).integers(0, 255, (3, 3, 24, 28, 3), np.uint8)\n"
        "lf = lfdepth.LightField(views, disparity_range=(-1, 1), name='noise')\n"
        "lf",
        "result = lfdepth.estimate(lf, 'fbs', step=0.5, threads=1)\nresult",
        "lfdepth.view(lf, result)",
    ]
    notebook = nbformat.v4.new_notebook(cells=[nbformat.v4.new_code_cell(each) for each in cells])
    nbclient.NotebookClient(notebook, timeout=120, kernel_name="python3").execute()
    shown = [cell.outputs[-1].data for cell in notebook.cells]
    for data in shown[:2]:
        assert base64.b64decode(data["image/png"]).startswith(b"\x89PNG")
        assert "<table>" in data["text/html"]
    assert "noise" in shown[0]["text/html"]
    assert shown[2]["text/html"].startswith("<iframe srcdoc=")
