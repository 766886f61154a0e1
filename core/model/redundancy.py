"""Constraints of joints that depend on each other, such as those of two hinges of one door."""

from collections.abc import Callable, Iterable, Mapping, Sequence

import numpy as np
from scipy.sparse import csgraph, csr_array, diags_array

from sparsemor.core.arrays import Csr, FloatArray
from sparsemor.core.linalg.dense import unit_columns
from sparsemor.core.model.equations import dense, system_jacobian
from sparsemor.core.model.model import Model
from sparsemor.core.notes import Note
from sparsemor.core.protocols.basis import Dictionary
from sparsemor.core.protocols.joint import Joint
from sparsemor.core.protocols.layout import Layout

MANY = 2000
"""Number of constraints above which nothing is analysed: time grows with its cube."""
DEPENDENT = 1e-12
"""Eigenvalue of G G^T, relative to the largest, up to which it counts as zero."""
UNMOVED = 1e-10
"""The same of trial spaces, where it is the square of a displacement: atoms that were learned from
motion without error have rounding of this size, amplified by the small share of the last atoms."""
NAMED = 3
"""Number of groups that are named in a message."""
SHARE = 1e-6
"""Share in a dependency above which a constraint takes part in it."""


def dependent_joints(layout: Layout, G: Csr) -> dict[tuple[str, ...], int]:
    """Groups of joints, by name, with linear dependencies among the rows of the constraint Jacobian
    G (l, n) of all joints, and how many of their constraints follow from others; empty where G has
    full rank.

    G is scaled to rows of length 1. With an orthonormal basis N of the null space of G G^T, two
    constraints depend on each other where (N N^T)_ij is not zero (above SHARE). DEPENDENT:
    eigenvalue, relative to the largest, that counts as zero; more than MANY constraints are not
    analysed.
    """
    count = G.shape[0]
    if not 0 < count <= MANY or not np.isfinite(G.data).all():
        return {}
    rows = _unit_rows(G)  # G G^T of these is free of units
    values, vectors = np.linalg.eigh((rows @ rows.T).toarray())
    N = vectors[:, values <= DEPENDENT * values[-1]]
    together = np.abs(N @ N.T) > SHARE
    number, labels = csgraph.connected_components(csr_array(together), directed=False)
    owners, share = _owners(layout), (N * N).sum(axis=1)
    # trace of N N^T over a group: dimension of its null space, its number of dependent constraints
    taking_part, found = together.diagonal(), dict[tuple[str, ...], int]()
    for k in range(number):
        at = np.flatnonzero(taking_part & (labels == k))
        if len(at):
            group = tuple(dict.fromkeys(owners[i] for i in at))
            found[group] = found.get(group, 0) + round(float(share[at].sum()))
    return found


def in_words(groups: Iterable[Sequence[str]]) -> str:
    """Groups of redundant joints as part of a sentence, "" for none."""
    texts = [
        f"the constraints of {', '.join(group[:-1])} and {group[-1]} depend on each other"
        if len(group) > 1 else f"the constraints of {group[0]} depend on each other"
        for group in groups]
    more = [f"and {len(texts) - NAMED} more such groups"] if len(texts) > NAMED else []
    return "; ".join(texts[:NAMED] + more)


def _owners(layout: Layout) -> list[str]:
    """Joint of each constraint."""
    return [b.owner for b in layout if b.kind.order == 0 for _ in range(b.size)]


COMPLIANCE, LEAST = 1e-6, 2e-13
"""Compliance of redundant constraints: max(COMPLIANCE h^2, LEAST s) / m, of a step h and
bodies of the size s and mass m. It is small next to the motion in a step, and large next to the
rounding of positions, which forces of least norm would otherwise consist of."""
REDUNDANT = "redundant_joints"
"""Kind of the note on redundant constraints."""
UNDETERMINED = "undetermined_forces"
"""Kind of the note on constraints that the atoms of trial spaces keep by themselves."""


def redundant_joints(model: Model, h: float) -> Mapping[str, tuple[FloatArray, Note | None]]:
    """Joint -> compliance of each of its constraints (l,), and a note with the first joint of each
    group, for the joints whose constraints depend on each other at the start. h: time step, s."""
    found = dict[str, tuple[FloatArray, Note | None]]()
    K = _constraint_rows(model)
    groups = {} if K is None else dependent_joints(  # without the columns of multipliers
        model.layout, K[:, : model.layout.algebraic.start])
    if not groups:
        return found
    soft = _compliance(model, h)
    for group, count in groups.items():
        note = Note(
            f"{in_words([group])}: {count} of them follow{'s' if count == 1 else ''} from the "
            "others. Their forces are those of least norm among all that have the same effect, "
            "which bodies that deform would share otherwise", REDUNDANT)
        for i, name in enumerate(g for g in group if g in model.joints):
            found[name] = soft(name), None if i else note
    return found


def undetermined_forces(
    model: Model, h: float, maps: Mapping[str, Dictionary]
) -> Mapping[str, tuple[Joint | None, Note]]:
    """Joint -> the same joint with a compliance of these constraints, and a note, for the joints
    that have constraints which the trial spaces keep by themselves: their forces would be rounding
    over rounding. None for a joint that has no such form, and in a flexible run of two stages.

    maps: trial spaces of blocks. With the rows of G of length 1 and atoms of length 1, a
    combination of constraints counts as kept where it moves by less than sqrt(UNMOVED) of the
    largest one. Such constraints get the compliance of redundant ones, others none.
    """
    layout, found = model.layout, dict[str, tuple[Joint | None, Note]]()
    constraint_rows = _constraint_rows(model) if maps else None
    if constraint_rows is None:
        return found
    first = layout.algebraic.start
    G = constraint_rows[:, :first]
    rigid_rows = constraint_rows[:, first:].diagonal() == 0.0  # of constraints without compliance
    if not np.isfinite(G.data).all():
        return found
    # gram = G T T^T G^T with the trial spaces T; rows that are compliant already count as held
    scaled = diags_array(np.where(rigid_rows, 1.0, 0.0)) @ _unit_rows(G)
    gram = np.diag(np.where(rigid_rows, 0.0, 1.0))
    for b in layout:
        if b.kind.order == 2:
            columns = scaled[:, layout[b.name]]
            by_atoms = columns @ unit_columns(maps[b.name].atoms) if (
                b.name in maps) else columns
            gram = gram + dense(by_atoms @ by_atoms.T)
    values, vectors = np.linalg.eigh(gram)
    unmoved = values <= UNMOVED * values[-1]
    share = (vectors[:, unmoved]**2).sum(axis=1)
    soft, owners = _compliance(model, h), np.array(_owners(layout))
    for name in dict.fromkeys(owners[share > SHARE].tolist()):
        shares = share[owners == name]
        kept_components = [
            part for part, s in zip(model.joints[name].components, shares, strict=True)
            if s > SHARE] if name in model.joints else []
        if kept_components:
            words = " and ".join(part for part, _ in kept_components)
            moved = np.sqrt(max(float(values[unmoved].max()), 0.0))
            plural = "s" if len(kept_components) > 1 else ""
            start = (f"{words} of {name}: the trial spaces move {'these' if plural else 'this'} "
                     f"constraint{plural} by {moved:.1g} of what a body could, so that the reduced "
                     "model does not determine the joint force: ")
            end = (". Take it from a run at full order or of reducer sparse, or let the basis have "
                   "the shapes of joint forces (craig_bampton)")
            least = Note(f"{start}the one of least norm, about zero, is stored{end}", UNDETERMINED)
            softer = None if model.stage is not None else model.joints[name].compliant(
                soft(name) * (shares > SHARE), least)
            found[name] = softer, least if softer else Note(
                f"{start}what is stored is rounding{end}", UNDETERMINED)
    return found


def _constraint_rows(model: Model) -> Csr | None:
    """Jacobian (l, n) of all constraints at the start; None where there are none or too many."""
    layout, first = model.layout, model.layout.algebraic.start
    some = [t for t in model.terms if len(t.rows) and t.rows.max() >= first]
    if not some or layout.size - first > MANY:
        return None
    zero = np.zeros(layout.size)
    return csr_array(system_jacobian(
        layout, some, model.x0, model.v0, zero, 0.0, zero, zero))[first:]


def _unit_rows(G: Csr) -> Csr:
    """Rows of G scaled to length 1; those of zeros stay zero."""
    length = np.sqrt(np.asarray(G.multiply(G).sum(axis=1)).ravel())
    return diags_array(1.0 / np.where(length > 0.0, length, 1.0)) @ csr_array(G)


def _compliance(model: Model, h: float) -> Callable[[str], FloatArray]:
    """Function: name of a joint -> compliance (l,) of each of its constraints, m/N for forces and
    rad/(N m) for moments; h: time step, s (`COMPLIANCE`)."""
    bodies = [b for b in model.bodies.values() if b.total_mass]
    mass = min((b.total_mass or 1.0 for b in bodies), default=1.0)
    size = max((b.extent for b in bodies), default=0.0) or 1.0
    one = max(COMPLIANCE * h * h, LEAST * size) / mass
    return lambda name: np.array([one if unit == "N" else one / size**2
                                  for _, unit in model.joints[name].components])
