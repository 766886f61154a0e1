"""No `Any` in the public signatures and fields of core, but where a reason is written here."""

import ast
import re
from collections.abc import Iterator
from pathlib import Path

import pytest

from source_trees import tree_of

CORE = Path(__file__).parents[3] / "core"
FOLDERS = ("protocols", "model", "simulation", "linalg", "registry", "results")
OBJECT = re.compile(r"NDArray\[Any\]|\b(?:dict|Mapping)\[str, Any\]")
"""Arrays with entries of any type; JSON objects, in the folder of stored results and in the
modules of `STATED`."""
STATED = ("results.", "simulation.recorder.", "simulation.step_control.ControlledSteps.summary",
          "linalg.threads.", "registry.hooks.Events.on_finish",
          "protocols.layout.FieldKind.of_plain", "simulation.reduced_model.",
          "simulation.prepared_run.PreparedRun.summary", "simulation.prepared_run.PreparedRun.kept",
          "simulation.checks.Findings.summary", "simulation.checks.Findings.kept",
          "simulation.workers.")
ALLOWED = {
    "registry.boundary.read_only": "an argument of any method of a plugin, of its own type again",
    "registry.value_types.fits": "any annotation",
    "registry.value_types.required_type": "any annotation",
    "registry.value_types.unfit": "any annotation",
    "registry.value_types.unfit_field": "a dataclass of any type",
    "registry.value_types.unfit_arrays": "a dataclass of any type",
    "registry.option_types.type_in_words": "a JSON schema",
    "registry.registry.Registry.load": "a class of any kind of plugin, which the caller names",
    "registry.slot.slot_default": "the default of an option: pydantic makes a plugin of the name",
    "registry.slot.name_default_slots": "the options of a plugin as they are written",
    "results.json_data.finite": "any JSON value",
    "results.model_file.packed.HasParts.of_parts": "arguments of the constructor of any class",
    "results.model_file.packed.Packed.made": "an object of any class of the table",
    "results.model_file.packed.Packed.tree": "plain data of an unknown object",
    "results.saved_state.Saved.tree": "plain data of an unknown memory",
    "results.saved_state.Saved.into": "plain data becomes a memory of the class of another one",
}


def functions() -> Iterator[tuple[str, str]]:
    for folder in FOLDERS:
        for path in sorted((CORE / folder).rglob("*.py")):
            place = ".".join(path.relative_to(CORE).with_suffix("").parts)
            yield from signatures(tree_of(path), place)


def signatures(tree: ast.AST, place: str) -> Iterator[tuple[str, str]]:
    """Names and annotations of public functions, methods and fields."""
    for node in ast.iter_child_nodes(tree):
        if isinstance(node, ast.AnnAssign) and isinstance(tree, ast.ClassDef):
            name = ast.unparse(node.target)
            if not name.startswith("_"):
                yield f"{place}.{name}", ast.unparse(node.annotation)
        elif isinstance(node, ast.FunctionDef):
            if node.name.startswith("_") and node.name not in ("__init__", "__call__"):
                continue
            a = node.args
            given = [*a.posonlyargs, *a.args, *a.kwonlyargs, a.vararg, a.kwarg]
            for annotation in [*(g.annotation for g in given if g is not None), node.returns]:
                if annotation is not None:
                    yield f"{place}.{node.name}", ast.unparse(annotation)
        elif isinstance(node, ast.ClassDef) and not node.name.startswith("_"):
            yield from signatures(node, f"{place}.{node.name}")


def untyped(name: str, annotation: str) -> bool:
    free = OBJECT.sub("", annotation) if name.startswith(STATED) else (
        annotation.replace("NDArray[Any]", ""))
    return re.search(r"\bAny\b", free) is not None


def test_no_signature_of_core_says_any() -> None:
    found = {name for name, annotation in functions() if untyped(name, annotation)}
    assert found == set(ALLOWED)


@pytest.mark.parametrize("text", [
    "def f(a: Any): ...", "def f(*, a: int) -> list[Any]: ...", "class C:\n    a: Any",
    "class C:\n    def __call__(self, *a: Any): ...", "def f(a: Mapping[str, Any]): ...",
])
def test_the_check_sees_an_any(text: str) -> None:
    assert any(untyped(*s) for s in signatures(ast.parse(text), "model.x"))
