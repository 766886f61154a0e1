"""What is published with the sources agrees with pyproject.toml: recipe, versions, citation."""

import re
import tomllib
from pathlib import Path

import pytest
from packaging.requirements import Requirement
from ruamel.yaml import YAML

ROOT = Path(__file__).parents[3]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
OF_CONDA = {"matplotlib": "matplotlib-base", "typing-extensions": "typing_extensions"}
"""Names of conda-forge that differ."""
ADDRESS = "https://example.org/sparsemor"


def least(texts: list[str]) -> dict[str, str]:
    """Distribution -> lower bound."""
    found = [Requirement(t) for t in texts]
    return {r.name: next((s.version for s in r.specifier if s.operator == ">="), "") for r in found}


def test_the_recipe_has_the_dependencies_and_bounds_of_the_package() -> None:
    jinja2 = pytest.importorskip("jinja2")
    text = jinja2.Environment(undefined=jinja2.StrictUndefined).from_string(
        (ROOT / "recipe" / "meta.yaml").read_text(encoding="utf-8")).render(
            environ={"SPARSEMOR_VERSION": "9.8.7"}, PYTHON="python")
    recipe = YAML(typ="safe").load(text)
    assert recipe["package"] == {"name": "sparsemor", "version": "9.8.7"}
    expected = {OF_CONDA.get(n, n): v for n, v in least(PROJECT["dependencies"]).items()}
    python = {"python": PROJECT["requires-python"].removeprefix(">=")}
    assert least(recipe["requirements"]["run"]) == expected | python
    build = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["build-system"]
    assert least(recipe["requirements"]["host"]) == least(build["requires"]) | python | {"pip": ""}
    assert recipe["build"]["entry_points"] == [
        f"{n} = {t}" for n, t in PROJECT["scripts"].items()]
    about = recipe["about"]
    assert (about["license"], about["summary"]) == (PROJECT["license"], PROJECT["description"])


def test_the_oldest_versions_are_the_lower_bounds() -> None:
    lines = [line for line in (ROOT / "tests/oldest.txt").read_text(encoding="utf-8").splitlines()
             if not line.startswith("#")]
    pinned = {Requirement(line).name: Requirement(line).specifier for line in lines}
    extras = PROJECT["optional-dependencies"]
    named = [t for t in extras["test"] if t.startswith("sparsemor[")]
    own = re.split(r"[\[\],]", named[0])[1:-1]
    wanted = [*PROJECT["dependencies"], *(t for t in extras["test"] if t not in named),
              *(t for extra in own for t in extras[extra])]
    for name, version in least(wanted).items():
        low = next(iter(pinned[name])).version.split(".")
        assert low[:len(version.split("."))] == version.split("."), name


def test_the_address_is_one_placeholder() -> None:
    for url in PROJECT["urls"].values():
        assert url.startswith(ADDRESS)
    assert ADDRESS in (ROOT / "RELEASING.md").read_text(encoding="utf-8")
    other = re.compile(r"https://example\.org(?!/sparsemor)")
    for file in ("pyproject.toml", "CITATION.cff", "SECURITY.md", "recipe/meta.yaml"):
        assert not other.search((ROOT / file).read_text(encoding="utf-8")), file


def test_the_citation_is_of_the_paper() -> None:
    cited = YAML(typ="safe").load((ROOT / "CITATION.cff").read_text(encoding="utf-8"))
    assert {"cff-version", "message", "title", "authors"} <= set(cited)
    paper = cited["preferred-citation"]
    pages = " ".join((ROOT / "docs/reference/bibliography.md").read_text(encoding="utf-8").split())
    assert f"{paper['title']}, {paper['journal']} {paper['volume']}({paper['issue']})" in pages
    assert paper["doi"] in pages and cited["license"] == PROJECT["license"]


def test_the_changelog_of_a_release_is_short() -> None:
    text = (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")
    for section in re.split(r"^## (?=\[)", text, flags=re.MULTILINE)[1:]:
        assert section.count("\n") <= 200 and section.startswith("[")


def test_workflows_and_templates_can_be_read() -> None:
    for file in [*(ROOT / ".github").rglob("*.yml"), ROOT / ".pre-commit-config.yaml"]:
        assert YAML(typ="safe").load(file.read_text(encoding="utf-8")), file
    job = YAML(typ="safe").load((ROOT / ".github/workflows/ci.yml").read_text())["jobs"]["run"]
    tested = job["strategy"]["matrix"]["python"]
    assert [f"Programming Language :: Python :: {v}" for v in tested] == [
        c for c in PROJECT["classifiers"] if re.search(r":: 3\.\d+$", c)]
    assert job["steps"][-1]["run"].endswith(".ci/run")
