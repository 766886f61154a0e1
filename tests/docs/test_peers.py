"""The page that compares codes: its numbers are the stored ones, and its script runs."""

import json
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
SCRIPT = ROOT / "tests" / "benchmarks" / "peers" / "side_by_side.py"
PAGE = ROOT / "docs" / "validation" / "peers.md"


def test_the_page_has_the_stored_numbers() -> None:
    """Each cell of the tables of the page, rounded as it is printed."""
    text = PAGE.read_text(encoding="utf-8")
    stored = json.loads((ROOT / "docs" / "measured" / "peers.json").read_text(encoding="utf-8"))
    rows = [[c.strip() for c in line.strip("|").split("|")] for line in text.split(
        "<!-- table of peers -->")[1].split("<!-- end -->")[0].splitlines()
        if line.startswith("| ") and not line.startswith("| code")]
    want = [row for table in stored["tables"] for row in table["rows"]]
    assert len(rows) == len(want) > 0
    for cells, row in zip(rows, want, strict=True):
        for cell, (column, value) in zip(cells, row.items(), strict=True):
            if isinstance(value, float):
                digits = {"rel": 0.0, "abs": 0.051} if column == "whole_s" else {"rel": 0.06}
                assert float(cell) == pytest.approx(value, **digits)
            else:
                assert cell == ("" if value is None else str(value))


def test_the_page_is_short() -> None:
    words = PAGE.read_text(encoding="utf-8").replace("|", " ").split()
    assert len(words) <= 900


@pytest.mark.full
def test_the_script_runs(tmp_path: Path) -> None:
    out = tmp_path / "out.json"
    done = subprocess.run([sys.executable, SCRIPT, "--quick", "--out", out], capture_output=True,
                          text=True)
    assert done.returncode == 0, done.stderr
    found = json.loads(out.read_text(encoding="utf-8"))
    assert [table["title"].split(",")[0] for table in found["tables"]] == [
        "Rod", "Slider-crank with that rod", "Heat with k(T)"]
    for table in found["tables"]:
        ours = [row for row in table["rows"] if row["code"].startswith("sparsemor")]
        assert ours
        for row in ours:
            assert row.get("error", 0.0) < 5e-3
    crank = found["tables"][1]["rows"]
    assert all(row["difference"] < 1e-4 for row in crank)
