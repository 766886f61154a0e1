"""Runs do what the linearised step says of them, and are warned of it or refused."""

from functools import cache
from math import inf
from pathlib import Path
from typing import Any

import pytest

from small_pendulum import small
from sparsemor.core.errors import InputError
from sparsemor.core.results.run_result import RunResult
from sparsemor.core.scene.scene import Scene
from sparsemor.core.simulation.simulate import simulate
from sparsemor.core.status import SolveFailed
from sparsemor.plugins.comparison.compare import compare
from sparsemor.plugins.stability.survey import SeedStability, Survey, VariantStability, survey
from sparsemor.plugins.stability.variants import SurveyPlan

pytestmark = pytest.mark.usefixtures("one_cache")


@cache
def drawn() -> Survey:
    """Six seeds with as many rows as atoms, required ones kept and drawn."""
    return survey(small(), SurveyPlan(required=[True, False], rows=[(15, 10)], seeds=6))


def scene_of(entry: VariantStability, finding: SeedStability) -> Scene:
    rows = tuple(int(n) for n in entry.settings["rows"].split("/"))
    return small(entry.settings["required"] == "kept", (rows[0], rows[1]), seed=finding.seed)


def ran(scene: Scene, out: Path | None = None) -> RunResult | None:
    """The run, also one that stopped; None for one that could not begin."""
    try:
        return simulate(scene, out=out)
    except SolveFailed as failure:
        result: Any = failure.result
        return result


@pytest.mark.slow
def test_each_prediction_on_the_small_scene_is_what_the_run_does() -> None:
    """Stable models repeat full order to 1e-7; the others stop or err by 1e-3 and more. Where no
    row feels a load the model errs without being unstable: the run says so by name."""
    full = simulate(small().using({"reducer": "full"}))
    seen = {True: 0, False: 0}
    for entry in drawn().entries:
        for f in entry.findings:
            # the survey has said already what the check before a run would say again
            run = ran(scene_of(entry, f).using({"check_stability": "off"}))
            errors = [inf] if run is None or not run.status.ok else [
                v for k, v in compare(full, r=run).errors["r"].items() if "." not in k]
            if f.judgement.stable and f.missed:
                continue
            seen[f.judgement.stable] += 1
            told = (entry.settings, f.as_dict(), errors)
            assert max(errors) < 1e-7 if f.judgement.stable else max(errors) > 1e-3, told
    assert seen[True] >= 6 and seen[False] >= 2, "both kinds must have been tried"


def unstable() -> Scene:
    """The seed that the survey says grows fastest, of those that have a map."""
    known = [(e, f) for e in drawn().entries for f in e.findings
             if f.judgement.status.ok and not f.judgement.stable]
    return scene_of(*max(known, key=lambda pair: pair[1].judgement.gate))


@pytest.mark.full
def test_run_warns_by_name_or_refuses_or_looks_away(tmp_path: Path) -> None:
    scene = unstable()
    warned = ran(scene, tmp_path / "warn")
    assert warned is not None
    (note,) = (n for n in warned.summary["notes"] if "unstable in link" in n)
    radius = warned.summary["stability"]["radius"]
    assert radius > 1.05 and f"spectral radius {radius:.6g}" in note
    assert "sparsemor stability" in note
    assert warned.summary["stability"]["stable"] is False
    assert warned.summary["stability"]["gate"] > 5.0
    with pytest.raises(InputError, match="unstable in link") as refused:
        simulate(scene.using({"check_stability": "refuse"}), out=tmp_path / "refused")
    assert [f.key for f in refused.value.faults] == ["check_stability"]
    assert not (tmp_path / "refused").exists()
    quiet = ran(scene.using({"check_stability": "off"}), tmp_path / "off")
    assert quiet is not None and quiet.summary["stability"] == {}
    assert not [n for n in quiet.summary["notes"] if "unstable" in n]


@pytest.mark.full
def test_no_alarm_where_the_run_is_good(tmp_path: Path) -> None:
    summary = simulate(small(check_stability="refuse"), out=tmp_path / "good").summary
    assert summary["status"] == "done" and set(summary["note_kinds"]) <= {"stiff_in_bending"}
    assert summary["stability"]["stable"] is True
    assert 1.0 < summary["stability"]["radius"] < 1.001
