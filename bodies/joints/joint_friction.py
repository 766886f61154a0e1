"""Friction in a joint: regularised Coulomb friction on the motion that the joint leaves free."""

from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from typing import Self

import numpy as np
from pydantic import Field, model_validator

from sparsemor.bodies.frames.springs import FRICTION, Numbers, RelativeItem
from sparsemor.bodies.joints.force_element import ForceElementPart, Relative
from sparsemor.bodies.joints.joint_heat import HeatOfFriction, heat_of_friction
from sparsemor.bodies.joints.joint_sides import sides_of
from sparsemor.core import Equations, InputError, Note, Part
from sparsemor.core.protocols.joint import RecordedForce

CYLINDRICAL = 4, 10
"""Numbers of multipliers of a cylindrical joint, alone and with the weld of a massless frame."""


@dataclass(frozen=True, slots=True, eq=False)
class FrictionPart(ForceElementPart):
    """Friction element; joint: name of the joint whose forces it reads, "" for none; heat: what
    becomes of its power; notes: warnings on its options."""

    joint: str = ""
    slides: bool = False
    heat: HeatOfFriction | None = None
    notes: tuple[Note, ...] = ()

    @property
    def _item(self) -> RelativeItem:
        (item,) = self.items
        assert isinstance(item, RelativeItem)
        return item

    @property
    def force(self) -> RecordedForce | None:  # type: ignore[override]
        """The force that is recorded: none that depends on multipliers."""
        return None if self.joint else ForceElementPart.force.fget(self)  # type: ignore[attr-defined]

    def contribute(self, equations: Equations) -> None:
        """Adds the friction force and its heat; of the friction of a joint it is a part of the
        equation of its multipliers, whose size presses the sides together. The item reads the first
        `count` of these (C: their unit columns); held: constraints of massless frames on flexible
        sides; prescribed: the motion of the sides is, and the joint has no multipliers."""
        if not self.joint:
            ForceElementPart.contribute(self, equations)
            self._warm(equations, 0)
            return
        block, d = f"{self.joint}.multiplier", self.sides[0].d
        size = equations.size(block)
        if self.prescribed or not size:
            raise InputError(f"joint {self.joint!r} has no multipliers, whose size the friction "
                             "depends on (of a rigid stage none are passed on): give a `force` "
                             "instead of a coefficient, or name another joint",
                             f"{equations.origin.key}.joint")
        # its first multipliers: forces across the axis of a joint along which a side slides
        # (CYLINDRICAL: numbers of multipliers of a cylindrical one), or all components of the force
        count = d - 1 if self.slides or size in CYLINDRICAL else d
        if size < count:
            raise InputError(f"joint {self.joint!r} has {size} multipliers, and none are the "
                             f"{count} forces that press its sides together",
                             f"{equations.origin.key}.joint")
        if self.held is not None:
            self.held.contribute(equations)
        own, other = self.sides
        assert own.body is not None
        equations.frame(own.body.name, replace(self._item, forces=count), multipliers=block,
                        C=np.eye(size, count), reads=f"{other.reads}.rigid" if other.reads else "")
        self._warm(equations, count)

    def _warm(self, equations: Equations, count: int) -> None:
        """Adds the heat; count: number of joint forces that the law reads."""
        if self.heat is None:
            return
        if self.prescribed:
            self.heat.contribute_along(equations, self._item, self.sides)
        else:
            self.heat.contribute(equations, replace(self._item, forces=count), self.sides,
                                 f"{self.joint}.multiplier" if count else "")


class JointFriction(Relative):
    """Coulomb friction of the angle or distance that a joint of the same sides leaves free.

    Moment (or force) M w (3 - w^2) / 2 against the motion, with w = rate / critical_rate in [-1, 1]
    and M = force + coefficient arm |F|, as the law `coulomb` of a contact; |F|: magnitude of the
    forces of the joint (of a prismatic or cylindrical one those across its axis). Where less than M
    is enough to hold them, the sides creep with a rate below `critical_rate`, in proportion to
    load / (1.5 M). Results store the moment or force on the first side, where it does not depend on
    a joint.
    """

    force: float = Field(default=0.0, ge=0.0)
    """Moment, N m, or force, N, of friction that does not depend on joint forces."""
    joint: str | None = None
    """The joint whose forces press the sides together: `revolute`, `spherical`, `cylindrical` or
    `prismatic`."""
    coefficient: float = Field(default=0.0, ge=0.0)
    """Coefficient of friction."""
    radius: float | None = Field(default=None, gt=0.0)
    """Radius of the pin, m, at which friction acts on a turning motion."""
    critical_rate: float = Field(default=1e-4, gt=0.0)
    """Rate above which the full friction acts, rad/s or m/s."""
    heat: float | None = Field(default=None, ge=0.0, le=1.0)
    """Share of the power of friction that enters the set of the first side as heat; the rest enters
    that of the second. Friction heats nothing when not given."""

    @model_validator(mode="after")
    def _acts(self) -> Self:
        """Checks that the options belong together and that the friction is not zero."""
        if (self.joint is None) is not (self.coefficient == 0.0):
            raise ValueError("joint and coefficient belong together: give both or none")
        if not self.force and self.joint is None:
            raise ValueError("it does nothing: give a force, or a joint with a coefficient")
        if (self.radius is None) is (self.motion == "turn" and self.joint is not None):
            raise ValueError("friction of joint forces on a turn needs the radius of the pin, and "
                             "no other friction has one")
        return self

    def law(self) -> Numbers:
        return FRICTION, self.force, self.coefficient * (self.radius or 1.0), self.critical_rate, 0

    def build(self, name: str, parts: Mapping[str, Part]) -> FrictionPart:
        made = super().build(name, parts)
        heat, notes = heat_of_friction(
            name, sides_of(parts, self.between, self.dimensions), self.heat, parts)
        return FrictionPart(
            **{f.name: getattr(made, f.name) for f in fields(made)}, joint=self.joint or "",
            slides=self.motion == "slide", heat=heat, notes=notes)
