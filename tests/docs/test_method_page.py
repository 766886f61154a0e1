"""What docs/gallery_src/plot_method.py says of its figures is what it computes."""

import runpy
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
import pytest
from matplotlib import pyplot

pytestmark = pytest.mark.full
SCRIPT = Path(__file__).parents[2] / "docs" / "gallery_src" / "plot_method.py"


@pytest.fixture(scope="module")
def page() -> dict[str, Any]:
    matplotlib.use("Agg")
    made = runpy.run_path(str(SCRIPT))
    pyplot.close("all")
    return made


def test_rows_must_carry_the_load_unless_they_are_rows_of_the_error(page: dict[str, Any]) -> None:
    """(5 numbers of rows, 3): least, median and largest error of 20 draws."""
    without, kept, of_error = (np.array(v) for v in page["ways"].values())
    np.testing.assert_array_equal(without, 1.0)  # c = 0 solves every sampled equation
    assert page["representable"] == pytest.approx(7e-5, rel=0.1)
    assert (of_error[:, 1] < kept[:, 1]).all()
    np.testing.assert_allclose(of_error[-2:, 1] / kept[-2:, 1], 0.5, atol=0.1)
    assert of_error[-1, 1] < 2 * page["representable"]
    assert kept[0, 2] > 1 and max(kept[3, 2], of_error[3, 2]) == pytest.approx(2e-3, rel=0.2)


def test_a_tight_frame_helps_with_overlap_and_not_with_missed_atoms(page: dict[str, Any]) -> None:
    plain, of_error, framed = (np.array(v) for v in page["shares"].values())
    assert (np.diff(page["overlap"]) > 0).all() and (np.diff(plain) < 0).all()
    assert (of_error < plain).all()
    assert framed[-1] > 2 * plain[-1] and framed[0] < plain[0]
