"""Options of a scene: time, training, rigid stage, output, probes."""

from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any

from pydantic import Field, model_validator

from sparsemor.core.errors import InputError
from sparsemor.core.protocols.layout import FieldKind
from sparsemor.core.protocols.plugin import Plugin
from sparsemor.core.scene.overrides import split
from sparsemor.core.scene.parameters_and_training_points import BoxTraining
from sparsemor.core.scene.varying_loads import VaryingLoads

_NOT_SIZES = frozenset({"tolerance", "max_halvings", "fields"})
"""Options of `Control` that are not reference sizes of a field."""


class Control(Plugin):
    """Adaptive time stepping by step doubling: each output step is subdivided until the local error
    estimate meets the tolerance."""

    tolerance: float = Field(gt=0, lt=1)
    """Error tolerance of the whole run; a step of length h may contribute the share h / end.
    Relative to the root mean square change of a block (one field of one body) since its start, or
    to the reference sizes below where these are larger."""
    max_halvings: int = Field(default=8, ge=1, le=24)
    """Largest number of halvings of a step; where more are needed the run ends as
    `step_too_long`."""
    rigid: float = Field(default=1.0, gt=0)
    """Reference size of changes of rigid coordinates, m and rad."""
    elastic: float = Field(default=1e-3, gt=0)
    """Reference size of displacements, m."""
    thermal: float = Field(default=100.0, gt=0)
    """Reference size of temperature changes, K."""
    fields: dict[str, Annotated[float, Field(gt=0)]] = {}
    """Reference sizes of changes of other fields, by the field's name."""

    def size_of(self, kind: FieldKind) -> float:
        """Reference size of changes of a field; by default the scale of its kind."""
        own = {name: size for name, size in self if name not in _NOT_SIZES}
        return float({**own, **self.fields}.get(kind.name, kind.scale))


class Time(Plugin):
    """Time span and step of a run, which starts at 0 s."""

    end: float = Field(gt=0)
    """End time of the run, s."""
    step: float = Field(gt=0)
    """Length of a time step, s."""
    control: Control | None = None
    """Adaptive time stepping; `step` remains the interval of stored states. Left out: fixed
    steps."""

    @model_validator(mode="after")
    def _one_step_fits(self) -> "Time":
        if self.step > self.end:
            message = f"the step must not exceed time.end = {self.end:g} s (got {self.step:g})"
            raise InputError(message, "step")
        return self


class Training(Plugin):
    """Full-order training run, whose snapshots define the reduced model."""

    end: float | None = Field(default=None, gt=0)
    """End time of the training run, s; `time.end` by default."""
    every: int = Field(default=1, ge=1)
    """Number of steps between snapshots."""
    overrides: dict[str, Any] = {}
    """Changes to the scene for the training run: dotted key -> value."""
    parameters: BoxTraining | None = None
    """Several training runs, at points of the box of the scene's parameters. Left out: one run,
    with the values of the scene."""
    loads: VaryingLoads | None = None
    """Loads that may vary: `varying` for all, names, or names with a range of their function of
    time, whose default is minus to plus its largest value in the run. Training runs replace them
    by impulses, steps and ramps, one run for each alone and three for all together. Left out: the
    loads of the scene."""

    @property
    def several(self) -> bool:
        """True if there are several training runs, or one with changes of its own."""
        return self.parameters is not None or self.loads is not None

    @model_validator(mode="after")
    def _of_the_problem(self) -> "Training":
        for key in self.overrides:
            if split(key)[0] in ("reducer", "training"):
                raise InputError(f"{key} has no effect on the training run, which is of full order "
                                 "and stored as `training` sets: remove it", f"overrides.{key}")
        return self


class Initial(Plugin):
    """Initial state from a stored result with the same meshes; time starts at 0 s again."""

    result: str
    """Directory of the result; a relative path starts from the working directory, as `--out`."""
    time: float | None = Field(default=None, ge=0)
    """Time in that run, s (the closest stored one); left out: its last."""

    def files(self, base: Path) -> Sequence[Path]:
        """Header and last steps of the result, which change with it."""
        store = Path(self.result) / "result"
        store = store if store.is_dir() else store.parent
        return [*store.glob("header.json"), *sorted(store.glob("steps-*.npz"))[-1:]]


class RigidStage(Plugin):
    """Rigid-body pre-simulation of the same scene; its motion and forces over time are prescribed
    in the flexible run."""

    overrides: dict[str, Any] = {}
    """Changes to the scene for the pre-simulation alone: dotted key -> value."""


class Output(Plugin):
    """Output options of a run."""

    every: int = Field(default=1, ge=1)
    """Number of steps between stored states."""


class Probe(Plugin):
    """Material point whose motion and temperature are recorded."""

    body: str
    """Name of the body."""
    at: str | Annotated[list[float], Field(min_length=2, max_length=3)]
    """Point set of the body (the mean of its nodes), or coordinates, m (the nearest node)."""
    stress: bool = False
    """Record the stress there, too, in body axes, and the von Mises stress, Pa."""
