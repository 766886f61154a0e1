"""Floating frame of reference of one body: protocols, and the work arrays of its equations.

Rigid coordinates, attachment forces and elastic displacements are coupled by scalar functions of
the motion, which multiply constant vectors and matrices (docs/reference/equations.md, section 1).
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Protocol, TypeAlias

import numpy as np
from numpy import zeros

from sparsemor.core.arrays import FloatArray, IntArray


class FrameWork:
    """Work arrays of `Frame.evaluate`: equations and derivatives of a floating frame of reference
    with p directions (constant vectors on the displacements u), b inputs y (rigid coordinates, then
    attachment forces) and g generators (constant matrices M_g).

    sigma (b + 1, p): the last row multiplies the directions in the elastic equations, row i is its
    derivative by y_i. border (b, b + 1): H = d rows / dy, and in the last column the rigid and
    attachment equations ("rows"). tau (b, p): d rows = H dy + tau ds with s = directions^T u.
    coefficients (2 g + 1,) = kappa, mu, 1: forces sum kappa_g M_g u + sum mu_g M_g u'. For the
    exact Jacobian only: kappa_y, mu_y (b, g) are the derivatives of kappa and mu by y, quad (b, 3,
    g) those of the rows by the forms (u.M_g u, u.M_g u', u.M_g u''). fresh: False where derivatives
    of the evaluation before serve, so that a frame need not write H, tau and the first b rows of
    sigma.
    """

    __slots__ = ("border", "coefficients", "fresh", "kappa_y", "mu_y", "quad", "sigma", "tau",
                 "views")

    def __init__(self, p: int, b: int, g: int) -> None:
        self.fresh = True
        self.views: object = None  # a kernel's own views of these arrays, made once
        self.sigma, self.border, self.tau = zeros((b + 1, p)), zeros((b, b + 1)), zeros((b, p))
        self.coefficients = zeros(2 * g + 1)
        self.coefficients[-1] = 1.0
        self.kappa_y, self.mu_y, self.quad = zeros((b, g)), zeros((b, g)), zeros((b, 3, g))


FrameFunction: TypeAlias = Callable[
    [IntArray, FloatArray, IntArray, FloatArray, FloatArray, FloatArray, FloatArray, float, float,
     FloatArray, FloatArray, FloatArray, FloatArray, FloatArray, FloatArray, FloatArray], None]
"""`Frame.evaluate` on arrays:

    function(kinds, numbers, starts, gains, y, v, a, c1, c2, s, forms, sigma, tau, border,
             coefficients, sums)

with the arrays of `FrameArrays`, the present values `gains` (i,) of its amplitudes, the inputs of
`Frame.evaluate` and the arrays of `FrameWork`, which it fills; `sums` (320,) is for its own use.
All arrays are those of the model's largest body, with zeros where this body has fewer border
unknowns b or directions p.
"""


@dataclass(frozen=True, slots=True, eq=False)
class FrameArrays:
    """A frame as a function of numbers.

    kinds (i,), numbers (i, j), starts (i, 3): of each contribution its kind, constants, and first
    functional, coordinate of another body, and multiplier; amplitudes (i,): None for those without.
    function: uses numbers and arrays only, and creates no array, so that numba can compile it; it
    need not give derivatives where c2 is 0. calls: the functions that it calls, each after those
    that it calls itself; parts: those of the kinds of contributions, of which only those in use are
    compiled; none if it has no such functions.
    """

    kinds: IntArray
    numbers: FloatArray
    starts: IntArray
    amplitudes: tuple[Callable[[float], float] | None, ...]
    function: FrameFunction
    calls: tuple[Callable[..., object], ...]
    parts: tuple[Callable[..., object], ...] = ()


class Frame(Protocol):
    """Floating frame of reference of one body: coupling of rigid coordinates, attachment forces and
    elastic displacements.

    Inputs: rigid coordinates, then the forces on each attachment; equations: rigid equations of
    motion, then the positions of the attachments. They are exact for a rigid body.

    rigid_size: number of rigid coordinates; border: b, of all inputs; p: of directions; generators:
    g, of generators (`FrameWork`).
    """

    @property
    def rigid_size(self) -> int: ...
    @property
    def border(self) -> int: ...
    @property
    def p(self) -> int: ...
    @property
    def generators(self) -> int: ...
    def evaluate(
        self, y: FloatArray, v: FloatArray, a: FloatArray, c1: float, c2: float,
        s: FloatArray, forms: FloatArray, t: float, work: FrameWork,
    ) -> None:
        """Fills `work` for the inputs y (rigid coordinates and attachment forces), their rates v
        and second derivatives a, all (b,), at time t, s; derivatives are for dv = c1 dy, da = c2 dy
        and likewise for the displacements u.

        These enter as functionals only: s (3, p) = directions^T (u, u', u''), and forms (3 g,) =
        u.M_g u, u.M_g u', u.M_g u''.
        """
        ...

    def drive(
        self, y: FloatArray, v: FloatArray, a: FloatArray, t: float, work: FrameWork
    ) -> None:
        """Fills the last row of `work.sigma` and `work.coefficients` for a body with prescribed
        motion; these do not depend on displacements. y, v, a (b,): inputs as in `evaluate`; t:
        s."""
        ...

    def drive_along(
        self, y: FloatArray, v: FloatArray, a: FloatArray, times: FloatArray
    ) -> FloatArray:
        """Coefficients kappa, mu and last row of sigma, side by side, (T, 2 g + p), for inputs,
        rates and second derivatives (T, b) at times (T,), s; by default `drive` at each time."""
        work = FrameWork(self.p, self.border, self.generators)
        made = np.empty((len(times), len(work.coefficients) - 1 + self.p))
        for row, *now, t in zip(made, y, v, a, times.tolist(), strict=True):
            self.drive(now[0], now[1], now[2], t, work)
            row[:] = np.concatenate((work.coefficients[:-1], work.sigma[-1]))
        return made

    def arrays(self) -> FrameArrays | None:
        """The equations as a function on arrays with its numbers; None without one, and then steps
        of the model are not compiled."""
        return None

    def exact(
        self, v: FloatArray, a: FloatArray, c1: float, c2: float, work: FrameWork
    ) -> None:
        """Fills `work.kappa_y`, `mu_y` and `quad` after `evaluate`; only the exact Jacobian needs
        them."""
        ...

    @property
    def shape_columns(self) -> tuple[tuple[int, int], ...]:
        """Pairs (direction, generator g) of directions that are M_g X with reference positions X,
        and so change with an offset of the displacements."""
        ...

    @property
    def stiff_columns(self) -> tuple[tuple[int, int], ...]:
        """Pairs (direction, generator g) of directions whose loads have the factors of a generator,
        as of geometric stiffness; the functional of the direction does not change with it."""
        return ()

    def shifted(self, s: FloatArray, quadratic: FloatArray) -> "Frame":
        """Frame for displacements measured from a shape `offset`: s = directions^T offset (p,),
        quadratic (g,) = offset.M_g offset."""
        ...

    def time_derivative(self, order: int, t: float, h: float) -> "Frame | None":
        """Frame whose attachment equations are the partial time derivative, of order 1 or 2, from
        the right at t (s); None if it is zero. h: time step, s."""
        ...


class FrameItem(Protocol):
    """One contribution to the equations of a floating frame: inertia, a force, or an attachment of
    a joint."""

    @property
    def forces(self) -> int:
        """Number of unknown forces, the multipliers of a joint; 0 for other contributions."""
        ...

    def names(self, source: str) -> tuple[str, ...]:
        """Load name of each direction; "" for one that is no load vector. source: name of the joint
        or load."""
        ...


class BodyFrame(Frame, Protocol):
    """A floating frame whose equations are a sum of contributions (inertia, forces,
    attachments)."""

    items: Sequence[FrameItem]

    @property
    def without_push(self) -> Sequence[FrameItem]:
        """Contributions that act on displacements but that `drive` cannot evaluate for a prescribed
        motion."""
        ...
    # as those of `Frame`: for displacements from an offset; of attachments, the time derivative
    def shifted(self, s: FloatArray, quadratic: FloatArray) -> "BodyFrame": ...
    def time_derivative(self, order: int, t: float, h: float) -> "BodyFrame | None": ...
