"""`sparsemor stability`: table, files, and bad input told with exit code 2."""

import csv
import json
from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner

from sparsemor.core.cli import app

pytestmark = pytest.mark.usefixtures("one_cache")

SMALL = {"bodies.link1.mesh.elements": 320, "bodies.link2.mesh.elements": 320,
         "time.end": 0.1, "training.end": 0.1}


def invoke(*arguments: str) -> Any:
    settings = [part for k, v in SMALL.items() for part in ("--set", f"{k}={v}")]
    return CliRunner().invoke(app, ["stability", "double_pendulum", *settings, *arguments])


@pytest.mark.slow
def test_the_command_prints_a_table_and_writes_tables_and_a_map(tmp_path: Path) -> None:
    out = tmp_path / "out"
    options = ("--set", "reducer.residual=plain", "--rows", "15/10,30/20", "--atoms", "15/10",
               "--required", "both", "--seeds", "2", "--samplers", "lhs", "--out", str(out))
    done = invoke(*options, "--json")
    assert done.exit_code == 0, done.output
    found = json.loads(done.stdout)
    assert found["limit"] == 5.0 and len(found["variants"]) == 4
    for v in found["variants"]:
        assert v["seeds"] == 2 == len(v["each"])
        assert v["stable"] == sum(f["stable"] for f in v["each"])
        gates = [f["gate"] for f in v["each"]]
        assert v["worst_gate"] == (None if None in gates else max(gates))
    assert [(r["sampler"], r["required"], r["rows"]) for r in found["least_rows"]] == [
        ("lhs", "kept", "15/10"), ("lhs", "drawn", "30/20")]
    with (out / "stability.csv").open(newline="") as text:
        lines = list(csv.DictReader(text))
    assert [int(row["stable"]) for row in lines] == [v["stable"] for v in found["variants"]]
    with (out / "seeds.csv").open(newline="") as text:
        assert len(list(csv.DictReader(text))) == 8
    for name in ("stability_map.png", "stability_map.svg"):
        assert (out / name).stat().st_size > 2000
    assert invoke(*options).exit_code == 2, "an earlier table is not replaced unasked"
    printed = invoke("--rows", "15/10", "--atoms", "15/10", "--seeds", "1", "--at", "0,0.05")
    assert printed.exit_code == 0, printed.output
    assert "least rows stable for all seeds: 15/10" in printed.stdout


@pytest.mark.parametrize("arguments, told", [
    (("--rows", "30"), "--rows: give elastic/thermal, 2 numbers (got 30)"),
    (("--atoms", "15/x"), "--atoms: must be a number for each field, such as 60/40 (got"),
    (("--step", "0"), "--step: must be step sizes in s, above 0"),
    (("--required", "perhaps"), "--required: must be true, false or both (got perhaps)"),
    (("--samplers", "nearest"), "--samplers: no sampler plugin is called 'nearest'"),
    (("--integrators", "{use: bdf1"), "--integrators: "),
    (("--integrators", "leapfrog"), "--integrators integrator: no integrator plugin is called"),
    (("--at", "7"), "--at: 7 s is no time of the run"),
    (("--rows", "9999/20"), "--rows reducer: reducer.budgets.*.elastic.rows: 9999 rows"),
    (("--set", "reducer=full", "--rows", "30/20"), "--rows: reducer full has no budgets"),
    (("--set", "reducer=full"), "full order is what reduced models are judged by"),
    (("--set", "check_stability=perhaps"), "check_stability"),
])
def test_bad_input_is_told_with_exit_code_2(arguments: tuple[str, ...], told: str) -> None:
    done = invoke(*arguments)
    assert done.exit_code == 2, done.output
    assert told in " ".join(done.stderr.split())
