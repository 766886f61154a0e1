"""What `sparsemor new-plugin` writes, for every kind: it keeps the laws of its kind at once."""

import inspect
import sys
import tomllib
from importlib import import_module
from pathlib import Path

import pytest

from public_names import PUBLIC, ours
from sparsemor.core.errors import InputError
from sparsemor.core.registry.registry import Registry
from sparsemor.plugins.commands.new_plugin import KINDS, package_files

LONG = {"basis", "body", "contact", "error_norm", "joint", "linear_solver", "load", "paper",
        "reducer", "scene", "sparse_solver", "study"}
"""Kinds whose laws take 0.3 CPU seconds and more."""


@pytest.fixture
def install(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """install(kind) puts a new package `my_own` on the path and imports its test."""
    def written(kind: str):
        files = package_files("my_own", kind)
        for name, text in files.items():
            (tmp_path / name).write_text(text)
        project = tomllib.loads(files["pyproject.toml"])["project"]
        info = tmp_path / f"{project['name'].replace('-', '_')}-0.1.0.dist-info"
        info.mkdir()
        (info / "METADATA").write_text(
            f"Metadata-Version: 2.1\nName: {project['name']}\nVersion: {project['version']}\n")
        (info / "entry_points.txt").write_text("\n".join(
            f"[{group}]\n" + "\n".join(f"{k} = {v}" for k, v in named.items())
            for group, named in project["entry-points"].items()))
        for module in ("sparsemor_my_own", "test_my_own"):
            monkeypatch.delitem(sys.modules, module, raising=False)
        monkeypatch.syspath_prepend(tmp_path)
        return import_module("test_my_own")

    return written


def test_every_kind_has_a_template():
    registry = Registry()
    of_others = {"error_norm"}  # tables have one for each; ours have the built-in norms alone
    assert set(KINDS) == of_others | {kind for kind in registry.kinds() if any(
        p.distribution == "sparsemor" for p in registry.names(kind))}


@pytest.mark.parametrize("kind", [
    pytest.param(k, marks=pytest.mark.full if k in LONG else ()) for k in KINDS])
def test_a_new_package_keeps_the_laws_of_its_kind(kind, install, here):
    test = install(kind).test_laws
    test(**{"tmp_path": here} if "tmp_path" in inspect.signature(test).parameters else {})


@pytest.mark.parametrize("kind", KINDS)
def test_a_new_package_imports_public_names_alone(kind):
    files = package_files("my_own", kind)
    assert {"pyproject.toml", "README.md", "sparsemor_my_own.py", "test_my_own.py"} <= set(files)
    for name, text in files.items():
        assert "$" not in text and (not name.endswith(".py") or ours(text) <= PUBLIC), name
    packaged = tomllib.loads(files["pyproject.toml"])["tool"]["hatch"]["build"]["targets"]["wheel"]
    assert "sparsemor_my_own.py" in packaged["only-include"]
    assert set(packaged["only-include"]) <= set(files)


@pytest.mark.parametrize("name, kind, message", [
    ("class", "sampler", "no keyword of Python"), ("My", "sampler", "lower-case letters"),
    ("mine", "smapler", "did you mean sampler")])
def test_what_cannot_be_written_is_refused(name, kind, message):
    with pytest.raises(InputError, match=message):
        package_files(name, kind)
