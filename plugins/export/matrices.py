"""Export of a linear kept model as matrices: state space for control design, and the second-order
equations from which it comes."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import scipy.io
from scipy.linalg import block_diag

from sparsemor.core.arrays import FloatArray
from sparsemor.core.errors import InputError
from sparsemor.core.results.atomic_files import replace_file
from sparsemor.core.simulation.sensors_and_outputs import read
from sparsemor.plugins.export.export_plan import make_folder
from sparsemor.plugins.kept_models.reduced_model import ReducedModel

LINEAR = 1e-9
"""Largest relative error of outputs and inputs that count as linear."""
FORMATS = ("npz", "mat", "mtx")


@dataclass(frozen=True, slots=True, eq=False)
class StateSpace:
    """Model z' = A z + B u + f, y = C z + y0, of z = [x; x'; T]: coefficients of displacements with
    their rates, and of temperatures.

    A (m, m), B (m, i), f (m,), C (o, m), y0 (o,), start (m,): z at the start. mass, damping,
    stiffness (n, n), force (n, i), constant (n,): the equations in q = [x; T] from which it comes,
    mass q'' + damping q' + stiffness q = force u + constant, with zeros in mass for T.
    inputs, outputs, unknowns: names of u, y and z.
    """

    A: FloatArray
    B: FloatArray
    C: FloatArray
    f: FloatArray
    y0: FloatArray
    start: FloatArray
    mass: FloatArray
    damping: FloatArray
    stiffness: FloatArray
    force: FloatArray
    constant: FloatArray
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    unknowns: tuple[str, ...]

    def arrays(self) -> Mapping[str, Any]:
        """Name -> array, of names as arrays of texts."""
        return {name: np.array(value) for name in self.__slots__
                if (value := getattr(self, name)) is not None}


def state_space(
    model: ReducedModel, inputs: Sequence[str] | None = None, outputs: Sequence[str] | None = None
) -> StateSpace:
    """State space of a model whose bodies stand still and whose terms are linear.

    inputs, outputs: as of `export_fmu`. Raises InputError for another model, for outputs that are
    not linear, and for functions of time that are neither inputs nor constant.
    """
    keys = model.possible_inputs if inputs is None else tuple(inputs)
    stepper = model.stepper(keys, outputs or ())
    system, start, layout = stepper.linear_system(), stepper.start, stepper.layout
    first = np.array([stepper.inputs[k] for k in keys])

    def force(values: FloatArray, t: float = 0.0) -> FloatArray:
        for key, value in zip(keys, values.tolist(), strict=True):
            stepper.set(key, value)
        return system.force(t)

    ends = force(first), force(first, model.scene.time.end)
    if not np.allclose(*ends, rtol=LINEAR, atol=LINEAR * np.abs(ends).max(initial=0.0)):
        raise InputError("loads vary with time: make their functions inputs", "inputs")
    F = np.array([force(first + e) - ends[0] for e in np.eye(len(keys))]).reshape(
        len(keys), len(ends[0])).T
    constant = ends[0] - F @ first
    second, hot = (np.arange(layout.size)[at] for at in (layout.second, layout.first))
    M, D, K = system.mass, system.damping, system.stiffness
    s, n = len(second), len(ends[0])
    rate = block_diag(M[np.ix_(second, second)], D[np.ix_(hot, hot)])
    order = np.concatenate((second, hot))
    slopes = -np.linalg.solve(rate, np.hstack((
        K[np.ix_(order, second)], D[np.ix_(order, second)], K[np.ix_(order, hot)])))
    pushes = np.linalg.solve(rate, np.column_stack((F, constant))[order])
    A = np.vstack((np.eye(s, n + s, s), slopes))
    pushes = np.vstack((np.zeros((s, pushes.shape[1])), pushes))
    z = np.concatenate((start.x[second], start.v[second], start.x[hot]))

    def outputs_at(z: FloatArray) -> FloatArray:
        x, v = np.zeros(n), np.zeros(n)
        x[second], v[second], x[hot] = z[:s], z[s : 2 * s], z[2 * s :]
        return read([*stepper.described.values()], replace(start, x=x, v=v))

    y0 = outputs_at(np.zeros(n + s))
    C = np.array([outputs_at(e) - y0 for e in np.eye(n + s)]).reshape(n + s, len(y0)).T
    wrong = np.abs(outputs_at(z) - C @ z - y0) > LINEAR * np.maximum(
        np.abs(C) @ np.abs(z), np.abs(y0))
    if wrong.any():
        name = [*stepper.described][int(np.argmax(wrong))]
        raise InputError(f"{name} is not linear in the state", "outputs")
    names = [f"{b.name}.{i}" for b in layout for i in range(b.size)]
    return StateSpace(
        A, pushes[:, :-1], C, pushes[:, -1], y0, z, M, D, K, F, constant, tuple(keys),
        tuple(stepper.outputs), (*(names[i] for i in second), *(f"{names[i]}'" for i in second),
                                 *(names[i] for i in hot)))


def export_matrices(
    model: ReducedModel, path: str | Path, to: str = "npz", inputs: Sequence[str] | None = None,
    outputs: Sequence[str] | None = None,
) -> StateSpace:
    """Writes the state space of a linear model: `npz` and `mat`, one file, or `mtx`, a new folder
    with one Matrix Market file for each matrix. Raises InputError as `state_space`."""
    if to not in FORMATS:
        raise InputError(f"no format of matrices is called {to!r}: {', '.join(FORMATS)}", "to")
    made, target = state_space(model, inputs, outputs), Path(path)
    if to == "mtx":
        make_folder(target)
        for name, value in made.arrays().items():
            if value.dtype.kind == "U":
                (target / f"{name}.txt").write_text("".join(f"{v}\n" for v in value))
            else:
                scipy.io.mmwrite(target / f"{name}.mtx", value.reshape(len(value), -1),
                                 precision=17)
        return made
    from io import BytesIO

    file = BytesIO()
    if to == "npz":
        np.savez(file, allow_pickle=False, **made.arrays())
    else:
        scipy.io.savemat(file, {n: v.astype(object) if v.dtype.kind == "U" else v
                                for n, v in made.arrays().items()})
    replace_file(target, file.getvalue())
    return made
