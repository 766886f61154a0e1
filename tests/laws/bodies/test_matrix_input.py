"""Matrices that no free body has, and files that cannot be read: one error with its key."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.sparse import csr_array, save_npz

from exported_matrices import built
from frame_beam import beam
from sparsemor.core.arrays import FloatArray
from sparsemor.core.errors import InputError
from sparsemor.core.testing.in_memory_run import scene_of

X, M, K = beam(3, 0.3, d=2)
ROD: dict[str, Any] = {"use": "matrices", "nodes": "nodes.npy", "mass": "M.npy",
                       "stiffness": "K.npy", "sets": {"foot": {"nodes": [1]}},
                       "reference": {"clamp": "foot"}}


def build(folder: Path, changes: dict[str, Any], **files: FloatArray) -> Any:
    for name, array in {"nodes": X, "M": M, "K": K, **files}.items():
        np.save(folder / f"{name}.npy", array)
    options = {**ROD, **changes}
    named = {k: str(folder / v) if isinstance(v, str) and "." in v else v
             for k, v in options.items()}
    return built(scene_of({"bodies": {"rod": named}, "time": {"end": 1.0, "step": 0.1}}), "rod")


def grounded(row: int) -> FloatArray:
    A = K.copy()
    A[row, row] *= 1.001
    return A


WRONG: dict[str, tuple[dict[str, Any], dict[str, FloatArray], str, str]] = {
    "spring to the ground": ({}, {"K": grounded(3)}, "stiffness", "resists rigid-body motion"),
    "not symmetric": ({}, {"K": K + np.triu(K, 1) * 1e-3}, "stiffness", "not symmetric"),
    "negative": ({}, {"K": -K}, "stiffness", "not positive semidefinite"),
    "half the mass along x": ({}, {"M": np.diag([0.5, 1, 1] * 4) @ M}, "mass",
                              "the same in all directions"),
    "no mass along x": ({}, {"M": np.diag([0.0, 1, 1] * 4) @ M @ np.diag([0.0, 1, 1] * 4)},
                        "mass", "the same in all directions"),
    "other order": ({}, {"nodes": X[[2, 0, 3, 1]]}, "stiffness", "in this order"),
    "fewer nodes": ({}, {"nodes": X[:-1]}, "mass", "no multiple of the 3 nodes"),
    "one node too many": ({}, {"nodes": np.vstack([X, X[-1] + 0.1])}, "mass", "no multiple"),
    "sizes": ({}, {"K": K[:9, :9]}, "stiffness", "12 x 12 is needed"),
    "not finite": ({}, {"K": K + np.diag([np.inf] * 12)}, "stiffness", "not finite"),
    "damper to the ground": ({"damping_matrix": "C.npy"}, {"C": np.eye(12)}, "damping_matrix",
                             "resists rigid-body motion"),
    "film": ({"conductivity": "L.npy", "capacity": "H.npy"}, {"L": np.eye(4), "H": np.eye(4)},
             "conductivity", "surroundings at 0 K"),
    "resultant": ({"coupling": "F.npy"}, {"F": np.ones((12, 4))}, "coupling", "resultant forces"),
    "no file": ({"stiffness": "none.npy"}, {}, "stiffness", "there is no file"),
    "format": ({"stiffness": "K.xls"}, {}, "stiffness", "supported formats"),
    "no such node": ({"sets": {"foot": {"nodes": [7]}}}, {}, "sets.foot.nodes", "no node 7"),
    "unknowns twice": ({"unknowns": "u.npy"}, {"u": np.ones((12, 2))}, "unknowns", "twice"),
    "direction": ({"unknowns": "u.npy"}, {"u": np.repeat([[1.0, 3.0]], 12, 0)}, "unknowns",
                  "in the plane are 1, 2 and 6"),
    "shapes": ({"shapes": "T.npy"}, {"T": np.ones((5, 2))}, "shapes", "5 rows"),
    "singular mass": ({}, {"M": beam(3, 0.3, d=2, mass=0.0)[1] + np.kron(
        np.eye(4), np.array([[1.0, 0, 0], [0, 1.0, 1e-3], [0, 1e-3, 1e-6]]))}, "mass",
        "singular")}


@pytest.mark.parametrize("which", WRONG)
def test_matrices_of_no_free_body_are_refused(which: str, tmp_path: Path) -> None:
    changes, files, key, message = WRONG[which]
    with pytest.raises(InputError, match=message) as found:
        build(tmp_path, changes, **files)
    assert [f.key.endswith(key) for f in found.value.faults] == [True]


def test_one_triangle_is_mirrored(tmp_path: Path) -> None:
    whole, half = build(tmp_path, {}), build(tmp_path, {}, K=np.triu(K), M=np.tril(M))
    np.testing.assert_array_equal(half.elasticity.stiffness.toarray(),
                                  whole.elasticity.stiffness.toarray())


def test_lines_of_text_are_named(tmp_path: Path) -> None:
    (tmp_path / "K.mtx").write_text("1 1 2.0\n2 2 x\n")
    with pytest.raises(InputError, match=r"K\.mtx:2: '2 2 x'"):
        build(tmp_path, {"stiffness": "K.mtx"})
    (tmp_path / "n.csv").write_text("1, 0, 0\n1, 1, 0\n2, 2, 0\n3, 3, 0\n")
    with pytest.raises(InputError, match="two nodes 1"):
        build(tmp_path, {"nodes": "n.csv"})


def test_no_pickled_objects_are_read(tmp_path: Path) -> None:
    np.save(tmp_path / "o.npy", np.array([{}], dtype=object), allow_pickle=True)
    with pytest.raises(InputError, match="cannot be read"):
        build(tmp_path, {"stiffness": "o.npy"})


def test_one_of_several_arrays_is_named(tmp_path: Path) -> None:
    np.savez(tmp_path / "all.npz", K=K, M=M)
    save_npz(tmp_path / "one.npz", csr_array(M))
    with pytest.raises(InputError, match="several arrays"):
        build(tmp_path, {"stiffness": "all.npz"})
    body = build(tmp_path, {"stiffness": "all.npz:K", "mass": "one.npz"})
    np.testing.assert_array_equal(body.elasticity.stiffness.toarray(), K)
