"""Axes of a study, and the changes to the scene in each of its runs."""

import json
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import product
from math import prod
from typing import Any

import numpy as np

from sparsemor.core.registry.registry import suggestions
from sparsemor.core.registry.validation_errors import dotted
from sparsemor.core.scene.overrides import split
from sparsemor.core.scene.yaml_reader import KeyPath
from sparsemor.plugins.study.study_file import RandomSubset, Study, StudyFault, StudyFile
from sparsemor.plugins.study.table_columns import OF_CHARTS, RESERVED

LABEL, SEED = "label", "seed"


@dataclass(frozen=True, slots=True)
class AxisValue:
    """One value of an axis of a study.

    columns: column -> value in the table; changes: key of the scene -> value; owners: key of the
    scene -> its position in the study file; place: position of the value itself; details: columns
    of the individual changes of a named alternative.
    """

    columns: Mapping[str, Any]
    changes: Mapping[str, Any]
    owners: Mapping[str, KeyPath]
    place: KeyPath
    details: Mapping[str, Any] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class Point:
    """One combination of axis values, which defines a run. settings: column of the table -> value;
    changes, owners: key of the scene -> value, and its position in the study file; places:
    positions of the axis values."""

    choices: tuple[AxisValue, ...]

    @property
    def settings(self) -> dict[str, Any]:
        return {k: v for c in self.choices for k, v in {**c.columns, **c.details}.items()}

    @property
    def changes(self) -> dict[str, Any]:
        return {k: v for c in self.choices for k, v in c.changes.items()}

    @property
    def owners(self) -> dict[str, KeyPath]:
        return {k: v for c in self.choices for k, v in c.owners.items()}

    @property
    def places(self) -> tuple[KeyPath, ...]:
        return tuple(c.place for c in self.choices)


Axis = Sequence[AxisValue]


def points_of(study: Study) -> list[Point]:
    """All runs of a study in order; the last axis varies fastest. Raises `LocatedError` with all
    faults of the axes (`Study.check`)."""
    file = study.file
    axes, findings = _axes(file)
    if file.seeds:
        where: KeyPath = ("seeds",)
        findings += _repeated(file.seeds, where)
        findings += [StudyFault((*where, i), f"a seed is at least 0 (got {s})")
                     for i, s in enumerate(file.seeds) if s < 0]
        findings += [StudyFault(where, f"the seed is also changed at {dotted(owner)}")
                     for axis in axes for choice in axis
                     for key, owner in choice.owners.items() if key == SEED][:1]
    count = prod(len(axis) for axis in axes)
    if file.random is not None and file.random.count > count:
        findings.append(StudyFault(
            ("random", "count"), f"the axes have {count} combinations: take at most that many "
            f"(got {file.random.count})"))
    study.check(findings)
    seeds = [_plain(SEED, s, ("seeds", i)) for i, s in enumerate(file.seeds)]
    combined = [Point(choices) for choices in _combinations(axes, file.random)]
    points = [Point((*p.choices, s)) for p in combined for s in seeds] if seeds else combined
    study.check(_of_chart(file, points))
    return points


def setting_columns(points: Sequence[Point]) -> list[str]:
    """Columns of the changed options: axes, then details of named alternatives, the seed last; a
    run may lack some of them."""
    names, details = dict.fromkeys(name for p in points for name in p.settings), _details(points)
    return sorted(names, key=lambda n: (n == SEED, n in details))


def axis_columns(points: Sequence[Point]) -> list[str]:
    """Columns of the axes, without the details of named alternatives."""
    details = _details(points)
    return [n for n in setting_columns(points) if n not in details]


def _details(points: Sequence[Point]) -> set[str]:
    return {name for p in points for c in p.choices for name in c.details}


def chart_columns(file: StudyFile, points: Sequence[Point]) -> list[str]:
    """Columns whose values distinguish the lines of the work-precision chart."""
    if file.method:
        return [file.method] if isinstance(file.method, str) else list(file.method)
    names = [n for n in axis_columns(points) if n not in (SEED, file.budget)]
    if LABEL in names and file.budget != LABEL:
        return [LABEL]
    several = [n for n in names if len({json.dumps(p.settings.get(n)) for p in points}) > 1]
    return several or names


def _axes(file: StudyFile) -> tuple[list[Axis], list[StudyFault]]:
    """Axes of a study and their faults; no two axes may change the same key."""
    if file.listed is not None:
        return _list_axis(file.listed)
    where, written = _written(file)
    axes: list[Axis] = []
    findings: list[StudyFault] = []
    owned: dict[tuple[str | int, ...], str] = {}  # changed key of the scene -> its axis
    for name, values in written.items():
        faults = _axis_faults(name, values, (*where, name))
        findings += faults
        if faults:
            continue
        axis = _axis(name, values, (*where, name))
        for key in dict.fromkeys(k for c in axis for k in c.changes):
            other = owned.setdefault(split(key), name)
            if other != name:
                findings.append(StudyFault(
                    (*where, name), f"{key} is also changed by the axis {other}: no two axes "
                    "change the same key"))
        axes.append(axis)
    return axes, findings


def _written(file: StudyFile) -> tuple[KeyPath, Mapping[str, Any]]:
    """Position and content of the axes in the study file."""
    if file.grid is not None:
        return ("grid",), file.grid
    return ("random", "axes"), file.random.axes if file.random else {}


def _list_axis(items: Sequence[Mapping[str, Any]]) -> tuple[list[Axis], list[StudyFault]]:
    axis, findings = [], []
    for i, item in enumerate(items):
        changes = {k: v for k, v in item.items() if k != LABEL}
        owners: dict[str, KeyPath] = {k: ("list", i, k) for k in changes}
        axis.append(AxisValue(dict(item), changes, owners, ("list", i)))
        if isinstance(item.get(LABEL, ""), dict | list):
            findings.append(StudyFault(("list", i, LABEL), "a label is a text or a number"))
    findings += _repeated(items, ("list",))
    return [axis], findings


def _axis(name: str, values: Any, where: KeyPath) -> Axis:
    if isinstance(values, list):
        return [_plain(name, v, (*where, i)) for i, v in enumerate(values)]
    return [_named(name, label, dict(changes or {}), (*where, label))
            for label, changes in values.items()]


def _plain(name: str, value: Any, place: KeyPath) -> AxisValue:
    return AxisValue({name: value}, {name: value}, {name: place}, place)


def _named(name: str, label: str, changes: dict[str, Any], place: KeyPath) -> AxisValue:
    return AxisValue({name: _number(label)}, changes, {k: (*place, k) for k in changes}, place,
                  {f"set.{k}": v for k, v in changes.items()})


def _number(label: str) -> Any:
    """Label of a named alternative as a number where possible: YAML keys are read as text."""
    for kind in (int, float):
        try:
            return kind(label)
        except ValueError:
            continue
    return label


def _axis_faults(name: str, values: Any, where: KeyPath) -> list[StudyFault]:
    if isinstance(values, list) and values:
        return _repeated(values, where)
    if not isinstance(values, dict) or not values:
        return [StudyFault(where, "an axis is a list of values of that key, or named alternatives "
                        "{label: {key: value}}, at least one")]
    findings = [StudyFault((*where, label), "an alternative is a mapping {key: value}")
                for label, changes in values.items() if not isinstance(changes, dict | None)]
    if name in RESERVED:
        findings.append(_taken(name, where))
    return findings


def taken_names(file: StudyFile, columns: Iterable[str]) -> list[StudyFault]:
    """Faults of axes with named alternatives whose names equal one of these result columns."""
    where, written = _written(file)
    return [_taken(name, (*where, name)) for name, values in written.items()
            if isinstance(values, dict) and name in set(columns)]


def _taken(name: str, where: KeyPath) -> StudyFault:
    return StudyFault(where, f"{name} is a column of the results: choose another name")


def _repeated(values: Sequence[Any], where: KeyPath) -> list[StudyFault]:
    first_of: dict[str, int] = {}
    findings = []
    for i, value in enumerate(values):
        first = first_of.setdefault(json.dumps(value, sort_keys=True), i)
        if first != i:
            findings.append(StudyFault((*where, i), f"the same as item {first}: remove one"))
    return findings


def _combinations(axes: Sequence[Axis], some: RandomSubset | None) -> list[tuple[AxisValue, ...]]:
    if some is None:
        return list(product(*axes))
    shape = tuple(len(axis) for axis in axes)
    rng = np.random.default_rng(some.seed)
    chosen = np.sort(rng.choice(prod(shape), some.count, replace=False))
    return [tuple(axis[int(i)] for axis, i in zip(axes, np.unravel_index(n, shape), strict=True))
            for n in chosen]


def _of_chart(file: StudyFile, points: Sequence[Point]) -> list[StudyFault]:
    names = setting_columns(points)
    lines = [file.method] if isinstance(file.method, str) else file.method
    named: list[tuple[KeyPath, str]] = [
        (("method",) if isinstance(file.method, str) else ("method", i), name)
        for i, name in enumerate(lines)]
    if file.budget and file.budget not in OF_CHARTS:
        named.append((("budget",), file.budget))
    return [
        StudyFault(path, f"nothing of that name varies: {suggestions(name, names, 'there are')}")
        for path, name in named if name not in names]
