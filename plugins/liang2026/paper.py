"""Paper file: the runs, studies, figures and tables of a publication, with its numbers."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any, Literal

from pydantic import Field, ValidationError, model_validator

from sparsemor.core.protocols.plugin import Plugin
from sparsemor.core.registry.registry import Registry
from sparsemor.core.scene.expressions import Expression
from sparsemor.core.scene.source import Source
from sparsemor.plugins.liang2026.pictures import Picture
from sparsemor.plugins.liang2026.quantities import Quantity, study

GRADES = ("better", "reproduced", "in part")
"""Verdicts that a rule may give, the best first; an item that meets none is `not reproduced`."""
MISSED, BROKEN = "not reproduced", "not computed"
Grade = Literal["better", "reproduced", "in part"]


class PaperEntry(Plugin):
    """A run or study that one or more items need."""

    quick: dict[str, Any] = {}
    """With `--quick`: further changes to the scene, or keys of the study file that are replaced;
    `set` and `grid` are merged with the file's."""
    after: str = ""
    """Run that must have ended first, because it leaves its snapshots in the cache."""


class RunEntry(PaperEntry):
    """A run of a scene."""

    scene: str
    """Packaged scene, or path of a scene file relative to the paper file."""
    changes: dict[str, Any] = Field(default={}, alias="set")
    """Changes to the scene: dotted key -> value."""
    profile: int = Field(default=100, ge=1)
    """Number of steps of the separate profiled pass, where an item needs the split of the computing
    time."""


class StudyEntry(PaperEntry):
    """A study."""

    study: str
    """Packaged study."""


class Value(Plugin):
    """One number (or text) of an item: ours, and the published one where the paper has it."""

    label: str
    """Label for tables."""
    unit: str = ""
    """Unit, "" for ratios and counts."""
    paper: float | str | None = None
    """Published value."""
    of: Quantity
    """The quantity that is computed."""


class PaperItem(Plugin):
    """One figure or table: what it shows, what is computed, and the rule of its verdict."""

    id: str = Field(pattern=r"^(fig|table)_\d+$")
    """`fig_N` or `table_N`."""
    scene: str
    """Scene under which it is listed."""
    title: str
    """What it shows, in one line."""
    published: str
    """What the paper reports, in words."""
    values: dict[str, Value] = Field(min_length=1)
    """Name -> number."""
    verdict: dict[Grade, str] = Field(min_length=1)
    """Verdict -> condition on the values; the first that holds, best first, is given."""
    remark: str = ""
    """What to know about the comparison."""
    shortfall: str = ""
    """Reason shown if the verdict is neither `better` nor `reproduced`."""
    pictures: list[Picture] = []
    """Pictures of our runs."""

    @property
    def name(self) -> str:
        """Name as printed, such as `Fig. 4`."""
        kind, number = self.id.split("_")
        return f"{'Fig.' if kind == 'fig' else 'Table'} {number}"

    @model_validator(mode="after")
    def _rules_use_known_names(self) -> "PaperItem":
        for grade, text in self.verdict.items():
            unknown = {*rule(text).names} - {*self.values, *(f"paper_{n}" for n in self.values)}
            if unknown:
                raise ValueError(f"{self.id}: {grade}: unknown names {', '.join(sorted(unknown))}")
        return self

    @property
    def runs(self) -> tuple[str, ...]:
        """Names of the runs that it needs, in order, each once."""
        return tuple(dict.fromkeys(n for part in self._parts() for n in part.runs))

    @property
    def studies(self) -> tuple[str, ...]:
        """Names of the studies that it needs."""
        return tuple(dict.fromkeys(n for part in self._parts() for n in part.studies))

    def _parts(self) -> list[Any]:
        return [*(v.of for v in self.values.values()), *self.pictures]

    def grade(self, values: Mapping[str, Any]) -> str:
        """Verdict whose rule the values meet, the best first."""
        return next((g for g, text in sorted(self.verdict.items(), key=lambda r: GRADES.index(r[0]))
                     if rule(text).value(values)), MISSED)


class PaperFile(Plugin):
    """Contents of a paper file."""

    format: Literal[1] = 1
    """Version of the format of paper files."""
    title: str
    """Authors and title of the publication."""
    source: str
    """Where it is published."""
    scenes: dict[str, str] = Field(min_length=1)
    """Scene -> title of its page."""
    matrix_operations: list[str] = []
    """Functions, `file.py:Class.name`, that count as matrix operations in the split of the
    computing time."""
    runs: dict[str, RunEntry] = {}
    """Runs by name."""
    studies: dict[str, StudyEntry] = {}
    """Studies by name."""
    items: list[PaperItem] = Field(min_length=1)
    """Figures and tables."""

    @classmethod
    def read(cls, paper: str | Path, registry: Registry) -> "PaperFile":
        """Reads a packaged paper or a paper file. Raises `LocatedError` with every fault."""
        source = Source.read(paper, registry, "paper")
        try:
            file = cls.model_validate(source.tree)
        except ValidationError as error:
            raise source.invalid(error) from None
        folder = source.folder or Path()
        # scene files next to the paper file, by their whole path
        near = {name: entry.model_copy(update={"scene": str(folder / entry.scene)})
                for name, entry in file.runs.items() if (folder / entry.scene).is_file()}
        return file.model_copy(update={"runs": {**file.runs, **near}})

    @property
    def entries(self) -> Mapping[str, RunEntry | StudyEntry]:
        """Runs and studies by name."""
        return {**self.runs, **self.studies}

    def rows_read(self, name: str) -> list[Mapping[str, Any]]:
        """Column -> value of the rows of a study that items read."""
        return [dict(v.of)["where"] for i in self.items for v in i.values.values()
                if type(v.of).function is study and name in v.of.studies]

    @model_validator(mode="after")
    def _names_exist(self) -> "PaperFile":
        """Checks that scenes, runs and studies that items name exist."""
        faults = []
        for i in self.items:
            faults += [f"{i.id}: no scene {i.scene!r}"] * (i.scene not in self.scenes)
            faults += [f"{i.id}: no run {n!r}" for n in i.runs if n not in self.runs]
            faults += [f"{i.id}: no study {n!r}" for n in i.studies if n not in self.studies]
        # a run that others wait for waits for none
        faults += [f"{name}: no run {e.after!r}" for name, e in self.entries.items()
                   if e.after and (e.after not in self.runs or self.runs[e.after].after)]
        faults += [f"{name}: a run and a study have this name"
                   for name in sorted({*self.runs} & {*self.studies})]
        ids = [i.id for i in self.items]
        faults += [f"{i}: twice" for i in sorted({i for i in ids if ids.count(i) > 1})]
        if faults:
            raise ValueError("; ".join(faults))
        return self


def rule(text: str) -> Expression:
    """Condition on the numbers and texts of an item. Raises InputError if it is none."""
    return Expression.parse(text, "condition", texts=True)
