"""Redundant joints: groups of joints whose constraints depend linearly on each other."""

from collections.abc import Sequence

import numpy as np
from scipy.sparse import csgraph, csr_array, diags_array

from sparsemor.core.arrays import Csr
from sparsemor.core.protocols.layout import Layout

MANY = 2000
"""Number of constraints above which nothing is analysed: time grows with its cube."""
DEPENDENT = 1e-12
"""Eigenvalue of G G^T, relative to the largest, up to which it counts as zero."""
NAMED = 3
"""Number of groups that are named in a message."""
SHARE = 1e-6
"""Share in a dependency above which a constraint takes part in it."""


def dependent_joints(layout: Layout, G: Csr) -> list[tuple[str, ...]]:
    """Groups of joints, by name, with linear dependencies among the rows of the constraint Jacobian
    G (l, n) of all joints; empty where G has full rank.

    G is scaled to rows of length 1. With an orthonormal basis N of the null space of G G^T, two
    constraints depend on each other where (N N^T)_ij is not zero.
    """
    count = G.shape[0]
    if not 0 < count <= MANY or not np.isfinite(G.data).all():
        return []
    length = np.sqrt(np.asarray(G.multiply(G).sum(axis=1)).ravel())
    rows = diags_array(1.0 / np.where(length > 0.0, length, 1.0)) @ csr_array(G)
    values, vectors = np.linalg.eigh((rows @ rows.T).toarray())
    N = vectors[:, values <= DEPENDENT * values[-1]]
    together = np.abs(N @ N.T) > SHARE
    number, labels = csgraph.connected_components(csr_array(together), directed=False)
    taking_part = together.diagonal()
    owners = _owners(layout)
    groups = (tuple(dict.fromkeys(
        owners[i] for i in np.flatnonzero(taking_part & (labels == k)))) for k in range(number))
    return [group for group in dict.fromkeys(groups) if group]


def in_words(groups: Sequence[Sequence[str]]) -> str:
    """Groups of redundant joints as part of a sentence, "" for none."""
    texts = [
        f"the constraints of {', '.join(group[:-1])} and {group[-1]} depend on each other"
        if len(group) > 1 else f"the constraints of {group[0]} depend on each other"
        for group in groups]
    more = [f"and {len(texts) - NAMED} more such groups"] if len(texts) > NAMED else []
    return "; ".join(texts[:NAMED] + more)


def _owners(layout: Layout) -> list[str]:
    """Joint of each constraint."""
    found = [""] * (layout.algebraic.stop - layout.algebraic.start)
    for b in layout:
        if b.kind.order == 0:
            at = layout[b.name]
            first = at.start - layout.algebraic.start
            found[first:first + b.size] = [b.owner] * b.size
    return found
