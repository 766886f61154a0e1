"""Each target of paper_map.md, and of other pages, exists: `file.py:Name` or `file.yaml`."""

import ast
import re
from functools import cache
from pathlib import Path

import pytest

from doc_pages import page_named
from source_trees import tree_of

ROOT = Path(__file__).parents[2]
TARGET = re.compile(r"`((?:core|plugins|bodies|integrators|reducers|tests)/[\w./]+\.(?:py|yaml))"
                    r"(?::([A-Za-z_][\w.]*))?`")
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]


def targets(page: Path) -> list[tuple[str, str]]:
    return TARGET.findall(page.read_text(encoding="utf-8"))


@cache
def names_in(path: Path) -> set[str]:
    return names(tree_of(path).body)


def names(body: list[ast.stmt], prefix: str = "") -> set[str]:
    """Classes, functions, methods and assigned names, dotted."""
    found: set[str] = set()
    for node in body:
        if isinstance(node, ast.ClassDef | ast.FunctionDef):
            found.add(prefix + node.name)
        if isinstance(node, ast.ClassDef):
            found |= names(node.body, f"{prefix}{node.name}.")
        if isinstance(node, ast.Assign | ast.AnnAssign):
            spots = node.targets if isinstance(node, ast.Assign) else [node.target]
            found |= {prefix + n.id for s in spots for n in ast.walk(s) if isinstance(n, ast.Name)}
    return found


@pytest.mark.full
def test_targets_exist() -> None:
    for page in PAGES:
        for file, name in targets(page):
            path = ROOT / file
            assert path.is_file(), f"{page.name}: there is no {file}"
            if name:
                assert name in names_in(path), f"{page.name}: {file} has no {name}"


def test_the_map_is_not_empty_and_a_wrong_target_is_seen() -> None:
    found = targets(page_named("paper_map.md"))
    assert len(found) > 40 and sum(bool(name) for _, name in found) > 38
    known = names(ast.parse("A, B = 1, 2\nclass C:\n    x: int\n    def f(self): ...\n").body)
    assert known == {"A", "B", "C", "C.x", "C.f"}
    text = "`core/no_such.py:thing`, `core/status.py`"
    assert TARGET.findall(text) == [("core/no_such.py", "thing"), ("core/status.py", "")]


def test_the_map_covers_every_figure_table_and_equation_of_the_method() -> None:
    """Rows begin with names such as `Fig. 14, 15` or `Table 2`."""
    page = page_named("paper_map.md").read_text(encoding="utf-8")
    assert all(f"Eq. {n}" in page for n in ("8-12", "24", "25", "29", "30", "31", "34"))
    found = {(kind, int(n)) for kind, numbers in re.findall(
        r"(?m)^\| (Fig\.|Table) ([\d, ]+) \|", page) for n in numbers.split(",")}
    assert found == {*(("Fig.", n) for n in range(1, 24)), *(("Table", n) for n in range(1, 13))}
