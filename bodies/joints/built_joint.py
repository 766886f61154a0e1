"""Joint of a scene: constraint equations, summed from conditions on the frames of its bodies."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from sparsemor.bodies.frames.applied_forces import Reaction
from sparsemor.bodies.frames.frame_items import Compliance, Item
from sparsemor.bodies.frames.mean_displacement_and_rotation import MeanPoint
from sparsemor.bodies.frames.rotation import torque
from sparsemor.bodies.joints.joint_heat import HeatExchange
from sparsemor.bodies.joints.joint_sides import Condition, Side
from sparsemor.bodies.terms.field_kinds import MULTIPLIER
from sparsemor.core import (
    Amplitude,
    Block,
    Body,
    Equations,
    FloatArray,
    InputError,
    Joint,
    Note,
    Table,
)
from sparsemor.core.protocols.poses import points_in_space


@dataclass(frozen=True, slots=True, eq=False)
class JointPart(Joint):
    """Joint: constraint equations sum of conditions - targets(t) = 0, with a multiplier each:
    forces on the first side (N, space axes), moments (N m), or forces perpendicular to a line (N).

    sides: sides that are bodies. adjusted: intermediate massless frame between two flexible bodies;
    the equations of its weld come last. localized: hyper-reduction keeps its rows, because a joint
    reaction acts on few unknowns. reactions: prescribed force and moment (`wrenches`) on each side;
    then the joint has neither unknowns nor constraints. exchange: its heat flow; notes: warnings on
    its options; compliance (l,): of constraints that depend on those of other joints.
    """

    name: str
    sides: tuple[Side, ...]
    conditions: tuple[Condition, ...]
    targets: tuple[Amplitude, ...]
    adjusted: Mapping[str, Body] = field(default_factory=dict)
    localized: bool = True
    reactions: Table | None = None
    exchange: HeatExchange | None = None
    notes: tuple[Note, ...] = ()
    compliance: FloatArray | None = None

    @property
    def bodies(self) -> Sequence[Body]:
        """Bodies that the joint connects."""
        return [side.body for side in self.sides if side.body is not None]

    @property
    def inert(self) -> bool:
        """True if the joint has no unknowns: a joint of bodies that do not move in a rigid
        pre-simulation. The flexible run then has it as a constraint."""
        return not any(b.moves or b.flexible for b in self.bodies)

    @property
    def components(self) -> tuple[tuple[str, str], ...]:
        """Name and unit of each multiplier."""
        return tuple(self._component(row) for row in range(len(self.targets)))

    def _component(self, row: int) -> tuple[str, str]:
        """Name and unit of a multiplier: those of the item multipliers that are added in its row,
        if all agree."""
        kinds = {c.item.reactions[i] for c in self.conditions if c.item.reactions
                 for i in np.flatnonzero(c.C[row]).tolist()}
        if len(kinds) == 1:
            return kinds.pop()
        units = {unit for _, unit in kinds} or {c.item.unit for c in self.conditions}
        # a constraint of positions, m, as that of a rack, has a force, whatever else is in it
        return ("force", "N") if "N" in units else ("moment", "N m") if units == {"N m"} else (
            "force and moment", "N or N m")

    def blocks(self) -> Sequence[Block]:
        if self.reactions is not None or self.inert:
            return ()
        return [Block(self.name, MULTIPLIER, len(self.targets))]

    def contribute(self, equations: Equations) -> None:
        """Adds the constraint equations of the conditions, with compliance where they are
        redundant; in a flexible run of two stages the prescribed reactions instead.

        Of a condition C (l, forces) times the rows of its item adds to the l constraints, and C^T
        multipliers are its forces; vectors: functionals of displacements that it uses; other: body
        whose rigid coordinates it reads. inert: all bodies are fixed, and there are no unknowns.
        """
        if self.exchange is not None:
            self.exchange.contribute(equations)
        if self.inert:
            return
        if self.reactions is not None:
            # a joint that lets its sides turn makes no moment, and its set may be a single point
            turns = not all(isinstance(c.item, MeanPoint) for c in self.conditions)
            write_reactions(equations, self.sides, self.reactions, turns)
            return
        block = f"{self.name}.multiplier"
        for c in self.conditions:
            equations.frame(c.body.name, c.item, c.vectors, multipliers=block, C=c.C,
                            reads=f"{c.other}.rigid" if c.other else "")
        for row, compliance in enumerate(
                () if self.compliance is None else self.compliance.tolist()):
            equations.frame(self.conditions[0].body.name, Compliance(compliance),
                            multipliers=block, C=np.eye(len(self.targets))[:, [row]])
        equations.constraint(block, self.targets)

    def compliant(self, compliance: FloatArray, note: Note | None) -> JointPart:
        notes = self.notes if note is None else (*self.notes, note)
        return replace(self, compliance=compliance, notes=notes)

    # ------------------------------------------------------------------ two stages

    @property
    def reaction_count(self) -> int:
        """Number of columns of the reactions that `known` takes. InputError for an item without
        `wrench`."""
        for c in self.conditions:
            holding(c.item)
        return sum(size(side) for side in self.sides)

    def reactions_passed_on(
        self, times: FloatArray, multipliers: FloatArray, poses: Mapping[str, FloatArray]
    ) -> FloatArray:
        """(T, columns) forces and moments on the sides, for `known`, from multipliers (T, l) and
        rigid coordinates `poses` (T, n) of each body."""
        return wrenches(self.sides, self.conditions, times, multipliers, poses,
                        welded=bool(self.adjusted))

    def known(self, reactions: Table) -> JointPart:
        """The same joint with prescribed forces and moments on its sides."""
        return replace(self, reactions=reactions, adjusted={})


def write_reactions(
    equations: Equations, sides: Sequence[Side], reactions: Table, turns: bool
) -> None:
    """Adds prescribed forces on sides and, with `turns`, moments to their elastic rows; nothing for
    a side without displacements. reactions: for each side `size` columns, force (d), N, and moment
    (1 or 3), N m, in space axes, with the sign of multipliers (left-hand side). displacement,
    turning (n, d): functionals of the mean displacement and rotation, in whose columns force and
    moment act, in this order (in the plane the second column of `turning` is empty); every flexible
    side has the first. Without the second, `Reaction(.., False)` reads the force columns alone."""
    for number, side in enumerate(sides):
        if not side.flexible or side.body is None:
            continue
        mine = reactions.columns(size(side) * number + np.arange(size(side)))
        turning = side.turning if turns else None
        vectors = [v for v in (side.displacement, turning) if v is not None]
        equations.frame(side.body.name, Reaction(mine, turning is not None),
                        np.concatenate(vectors, axis=1))


def size(side: Side) -> int:
    """Number of components of a reaction on a side: force (d), N, and moment (1 or 3), N m."""
    return 3 * side.d - 3


def wrenches(
    sides: Sequence[Side], conditions: Sequence[Condition], times: FloatArray,
    multipliers: FloatArray, poses: Mapping[str, FloatArray], *, welded: bool,
) -> FloatArray:
    """(T, sum of sizes) force (N) on each side and moment (N m) about its mean point, in space
    axes, with the sign of the left-hand sides of the equations.

    multipliers (T, l), of which those of an item are C^T times them; poses: rigid coordinates (T,
    n) of bodies that move; welded: an intermediate massless frame is welded to the first side, so
    that the conditions of both sides are listed. A wrench has the force at the body's own point
    and, if it acts on the other body too, the point `reach` where.
    """
    bodies = [side.body for side in sides if side.body is not None]
    motion = {b.name: poses.get(b.name, b.pose[None]) for b in bodies}
    of, d = {b.name: i for i, b in enumerate(bodies)}, sides[0].d
    # a condition acts on the body with whose equations it is evaluated, and the other one answers
    found = np.zeros((len(times), len(bodies), size(sides[0])))
    for c in conditions:
        if c.body.name not in of:  # a massless frame
            continue
        other = poses[c.other] if c.other else None
        w = holding(c.item).wrench(times, multipliers @ c.C, motion[c.body.name], other)
        found[:, of[c.body.name], :d] += w.force
        found[:, of[c.body.name], d:] += w.moment
        if w.reach is None or welded:
            continue
        for name, i in of.items():
            if name != c.body.name:  # it answers with a force at `reach`
                found[:, i, :d] -= w.force
                found[:, i, d:] -= w.moment + torque(
                    w.reach - _mean_point(sides[i], motion[name]), w.force)
    return found.reshape(len(times), -1)


def holding(item: Item) -> Item:
    """The item of a joint, checked. InputError for one without `wrench`."""
    if item.reactions:
        return item
    raise InputError(
        f"its item {type(item).__name__} has no method `wrench`, so what it does to its bodies "
        "cannot be passed on by a rigid stage: give it that method (bodies/frames/frame_items.py, "
        "`Item`), or drop rigid_stage")


def _mean_point(side: Side, pose: FloatArray) -> FloatArray:
    """(T or 1, d) position of a side's mean point, m, space axes."""
    return points_in_space(pose, np.broadcast_to(side.point, (len(pose), side.d)))
