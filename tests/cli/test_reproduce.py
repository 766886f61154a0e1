"""The command `reproduce`: two items of the paper computed for real, and what is refused."""

import json
from pathlib import Path

import pytest

from in_process import sparsemor

pytestmark = pytest.mark.full


def test_two_items_of_the_paper(here: Path) -> None:
    """Figures 9 and 10 share their run; forces are 15.625 N and, in the paper, 3.115 N."""
    done = json.loads(sparsemor("reproduce", "--quick", "--items", "fig_9,fig_10", "--out", "out",
                                "--workers", "1", "--json", code=0).out)
    assert done["counts"] == {"reproduced": 2} and done["status"] == "done"
    mesh, forces = done["verdicts"]
    assert mesh["numbers"]["slider"] == {"published": 1336.0, "here": 1336, "unit": ""}
    assert forces["rule"].startswith("abs(normal / paper_normal - 1) <= 0.005")
    assert forces["numbers"]["normal"]["here"] == pytest.approx(15.625, abs=2e-3)
    assert forces["numbers"]["friction"]["here"] == pytest.approx(3.125, abs=1e-3)
    page = (here / "out" / "slider_plate.html").read_text()
    assert all(f"pictures/{name}" in page and (here / "out" / "pictures" / name).is_file()
               for name in ("fig_9_1_geometry.png", "fig_10_1_forces.png"))
    assert "slider_plate.html#fig_10" in (here / "out" / "index.html").read_text()
    assert not (here / "out" / "runs" / "s_full" / "split.json").exists()  # no item needs it


@pytest.mark.parametrize(("arguments", "fault"), [
    (("moon",), "SCENE"), (("--items", "fig_77"), "--items: no figure or table 'fig_77'"),
    (("--workers", "0"), "--workers: at least 1"), (("--paper", "no_such"), "no packaged paper")])
def test_wrong_input_is_one_line(arguments: tuple[str, ...], fault: str, here: Path) -> None:
    done = sparsemor("reproduce", *arguments, code=2)
    assert fault in done.err and len(done.lines) == 1
    assert not (here / "runs").exists()
