"""Equations of a frame in space as one function on arrays (core/protocols/body_frame.py)."""

from collections.abc import Callable, Sequence

import numpy as np

from sparsemor.bodies.frames import space_motion as motion
from sparsemor.bodies.frames.frame_items import Item
from sparsemor.bodies.frames.space_items import (
    SpaceFunction,
    SpacePart,
    add_pull,
    axial,
    body_force,
    compliance,
    constraint,
    factor,
    inert,
    moment,
    moved,
    pull,
    space_force,
    space_inertia,
    stiffening,
    trace,
    unit_length,
)
from sparsemor.bodies.frames.space_motion import SpaceMotion, SpaceSums, levers, spin, turn, vector
from sparsemor.bodies.frames.space_springs import (
    counted_angle,
    overlap,
    quaternion,
    space_rotational_spring,
    space_spring,
)
from sparsemor.core import FloatArray, IntArray
from sparsemor.core.protocols.body_frame import FrameArrays

FUNCTIONS: tuple[SpaceFunction, ...] = (
    space_inertia, unit_length, space_force, body_force, moment, constraint, space_spring,
    space_rotational_spring, compliance, stiffening)
"""Functions of parts; the position is the kind of part in `evaluate_space`."""
CALLS: tuple[Callable[..., object], ...] = (
    motion.vector, motion.plus, motion.dot, motion.cross, motion.times, motion.back, motion.add,
    motion.put, motion.turn, motion.turn_rate, motion.bend, motion.add_bend, motion.levers,
    motion.spin, motion.add_torque, trace, inert, axial, factor, moved, pull, add_pull, quaternion,
    overlap, counted_angle, *FUNCTIONS)
"""All functions that it calls, each after those that it calls itself."""


def space_arrays(
    n: int, items: Sequence[Item], starts: Sequence[tuple[int, int, int]]
) -> FrameArrays | None:
    """Items of a frame with n attitude coordinates as arrays, None where one is not given so.
    starts: first functional j, coordinate of another body o and multiplier k of each item. An item
    can have several parts, each a row of numbers that begins with n; the last two arguments are all
    functions that are called, and those of parts."""
    parts, at = list[SpacePart](), list[tuple[int, int, int]]()
    for item, (j, o, k) in zip(items, starts, strict=True):
        made = item.in_space()
        if made is None:
            return None
        parts += made
        at += [(j, o, k + part.row) for part in made]
    numbers = np.zeros((len(parts), max((1 + len(p.numbers) for p in parts), default=1)))
    for row, part in zip(numbers, parts, strict=True):
        row[: 1 + len(part.numbers)] = n, *part.numbers
    return FrameArrays(
        np.array([FUNCTIONS.index(p.function) for p in parts], dtype=np.int64), numbers,
        np.array(at, dtype=np.int64).reshape(-1, 3),
        tuple(p.amplitude for p in parts), evaluate_space, CALLS, FUNCTIONS)


def evaluate_space(
    kinds: IntArray, numbers: FloatArray, starts: IntArray, gains: FloatArray, y: FloatArray,
    v: FloatArray, a: FloatArray, c1: float, c2: float, s: FloatArray, forms: FloatArray,
    sigma: FloatArray, tau: FloatArray, border: FloatArray, coefficients: FloatArray,
    sums: FloatArray
) -> None:
    """Equations of a frame in space from arrays (`FrameFunction` in core/protocols/body_frame.py);
    without derivatives where c2 is 0."""
    b = len(y)
    sigma[b], border[:, b] = 0.0, 0.0
    if c2 != 0.0:
        sigma[:b], tau[:], border[:, :b] = 0.0, 0.0, 0.0
    if len(kinds) == 0:
        return
    n = int(numbers[0, 0])
    # `sums` holds the working arrays of the motion: own rotation matrix and derivatives, far, rest,
    # lever, dw, dal, pairs, square
    own, far = sums[:45].reshape(5, 3, 3), sums[45:90].reshape(5, 3, 3)
    lever, dw = sums[135:147].reshape(4, 3), sums[147:159].reshape(4, 3)
    dal, rest = sums[159:171].reshape(4, 3), sums[90:135].reshape(5, 3, 3)
    turn(y, 3, n, own)
    sums[135:171] = 0.0
    levers(y, 3, n, 1.0, lever)
    levers(y, 3, n, c1, dw)
    levers(y, 3, n, c2, dal)
    if n == 4:  # G is linear in p
        levers(v, 3, n, -1.0, dw)
        levers(a, 3, n, -1.0, dal)
    m = SpaceMotion(  # in the order of its fields; w and al from the levers and the rates
        n, y, v, vector(y, 0), vector(a, 0), own[0], own[1:], spin(lever, v, 3, n),
        spin(lever, a, 3, n), dw, dal, lever, c1, c2, s.shape[1] > 0, s[0], s[1], s[2], forms,
        rest, far, sums[171:255].reshape(14, 2, 3), sums[255:319].reshape(8, 8))
    out = SpaceSums(sigma[b], sigma[:b], tau, border[:, :b], border[:, b], coefficients)
    for i in range(len(kinds)):
        kind, given, g, j, o, k = (
            kinds[i], numbers[i], gains[i], starts[i, 0], starts[i, 1], starts[i, 2])
        if kind == 0:
            space_inertia(given, g, m, j, o, k, out)
        elif kind == 1:
            unit_length(given, g, m, j, o, k, out)
        elif kind == 2:
            space_force(given, g, m, j, o, k, out)
        elif kind == 3:
            body_force(given, g, m, j, o, k, out)
        elif kind == 4:
            moment(given, g, m, j, o, k, out)
        elif kind == 5:
            constraint(given, g, m, j, o, k, out)
        elif kind == 6:
            space_spring(given, g, m, j, o, k, out)
        elif kind == 7:
            space_rotational_spring(given, g, m, j, o, k, out)
        elif kind == 8:
            compliance(given, g, m, j, o, k, out)
        else:
            stiffening(given, g, m, j, o, k, out)
