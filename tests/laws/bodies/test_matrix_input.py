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
    "dependent shapes": ({"shapes": "T.npy"}, {"T": np.hstack([np.eye(12)[:, 3:],
                                                               np.eye(12)[:, 6:8]])}, "shapes",
                         "11 shapes are 9"),
    "singular mass": ({}, {"M": beam(3, 0.3, d=2, mass=0.0)[1] + np.kron(
        np.eye(4), np.array([[1.0, 0, 0], [0, 1.0, 1e-3], [0, 1e-3, 1e-6]]))}, "mass",
        "singular")}


@pytest.mark.parametrize("which", WRONG)
def test_matrices_of_no_free_body_are_refused(which: str, tmp_path: Path) -> None:
    changes, files, key, message = WRONG[which]
    with pytest.raises(InputError, match=message) as found:
        build(tmp_path, changes, **files)
    assert [f.key.endswith(key) for f in found.value.faults] == [True]


def test_each_entry_or_its_mirror_image_alone(tmp_path: Path) -> None:
    """As codes write that have their unknowns in an order of their own."""
    half = K.copy()
    for i, j in np.argwhere(K):
        if i < j:
            kept = (i, j) if (i + j) % 2 else (j, i)
            half[i, j] = half[j, i] = 0.0
            half[kept] = K[i, j]
    whole, found = build(tmp_path, {}), build(tmp_path, {}, K=half)
    np.testing.assert_array_equal(found.elasticity.stiffness.toarray(),
                                  whole.elasticity.stiffness.toarray())


LINES = [f"{i}, {x}, {y}" for i, (x, y) in enumerate(X, 1)]


@pytest.mark.parametrize("text", [
    "** nodes of the rod\n", "# number, x, y of 4 nodes\n", "\ufeff% rod\r\n\r\n"])
def test_remarks_in_tables(text: str, tmp_path: Path) -> None:
    (tmp_path / "n.csv").write_text(text + "\n".join(LINES), encoding="utf-8", newline="")
    np.testing.assert_allclose(build(tmp_path, {"nodes": "n.csv"}).X, X, atol=1e-15)


TABLES: dict[str, tuple[dict[str, Any], str, str]] = {
    "nan": ({"nodes": "t.csv"}, "1, 0, 0\n2, nan, 0\n", r"t\.csv:2: '2  nan  0' is no entry"),
    "large": ({"nodes": "t.csv"}, "1e30, 0, 0\n", "1e\\+30 is no whole number"),
    "half a node": ({"load_vectors": {"w": "t.csv"}}, "1.5, 1, 2", "1.5 is no whole number"),
    "no force": ({"load_vectors": {"w": "t.csv"}}, "1, 1, inf", r"t\.csv:1: '1  1  inf'"),
    "cylindrical": ({"nodes": "t.inp"}, "*NODE, SYSTEM=C\n1, 0, 0", r"t\.inp:1: \*NODE: coord"),
    "system": ({"nodes": "t.inp"}, "*SYSTEM\n1, 0, 0\n*NODE\n", r"t\.inp:1: \*SYSTEM: coord"),
    "axes": ({"nodes": "t.bdf"}, "GRDSET,,,,,,2\nGRID,1,,0.,0.,0.\n",
             "t.bdf:2: GRID: displacements in the coordinate system 2")}


@pytest.mark.parametrize("which", TABLES)
def test_tables_that_say_something_else_are_refused(which: str, tmp_path: Path) -> None:
    changes, text, message = TABLES[which]
    (file,) = (v if isinstance(v, str) else v["w"] for v in changes.values())
    (tmp_path / file).write_text(text)
    if "load_vectors" in changes:
        changes = {"load_vectors": {"w": str(tmp_path / file)}}
    with pytest.raises(InputError, match=message):
        build(tmp_path, changes)


def test_nodes_and_sets_of_an_input_file(tmp_path: Path) -> None:
    """A set in pieces, a set of sets, and a node that the matrices do not have."""
    (tmp_path / "n.inp").write_text("*NODE\n" + "\n".join(LINES) + "\n50, 9., 0.\n"
        "*NSET, NSET=A\n1\n*NSET, NSET=A\n2\n*NSET, NSET=B\nA, 50\n*NSET, NSET=C, ELSET=E\n")
    np.savetxt(tmp_path / "u.csv", [(i, c) for i in range(1, 5) for c in (1, 2, 6)],
               fmt="%d", delimiter=",")
    body = build(tmp_path, {"nodes": "n.inp", "unknowns": "u.csv"})
    assert len(body.X) == 4
    with pytest.raises(InputError, match="has no node 50 with unknowns"):
        build(tmp_path, {"nodes": "n.inp", "unknowns": "u.csv", "sets": {"foot": {"nodes": [50]}}})
    np.savetxt(tmp_path / "u.csv", np.zeros((12, 2)), fmt="%d", delimiter=",")
    with pytest.raises(InputError, match="12 unknowns have no place|is 0, 0 kg"):
        build(tmp_path, {"nodes": "n.inp", "unknowns": "u.csv"})
    assert {k: v.tolist() for k, v in body.points.items()} == {
        "A": [0, 1], "B": [0, 1], "foot": [0]}
    assert [n.text for n in body.mesh_notes] == [f"{tmp_path / 'n.inp'}: 1 nodes (50) have no "
                                                "unknowns, and are left out"]


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
