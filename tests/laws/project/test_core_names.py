"""Core names no field, no reducer and no kind of load: it reads kinds, abilities and columns."""

import ast
import re
from collections.abc import Iterator
from pathlib import Path

import pytest

import sparsemor.core
from source_trees import tree_of

CORE = Path(sparsemor.core.__file__).parent
DEFAULTS = CORE / "scene" / "default_plugins.py"
"""The names that a scene takes where it names none."""
FIELD_OR_REDUCER = re.compile(r"\b(elastic|thermal|galerkin)\b")
EXACT = {"full", "rigid", "multiplier"}
PREFIX = "joint "
"""Begin of names of joint forces; a sentence may have the word further in."""
READERS = ("registry", "scene", "cli")
"""Folders that read texts: entry points, YAML, options."""
TEXTS = {
    ("model/assembly.py", "group.removesuffix('s')"),  # keys of a scene and kinds of plugins
    ("results/output_directory.py", "path.name.startswith(_SCRATCH)"),
    ("results/run_result.py", "n.removeprefix('probe.')"),  # an array of a probe
    ("simulation/offline.py", "phase.removesuffix(' run')"),
    ("simulation/workers/local_pool.py", "line.endswith('\\n')"),
}
"""File and test of the begin or end of a text, none of which is the name of a part."""
OPTIONS = {Path("simulation/rigid_stage.py"): {"rigid"}, Path("protocols/contact.py"): {"rigid"}}
"""File -> words that are values of an option there: surfaces of a contact are `rigid`."""


@pytest.mark.full
def test_no_field_reducer_or_joint_is_named() -> None:
    found = [f"{path.relative_to(CORE)}:{line}: {text!r}"
             for path in sorted(CORE.rglob("*.py")) if path != DEFAULTS
             for line, text in literals(tree_of(path))
             if named(text) and text not in OPTIONS.get(path.relative_to(CORE), set())]
    assert found == []


def test_names_are_found_in_code_and_not_in_docstrings() -> None:
    source = '"""elastic"""\nX = "thermal"\n"""galerkin"""\ndef f(b): return f"{b}.elastic", "full"'
    found = {text for _, text in literals(ast.parse(source)) if named(text)}
    assert found == {"thermal", ".elastic", "full"}
    assert named("joint pin x") and not named("the velocities at the start break joint ")
    assert not named("linear elasticity") and not named("fully")


@pytest.mark.full
def test_no_name_is_taken_apart() -> None:
    """A kind, a phase or a role is a value: the begin or end of a name says nothing."""
    found = {(str(path.relative_to(CORE)), call)
             for path in sorted(CORE.rglob("*.py"))
             if path.relative_to(CORE).parts[0] not in READERS
             for call in parts_of_names(tree_of(path))}
    assert found == TEXTS


def test_begins_and_ends_of_names_are_found() -> None:
    source = 'a = block.name.startswith("u_")\nb = "." in name\nc = f(name.endswith)\nd = x in y'
    assert set(parts_of_names(ast.parse(source))) == {"block.name.startswith('u_')", "'.' in name"}


def parts_of_names(tree: ast.AST) -> Iterator[str]:
    """Calls that look at the begin or end of a string, and searches for punctuation in one."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute) and (
                node.func.attr in ("startswith", "endswith", "removeprefix", "removesuffix")):
            yield ast.unparse(node)
        elif isinstance(node, ast.Compare) and isinstance(node.ops[0], ast.In | ast.NotIn) and (
                isinstance(node.left, ast.Constant) and isinstance(node.left.value, str)
                and re.fullmatch(r"\W+", node.left.value)):
            yield ast.unparse(node)


def named(text: str) -> bool:
    return bool(FIELD_OR_REDUCER.search(text)) or text in EXACT or text.startswith(PREFIX)


def literals(tree: ast.AST) -> Iterator[tuple[int, str]]:
    """Line and value of each string of a module that is not a statement of its own."""
    documentation = {id(node.value) for node in ast.walk(tree) if isinstance(node, ast.Expr)}
    for node in ast.walk(tree):
        if isinstance(node, ast.Constant) and isinstance(node.value, str) and (
                id(node) not in documentation):
            yield node.lineno, node.value
