"""Who may import whom: core knows nobody, every other folder knows core and itself; inside core
each folder knows those that stand before it."""

import ast
from collections.abc import Mapping
from functools import cache
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

import pytest

from public_names import PUBLIC, ours
from source_trees import tree_of
from tiers import full

ROOT = Path(__file__).parents[3]
FOLDERS = ("core", "bodies", "integrators", "reducers", "plugins")
LAYERS = ("arrays", "errors", "notes", "status", "protocols", "registry", "linalg", "scene",
          "model", "results", "simulation", "cli", "testing")
"""Of core, from the lowest: each imports only itself and what stands before it."""
DEPTH = 7
"""Imports at most from a folder of core down to the modules that import nothing of it: cli,
simulation, results, model, scene, registry, protocols, arrays."""
FLAT_MODULES = {"arrays", "errors", "notes", "status"}
HEAVY = {"skfem", "matplotlib", "meshio", "xarray", "rich", "pyvista"}
EACH = [f if f == "integrators" else full(f) for f in FOLDERS]
"""Folders as parameters; the syntax trees of the large ones take half a second each."""
FILES = sorted(p for folder in FOLDERS for p in (ROOT / folder).rglob("*.py"))
FORMS = "sparsemor.bodies.fem.element_matrices"
"""Imports scikit-fem, and is itself imported inside functions only."""
BUILD = ROOT / "core" / "_distribution"
COMMANDS = [ROOT / "plugins" / name for name in (
    "advice", "analyses", "charts", "command_line", "commands", "comparison", "error_estimate",
    "export", "kept_models", "liang2026", "publishing", "stability", "study")]
"""Folders of commands, which import of core what its own commands do: runs, studies, charts."""


def imported(tree: ast.AST) -> set[str]:
    names: set[str] = set()
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, "relative imports hide where a name comes from"
            names |= {f"{node.module}.{alias.name}" for alias in node.names}
    return names


@cache
def imported_by(path: Path) -> frozenset[str]:
    return frozenset(imported(tree_of(path)))


def breaches(folder: str, tree: ast.AST) -> set[str]:
    ours = {name for name in imported(tree) if name.split(".")[0] == "sparsemor"}
    allowed = {"core", folder}
    return {n for n in ours if "." not in n or n.split(".")[1] not in allowed}


def private(tree: ast.AST) -> set[str]:
    """Imports of core that a third party may not do: all but those of public modules."""
    return {n.module or "" for n in ast.walk(tree)
            if isinstance(n, ast.ImportFrom) and f"{n.module}.".startswith("sparsemor.core.")
            and n.module not in PUBLIC}


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


def module_of(path: Path) -> str:
    parts = path.relative_to(ROOT).with_suffix("").parts
    return ".".join(("sparsemor", *(parts[:-1] if parts[-1] == "__init__" else parts)))


def graph(folders: tuple[str, ...]) -> dict[str, set[str]]:
    """Module -> modules that it imports anywhere: in functions and for type checkers, too."""
    files = {module_of(p): p for p in FILES
             if p.relative_to(ROOT).parts[0] in folders and not p.is_relative_to(BUILD)}
    found = {}
    for name, path in files.items():
        names = imported_by(path)
        found[name] = {n if n in files else n.rpartition(".")[0] for n in names} & set(files)
        found[name].discard(name)
    return found


def between_folders(modules: Mapping[str, set[str]]) -> dict[str, set[str]]:
    """The same between the folders of core; what stands in none is one more."""
    found: dict[str, set[str]] = {}
    for name, others in modules.items():
        folder, *to = (parts[2] if len(parts) > 3 or parts[-1] not in FLAT_MODULES else "core"
                       for parts in (n.split(".") for n in (name, *others)))
        found.setdefault(folder, set()).update(set(to) - {folder})
    return found


def between_parts(modules: Mapping[str, set[str]], folder: str) -> dict[str, set[str]]:
    """The same between the folders and single modules of a folder of plugins. An import of a public
    name of `sparsemor.reducers` is one of the modules that this package takes its names from."""
    package = f"sparsemor.{folder}"
    homes = modules[package]

    def part(name: str) -> str:
        return name.split(".")[2]

    found: dict[str, set[str]] = {}
    for name, others in modules.items():
        if name != package:
            to = others | (homes if package in others else set())
            found.setdefault(part(name), set()).update(
                {part(n) for n in to if n != package} - {part(name)})
    return found


def longest_chain(graph: Mapping[str, set[str]]) -> int:
    """Number of imports in the longest chain. Raises CycleError."""
    length: dict[str, int] = {}
    for name in TopologicalSorter(graph).static_order():
        length[name] = max((length[n] + 1 for n in graph[name]), default=0)
    return max(length.values())


@pytest.mark.parametrize("folder", EACH)
def test_imports_follow_the_table(folder: str) -> None:
    for path in FILES:
        parts = path.relative_to(ROOT).parts
        if parts[0] != folder:
            continue
        tree = tree_of(path)
        if not path.is_relative_to(BUILD):  # the package itself, with names from all folders
            assert not breaches(folder, tree), path
        heavy = HEAVY - ({"skfem"} if path == ROOT / "bodies/fem/element_matrices.py" else set())
        loaded = at_import(tree)
        assert not {n.split(".")[0] for n in loaded} & heavy, (path, "import inside functions")
        assert not any(n.startswith(FORMS) for n in loaded), path
        layer = parts[1].removesuffix(".py") if len(parts) > 1 else ""
        if folder == "core" and layer in LAYERS:
            assert not upward(layer, tree), path


@pytest.mark.parametrize("folder", EACH[1:])
def test_plugins_import_what_third_parties_may(folder: str) -> None:
    found = {path: names for path in FILES if path.relative_to(ROOT).parts[0] == folder
             if not any(map(path.is_relative_to, COMMANDS)) and (names := private(tree_of(path)))}
    assert not found


@pytest.mark.parametrize("module", [
    "galerkin", "deim", "least_squares", "ecsw/reducer", "ecsw/training", "ecsw/training_matrix",
    "ecsw/nnls"])
def test_projecting_reducers_import_what_third_parties_may(module: str) -> None:
    """Public names of core and of reducers; besides, modules of a method's own folder."""
    path = ROOT / "reducers" / "projection" / f"{module}.py"
    own = module_of(path.parent) + "." if "/" in module else "sparsemor.core"
    assert {m for m in ours(path.read_text(encoding="utf-8")) if not m.startswith(own)} <= PUBLIC


def test_the_check_sees_a_private_import() -> None:
    assert private(ast.parse("def f():\n    from sparsemor.core.simulation.training import train"))
    assert not private(ast.parse("from sparsemor.core import Term"))


@pytest.mark.parametrize("folder, text", [
    ("core", "from sparsemor.bodies import flexible"),
    ("bodies", "import sparsemor.reducers.full"),
    ("plugins", "from sparsemor import load"),
    ("reducers", "def f():\n    from sparsemor.plugins.bases.pod import Pod"),
])
def test_the_check_sees_a_breach(folder: str, text: str) -> None:
    assert breaches(folder, ast.parse(text))


def test_the_check_sees_an_upward_import() -> None:
    tree = ast.parse("def f():\n    from sparsemor.core.simulation.training import train")
    assert upward("results", tree) and not upward("cli", tree)


def test_every_folder_is_looked_at() -> None:
    assert {p.relative_to(ROOT).parts[0] for p in FILES} == set(FOLDERS)
    inside = {p.relative_to(ROOT).parts[1].removesuffix(".py") for p in FILES
              if p.is_relative_to(ROOT / "core") and not p.is_relative_to(BUILD)}
    assert inside == {*LAYERS, "__init__"}


@pytest.mark.parametrize("folder", EACH)
def test_no_module_imports_itself_through_others(folder: str) -> None:
    """With imports in functions and type-only ones, so that neither can hide a circle."""
    longest_chain(graph((folder,)))


@pytest.mark.parametrize("folder", EACH[1:])
def test_no_folder_of_plugins_imports_itself_through_others(folder: str) -> None:
    """Circles between folders that no circle of single modules shows."""
    longest_chain(between_parts(graph((folder,)), folder))


def test_the_check_sees_a_circle_of_folders() -> None:
    modules = {"sparsemor.reducers": {"sparsemor.reducers.full.c"},
               "sparsemor.reducers.full.a": {"sparsemor.reducers.step.b"},
               "sparsemor.reducers.full.c": set(),
               "sparsemor.reducers.step.b": set()}
    longest_chain(between_parts(modules, "reducers"))
    for imports in ("sparsemor.reducers.full.c", "sparsemor.reducers"):
        with pytest.raises(CycleError):
            longest_chain(between_parts(
                {**modules, "sparsemor.reducers.step.b": {imports}}, "reducers"))


@pytest.mark.full
def test_imports_between_folders_of_core_are_few_deep() -> None:
    folders = between_folders({name: others for name, others in graph(("core",)).items()
                               if name != "sparsemor.core"})
    assert set(folders) == {*LAYERS} - FLAT_MODULES | {"core"}
    assert longest_chain(folders) <= DEPTH


def test_the_check_sees_a_circle() -> None:
    with pytest.raises(CycleError):
        longest_chain({"a": {"b"}, "b": {"c"}, "c": {"a"}})
    assert longest_chain({"a": {"b", "c"}, "b": {"c"}, "c": set()}) == 2
