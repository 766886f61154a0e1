"""Who may import whom: core knows nobody, every other folder knows core and itself."""

import ast
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
FOLDERS = ("core", "bodies", "integrators", "reducers", "plugins")
HEAVY = {"skfem", "matplotlib", "meshio", "zarr", "xarray", "rich", "pyvista"}
FILES = sorted(p for folder in FOLDERS for p in (ROOT / folder).rglob("*.py"))


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


def at_import(tree: ast.Module) -> set[str]:
    """Top packages that importing the module imports: not in functions, not for type checkers."""
    body = [n for n in tree.body if not (
        isinstance(n, ast.FunctionDef | ast.ClassDef)
        or isinstance(n, ast.If) and "TYPE_CHECKING" in ast.unparse(n.test))]
    return {n.split(".")[0] for n in imported(ast.Module(body, []))}


@pytest.mark.parametrize("path", FILES, ids=lambda p: str(p.relative_to(ROOT)))
def test_imports_follow_the_table(path: Path) -> None:
    tree = ast.parse(path.read_text(encoding="utf-8"))
    assert not breaches(path.relative_to(ROOT).parts[0], tree)
    assert not at_import(tree) & HEAVY, "import these inside the functions that need them"


@pytest.mark.parametrize("folder, text", [
    ("core", "from sparsemor.bodies import flexible"),
    ("bodies", "import sparsemor.reducers.full"),
    ("plugins", "from sparsemor import load"),
    ("reducers", "def f():\n    from sparsemor.plugins.bases.pod import Pod"),
])
def test_the_check_sees_a_breach(folder: str, text: str) -> None:
    assert breaches(folder, ast.parse(text))


def test_every_folder_is_looked_at() -> None:
    assert {p.relative_to(ROOT).parts[0] for p in FILES} == set(FOLDERS)


def test_files_stay_short() -> None:
    lengths = {str(p.relative_to(ROOT)): len(p.read_text(encoding="utf-8").splitlines())
               for p in FILES}
    assert {name: n for name, n in lengths.items() if n > 300} == {}
