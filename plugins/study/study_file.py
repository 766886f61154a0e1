"""Study file: scene, changes to it that define the runs, and the reference of the errors."""

from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from pydantic import Field, ModelWrapValidatorHandler, ValidationError, model_validator

from sparsemor.core.errors import Fault, InputError
from sparsemor.core.protocols.plugin import Plugin
from sparsemor.core.registry.registry import Registry, suggestions
from sparsemor.core.registry.validation_errors import custom, dotted, with_advice
from sparsemor.core.scene.default_plugins import FULL_ORDER
from sparsemor.core.scene.source import Source
from sparsemor.core.scene.yaml_reader import KeyPath, LocatedError, located
from sparsemor.plugins.study.quantities import QuantityOfInterest
from sparsemor.plugins.study.varied_scene import Subject

FORMS = ("grid", "list", "random")
FULL = {"reducer": FULL_ORDER}


@dataclass(frozen=True, slots=True)
class StudyFault:
    """Fault at a position of the study file."""

    path: KeyPath
    message: str


class RandomSubset(Plugin):
    """Random selection of runs of a grid, without repetition."""

    count: int = Field(ge=1)
    """Number of runs."""
    seed: int = Field(default=0, ge=0)
    """Seed of the selection; the runs themselves use the scene's seed."""
    axes: dict[str, Any] = Field(min_length=1)
    """Axes of the grid, as in `grid`."""


class StudyFile(Plugin):
    """Contents of a study file, with exactly one of `grid`, `list` and `random`."""

    format: Literal[1] = 1
    """Version of the study format."""
    title: str = ""
    """Title of the study, for its report."""
    scene: str = ""
    """Name of a packaged scene, or path of a scene file relative to the study file; empty: a study
    of any scene, which is named with the command."""
    changes: dict[str, Any] = Field(default={}, alias="set")
    """Changes to the scene for all runs, including the reference: dotted key -> value."""
    reference: Literal["fixed", "none"] | dict[str, Any] = FULL
    """Changes that turn a run into its reference: dotted key -> value. `fixed`, or changes under
    the key `fixed`: one reference for all runs; `none`: no reference and no errors."""
    grid: dict[str, Any] | None = Field(default=None, min_length=1)
    """Axis name -> list of values of that key, or named alternatives {label: {key: value}}; every
    combination is a run."""
    listed: list[dict[str, Any]] | None = Field(default=None, alias="list", min_length=1)
    """Changes to the scene for each run, one mapping per run; its key `label` is the name of the
    run."""
    random: RandomSubset | None = None
    """Random selection of runs of a grid."""
    seeds: list[int] = []
    """Seeds: each run is repeated with each of them."""
    method: str | list[str] = []
    """Columns whose values distinguish the lines of the chart; by default all that vary except
    `budget` and the seed."""
    budget: str = ""
    """Column that varies along a line of the chart."""
    errors_from: float = Field(default=0.0, ge=0)
    """Time from which the late errors are evaluated, s."""
    over_time: bool = False
    """Store the errors of each run over time, and draw them: one line per method."""
    quantities: dict[str, QuantityOfInterest] = {}
    """Column -> quantity of interest of each run."""
    keep: bool = False
    """Keep the result of each run next to the table."""

    @model_validator(mode="wrap")
    @classmethod
    def _one_form(cls, data: Any, validate: ModelWrapValidatorHandler["StudyFile"]) -> "StudyFile":
        """Validation that also asks for exactly one form of runs (`FORMS`)."""
        lines = []
        try:
            file = validate(data)
        except ValidationError as error:
            lines = with_advice(cls, error)
        forms = [form for form in FORMS if isinstance(data, dict) and data.get(form) is not None]
        if len(forms) != 1:
            what = f"(got {' and '.join(forms) or 'none'})"
            message = f"a study has exactly one of {', '.join(FORMS)} {what}"
            lines.append(custom("form", message, (forms[1],) if forms else (), None))
        if lines:
            raise ValidationError.from_exception_data("Study", lines)
        return file

    def quantity_faults(
        self, scene: Mapping[str, Any], taken: Collection[str]
    ) -> list[StudyFault]:
        """Faults of quantities that have the name of a column, or name what the scene has not."""
        found = [
            StudyFault(("quantities", name),
                       f"{name} is a column of the results: choose another name")
            for name in self.quantities if name in taken]
        for name, quantity in self.quantities.items():
            for table, needed in quantity.names.items():
                known = list(scene.get(table) or ())
                if needed not in known:
                    found.append(StudyFault(("quantities", name), f"the scene has no {needed!r}: "
                                         f"{suggestions(needed, known, table)}"))
        return found

    @property
    def compared(self) -> bool:
        """True if runs have references."""
        return self.reference != "none"

    @property
    def fixed(self) -> bool:
        """True if all runs have the same reference."""
        return self.reference == "fixed" or "fixed" in self.reference

    @property
    def reference_changes(self) -> dict[str, Any]:
        """Changes to a run's scene that define its reference; the reducer is `full` (full order)
        unless set."""
        if isinstance(self.reference, str):
            return FULL
        changes = self.reference.get("fixed", self.reference)
        return FULL | (changes or {})


@dataclass(frozen=True, slots=True, eq=False)
class Study:
    """Study file after reading and validation of its form.

    scene: the scene that was named with the command, None for that of the file; derived: True if a
    function of the scene made the contents.
    """

    file: StudyFile
    source: Source
    scene: Source | None = None
    derived: bool = False

    @property
    def name(self) -> str:
        own = Path(self.source.document.name).stem or "study"
        return own if self.scene is None else f"{own}_{self.scene.name}"

    @classmethod
    def read(
        cls, study: str | Path | Mapping[str, Any], registry: Registry,
        scene: Source | None = None,
    ) -> "Study":
        """Reads a packaged study, a study file or the contents of one as plain data; scene: that it
        varies instead of its own. Raises `LocatedError` with every fault of its form."""
        source, derived = _source_of(study, registry, scene)
        try:
            read = cls(StudyFile.model_validate(source.tree), source, scene, derived)
        except ValidationError as error:
            raise source.invalid(error) from None
        reference = read.file.reference
        if isinstance(reference, dict) and "fixed" in reference:
            read.check(_of_fixed(reference))
        read.check(_without_effect(read.file))
        return read

    def check(self, findings: Sequence[StudyFault]) -> None:
        """Raises `LocatedError` with all faults, in the order of the file, if there are any."""
        if findings:
            raise self.locate(findings)

    def locate(self, findings: Iterable[StudyFault]) -> LocatedError:
        place = self.source.document.place
        ordered = sorted(set(findings), key=lambda f: (place(f.path), dotted(f.path), f.message))
        name = self.source.document.name
        return LocatedError(
            [Fault(dotted(f.path), f.message) for f in ordered],
            [located(name, place(f.path), dotted(f.path), f.message) if name else
             f"{dotted(f.path)}: {f.message}" for f in ordered])


def _source_of(
    study: str | Path | Mapping[str, Any], registry: Registry, scene: Source | None
) -> tuple[Source, bool]:
    """Contents of a study, and whether a function of the scene made them."""
    if isinstance(study, Mapping):
        return Source.of_tree({"format": 1, **study}, registry), False
    made = registry.load("study", study) if isinstance(study, str) and registry.has(
        "study", study) else None
    if not callable(made):
        return Source.read(study, registry, "study"), False
    if scene is None:
        message = (f"{study} is a study of any scene: name one, as in "
                   f"`sparsemor study {study} double_pendulum`")
        raise LocatedError([Fault("", message)], [message])
    try:
        contents = dict(made(Subject.from_source(scene)))
    except LocatedError:
        raise
    except InputError as error:
        message = f"{study}: {error}"
        raise LocatedError([Fault("", message)], [message]) from None
    return Source.of_tree({"format": 1, **contents}, registry, str(study)), True


def _of_fixed(reference: dict[str, Any]) -> list[StudyFault]:
    if not isinstance(reference["fixed"], dict | None):
        return [StudyFault(("reference", "fixed"), "give changes to the scene, {key: value}")]
    others = [key for key in reference if key != "fixed"]
    return [StudyFault(("reference", key), "move it under `fixed`, the only key allowed here")
            for key in others]


def _without_effect(file: StudyFile) -> list[StudyFault]:
    """Keys about errors in a study without errors."""
    keys = {"errors_from": file.errors_from > 0.0, "over_time": file.over_time}
    return [StudyFault((key,), "has no effect with reference: none, which leaves out the errors: "
                    "remove one of the two")
            for key, used in keys.items() if used and not file.compared]
