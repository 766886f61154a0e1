"""PID controller: a function of time that follows from a sensor and its target."""

from collections.abc import Sequence
from typing import Self

from pydantic import Field, model_validator

from sparsemor.core import Controller, FloatArray
from sparsemor.plugins.functions import Part


class Pid(Controller):
    """PID controller: value kp e + ki (integral of e) - kd s', with the error e = target - s of the
    sensor s, in the place of a function of time.

    It is computed at the beginning of each step from the last accepted state and constant over the
    step (zero-order hold): a delay of half a step. The integral is a sum of e h, which is not
    increased while the value is beyond a limit; s' is the difference of two steps, zero in the
    first. The derivative acts on the sensor, so that jumps of the target make none of it.
    """

    sensor: str
    """Quantity that is controlled: of a probe (`tip.x`, `tip.u_y`, `tip.temperature`), a rigid
    coordinate or its rate (`arm.rigid.angle`, `arm.rigid.angle_rate`), a joint force
    (`pin.force_x`)."""
    target: Part = Field(default=0.0, validate_default=True)
    """Target of the sensor, a number or a function of time."""
    kp: float = 0.0
    """Proportional gain, in the unit of the value over that of the sensor."""
    ki: float = 0.0
    """Integral gain, per s."""
    kd: float = 0.0
    """Derivative gain, times s."""
    lower: float | None = None
    """Smallest value; no limit when not given."""
    upper: float | None = None
    """Largest value; no limit when not given."""

    @model_validator(mode="after")
    def _acts(self) -> Self:
        if not (self.kp or self.ki or self.kd):
            raise ValueError("it does nothing: give kp, ki or kd")
        if self.lower is not None and self.upper is not None and self.lower >= self.upper:
            raise ValueError(f"lower {self.lower:g} must be below upper {self.upper:g}")
        return self

    @property
    def sensors(self) -> Sequence[str]:
        return (self.sensor,)

    def begin(self) -> Sequence[float]:
        """Integral of the error, last value of the sensor, and 1 from the second step on."""
        return 0.0, 0.0, 0.0

    def update(
        self, t: float, h: float, sensed: FloatArray, memory: tuple[float, ...]
    ) -> tuple[float, tuple[float, ...]]:
        """Value k_p e + k_i (integral of e) - k_d ds/dt from the sensor s and the error e = target
        - s; the integral stops where the value is limited (anti-windup). t, h: start and size of
        the step in which it acts, s; sensed (1,): s; memory: as of `begin`, returned for the next
        step."""
        integral, last, begun = memory
        s = float(sensed[0])
        e = self.target.value(t) - s
        rate = (s - last) / h if begun else 0.0
        whole = self.kp * e + self.ki * (integral + e * h) - self.kd * rate
        value = whole
        if self.lower is not None:
            value = max(value, self.lower)
        if self.upper is not None:
            value = min(value, self.upper)
        return value, (integral + e * h if value == whole else integral, s, 1.0)
