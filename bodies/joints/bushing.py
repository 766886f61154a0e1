"""Bushing: springs and dampers between two frames along and about the axes of one of them."""

from typing import Annotated, ClassVar

import numpy as np
from pydantic import Field

from sparsemor.bodies.frames.springs import RelativeItem, linear
from sparsemor.bodies.initial_pose import Vector
from sparsemor.bodies.joints.force_element import ForceElement, ItemForce, relative_item
from sparsemor.bodies.joints.joint_sides import Side, unit
from sparsemor.core import FloatArray, InputError

Size = Annotated[float, Field(ge=0.0)]


class Bushing(ForceElement):
    """Elastic bushing: springs and dampers on the relative displacement of two points along the
    axes of the second side, and on the relative angles about them, all relaxed at the start.

    Forces stiffness q + damping q', N or N m. Angles about several axes are independent to first
    order: for large ones about one axis only. Results store the force on the first side along the
    first axis.
    """

    turns: ClassVar[bool] = True
    recorded: ClassVar[tuple[str, str]] = ("force", "N")

    stiffness: list[Size]
    """Stiffness along each axis, N/m: two numbers in the plane, three in space."""
    damping: list[Size] | None = None
    """Damping along each axis, N s/m; zero when not given."""
    turning_stiffness: list[Size] | None = None
    """Stiffness about each axis, N m/rad: one number in the plane, three in space; zero when not
    given."""
    turning_damping: list[Size] | None = None
    """Damping about each axis, N m s/rad; zero when not given."""
    axis: Vector | None = None
    """Direction of the first axis at the start (space axes); x when not given."""
    second_axis: tuple[float, float, float] | None = None
    """In space: direction of the second axis, perpendicular to the first; y when not given."""

    def item(self, own: Side, other: Side, first: bool) -> RelativeItem:
        return self.items(own, other, first)[0]

    def _law(self, item: object, first: bool) -> ItemForce:
        assert isinstance(item, RelativeItem)
        return ItemForce(item, -1.0)

    def items(self, own: Side, other: Side, first: bool) -> tuple[RelativeItem, ...]:
        """Springs and dampers along the axes, then about them, without those that do nothing but
        for the first, which is recorded. first: True if `own` is the first side of the scene. law:
        kind, stiffness, damping, .. of each."""
        d, axes = own.d, self._axes(own.d)
        found = []
        for key, count, motion in (("", d, "slide"), ("turning_", 2 * d - 3, "turn")):
            k = self._numbers(f"{key}stiffness", count)
            c = self._numbers(f"{key}damping", count)
            # in the plane the one angle has no axis
            about = axes if d == 3 or motion == "slide" else np.zeros((1, 2))
            found += [relative_item(motion, e, own, other, first, linear(ki, ci))
                      for e, ki, ci in zip(about, k, c, strict=True)]
        if not any(i.law[1] or i.law[2] for i in found):
            raise InputError("it does nothing: give a stiffness or a damping", "stiffness")
        return tuple(i for n, i in enumerate(found) if not n or i.law[1] or i.law[2])

    def _numbers(self, key: str, count: int) -> list[float]:
        """The `count` numbers of an option, 0 when not given. InputError for another count."""
        given: list[float] | None = getattr(self, key)
        if given is None:
            return [0.0] * count
        if len(given) != count:
            raise InputError(f"give {count} number{'s' if count > 1 else ''} (got {given})", key)
        return given

    def _axes(self, d: int) -> FloatArray:
        """Axes (d, d) as rows, unit vectors in space axes at the start, from the options `axis` and
        `second_axis`; the third one completes them to a right-handed system."""
        e = np.eye(d)[0] if self.axis is None else unit(self.axis, d)
        if d == 2:
            if self.second_axis is not None:
                raise InputError("the bodies are plane: drop it", "second_axis")
            return np.array([e, [-e[1], e[0]]])
        given = self.second_axis
        if given is None and self.axis is not None:
            raise InputError("missing: with an axis in space give the second one too",
                             "second_axis")
        f = np.eye(3)[1] if given is None else unit(given, 3, "second_axis")
        if abs(e @ f) > 1e-9:
            raise InputError(f"is perpendicular to axis (their cosine is {e @ f:.3g})",
                             "second_axis")
        return np.array([e, f, np.cross(e, f)])
