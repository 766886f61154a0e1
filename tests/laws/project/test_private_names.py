"""Tests use public names: no import of, and no access to, names of others with a leading `_`."""

import ast
from collections.abc import Iterator
from pathlib import Path

import pytest

pytestmark = pytest.mark.full
TESTS = Path(__file__).parents[2]
LIBRARIES = {"_replace", "_exit", "_fields", "_asdict", "_repr_html_"}
"""Public though they begin so: of named tuples, of `os`, of notebooks."""


def private(name: str) -> bool:
    return name.startswith("_") and not name.startswith("__") and name.strip("_") != ""


def uses(tree: ast.AST) -> Iterator[tuple[int, str]]:
    """Line and name of each use of a private name that the text does not define itself."""
    own = {n.name for n in ast.walk(tree) if isinstance(n, ast.FunctionDef | ast.ClassDef)}
    own |= {n.attr for n in ast.walk(tree) if isinstance(n, ast.Attribute)
            and isinstance(n.value, ast.Name) and n.value.id == "self"}
    for node in ast.walk(tree):
        if isinstance(node, ast.Attribute) and private(node.attr) and node.attr not in own:
            yield node.lineno, node.attr
        elif isinstance(node, ast.ImportFrom) and (node.module or "").startswith("sparsemor"):
            names = [*(node.module or "").split("."), *(alias.name for alias in node.names)]
            yield from ((node.lineno, n) for n in names if private(n))
        elif isinstance(node, ast.Call) and getattr(node.func, "attr", "") == "setattr":
            yield from ((node.lineno, a.value) for a in node.args if isinstance(a, ast.Constant)
                        and isinstance(a.value, str) and private(a.value.split(".")[-1]))


def test_no_test_uses_private_names() -> None:
    found = [f"{path.relative_to(TESTS)}:{line}: {name}"
             for path in sorted(TESTS.rglob("*.py"))
             for line, name in uses(ast.parse(path.read_text(encoding="utf-8")))
             if name not in LIBRARIES]
    assert found == []


def test_the_check_sees_them() -> None:
    source = ("from sparsemor.core.model import _hidden\nmodel._grown\nthis._replace(a=1)\n"
              "patch.setattr(Part, '_built', 1)\nclass A:\n    def f(self): return self._own\n")
    assert [name for _, name in uses(ast.parse(source))] == [
        "_hidden", "_grown", "_built", "_replace"]
