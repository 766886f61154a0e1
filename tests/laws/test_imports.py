"""Who may import whom: core knows nobody, every other folder knows core and itself; inside core
each folder knows those that stand before it. Folders stay small enough to be searched by eye."""

import ast
import warnings
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
FOLDERS = ("core", "bodies", "integrators", "reducers", "plugins")
LAYERS = ("arrays", "errors", "notes", "status", "protocols", "registry", "linalg", "scene",
          "model", "results", "simulation", "analysis", "cli", "testing")
"""Of core, from the lowest: each imports only itself and what stands before it."""
FLAT = {"core": 4, "bodies": 10, "reducers": 10}
"""Modules at most that stand in no folder of their role."""
CROWD = 25
HEAVY = {"skfem", "matplotlib", "meshio", "zarr", "xarray", "rich", "pyvista"}
FILES = sorted(p for folder in FOLDERS for p in (ROOT / folder).rglob("*.py"))
FORMS = "sparsemor.bodies.fem.forms"
"""Imports scikit-fem, and is itself imported inside functions only."""
BUILD = ROOT / "core" / "_distribution"


def imported(tree: ast.AST) -> set[str]:
    names: set[str] = set()
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, "relative imports hide where a name comes from"
            names |= {f"{node.module}.{alias.name}" for alias in node.names}
    return names


def breaches(folder: str, tree: ast.AST) -> set[str]:
    ours = {name for name in imported(tree) if name.split(".")[0] == "sparsemor"}
    allowed = {"core", folder}
    return {n for n in ours if "." not in n or n.split(".")[1] not in allowed}


def upward(layer: str, tree: ast.AST) -> set[str]:
    """Imports of a module of core that break the order of its folders, type-only ones included."""
    names = {n for n in imported(tree) if n.startswith("sparsemor.core.")}
    return {n for n in names if n.split(".")[2] in LAYERS
            and LAYERS.index(n.split(".")[2]) > LAYERS.index(layer)}


def at_import(tree: ast.Module) -> set[str]:
    """Names that importing the module imports: not in functions, not for type checkers."""
    body = [n for n in tree.body if not (
        isinstance(n, ast.FunctionDef | ast.ClassDef)
        or isinstance(n, ast.If) and "TYPE_CHECKING" in ast.unparse(n.test))]
    return imported(ast.Module(body, []))


@pytest.mark.parametrize("folder", FOLDERS)
def test_imports_follow_the_table(folder: str) -> None:
    for path in FILES:
        parts = path.relative_to(ROOT).parts
        if parts[0] != folder:
            continue
        tree = ast.parse(path.read_text(encoding="utf-8"))
        assert not breaches(folder, tree), path
        heavy = HEAVY - ({"skfem"} if path == ROOT / "bodies/fem/forms.py" else set())
        loaded = at_import(tree)
        assert not {n.split(".")[0] for n in loaded} & heavy, (path, "import inside functions")
        assert not any(n.startswith(FORMS) for n in loaded), path
        layer = parts[1].removesuffix(".py") if len(parts) > 1 else ""
        if folder == "core" and layer in LAYERS:
            assert not upward(layer, tree), path


@pytest.mark.parametrize("folder, text", [
    ("core", "from sparsemor.bodies import flexible"),
    ("bodies", "import sparsemor.reducers.full"),
    ("plugins", "from sparsemor import load"),
    ("reducers", "def f():\n    from sparsemor.plugins.bases.pod import Pod"),
])
def test_the_check_sees_a_breach(folder: str, text: str) -> None:
    assert breaches(folder, ast.parse(text))


def test_the_check_sees_an_upward_import() -> None:
    tree = ast.parse("def f():\n    from sparsemor.core.simulation.cache import Cache")
    assert upward("results", tree) and not upward("analysis", tree)


def test_every_folder_is_looked_at() -> None:
    assert {p.relative_to(ROOT).parts[0] for p in FILES} == set(FOLDERS)
    inside = {p.relative_to(ROOT).parts[1].removesuffix(".py") for p in FILES
              if p.is_relative_to(ROOT / "core") and not p.is_relative_to(BUILD)}
    assert inside == {*LAYERS, "__init__"}


def test_folders_can_be_searched_by_eye() -> None:
    crowds = {p.parent: len(list(p.parent.glob("*.py"))) for p in FILES}
    assert {str(f.relative_to(ROOT)): n for f, n in crowds.items() if n > CROWD} == {}
    flat = {name: len(list((ROOT / name).glob("*.py"))) - 1 for name in FLAT}  # but __init__
    assert {name: n for name, n in flat.items() if n > FLAT[name]} == {}


def test_long_files_are_named() -> None:
    """A file is one concept: a long one is looked at again, and never cut to fit a number."""
    lengths = {str(p.relative_to(ROOT)): len(p.read_text(encoding="utf-8").splitlines())
               for p in FILES}
    long = {name: n for name, n in lengths.items() if n > 300}
    with warnings.catch_warnings():
        warnings.simplefilter("default")
        if long:
            warnings.warn(f"files of more than 300 lines: {long}", stacklevel=1)
