"""POD in the products of mass and stiffness: orthogonality, optimality, peers, semi-definite
ones."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from pydantic import ValidationError
from scipy import linalg, sparse

from sparsemor.core.arrays import FloatArray
from sparsemor.core.errors import InputError
from sparsemor.core.linalg import snapshots as snapshots_module
from sparsemor.core.model.assembly import assemble
from sparsemor.core.protocols import BlockData, Dictionary
from sparsemor.core.scene.scene import load
from sparsemor.core.testing import check_basis
from sparsemor.plugins.bases.inner_product import free_rigid_motions, inner_product, rigid_motions
from sparsemor.plugins.bases.pod import Pod


@pytest.fixture(scope="module")
def model() -> Any:
    return assemble(load("double_pendulum", {
        f"bodies.link{i}.mesh.elements": 320 for i in (1, 2)}))


def snapshots_of(data: BlockData, rank: int, M: int = 40) -> FloatArray:
    """Smooth and rough fields with amplitudes over six decades, (n, M) of numerical rank `rank`."""
    rng = np.random.default_rng(data.size)
    D = sparse.csc_array(data.stiffness + 1e-3 * float(
        data.stiffness.diagonal().sum() / data.mass.diagonal().sum()) * data.mass)
    smooth = sparse.linalg.splu(D).solve(rng.standard_normal((data.size, rank)))
    fields = smooth / np.linalg.norm(smooth, axis=0) * 10.0 ** -np.linspace(0.0, 6.0, rank)
    fields[:, -1] = 1e-6 * rng.standard_normal(data.size) / np.sqrt(data.size)
    return np.asarray(fields @ rng.standard_normal((rank, M)))


def block(model: Any, name: str, rank: int = 12) -> BlockData:
    data: BlockData = model.block_data(name)
    return replace(data, snapshots=snapshots_of(data, rank))


def gram(d: Dictionary, X: Any) -> FloatArray:
    """Gram matrix (k, k) of the atoms in the product X, scaled to a unit diagonal."""
    G = d.atoms.T @ (X @ d.atoms)
    size = np.sqrt(np.diagonal(G))
    return np.asarray(G / np.outer(size, size))


def missed(A: FloatArray, d: Dictionary, X: Any) -> float:
    """Root of the summed squared X-norms of A less its X-orthogonal projection on the atoms."""
    c = np.linalg.solve(d.atoms.T @ (X @ d.atoms), d.atoms.T @ (X @ A))
    rest = A - d.atoms @ c
    return float(np.sqrt(np.sum(rest * (X @ rest))))


def by_cholesky(A: FloatArray, X: Any) -> tuple[FloatArray, FloatArray]:
    """X-orthonormal left singular vectors and singular values of A, by X = L L^T."""
    L = np.linalg.cholesky(X.toarray())
    U, s, _ = np.linalg.svd(L.T @ A, full_matrices=False)
    return linalg.solve_triangular(L.T, U), s


CASES = [("link1.elastic", "mass"), ("link1.elastic", "stiffness"), ("link1.thermal", "mass"),
         ("link1.thermal", "stiffness")]


@pytest.mark.parametrize(("name", "product"), CASES)
def test_atoms_are_orthogonal_and_the_truncation_is_optimal(
    model: Any, name: str, product: Any
) -> None:
    data = block(model, name)
    A, used = data.snapshots, inner_product(data, product)
    assert used.X is not None
    peer, s = by_cholesky(A, used.X)
    for k in (1, 3, 6, 12):
        d = Pod(product=product, count=k).build(data)
        assert d.atoms.shape == (data.size, k)
        np.testing.assert_allclose(np.linalg.norm(d.atoms, axis=0), 1.0, rtol=1e-12)
        assert np.abs(gram(d, used.X) - np.eye(k)).max() < 1e-10
        least = float(np.linalg.norm(s[k:]))
        assert missed(A, d, used.X) <= least * (1.0 + 1e-9) + 1e-12 * s[0]
        told = d.info["energy_in_product"]
        assert isinstance(told, float)
        assert abs(1.0 - told - least**2 / float(s @ s)) < 1e-12
    both = peer[:, :6] / np.linalg.norm(peer[:, :6], axis=0)
    both *= np.sign((both * d.atoms[:, :6]).sum(axis=0))
    assert np.abs(both - d.atoms[:, :6]).max() < 1e-8
    # the Euclidean POD misses more in this norm, so the comparison can fail
    plain = Pod(count=3).build(data)
    assert missed(A, plain, used.X) > missed(A, Pod(product=product, count=3).build(data), used.X)


@pytest.mark.parametrize(("name", "product"), CASES)
def test_energy_cuts_in_the_norm_of_the_product(model: Any, name: str, product: Any) -> None:
    data = block(model, name)
    X = inner_product(data, product).X
    _, s = by_cholesky(data.snapshots, X)
    rest = 1.0 - np.cumsum(s * s) / float(s @ s)
    for energy in (0.9, 0.9999, 1.0 - 1e-8):
        d = Pod(product=product, energy=energy).build(data)
        assert d.atoms.shape[1] == int(np.flatnonzero(rest <= 1.0 - energy)[0]) + 1
        assert d.info["cut"] == "energy"


@pytest.mark.parametrize("product", ["mass", "stiffness"])
def test_rank_deficient_snapshots_lose_no_direction_and_gain_none(
    model: Any, product: Any
) -> None:
    data = block(model, "link2.elastic", rank=7)
    A = np.hstack([data.snapshots, 2.0 * data.snapshots, np.zeros((data.size, 3))])
    d = Pod(product=product).build(replace(data, snapshots=A))
    assert d.info["numerical_rank"] == d.atoms.shape[1] == 7
    assert "round-off" in str(d.info["cut"])
    X = inner_product(data, product).X
    assert missed(A, d, X) < 1e-10 * np.sqrt(np.sum(A * (X @ A)))
    # all columns: the span is that of the Euclidean POD
    Q = Pod().build(replace(data, snapshots=A)).atoms
    assert np.abs(d.atoms - Q @ (Q.T @ d.atoms)).max() < 1e-8


@pytest.mark.parametrize("product", ["mass", "stiffness"])
def test_pod_with_a_product_is_that_of_pymor(model: Any, product: Any) -> None:
    """Peer: pyMOR's POD in an inner product given as an operator."""
    from pymor.algorithms.pod import pod
    from pymor.operators.numpy import NumpyMatrixOperator
    from pymor.vectorarrays.numpy import NumpyVectorSpace

    data = block(model, "link1.elastic")
    X = inner_product(data, product).X
    assert X is not None
    own = Pod(product=product, count=4).build(data)
    space = NumpyVectorSpace(data.size)
    in_rows = space.zeros(2).to_numpy().shape == (2, data.size)  # before pyMOR 2025
    U = space.make_array(data.snapshots.T if in_rows else data.snapshots)
    for method, tolerance in (("qr_svd", 1e-8), ("method_of_snapshots", 1e-4)):
        peer, values = pod(
            U, product=NumpyMatrixOperator(sparse.csc_matrix(X)), modes=4, method=method)
        other = peer.to_numpy().T if in_rows else peer.to_numpy()
        other = other / np.linalg.norm(other, axis=0)
        other = other * np.sign((other * own.atoms).sum(axis=0))
        assert np.abs(other - own.atoms).max() < tolerance
        assert values[3] / values[0] == pytest.approx(own.info["last_singular_value"], rel=1e-6)


def test_a_singular_stiffness_measures_its_kernel_in_the_mass(model: Any) -> None:
    """x^T K x <= x^T X x <= 2 x^T K x outside the kernel, lambda x^T M x inside it."""
    data = block(model, "link1.thermal")
    K, M = data.stiffness, data.mass
    assert free_rigid_motions(data) == 1
    X = inner_product(data, "stiffness").X
    assert X is not None
    values = linalg.eigh(K.toarray(), M.toarray(), eigvals_only=True)
    one = np.ones(data.size)
    assert one @ (X @ one) == pytest.approx(values[1] * (one @ (M @ one)), rel=1e-6)
    x = np.random.default_rng(0).standard_normal((data.size, 20))
    x -= np.outer(one, one @ (M @ x)) / (one @ (M @ one))
    ratio = np.sum(x * (X @ x), axis=0) / np.sum(x * (K @ x), axis=0)
    assert (ratio >= 1.0).all() and (ratio <= 2.0).all()


def test_a_body_without_supports_has_its_rigid_motions_found(model: Any) -> None:
    held = block(model, "link1.elastic")
    assert free_rigid_motions(held) == 0
    n = 30  # a free chain of springs in the plane: every node joined to every other
    rng = np.random.default_rng(2)
    points = rng.random((n, 2))
    K = np.zeros((2 * n, 2 * n))
    for i in range(n):
        for j in range(i):
            along = (points[i] - points[j]) / np.linalg.norm(points[i] - points[j])
            g = np.zeros(2 * n)
            g[2 * i : 2 * i + 2], g[2 * j : 2 * j + 2] = along, -along
            K += np.outer(g, g)
    free = replace(held, stiffness=sparse.csr_array(K), mass=sparse.csr_array(np.eye(2 * n)),
                   coordinates=np.repeat(points, 2, axis=0), component=np.tile([0, 1], n),
                   snapshots=rng.standard_normal((2 * n, 9)))
    assert rigid_motions(free).shape[1] == free_rigid_motions(free) == 3
    d = Pod(product="stiffness").build(free)
    assert d.atoms.shape[1] == 9
    assert np.abs(gram(d, inner_product(free, "stiffness").X) - np.eye(9)).max() < 1e-10


def test_what_is_no_inner_product_is_refused_at_its_option(model: Any) -> None:
    data = block(model, "link1.elastic")
    odd = replace(data, stiffness=-data.stiffness, mass=-data.mass)
    for product in ("mass", "stiffness"):
        with pytest.raises(InputError, match="product") as refused:
            Pod(product=product).build(odd)
        assert refused.value.faults[0].key == "product"
    with pytest.raises(ValidationError, match="give one of them"):
        Pod(product="mass", complete=True)
    with pytest.raises(ValidationError):
        Pod.model_validate({"product": "energy"})


@pytest.mark.parametrize("options", [
    {"product": "mass"}, {"product": "stiffness"}, {"product": "stiffness", "centred": True},
    {"product": "mass", "weights": "inverse_sqrt_norm"}, {"product": "stiffness", "energy": 0.99},
    {"product": "mass", "windows": 3, "count": 2}], ids=str)
def test_pod_keeps_the_laws_of_a_basis_in_every_product(options: dict[str, Any]) -> None:
    check_basis(Pod(**options), seed=3)


@pytest.mark.parametrize("product", ["mass", "stiffness"])
def test_snapshots_read_by_chunks_give_the_same_basis(
    model: Any, product: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    data = block(model, "link1.elastic")
    X = inner_product(data, product).X
    options: list[dict[str, Any]] = [
        {"count": 5}, {"energy": 0.9999}, {}, {"count": 4, "centred": True}]
    exact = [Pod(product=product, **o).build(data) for o in options]
    monkeypatch.setattr(snapshots_module, "HELD", 1000)
    monkeypatch.setattr(snapshots_module, "STRETCH", 8 * data.size * 7)
    for o, whole in zip(options, exact, strict=True):
        d = Pod(product=product, **o).build(data)
        assert d.atoms.shape == whole.atoms.shape
        k = d.atoms.shape[1]
        assert np.abs(gram(d, X) - np.eye(k)).max() < 1e-10
        A = data.snapshots - d.offset[:, None]
        assert missed(A, d, X) <= 1.001 * missed(A, whole, X) + 1e-11 * np.sqrt(np.sum(A * (X @ A)))
        assert d.info["energy_in_product"] == pytest.approx(
            whole.info["energy_in_product"], abs=1e-4)
