"""The smaller parts of a scene."""

from typing import Annotated, Any

from pydantic import Field, model_validator

from sparsemor.core.errors import InputError
from sparsemor.core.plugin import Plugin


class Time(Plugin):
    """The clock of a run, which starts at 0 s."""

    end: float = Field(gt=0)
    """When the run ends, s."""
    step: float = Field(gt=0)
    """Length of a time step, s."""

    @model_validator(mode="after")
    def _one_step_fits(self) -> "Time":
        if self.step > self.end:
            message = f"the step must not exceed time.end = {self.end:g} s (given: {self.step:g})"
            raise InputError(message, "step")
        return self


class Training(Plugin):
    """The full-order run whose snapshots a reduced run learns from."""

    end: float | None = Field(default=None, gt=0)
    """When the training run ends, s; time.end when not given."""
    every: int = Field(default=1, ge=1)
    """Every how many steps a snapshot is taken."""
    overrides: dict[str, Any] = {}
    """Changes to the scene for the training run: dotted key -> value."""


class Output(Plugin):
    """What a run keeps."""

    every: int = Field(default=1, ge=1)
    """Every how many steps the state is stored."""


class Probe(Plugin):
    """A point whose motion and temperature are recorded."""

    body: str
    """The body's name."""
    at: str | Annotated[list[float], Field(min_length=2, max_length=3)]
    """A point set of the body (the mean of its nodes), or coordinates, m (the nearest node)."""
