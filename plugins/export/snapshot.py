"""Snapshot of one body at one time in three coordinates and space axes, as visualization programs
require."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from sparsemor.core.arrays import FloatArray, IntArray
from sparsemor.core.protocols.cells import KINDS, by_kind, corners_of
from sparsemor.core.results.run_result import RunResult


@dataclass(frozen=True, slots=True, eq=False)
class BodySnapshot:
    """Snapshot of one body. points (P, 3): current positions, m; fields: name -> (P,), (P, 3) or
    (P, 9) values there."""

    points: FloatArray
    fields: Mapping[str, FloatArray]


def frame_at(run: RunResult, body: str, step: int, fields: Sequence[str]) -> BodySnapshot:
    """Snapshot of a body: nodes at R + A (X + u), displacement A u in space axes, temperature.

    Warping the points by the displacement field magnifies the deformation. Planar bodies lie in z =
    0. Points are those of `exported_mesh`.
    """
    nodes = exported_mesh(run, body, fields)[0]
    u = run.nodal_displacement(body, step)
    values: dict[str, FloatArray] = {}
    if "displacement" in fields:
        values["displacement"] = _in_three(run.turned(body, step, u))[nodes]
    if "temperature" in fields:
        values["temperature"] = run.nodal_temperature(body, step)[nodes]
    if "stress" in fields:
        values["stress"] = run.von_mises(body, step)
        values["stress_tensor"] = _turned(run, body, step, run.stress(body, step))
    if "strain" in fields:
        values["strain"] = run.equivalent_strain(body, step)
        values["strain_tensor"] = _turned(run, body, step, run.strain(body, step))
    return BodySnapshot(_in_three(run.in_space(body, step, run.points(body) + u))[nodes], values)


def exported_mesh(run: RunResult, body: str, fields: Sequence[str]) -> tuple[IntArray, IntArray]:
    """Nodes (P,) of the points and cells (E, q) of an export: with stress or strain, nodes between
    materials have a point for each of them."""
    if {"stress", "strain"} & set(fields):
        return run.stress_mesh(body)
    return np.arange(len(run.points(body))), run.cells(body)


def named_cells(cells: IntArray, d: int) -> list[tuple[str, IntArray]]:
    """Name in meshio and nodes (n, q) of the cells of each kind among cells (E, q)."""
    return [(KINDS[d, p].names[own.shape[1] > p], own) for _, own in by_kind(cells, d)
            for p in [corners_of(d, own.shape[1])]]


def _turned(run: RunResult, body: str, step: int, tensors: FloatArray) -> FloatArray:
    """(P, 9) tensors (P, 3, 3) given in body axes, in space axes, by rows."""
    d = run.points(body).shape[1]
    A = np.eye(3)
    A[:d, :d] = run.turned(body, step, np.eye(d)).T
    return np.ascontiguousarray((A @ tensors @ A.T).reshape(-1, 9))


def _in_three(vectors: FloatArray) -> FloatArray:
    """(N, 3) vectors: (N, 2) vectors padded by zeros, (N, 3) vectors unchanged."""
    return np.ascontiguousarray(np.pad(vectors, ((0, 0), (0, 3 - vectors.shape[1]))))
