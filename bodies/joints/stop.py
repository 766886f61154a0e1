"""Limits of a joint: one-sided springs with damping."""

from typing import Self

from pydantic import Field, model_validator

from sparsemor.bodies.frames.relative import STOP, Numbers
from sparsemor.bodies.joints.relative import RECORDED, Relative

NONE = 1e300
"""Angle or distance of a limit that is not given."""


class Stop(Relative):
    """Limits of the angle or distance that a joint of the same sides leaves free.

    Beyond a limit by the depth s acts the force stiffness s (1 + damping s') against it, never less
    than zero (Hunt and Crossley 1975, doi 10.1115/1.3423596). A body that meets the limit with the
    speed v leaves it with e v, where the restitution e follows from D = damping v alone, whatever
    the mass: D (1 + e) = ln((1 + D) / (1 - e D)), about e = 1 - 2/3 D for small D. Results store
    the force or moment on the first side.
    """

    lower: float | None = Field(default=None, le=0.0)
    """Lower limit, rad or m, measured from the start; none when not given."""
    upper: float | None = Field(default=None, ge=0.0)
    """Upper limit, rad or m, measured from the start; none when not given."""
    stiffness: float = Field(gt=0.0)
    """Stiffness, N m/rad or N/m."""
    damping: float = Field(default=0.0, ge=0.0)
    """Damping factor, s/rad or s/m: the restitution is 0.94 at a damping times speed
    of 0.1, 0.75 at 0.5, 0.59 at 1."""

    @model_validator(mode="after")
    def _limits(self) -> Self:
        if self.lower is None and self.upper is None:
            raise ValueError("it limits nothing: give lower, upper or both")
        return self

    @property
    def recorded(self) -> tuple[str, str]:  # type: ignore[override]
        return RECORDED[self.motion]

    def law(self) -> Numbers:
        lower, upper = (f if x is None else x for x, f in ((self.lower, -NONE), (self.upper, NONE)))
        return STOP, lower, upper, self.stiffness, self.damping

    @property
    def centre(self) -> float:
        """Between the limits, or the one limit."""
        given = [x for x in (self.lower, self.upper) if x is not None]
        return sum(given) / len(given)
