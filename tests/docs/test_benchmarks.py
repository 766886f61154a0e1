"""Each benchmark script runs on tiny sizes, and what it prints and writes holds together."""

import csv
import json
import os
import signal
import subprocess
import sys
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from sparsemor import compare, load, simulate
from sparsemor.core.simulation.cache import Cache

pytestmark = pytest.mark.full

SCRIPTS = Path(__file__).parents[1] / "benchmarks"
Rows = list[dict[str, Any]]
Run = Callable[..., dict[str, Any]]


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Run:
    """run(name, options): the JSON of one script under --quick; its table must be on standard
    output."""
    folder = tmp_path_factory.mktemp("benchmarks")

    @cache
    def script(name: str, *options: str) -> dict[str, Any]:
        out = folder / "results" / f"{name}{''.join(options)}.json"
        done = subprocess.run(
            [sys.executable, SCRIPTS / f"{name}.py", "--quick", *options, "--out", out],
            env=os.environ | {"SPARSEMOR_CACHE": str(folder / "cache")},
            capture_output=True, text=True)
        assert done.returncode == 0, done.stderr
        found: dict[str, Any] = json.loads(out.read_text())
        assert done.stdout.startswith(f"{name}: done")
        assert all(table["title"] in done.stdout for table in found["tables"])
        assert found["settings"]["threads"].startswith("1 ")
        return found

    return script


def rows_of(found: dict[str, Any], title: str) -> Rows:
    (table,) = (t for t in found["tables"] if t["title"] == title)
    rows: Rows = table["rows"]
    return rows


def test_cost_times_every_method_over_several_windows(run: Run) -> None:
    found = run("cost")
    times = {row["method"]: row for row in rows_of(found, "Milliseconds a step")}
    assert set(times) == {"full", "galerkin", "sparse", "sparse, 15/10 of all", "full, newton"}
    for row in times.values():
        assert 0 < row["least"] <= row["ms"] <= row["most"]
        assert row["iterations"] >= 1
    for row in rows_of(found, "Ratios of the medians (and of single windows)"):
        slow, fast = (times[name]["ms"] for name in row["ratio"].split(" : "))
        assert row["value"] == pytest.approx(slow / fast)


def test_compiled_steps_counts_the_calls_of_a_step(run: Run) -> None:
    (row,) = rows_of(run("compiled_steps"), "CPU ms per step")
    assert row["ms"] > 0.0 and row["calls"] > row["products"] > 0


def test_chains_fits_exponents_to_the_costs(run: Run) -> None:
    found = run("chains")
    rows = rows_of(found, "CPU milliseconds per step")
    fits = {r["case"]: r for r in rows_of(found, "Exponents of the cost of a step")}
    assert set(fits) == {"rigid", "full", "galerkin", "loads", "stored steps, whole run"}
    for case in ("rigid", "full", "galerkin", "loads"):
        (few, some), (least, most) = zip(
            *((r["count"], r["ms"]) for r in rows if r["case"] == case), strict=True)
        assert 0 < least and 0 < most
        assert fits[case]["fitted"] == pytest.approx(np.log(most / least) / np.log(some / few))


def test_accuracy_meets_its_targets_on_a_short_run(run: Run) -> None:
    found = run("accuracy")
    assert {t["verdict"] for t in found["targets"]} == {"met"}
    each = rows_of(found, "Every run")
    assert [row["seed"] for row in each if row["method"] == "sparse"] == [1, 2]
    for row in rows_of(found, "Errors over the seeds"):
        own = [e[row["field"]] for e in each if e["method"] == row["method"]]
        assert row["worst"] == max(own) > 0


def test_selection_keeps_to_its_budget_and_changes_supports(run: Run) -> None:
    rows = {row["variant"]: row for row in rows_of(run("selection"), "Selection")}
    for name in (f"{who}, {when}" for who in ("default", "published")
                 for when in ("each step", "each step, from none", "every 10")):
        elastic, thermal = (float(n) for n in rows[name]["active"].split("/"))
        whole = [float(n) for n in rows[name]["atoms"].split("/")]
        assert elastic <= 6 < whole[0] and thermal <= 4 < whole[1]
        assert rows[name]["changes"] >= 4, "two fields of two links start from no atoms"
    assert rows["all atoms, sampled"]["changes"] == 0
    assert rows["all atoms, sampled"]["elastic"] < rows["leading atoms, sampled"]["elastic"]


def test_selection_errors_are_those_of_compare(run: Run, tmp_path: Path) -> None:
    """The benchmarks keep runs in memory; `simulate` and `compare` say the same of them."""
    (row,) = (r for r in rows_of(run("selection"), "Selection")
              if r["variant"] == "leading atoms, galerkin")
    bases = {"basis": {"use": "pod", "count": 6},
             "bases": {"*.thermal": {"use": "pod", "count": 4}}}
    scene = load("double_pendulum", {"time.end": 0.06, "training.end": 0.06,
                                     "reducer": {"use": "galerkin", **bases}})
    kept = Cache(tmp_path / "cache")
    full = simulate(scene.using({"reducer": "full"}), out=tmp_path / "full", cache=kept)
    reduced = simulate(scene, out=tmp_path / "galerkin", cache=kept)
    measured = compare(full, errors_from=0.03, reduced=reduced)
    assert row["angle"] == pytest.approx(measured.errors["reduced"]["angle_rad"], rel=1e-3)
    assert row["thermal"] == pytest.approx(measured.errors["reduced"]["thermal"], rel=1e-3)
    assert row["elastic"] == pytest.approx(measured.late_errors["reduced"]["elastic"], rel=1e-3)


@pytest.mark.slow
def test_published_counts_and_names_every_failure(run: Run) -> None:
    found = run("published")
    counts = rows_of(found, "Failures on a fixed support")
    assert {(r["rows"], r["required"]) for r in counts} == {
        (rows, kept) for rows in ("240/80", "36/24") for kept in ("as published", "kept")}
    for row in counts:
        assert row["failed"] == row["stopped"] + row["never_heated"] + row["inaccurate"]
        named = [r for r in rows_of(found, "Every failure")
                 if (r["rows"], r["required"]) == (row["rows"], row["required"])]
        assert len(named) == row["failed"] <= row["seeds"]
    assert all(row["status"] for row in rows_of(found, "The packaged published scene"))


@pytest.mark.slow
def test_recovery_scores_every_solver_on_columns_and_in_a_scene(run: Run) -> None:
    found = run("recovery")
    columns = [t["rows"] for t in found["tables"] if "coherence" in t["title"]]
    for rows in columns:
        for row in rows:
            assert 0 <= row["found"] <= row["of"] == 2 and row["atoms_found"] <= 1.0
            assert (row["found"] == row["of"]) == (row["atoms_found"] == 1.0)
    gaussian, parallel = ({row["solver"]: row["found"] for row in rows} for rows in columns)
    assert set(gaussian.values()) == {2}, "incoherent columns are easy"
    assert parallel["basis_pursuit_lp"] == 2 > parallel["omp"]
    (scene,) = (t["rows"] for t in found["tables"] if "double_pendulum" in t["title"])
    assert {row["status"] for row in scene} == {"done"}
    assert all(row["active_elastic"] <= 8 and row["active_thermal"] <= 5 for row in scene)


def test_recovered_scenes_are_accurate_at_every_seed(run: Run) -> None:
    found = run("recovery", "--packaged")
    (worst,) = rows_of(found, "Worst seed of each scene")
    assert worst["scene"] == "double_pendulum" and (worst["seeds"], worst["stopped"]) == (2, 0)
    assert worst["largest"] < 1e-8


def test_rows_of_the_preconditioned_residual_have_the_smaller_constants(run: Run) -> None:
    found = run("recovery", "--constants")
    plain, better = (next(
        row for row in rows_of(found, "Constants of sampled rows")
        if (row["field"], row["rows"]) == ("elastic", rows)) for rows in ("r", "D^-1 r"))
    for constant in ("coherence", "condition", "delta_random", "delta_leading"):
        assert better[constant] < plain[constant]
    errors = {(row["rows"], row["solver"]): row["error"] for row in rows_of(
        found, "Recovery of the last snapshot from an empty support")
        if row["field"] == "elastic"}
    for solver in ("greedy", "omp", "lasso_lars", "basis_pursuit_lp"):
        assert errors["D^-1 r", solver] < 1e-3 * errors["r", solver]


def test_safe_rules_exclude_columns_at_large_penalties_alone(run: Run) -> None:
    found = run("recovery", "--screening")
    (table,) = found["tables"]
    for block in ("link1.elastic", "link1.thermal"):
        mine = {row["penalty"]: row for row in table["rows"] if row["block"] == block}
        assert list(mine) == ["0.1", "0.01", "0.001", "0.0001", "1e-05"]
        assert 0.0 <= mine["1e-05"]["excluded"] <= mine["0.1"]["excluded"] <= 100.0
        assert mine["1e-05"]["error"] < mine["0.1"]["error"]


def test_untf_is_judged_by_pairs(run: Run) -> None:
    found = run("untf")
    for measure in ("thermal", "combined"):
        rows = rows_of(found, f"{measure} error")
        assert [r["preconditioner"] for r in rows] == ["untf", "untf, one product", "parseval"]
        for row in rows:
            assert row["better_with"] + row["worse_with"] == 2
            assert row["p"] >= 0.5 and row["verdict"] == "no difference shown"
            assert row["none"] != row["with"]


@pytest.mark.slow
def test_samplers_that_see_the_atoms_need_no_luck(run: Run) -> None:
    found = run("samplers")
    for row in rows_of(found, "Errors over rows"):
        if row["sampler"].partition(",")[0] in ("deim", "s_opt"):
            assert row["failed"] == 0
            # Galerkin with these atoms: 1.1e-6 elastic, 1.5e-6 thermal
            assert row["elastic"] < 1e-4 and row["thermal"] < 1e-5
        if row["required"] == "kept":
            assert row["failed"] == 0 and row["elastic_worst"] < 1e-3
    seen = rows_of(found, "What is sampled")
    assert {"operator, h", "stiffness alone", "mass alone", "atoms"} < {row["of"] for row in seen}


@pytest.mark.slow
def test_hyper_reduction_reaches_full_order(run: Run) -> None:
    found = run("hyper_reduction")
    assert {t["verdict"] for t in found["targets"]} == {"met"}
    rows = {row["method"]: row for row in rows_of(found, "Errors and time of a step")}
    assert {"full", "galerkin", "lspg", "deim", "gnat", "gnat, energy"} <= set(rows)
    assert rows["deim"]["force_modes"] == rows["gnat"]["force_modes"]
    for row in rows.values():
        assert row["full_to_this"] == pytest.approx(rows["full"]["ms"] / row["ms"])
    for row in rows_of(found, "Drawn points"):
        assert row["stopped"] + row["inaccurate"] <= row["seeds"]
        if row["required"] == "kept":
            assert row["stopped"] == row["inaccurate"] == 0
        assert (row["stopped"] > 0) == bool(row["first_stop"])


@pytest.mark.slow
def test_nonlinear_heat_measures_every_reducer(run: Run) -> None:
    found = run("nonlinear_heat")
    for title in ("k(T)", "k(T) and c(T)", "Radiating plate, 200 triangles"):
        rows = {row["reducer"]: row for row in rows_of(found, title)}
        assert {"full", "galerkin", "lspg", "deim", "gnat", "ecsw", "sparse"} <= set(rows)
        assert max(row["error"] for row in rows.values()) < 1e-2
        for row in rows.values():
            assert row["full_to_this"] == pytest.approx(rows["full"]["ms"] / row["ms"])
        assert rows["ecsw"]["elements"] < rows["full"]["elements"]


def test_hot_pendulum_measures_each_field_under_an_unseen_flux(run: Run) -> None:
    found = run("hot_pendulum")
    rows = rows_of(found, "2 x 320 triangles: errors")
    assert {row["reducer"] for row in rows} == {"galerkin", "ecsw"}
    for row in rows:
        assert 0 < max(row[field] for field in ("rigid", "elastic", "thermal")) < 1e-3
    cost = {row["method"]: row for row in rows_of(found, "2 x 320 triangles: cost")}
    assert 0 < cost["ecsw"]["elements"] < cost["galerkin"]["elements"]
    assert 0 < cost["ecsw"]["residual"] <= 1.01e-6
    assert cost["ecsw"]["full_to_this"] == pytest.approx(cost["full"]["ms"] / cost["ecsw"]["ms"])


@pytest.mark.slow
def test_stability_sets_every_prediction_beside_a_run(run: Run) -> None:
    found = run("stability")
    assert {t["verdict"] for t in found["targets"]} == {"met"}
    counts = rows_of(found, "Predicted and observed")
    assert {row["integrator"] for row in counts} == {"bdf1", "ga 1"}
    for row in counts:
        predicted = [row[k] for k in ("stable", "marginal", "unstable", "no_step",
                                           "no_model")]
        observed = [row[k] for k in ("good", "cold", "errs", "stopped")]
        assert sum(predicted) == sum(observed) == row["seeds"] == 2
    confused = rows_of(found, "Confusion")
    assert sum(row[k] for row in confused for k in ("good", "cold", "errs", "stopped")) == 8


@pytest.mark.slow
def test_slider_variants_are_overrides_of_one_scene(run: Run) -> None:
    rows = {row["variant"]: row for row in rows_of(
        run("slider_variants"), "Largest temperature of the slider")}
    assert set(rows) == {"as packaged", "conductance 1e4", "uniform pressure, perfect contact"}
    for row in rows.values():
        assert 0.0 < row["largest_K"] < row["prototype_K"]  # 20 of the 1000 steps
        assert row["mean_normal_N"] == pytest.approx(15.625, rel=2e-3)
    assert rows["conductance 1e4"]["heat_J"] < rows["as packaged"]["heat_J"]


@pytest.mark.slow
def test_slider_measures_every_field_in_and_out_of_training(run: Run) -> None:
    found = run("slider")
    inside = {row["method"]: row for row in rows_of(found, "In training")}
    assert set(inside) == {"full", "galerkin"}
    assert inside["galerkin"]["stopped"] == "0/1"
    outside = rows_of(found, "Outside training: worst error of each field, whole run")
    assert [row["method"] for row in outside] == ["galerkin, POD"] * 4
    fields = ("slider.elastic", "plate.elastic", "slider.thermal", "plate.thermal")
    for field in fields:
        assert 0.0 < inside["galerkin"][f"{field} steady"] < 1e-3
        assert all(row["status"] == "done" and row[field] > 0.0 for row in outside)
    # 40 steps in, nothing was learned at another friction, and all of it on a longer run
    assert max(outside[1][f] for f in fields) > 10 * max(outside[3][f] for f in fields)


@pytest.mark.slow
def test_linear_solvers_are_measured_apart(run: Run) -> None:
    found = run("linear_solvers")
    rows = rows_of(found, "Factorization s / solve ms")
    for field in ("T", "u"):
        mine = {row["solver"]: row for row in rows if row["field"] == field}
        assert {"splu", "cg", "amg", "auto"} <= set(mine)
        assert mine["auto"]["status"].startswith("takes splu")
        for name in ("splu", "cg", "amg"):
            assert mine[name]["status"] == "done" and mine[name]["residual"] <= 1e-10
            assert mine[name]["factors"] <= mine[name]["expected"]
        assert mine["cg"]["warm"] <= mine["cg"]["iterations"]


@pytest.mark.slow
def test_brake_disk_measures_every_field_in_and_out_of_training(run: Run) -> None:
    found = run("brake_disk")
    inside = {row["method"]: row for row in rows_of(found, "In training")}
    assert set(inside) == {"full", "recommended"}
    assert inside["recommended"]["stopped"] == "0/1"
    outside = rows_of(found, "Outside training: worst error of each field, whole run")
    assert [(row["case"], row["status"]) for row in outside] == [
        ("40 km/h", "done"), ("mu 0.4", "done")]
    held = {(row["block"], row["atoms"]): row for row in rows_of(
        found, "Best approximation of the states")}
    few, many = (held["disk.thermal", f"{n} pulses"] for n in (100, 200))
    for case in ("60 km/h, mu 0.7", "40 km/h", "mu 0.4"):
        assert 0.0 <= many[case] <= few[case] < 1e-6  # ten steps: 100 hold them
    for (block, _), row in held.items():  # nothing is nearer than the best approximation
        if block.endswith("elastic"):
            assert row["40 km/h"] <= row["40 km/h, by energy"] * (1 + 1e-9)
    beside = rows_of(
        found, "Beside the steps: ms a step for storing, making full fields, writing them")
    assert [(row["run"], row["steps"]) for row in beside] == [("full", 10), ("recommended", 10)]


@pytest.mark.slow
def test_the_fine_brake_disk_is_measured_against_full_order(run: Run) -> None:
    found = run("brake_disk_fine")
    times = {row["method"]: row for row in rows_of(found, "Milliseconds a step")}
    assert {row["status"] for row in times.values()} == {"done"}
    assert times["recommended"]["solved"] < 0.2 * times["full"]["solved"]
    (errors,) = rows_of(found, "Errors of the recommended reducer")
    worst, ratio = found["targets"]
    assert worst["measured"] == max(errors.values()) < 1e-3 and worst["verdict"] == "met"
    assert ratio["measured"] > 1.0 and len(errors) == 4
    full, reduced = (times[n]["ms"] + times[n]["ahead"] for n in ("full", "recommended"))
    assert ratio["measured"] == pytest.approx(full / reduced)
    (held,) = rows_of(found, "Best approximation: as recommended")
    (pulses,) = rows_of(found, "Best approximation: the disk's temperatures, by pulses")
    for block, error in errors.items():  # no run is nearer than the best approximation
        assert 0.0 < held.get(block, pulses["60"]) <= error * (1 + 1e-6)


@pytest.mark.slow
def test_scaling_takes_each_method_on_each_mesh_apart(run: Run) -> None:
    found = run("scaling")
    rows = rows_of(found, "Milliseconds a step")
    assert {row["status"] for row in rows} == {"done"}
    coarse, fine = ({r["method"]: r for r in rows if r["unknowns"] == n}
                    for n in sorted({r["unknowns"] for r in rows}))
    assert set(coarse) == set(fine) == {"full", "galerkin", "sparse"}
    assert fine["full"]["peak"] > fine["full"]["base"] > 0.0
    for name in ("galerkin", "sparse"):  # counted, not timed: nothing of the mesh is left in a step
        assert fine[name]["solved"] <= sum((6, 6, 6, 6)) < 0.1 * fine["full"]["solved"]
        assert fine[name]["elements"] == coarse[name]["elements"] == 0
        assert fine[name]["iterations"] == pytest.approx(coarse[name]["iterations"], rel=0.3)
    assert {row["meshes"] for row in rows_of(found, "Exponents")} == {2}
    for row in rows_of(found, "Galerkin with the atoms for 0.001"):
        counted = next(r for r in rows_of(found, "POD atoms for 0.001: projection, by steps "
                                                 "trained on")
                       if (r["unknowns"], r["block"]) == (row["unknowns"], "disk.thermal"))
        assert row["disk.thermal"] >= counted["16"] > counted["4"] > 0
    last = rows_of(found, "Galerkin with the atoms for 0.001")[-1]
    assert last["error"] <= 1e-3


def test_step_sizes_compares_both_full_orders_and_the_reduced_ones(run: Run) -> None:
    found = run("step_sizes")
    rows = rows_of(found, "Bordered against Newton, and reduced against full order")
    assert {row["ended"] for row in rows} == {"done"} and len(rows) == 8
    motion, failures = found["targets"]
    assert motion["measured"] == max(row["of_motion"] for row in rows) < 1e-12
    assert failures["measured"] == 0
    for row in rows:
        assert 0.0 < row["of_bending"] < 1e-7
        assert row["galerkin, bending"] <= 1e-4 and row["sparse, bending"] <= 1e-2


def test_an_interrupted_benchmark_prints_what_it_has(tmp_path: Path) -> None:
    out = tmp_path / "accuracy.json"
    with subprocess.Popen(
        [sys.executable, SCRIPTS / "accuracy.py", "--seeds", "1", "0", "--out", out],
        env=os.environ | {"SPARSEMOR_CACHE": str(tmp_path / "cache")},
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
    ) as process:
        assert process.stderr is not None
        assert "full order" in process.stderr.readline()
        process.send_signal(signal.SIGINT)
        printed, _ = process.communicate(timeout=60)
    assert process.returncode == 130
    assert printed.startswith("accuracy: INTERRUPTED")
    assert json.loads(out.read_text())["interrupted"] is True


def test_a_third_party_reducer_is_timed_beside_galerkin(run: Run) -> None:
    found = run("third_party_reducer")
    rows = {row["method"]: row for row in rows_of(found, "CPU milliseconds per step")}
    assert set(rows) == {"galerkin", "oblique"}
    assert len({(row["atoms"], row["solver"]) for row in rows.values()}) == 1
    assert all(0 < row["least"] <= row["ms"] <= row["most"] for row in rows.values())
    assert len(found["targets"]) == 1


def test_a_kept_model_is_timed_against_full_order(run: Run) -> None:
    found = run("kept_model")
    row, = rows_of(found, "CPU time")
    assert row["scene"] == "double_pendulum" and len(found["targets"]) == 4
    assert row["full_s"] > row["kept_s"] > 0.0 and row["file_mb"] < 2.0


def test_a_box_of_parameters_is_tested_at_unseen_ones(tmp_path: Path) -> None:
    done = subprocess.run(
        [sys.executable, SCRIPTS / "errors/parameters.py", "--quick", "--out", tmp_path],
        env=os.environ | {"SPARSEMOR_CACHE": str(tmp_path / "cache")},
        capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert "trained at 9 points" in done.stdout and "CPU time of a whole run" in done.stdout
    with (tmp_path / "double_pendulum.csv").open(encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    assert len({row["flux"] for row in rows}) == len(rows) == 2
    assert all(0.0 < float(row["error_elastic"]) < 1e-3 for row in rows)


def test_the_chosen_models_are_measured_under_other_loads(tmp_path: Path) -> None:
    done = subprocess.run(
        [sys.executable, SCRIPTS / "errors" / "advice.py", "--quick"],
        env=os.environ | {"SPARSEMOR_CACHE": str(tmp_path)}, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    for line, tolerance in zip(done.stdout.splitlines()[-3:], (1e-2, 1e-3, 1e-4), strict=True):
        cells = [c.strip() for c in line.strip("|").split("|")]
        assert cells[:2] == ["double_pendulum", f"{tolerance:g}"] and cells[7] == "0 of 1"
        assert all(0.0 < float(cell) < tolerance for cell in cells[3:7])
