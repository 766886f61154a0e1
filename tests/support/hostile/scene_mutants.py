"""Damaged scene files: those of the tests, changed at random from a seed, as tree or as text."""

import copy
import json
from collections.abc import Callable, Iterator
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from sparsemor.core.scene.yaml_reader import parse

SCENES = Path(__file__).parents[2] / "scenes"
OFTEN = ("tiny",) * 6 + ("small_slider", "small_brake", "heated_disk")
"""Names of the files, the quick one more often."""

VALUES: tuple[Any, ...] = (
    None, True, False, 0, 1, -1, 3, 10**12, 10**30, 0.5, -0.0, 1e-300, 1e300, -1e12, "", "x",
    "left", "ground", "bar:left", "bar", "x > 0", "1e-3", "nan", [], [0], [1, 2, 3],
    [[1, 2], [3, 4]], {},
    {"use": "lhs"}, {"use": "sine", "amplitude": 1e3, "frequency": 5}, {"use": "full"}, "galerkin",
    {"clamp": "left"}, "\u0000", "\U0001f600", "a" * 300, "~" * 1500 + "x")

Tree = Any
Path_ = tuple[Any, ...]


@cache
def texts() -> dict[str, str]:
    return {name: (SCENES / f"{name}.yaml").read_text(encoding="utf-8") for name in set(OFTEN)}


@cache
def trees() -> dict[str, Tree]:
    return {name: parse(text, name).tree for name, text in texts().items()}


def mutants(seed: int, count: int) -> Iterator[tuple[str, str]]:
    """(what was done, text) of `count` damaged scenes."""
    for number in range(count):
        rng = np.random.default_rng([seed, number])
        name = OFTEN[int(rng.integers(len(OFTEN)))]
        tree, text, done = copy.deepcopy(trees()[name]), texts()[name], []
        as_text = rng.random() < 0.2
        for _ in range(int(rng.choice([1, 1, 2, 3]))):
            if as_text:
                change = TEXT_CHANGES[int(rng.integers(len(TEXT_CHANGES)))]
                text = change(text, rng)
                done.append(change.__name__.strip("_"))
            else:
                changed = TREE_CHANGES[int(rng.integers(len(TREE_CHANGES)))]
                done.append(f"{changed.__name__.strip('_')} {changed(tree, rng)}")
        yield (f"[{seed}, {number}] {name}: {', '.join(done)}",
               text if as_text else json.dumps(tree))


def _nodes(tree: Tree, path: Path_ = ()) -> list[Path_]:
    """The path of everything below the root."""
    items = tree.items() if isinstance(tree, dict) else (
        enumerate(tree) if isinstance(tree, list) else ())
    return [p for key, value in items for p in ((*path, key), *_nodes(value, (*path, key)))]


def _some(tree: Tree, rng: np.random.Generator) -> Path_:
    nodes = _nodes(tree)
    return nodes[int(rng.integers(len(nodes)))] if nodes else ()


def _at(tree: Tree, path: Path_) -> Tree:
    for key in path:
        tree = tree[key]
    return tree


def _put(tree: Tree, path: Path_, value: Any) -> None:
    if path:
        _at(tree, path[:-1])[path[-1]] = value


def _removed(tree: Tree, rng: np.random.Generator) -> Path_:
    path = _some(tree, rng)
    if path:
        del _at(tree, path[:-1])[path[-1]]
    return path


def _retyped(tree: Tree, rng: np.random.Generator) -> Path_:
    path = _some(tree, rng)
    _put(tree, path, copy.deepcopy(VALUES[int(rng.integers(len(VALUES)))]))
    return path


def _scaled(tree: Tree, rng: np.random.Generator) -> Path_:
    """A number times a power of ten, or with the other sign."""
    numbers = [p for p in _nodes(tree)
               if isinstance(_at(tree, p), int | float) and not isinstance(_at(tree, p), bool)]
    if not numbers:
        return ()
    path = numbers[int(rng.integers(len(numbers)))]
    factor = float(rng.choice([-1.0, 0.0, 1e-12, 1e-3, 0.1, 3.0, 10.0, 1e3, 1e9, 1e120, 1e280]))
    value = factor * _at(tree, path)
    whole = isinstance(_at(tree, path), int) and value == round(value)
    _put(tree, path, round(value) if whole else value)
    return (*path, factor)


def _swapped(tree: Tree, rng: np.random.Generator) -> Path_:
    one, other = _some(tree, rng), _some(tree, rng)
    if one and other and one != other[:len(one)] and other != one[:len(other)]:
        first, second = _at(tree, one), _at(tree, other)
        _put(tree, one, second)
        _put(tree, other, first)
    return (*one, "with", *other)


def _doubled(tree: Tree, rng: np.random.Generator) -> Path_:
    """Once more, under another name or further on in the list."""
    path = _some(tree, rng)
    if path:
        parent, value = _at(tree, path[:-1]), copy.deepcopy(_at(tree, path))
        if isinstance(parent, list):
            parent.append(value)
        else:
            parent[f"{path[-1]}2"] = value
    return path


def _renamed(tree: Tree, rng: np.random.Generator) -> Path_:
    path = _some(tree, rng)
    if path and isinstance(_at(tree, path[:-1]), dict):
        parent = _at(tree, path[:-1])
        parent[str(path[-1])[::-1]] = parent.pop(path[-1])
    return path


def _reduced(tree: Tree, rng: np.random.Generator) -> Path_:
    name = str(rng.choice(["galerkin", "sparse", "deim", "ecsw", "lspg", "gnat", "full"]))
    if isinstance(tree, dict):
        tree["reducer"] = {"use": name, "basis": {"use": "pod", "count": int(rng.integers(1, 9))}}
    return (name,)


def _bytes(text: str, rng: np.random.Generator) -> str:
    letters = list(text)
    for at in rng.integers(len(letters), size=int(rng.integers(1, 6))) if letters else ():
        letters[at] = chr(int(rng.choice([0, 9, 10, 33, 34, 38, 42, 44, 45, 58, 63, 91, 93, 123,
                                          124, 125, 126, 0xE9, 0x2028, 0x1F600])))
    return "".join(letters)


def _cut(text: str, rng: np.random.Generator) -> str:
    return text[: int(rng.integers(len(text) + 1))]


def _lines(text: str, rng: np.random.Generator) -> str:
    lines = text.splitlines(keepends=True)
    if lines:
        i, j = rng.integers(len(lines), size=2)
        lines[i], lines[j] = lines[j], lines[i]
        del lines[int(rng.integers(len(lines)))]
    return "".join(lines)


def _nested(text: str, rng: np.random.Generator) -> str:
    at = int(rng.integers(len(text) + 1))
    return text[:at] + str(rng.choice(["[", "{a: ", "- ", "? ", "&a *a"])) * int(
        rng.integers(1, 3000)) + text[at:]


TREE_CHANGES: tuple[Callable[[Tree, np.random.Generator], Path_], ...] = (
    _removed, _retyped, _retyped, _scaled, _scaled, _scaled, _swapped, _doubled, _renamed, _reduced)
TEXT_CHANGES: tuple[Callable[[str, np.random.Generator], str], ...] = (
    _bytes, _cut, _lines, _nested)
