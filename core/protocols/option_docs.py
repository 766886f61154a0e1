"""Docstrings of options: the text below each field of a plugin's class.

They are read from the source where they are shown, in a JSON schema. Pydantic's own way,
`use_attribute_docstrings`, reads them whenever a class is defined: a third of the time that a
command takes to start.
"""

import ast
import sys
from collections.abc import Iterator, Mapping
from functools import cache
from inspect import cleandoc, getsource
from itertools import pairwise


def option_docs(cls: type) -> Mapping[str, str]:
    """Name of each annotated attribute of a class, its bases' among them -> its docstring, empty
    if there is none. Of a class without source, such as one made by a function, nothing."""
    found: dict[str, str] = {}
    for c in reversed(cls.__mro__):
        module = sys.modules.get(c.__module__)
        try:
            source = getsource(module) if module else ""
        except (OSError, TypeError):  # built-in, or entered at a prompt
            continue
        found |= _of_source(source).get(c.__qualname__, {})
    return found


@cache
def _of_source(source: str) -> Mapping[str, Mapping[str, str]]:
    """Qualified name of each class of a module -> docstrings of its annotated attributes."""
    return dict(_classes(ast.parse(source), ""))


def _classes(parent: ast.AST, prefix: str) -> Iterator[tuple[str, Mapping[str, str]]]:
    """Qualified name of each class inside of a node -> docstrings of its attributes; prefix: of
    their names."""
    for node in ast.iter_child_nodes(parent):
        if isinstance(node, ast.ClassDef):
            yield prefix + node.name, dict(_attributes(node))
            yield from _classes(node, f"{prefix}{node.name}.")
        elif isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
            yield from _classes(node, f"{prefix}{node.name}.<locals>.")
        else:
            yield from _classes(node, prefix)


def _attributes(node: ast.ClassDef) -> Iterator[tuple[str, str]]:
    """Annotated attributes of a class and the string after each, "" without one."""
    for statement, after in pairwise([*node.body, ast.Pass()]):
        if isinstance(statement, ast.AnnAssign) and isinstance(statement.target, ast.Name):
            text = after.value if isinstance(after, ast.Expr) else None
            found = text.value if isinstance(text, ast.Constant) else None
            yield statement.target.id, cleandoc(found) if isinstance(found, str) else ""
