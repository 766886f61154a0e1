"""The sample distributions work like first-party plugins; the broken one harms nobody."""

import ast
import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from in_process import sparsemor
from public_names import PUBLIC, ours

pytestmark = pytest.mark.full

FOLDER = Path(__file__).parents[1] / "third_party"
SAMPLE, BEAM = FOLDER / "sparsemor-sample", FOLDER / "sparsemor-beam"
MODULES = sorted(SAMPLE.glob("*.py"))


def run(third_party: Path, *arguments: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, *arguments], env={**os.environ, "PYTHONPATH": str(third_party)},
        capture_output=True, text=True, check=False)


@pytest.fixture
def installed(third_party, monkeypatch):
    """The distributions, for the process of the test."""
    monkeypatch.syspath_prepend(third_party)


@pytest.mark.usefixtures("installed")
def test_both_are_listed_and_the_broken_one_with_its_cause():
    done = sparsemor("plugins", "sampler", "--json")
    assert (done.code, done.err) == (0, "")
    found = {p["use"]: p for p in json.loads(done.out)["plugins"]}
    assert found["every_nth"]["distribution"] == "sparsemor-sample"
    assert found["every_nth"]["version"] == "0.3.0"
    assert found["every_nth"]["options"][0]["doc"].startswith("First row")
    assert found["broken"]["distribution"] == "sparsemor-broken"
    assert "No module named 'a_package_that_nobody_has'" in found["broken"]["broken"]
    assert found["lhs"]["broken"] == ""


@pytest.mark.usefixtures("installed")
def test_the_listing_has_what_a_package_of_one_integrator_replaces():
    (found,) = json.loads(sparsemor("plugins", "radau_iia", "--json").out)["plugins"]
    assert found["distribution"] == "sparsemor-radau" and found["broken"] == ""
    assert found["required"] == ["order", "rules(h)"]
    assert [own["name"] for own in found["own"]] == ["advance(solve, step)"]


@pytest.mark.usefixtures("installed")
def test_the_schema_completes_it_and_leaves_the_broken_one_out():
    schema = json.loads(sparsemor("schema", code=0).out)
    names = {c["const"] for c in schema["$defs"]["slot.sampler"]["anyOf"] if "const" in c}
    assert "every_nth" in names and "broken" not in names


@pytest.mark.parametrize("own", [SAMPLE / "check_sample.py", BEAM / "check_beam.py"])
def test_its_law_test_passes(third_party, tmp_path, own):
    """In a temporary folder of its own: other test runs clean up the common one."""
    done = run(third_party, "-m", "pytest", "-q", "-p", "no:cacheprovider",
               "--basetemp", str(tmp_path / "own"),
               "--rootdir", str(own.parent), str(own))
    assert done.returncode == 0, done.stdout


@pytest.mark.usefixtures("installed")
def test_all_of_its_plugins_work():
    """Nothing of it is broken."""
    found = {(p["kind"], p["name"]): p for p in json.loads(sparsemor("plugins", "--json").out)[
        "plugins"] if p["distribution"] == "sparsemor-sample"}
    assert set(found) == {
        ("body", "ring"), ("joint", "gear"), ("load", "spring"), ("load", "contact_resistance"),
        ("load", "calm_air"), ("material", "alloy"), ("check", "idle"), ("normal_law", "power_law"),
        ("integrator", "trapezoidal"), ("sampler", "every_nth"),
        ("sparse_solver", "hard_thresholding"), ("reducer", "oblique"),
        ("command", "span")}
    assert not any(p["broken"] for p in found.values())


@pytest.mark.usefixtures("installed")
def test_its_command_is_one_of_the_program():
    """It is called and refused as core's own are."""
    scene = str(SAMPLE / "scenes" / "plate.yaml")
    done = sparsemor("span", scene)
    assert (done.code, done.err) == (0, "") and json.loads(done.out)
    for arguments, fault in ((("no_such",), "no packaged scene"),
                             ((scene, "--block", "no"), "no block")):
        refused = sparsemor("span", *arguments)
        assert (refused.code, refused.out) == (2, "")
        assert fault in refused.err and len(refused.lines) == 1


def test_a_broken_command_says_so_in_one_line_and_hides_no_other(third_party, installed):
    """Also as a process."""
    done = run(third_party, "-m", "sparsemor", "broken", "some", "--thing", "3")
    assert (done.returncode, done.stdout) == (2, "") and len(done.stderr.splitlines()) == 1
    assert "sparsemor-broken 0.1.0 cannot be imported (ModuleNotFoundError" in done.stderr
    shown = sparsemor("--help").out
    assert all(f"│ {name} " in shown for name in ("run", "reproduce", "span", "broken"))
    assert "BROKEN: " in shown and shown.count("│ run ") == 1
    found = {p["use"]: p for p in json.loads(
        sparsemor("plugins", "command", "--json").out)["plugins"]}
    assert "No module named" in found["broken"]["broken"]
    assert not found["run"]["broken"] and found["run"]["distribution"] == "sparsemor"
    assert found["span"]["doc"].startswith("Print the largest") and not found["span"]["broken"]


def test_it_imports_public_names_alone():
    for path in (*MODULES, *BEAM.glob("*.py")):
        assert ours(path.read_text()) <= PUBLIC, path.name


def test_a_private_module_would_be_seen():
    assert ours("from sparsemor.core.model.assembly import assemble\nimport numpy") == {
        "sparsemor.core.model.assembly"}


def test_a_third_party_writes_few_lines_for_a_plugin():
    """Classes of plugins, without the functions that they share."""
    lengths = {c.name: (c.end_lineno or 0) - c.lineno + 1 for path in MODULES
               for c in ast.walk(ast.parse(path.read_text())) if isinstance(c, ast.ClassDef)}
    assert len(lengths) >= 9 and max(lengths.values()) < 60, lengths
