"""Steady temperatures: the heat equations without rates, K_T(T) T + q(T) = f, by Newton's method.

Radiation, convection, conductivity that depends on temperature and conduction through joints and
contacts are terms of the model, with their own tangents; bodies stand as at the start.
"""

import numpy as np
from scipy.sparse import csgraph, csr_array

from sparsemor.core import InputError
from sparsemor.plugins.analyses.equilibrium import Solved, newton
from sparsemor.plugins.analyses.prepared import Prepared, time_of
from sparsemor.plugins.analyses.system import System

SINK = 1e-11
"""Heat per kelvin that leaves a group of bodies, relative to that between its nodes, below which
nothing leaves."""


def steady_heat(p: Prepared, *, at: float | None = None) -> Solved:
    """Steady temperatures under the heat loads at a time, s. Raises InputError for bodies that no
    heat can leave, SolveFailed where the iteration does not converge."""
    system = p.system
    rows = system.thermal
    if not len(rows):
        raise InputError("no body of this scene has a thermal field", "bodies")
    start = system.start(time_of(p.scene, at))
    _check_sinks(System.of(p.model, {}), start.t)
    return newton(system, start, rows)


def _check_sinks(system: System, t: float) -> None:
    """Raises InputError with the bodies whose heat can go nowhere: rows of their tangent sum to
    zero."""
    layout, rows = system.layout, system.thermal
    K = csr_array(system.jacobian(system.start(t))[rows][:, rows])
    count, label = csgraph.connected_components(K, directed=False)
    leaves = np.bincount(label, np.asarray(K.sum(axis=1)).ravel(), count)
    between = np.bincount(label, np.asarray(abs(K).sum(axis=1)).ravel(), count)
    for i in np.flatnonzero(np.abs(leaves) <= SINK * between):
        names = [layout.block(n).owner for n in layout.containing(rows[label == i])]
        word = "them" if len(names) > 1 else "it"
        raise InputError(
            f"no heat leaves {' and '.join(names)}, so that no steady temperature exists: give "
            f"{word} convection, radiation, a prescribed temperature, or a joint or contact that "
            "conducts to a body with one", f"bodies.{names[0]}")
