"""Matrices of a flexible body in files, as another code would write them."""

from pathlib import Path
from typing import Any

import numpy as np
from scipy.io import mmwrite, savemat
from scipy.linalg import eigh
from scipy.sparse import csr_matrix, kron, save_npz

from sparsemor.bodies.floating_body import FloatingBody
from sparsemor.core.scene.scene import Scene


def built(scene: Scene, name: str) -> FloatingBody:
    body = scene.bodies[name].build(name, scene.file_folder or Path())
    assert isinstance(body, FloatingBody)
    return body


def exported(body: FloatingBody, folder: Path, kind: str = "npz") -> dict[str, Any]:
    """Options `nodes`, `mass`, ... of a body `matrices`, whose files are written to `folder`."""
    e, h, m = body.elasticity, body.heat, body.mass_matrix
    assert m is not None
    found: dict[str, Any] = {"mass": kron(m, np.eye(body.d))}
    if e is not None:
        found |= {"stiffness": e.stiffness, "coupling": e.coupling}
    if h is not None:
        found |= {"conductivity": h.conductivity, "capacity": h.capacity}
    else:
        found.pop("coupling", None)
    options: dict[str, Any] = {}
    for key, matrix in found.items():
        file = folder / f"{key}.{kind}"
        if kind == "npz":
            save_npz(file, csr_matrix(matrix))
        elif kind == "mtx":
            mmwrite(file, csr_matrix(matrix), precision=17)
        options[key] = str(file)
    if kind == "mat":
        savemat(folder / "all.mat", {k: csr_matrix(a) for k, a in found.items()} | {"X": body.X})
        return {k: f"{folder / 'all.mat'}:{k}" for k in found} | {"nodes": f"{folder}/all.mat:X"}
    np.save(folder / "nodes.npy", body.X)
    return options | {"nodes": str(folder / "nodes.npy")}


def instead(
    scene: dict[str, Any], name: str, body: FloatingBody, folder: Path, kind: str = "npz"
) -> dict[str, Any]:
    """Scene with the flexible body `name` given by its matrices, and its sets by nodes with the
    same weights."""
    old = scene["bodies"][name]
    kept = {k: old[k] for k in ("fields", "reference", "damping", "frame", "pose",
                                "reference_temperature", "initial_temperature") if k in old}
    sets: dict[str, Any] = {}
    for which, nodes in body.points.items():
        centre = body.centre_of(which, nodes)
        used = nodes[centre.weights[nodes] > 0]
        sets[which] = {"nodes": (used + 1).tolist(), "weights": centre.weights[used].tolist()}
    new = {"use": "matrices", **exported(body, folder, kind), "sets": sets, **kept}
    return {**scene, "bodies": {**scene["bodies"], name: new}}


def superelement(
    body: FloatingBody, interface: Any, modes: int, folder: Path, whole: bool = False
) -> dict[str, Any]:
    """Options of the Craig-Bampton superelement of a body with the given interface nodes and number
    of fixed-interface modes: u = [1 0; -K_ii^-1 K_ib, Phi] (u_b, q); whole: with the shapes and the
    mass matrix of all nodes."""
    e, m, d = body.elasticity, body.mass_matrix, body.d
    assert e is not None and m is not None
    K, M = e.stiffness.toarray(), np.kron(m.toarray(), np.eye(d))
    b = (d * np.asarray(interface)[:, None] + np.arange(d)).ravel()
    i = np.setdiff1d(np.arange(len(K)), b)
    shapes = eigh(K[np.ix_(i, i)], M[np.ix_(i, i)], subset_by_index=(0, modes - 1))[1]
    T = np.zeros((len(K), len(b) + modes))
    T[b, np.arange(len(b))] = 1.0
    T[i, : len(b)] = -np.linalg.solve(K[np.ix_(i, i)], K[np.ix_(i, b)])
    T[np.ix_(i, len(b) + np.arange(modes))] = shapes
    files = {"mass": T.T @ M @ T, "stiffness": T.T @ K @ T, "nodes": body.X[interface]}
    if whole:
        files |= {"mass": M, "shapes": T, "nodes": body.X}
    for key, value in files.items():
        np.save(folder / f"super_{key}.npy", value)
    return {"use": "matrices", **({} if whole else {"modes": modes}),
            **{k: str(folder / f"super_{k}.npy") for k in files}}
