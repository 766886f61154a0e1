"""Loads that move over a body: tables, the term, and what reduced blocks keep of them."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.sparse import random_array

from sparsemor import load
from sparsemor.core.model.assembly import assemble
from sparsemor.core.model.equations import AssembledTerm
from sparsemor.core.model.linear_equations import TabledEquations
from sparsemor.core.model.model import Model
from sparsemor.core.model.prescribed_quantities import AtStart
from sparsemor.core.protocols.load_tables import LoadTable, Table, times_rows
from sparsemor.core.testing import check_term
from sparsemor.reducers.step.time_tables import projected_tables, total_load

SLIDER = Path(__file__).parents[2] / "scenes" / "small_slider.yaml"


def table(steps: int = 9, width: int = 4, seed: int = 0) -> Table:
    rng = np.random.default_rng(seed)
    return Table(np.cumsum(rng.uniform(0.5, 1.5, steps)), rng.standard_normal((steps, width)))


def test_rows_of_the_table_at_its_times_lines_between_constant_outside():
    t = table()
    for i, time in enumerate(t.times):
        np.testing.assert_array_equal(t.at(float(time)), t.values[i])
    middle = 0.25 * t.times[3] + 0.75 * t.times[4]
    np.testing.assert_allclose(t.at(float(middle)), 0.25 * t.values[3] + 0.75 * t.values[4])
    np.testing.assert_array_equal(t.at(-1.0), t.values[0])
    np.testing.assert_array_equal(t.at(1e9), t.values[-1])


def test_a_time_that_was_summed_up_is_that_of_the_grid():
    h = 3.75e-6
    t = Table(h * np.arange(1001), np.arange(1001.0)[:, None])
    summed = np.cumsum(np.full(1000, h))
    assert (summed != t.times[1:]).any()
    assert [t.at(s)[0] for s in summed.tolist()] == list(range(1, 1001))


def test_what_a_map_sees_is_the_map_of_the_load():
    rng = np.random.default_rng(3)
    columns = [random_array((20, 4), density=0.3, rng=rng, format="csr") for _ in range(3)]
    loads = [LoadTable("a", c, ("",) * 4, table(seed=s))
             for c, s in zip(columns, (1, 1, 2), strict=True)]
    left, rows = rng.standard_normal((6, 20)), np.array([2, 3, 11])
    for test, dense in ((lambda m: left @ m, left), (lambda m: m[rows], np.eye(20)[rows])):
        seen = projected_tables(loads, test)
        assert len(seen) == 2  # one table for loads of the same times
        for t in (0.0, 3.3, 7.0):
            want = dense @ sum(one.at(t) for one in loads)
            np.testing.assert_allclose(total_load(seen, t), want, rtol=1e-13, atol=1e-13)
    np.testing.assert_allclose(
        loads[0].projected(left).at(2.2), left @ loads[0].at(2.2), atol=1e-13)


@pytest.fixture(scope="module")
def model() -> Model:
    return assemble(load(SLIDER), AtStart())


def moving(model: Model) -> list[AssembledTerm[TabledEquations]]:
    """The contact's terms, with loads drawn at random in place of those at the start."""
    found = [t for t in model.terms
             if isinstance(t, AssembledTerm) and isinstance(t.equations, TabledEquations)]
    loads = [t.equations.load for t in found]
    return [replace(t, equations=TabledEquations(
                replace(load, table=table(width=load.columns.shape[1], seed=i))))
            for i, (t, load) in enumerate(zip(found, loads, strict=True))]


def test_table_terms_keep_the_laws_of_a_term(model):
    terms = moving(model)
    assert len(terms) == 4  # force and heat on both bodies
    for term in terms:
        check_term(term, np.random.default_rng(1), base=np.zeros(0))


def test_rows_that_a_table_loads_are_required_and_named(model):
    for name, nodes in (("slider.elastic", 6), ("plate.elastic", 13)):
        loaded = model.loaded[name]["sole"]
        assert len(loaded) == 2 * nodes and set(loaded) <= set(model.required[name])
    heat = model.separated.heat[0].tables
    assert [t.source for t in heat] == ["sole"]
    assert heat[0].names[0].startswith("sole, node ")
    assert heat[0].columns.shape == (len(model.geometry["slider.thermal"][0]), 6)


def test_a_block_gets_the_rows_that_the_term_has(model):
    for term in moving(model):
        block = next(b for b in model.reducible()
                     if model.layout[b].start <= term.rows[0] < model.layout[b].stop)
        at, whole = model.layout[block], np.zeros(model.layout.size)
        whole[term.rows] = -term.residual(*(np.zeros(0),) * 3, 2.2)
        assert whole.any()
        (load,) = model.moving(block)
        load = replace(load, table=term.equations.load.table)
        np.testing.assert_array_equal(load.at(2.2), whole[at])


def test_rows_of_a_product_do_not_depend_on_their_number() -> None:
    rng = np.random.default_rng(2)
    values, left = rng.standard_normal((150, 37)), rng.standard_normal((6, 37))
    whole = times_rows(values, left)
    np.testing.assert_allclose(whole, values @ left.T, rtol=0, atol=1e-13)
    for count in range(1, 150, 7):
        assert np.array_equal(times_rows(values[:count], left), whole[:count])
