"""Core names no field, no reducer and no kind of load: it reads kinds, abilities and columns."""

import ast
import re
from collections.abc import Iterator
from pathlib import Path

import sparsemor.core

CORE = Path(sparsemor.core.__file__).parent
DEFAULTS = CORE / "scene" / "defaults.py"
"""The names that a scene takes where it names none."""
FIELD_OR_REDUCER = re.compile(r"\b(elastic|thermal|galerkin)\b")
EXACT = {"full", "rigid", "multiplier"}
PREFIX = "joint "
"""Begin of names of joint forces; a sentence may have the word further in."""
OPTIONS = {Path("simulation/rigid_stage.py"): {"rigid"}, Path("protocols/contact.py"): {"rigid"}}
"""File -> words that are values of an option there: surfaces of a contact are `rigid`."""


def test_no_field_reducer_or_joint_is_named() -> None:
    found = [f"{path.relative_to(CORE)}:{line}: {text!r}"
             for path in sorted(CORE.rglob("*.py")) if path != DEFAULTS
             for line, text in literals(path.read_text(encoding="utf-8"))
             if named(text) and text not in OPTIONS.get(path.relative_to(CORE), set())]
    assert found == []


def test_names_are_found_in_code_and_not_in_docstrings() -> None:
    source = '"""elastic"""\nX = "thermal"\n"""galerkin"""\ndef f(b): return f"{b}.elastic", "full"'
    found = {text for _, text in literals(source) if named(text)}
    assert found == {"thermal", ".elastic", "full"}
    assert named("joint pin x") and not named("the velocities at the start break joint ")
    assert not named("linear elasticity") and not named("fully")


def named(text: str) -> bool:
    return bool(FIELD_OR_REDUCER.search(text)) or text in EXACT or text.startswith(PREFIX)


def literals(source: str) -> Iterator[tuple[int, str]]:
    """Line and value of each string of a module that is not a statement of its own."""
    tree = ast.parse(source)
    documentation = {id(node.value) for node in ast.walk(tree) if isinstance(node, ast.Expr)}
    for node in ast.walk(tree):
        if isinstance(node, ast.Constant) and isinstance(node.value, str) and (
                id(node) not in documentation):
            yield node.lineno, node.value
