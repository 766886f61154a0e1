"""The sample distribution works like a first-party plugin; the broken one harms nobody."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from sparsemor.core.cli.skeleton import package_files
from sparsemor.core.cli.templates import KINDS

SAMPLE = Path(__file__).parents[1] / "third_party" / "sparsemor-sample"


def run(third_party: Path, *arguments: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, *arguments], env={**os.environ, "PYTHONPATH": str(third_party)},
        capture_output=True, text=True, check=False)


def command(third_party: Path, *arguments: str) -> subprocess.CompletedProcess[str]:
    return run(third_party, "-c", "from sparsemor.core.cli import main; main()", *arguments)


def test_both_are_listed_and_the_broken_one_with_its_cause(third_party):
    done = command(third_party, "plugins", "sampler", "--json")
    assert (done.returncode, done.stderr) == (0, "")
    found = {p["name"]: p for p in json.loads(done.stdout)["plugins"]}
    assert found["every_nth"]["distribution"] == "sparsemor-sample"
    assert found["every_nth"]["version"] == "0.3.0"
    assert found["every_nth"]["options"][0]["doc"].startswith("First row")
    assert found["broken"]["distribution"] == "sparsemor-broken"
    assert "No module named 'a_package_that_nobody_has'" in found["broken"]["broken"]
    assert found["lhs"]["broken"] == ""


def test_the_schema_completes_it_and_leaves_the_broken_one_out(third_party):
    schema = json.loads(run(third_party, "-c", (
        "import json; from sparsemor.core.schema import _Definitions; "
        "from sparsemor.core.registry import Registry; "
        "print(json.dumps(_Definitions(Registry())._any_of('sampler')))")).stdout)
    names = {c["const"] for c in schema["anyOf"] if "const" in c}
    assert "every_nth" in names and "broken" not in names


def test_its_law_test_passes(third_party):
    done = run(third_party, "-m", "pytest", "-q", "-p", "no:cacheprovider", "--rootdir",
               str(SAMPLE), str(SAMPLE / "check_sample.py"))
    assert done.returncode == 0, done.stdout


def test_a_third_party_writes_less_than_forty_lines():
    count = sum(len(p.read_text().splitlines()) for p in SAMPLE.glob("*.py"))
    assert count < 40


@pytest.mark.parametrize("kind", sorted(KINDS))
def test_new_packages_obey_the_laws_of_their_kind(kind, distribute):
    files = package_files("my_own", kind)
    assert set(files) == {"pyproject.toml", "README.md", "sparsemor_my_own.py", "test_my_own.py"}
    distribute("sparsemor-my-own", {kind: {"my_own": "sparsemor_my_own:MyOwn"}},
               sparsemor_my_own=files["sparsemor_my_own.py"],
               law_of_my_own=files["test_my_own.py"])
    import law_of_my_own

    law_of_my_own.test_laws()
