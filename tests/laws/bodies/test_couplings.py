"""Couplings between thermal blocks: a contact resistance keeps the prefactored step."""

from typing import Any

import numpy as np
import pytest
from scipy.sparse import csr_array
from thermal_contact import ContactResistance

from reduced_runs import errors as true_errors
from reduced_runs import estimates, learnt
from sparsemor.bodies.terms.field_kinds import MULTIPLIER, THERMAL
from sparsemor.core import InputError
from sparsemor.core.model.assembly import assemble
from sparsemor.core.model.block_operators import block_operators
from sparsemor.core.model.equations import system_jacobian, system_residual
from sparsemor.core.model.general_terms import general_terms
from sparsemor.core.model.model import Model
from sparsemor.core.protocols.contributions import Equations, Origin, Records
from sparsemor.core.protocols.layout import Block, Layout
from sparsemor.core.scene.scene import Scene
from sparsemor.core.testing.in_memory_run import March, march
from sparsemor.reducers.sparse.supported_steps import SparseStepper
from sparsemor.reducers.step.blockwise_solver import BlockwiseSolver
from springs import bars
from tiers import quick

HOT = ("one.thermal", "two.thermal")
REDUCERS: dict[str, dict[str, Any]] = {
    use: {"use": use, "basis": {"use": "pod", "count": 12}}
    for use in ("galerkin", "lspg", "ecsw", "sparse")}
REDUCERS["sparse"]["sampler"] = {"use": "deim", "method": "qr"}
LIMITS = {"ecsw": 1e-4}


def linked(scene: Scene, conductance: float = 400.0) -> Model:
    """The two bars with a contact resistance between the ends that face each other."""
    gap = ContactResistance(between=("one:right", "two:left"), conductance=conductance)
    return assemble(scene.model_copy(update={"loads": {**scene.loads, "gap": gap}}))


def run(reducer: Any, of: March | None = None) -> March:
    scene = bars(divisions=(6, 2)).using({"reducer": reducer, "time.end": 0.02})
    snapshots = None if of is None else {n: of.block(n).T for n in of.model.reducible()}
    return march(scene, model=linked(scene), snapshots=snapshots)


@pytest.fixture(scope="module")
def textbook() -> March:
    return run({"use": "full", "method": "newton"})


def errors(found: March, truth: March) -> dict[str, float]:
    """Relative to the change over the run, where there is one."""
    out = {}
    for name in found.model.reducible():
        x, d = found.block(name), found.solver.dictionaries.get(name)
        x = x if d is None else d.offset + x @ d.atoms.T
        change = np.abs(truth.block(name) - truth.block(name)[0]).max()
        out[name] = float(np.abs(x - truth.block(name)).max() / change)
    return out


@pytest.mark.full
def test_the_error_of_coupled_temperatures_is_estimated() -> None:
    full = run("full")
    scene = bars(divisions=(6, 2)).using({
        "reducer": {**REDUCERS["galerkin"], "basis": {"use": "pod", "count": 4}}, "time.end": 0.02})
    found = march(scene, model=linked(scene), snapshots=learnt(full))
    guess = estimates(scene, found)
    for name in HOT:
        assert guess[name].max() == pytest.approx(true_errors(full, found, name).max(), rel=1e-3)


@pytest.mark.full
def test_full_order_is_the_textbook_newton_by_one_factor_of_the_group(textbook: March) -> None:
    fast = run("full")
    assert isinstance(fast.solver, BlockwiseSolver) and not fast.model.separated.other
    assert [name for name, _ in fast.solver.heat_groups] == ["+".join(HOT)]
    _, memory = fast.solver.start(fast.end)
    assert fast.solver.counters(memory)["factorizations"] == 3  # both temperatures, two bars
    assert max(errors(fast, textbook).values()) < 1e-9


@pytest.mark.full
@pytest.mark.parametrize("use", quick(REDUCERS, "galerkin", "sparse"))
def test_a_reduced_step_is_as_short_as_without_it(use: str, textbook: March) -> None:
    reduced = run(REDUCERS[use], textbook)
    assert isinstance(reduced.solver, BlockwiseSolver)
    (block,) = reduced.solver.heat.values()
    assert not block.elements
    assert max(errors(reduced, textbook).values()) < LIMITS.get(use, 1e-6)


@pytest.mark.full
def test_a_choice_of_atoms_is_refused_where_it_cannot_be_made(textbook: March) -> None:
    chosen = {**REDUCERS["sparse"], "budgets": {"*.thermal": {"rows": 14, "atoms": 4}}}
    with pytest.raises(InputError, match="gap couples bodies inside the step"):
        run(chosen, textbook)


@pytest.mark.full
def test_atoms_of_displacements_are_selected_next_to_a_coupling(textbook: March) -> None:
    """Temperatures are those of all atoms; thermal blocks that are coupled select nothing."""
    chosen = {**REDUCERS["sparse"], "budgets": {"*.elastic": {"rows": 30, "atoms": 6}}}
    found = run(chosen, textbook)
    assert isinstance(found.solver, SparseStepper) and set(found.solver.steps.elastic) == {
        "one.elastic", "two.elastic"}
    wrong = errors(found, textbook)
    assert max(wrong[name] for name in HOT) < 1e-6
    assert max(wrong.values()) < 0.1


def test_both_forms_of_all_kinds_of_records_are_the_same_equations() -> None:
    """Random matrices on and between blocks: the general residual and Jacobian against the
    operators of the blocks."""
    layout = Layout(
        [Block("a", THERMAL, 4), Block("b", THERMAL, 3), Block("j", MULTIPLIER, 2)])
    rng, records = np.random.default_rng(1), Records()
    for body in "ab":
        Equations(layout, Origin("bodies", body), records).body(
            lambda items: pytest.fail("no frame"), np.zeros(3), moves=False)
    load = Equations(layout, Origin("loads", "c"), records)
    for rows in ("a.thermal", "b.thermal"):
        for columns in ("a.thermal", "b.thermal"):
            shape = load.size(rows), load.size(columns)
            load.matrix(rows, columns, A=csr_array(rng.standard_normal(shape)),
                        B=csr_array(rng.standard_normal(shape)))
        load.vector(rows, rng.standard_normal(load.size(rows)), lambda t: 2.0 + t)
        load.vector(rows, rng.standard_normal(load.size(rows)))
    load.matrix("j.multiplier", "a.thermal", A=csr_array(rng.standard_normal((2, 4))))
    s = block_operators(layout, records, 0.1)
    assert len(s.couplings) == 2 and len(s.other) == 1 and len(s.heat_groups) == 1
    terms = [t for part in general_terms(layout, records).values() for t in part]
    x, v, zero, t = rng.standard_normal(9), rng.standard_normal(9), np.zeros(9), 0.3
    want = np.zeros(9)
    for h in s.heat:
        at = layout[h.thermal]
        want[at] += (h.conductivity @ x[at] + h.capacity @ v[at] - h.constant
                     - h.loads @ [f(t) for f in h.amplitudes])
    for c in s.couplings:
        want[layout[c.rows]] += c.A @ x[layout[c.columns]] + c.B @ v[layout[c.columns]]
    want[s.other[0].rows] += s.other[0].residual(x[:4], v[:4], zero[:4], t)
    np.testing.assert_allclose(system_residual(layout, terms, x, v, zero, t), want, rtol=1e-13)
    K = system_jacobian(layout, terms, x, v, zero, t, zero, zero).toarray()
    np.testing.assert_allclose(K[:4, 4:7], s.couplings[0].A.toarray(), rtol=1e-13)


@pytest.mark.parametrize("write, message", [
    (lambda e: e.matrix("a.thermal", "c.thermal"), "'c.thermal', which the scene does not have"),
    (lambda e: e.matrix("a.thermal", "a.thermal", A=csr_array((4, 3))),
     r"A on \(a.thermal, a.thermal\) has shape \(4, 3\)"),
    (lambda e: e.vector("a.thermal", np.zeros(3)), "a vector on a.thermal has shape"),
    (lambda e: e.constraint("a.thermal", [float]), "1 targets for the 4 rows"),
])
def test_what_does_not_fit_a_block_is_one_located_error(write: Any, message: str) -> None:
    equations = Equations(Layout([Block("a", THERMAL, 4)]), Origin("loads", "wind"), Records())
    with pytest.raises(InputError, match="^loads.wind: .*" + message):
        write(equations)
