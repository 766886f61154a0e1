"""A class chosen by name is checked against the protocol of its kind before anything runs."""

from pathlib import Path
from typing import Any

import pytest

from sparsemor.core.checks import checked_model
from sparsemor.core.contracts import CONTRACTS, breaches
from sparsemor.core.errors import InputError
from sparsemor.core.registry import Registry
from sparsemor.core.scene import load
from sparsemor.core.simulate import simulate

TINY = Path(__file__).parents[1] / "scenes" / "tiny.yaml"
SAMPLED = {"reducer": "sparse", "reducer.budgets": {"*": {"rows": 12, "atoms": 2}}}
HEAD = """
import numpy as np
from sparsemor.core.plugin import Plugin

class Own(Plugin):
    'A plugin.'
    BODY
"""

CASES = {
    "no method": ("sampler", "", "lacks sample(block, m, dictionary, rng, required)"),
    "misspelled": (
        "sampler", "def smaple(self, block, m, dictionary, rng, required): ...",
        "lacks sample(block, m, dictionary, rng, required) (smaple is near to it)"),
    "too few arguments": (
        "sampler", "def sample(self, block, m): ...",
        "sample(block, m) cannot be called as sample(block, m, dictionary, rng, required)"),
    "one too many": (
        "sampler", "def sample(self, block, m, dictionary, rng, required, more): ...",
        "missing a required argument: 'more'"),
    "another order": (
        "sampler", "def sample(self, block, dictionary, m, rng, required): ...",
        "has m and dictionary at other places than sample(block, m, dictionary, rng, required)"),
    "a value for a method": ("preconditioner", "check: str = ''; build: int = 3",
                             "build must be a method build(A)"),
    "a method for a property": (
        "basis", "def needs_snapshots(self): return False\n    def build(self, data): ...",
        "needs_snapshots must be a property or a value, and is a method"),
    "an optional argument left out": ("linear_solver", "def factorize(self, A): ...",
                                      "cannot be called as factorize(A, places=None)"),
    "near to an ability": (
        "basis", "needs_snapshots: bool = False\n    def build(self, data): ...\n"
        "    def most_atom(self, size): ...",
        "most_atom is not looked for: did you mean most_atoms?"),
    "no solve": ("sparse_solver", "", "lacks solve(problem, start)"),
    "no formula": ("integrator", "order: int = 1\n    def start(self, layout, state): ...\n"
                   "    def advance(self, layout, state, formula, x, h): ...",
                   "lacks formula(layout, state, h)"),
    "no prepare": ("reducer", "", "lacks prepare(model, integrator, h, offline, rng)"),
    "no value": ("function", "def rate(self, t): ...", "lacks value(t)"),
    "no build of a mesh": ("mesh", "", "lacks build(base)"),
    "a build of a body": ("body", "def build(self): ...", "cannot be called as build(name, base)"),
    "a build of a joint": ("joint", "def build(self, name): ...", "build(name, parts)"),
    "a build of a load": ("load", "", "lacks build(name, parts)"),
}


@pytest.mark.parametrize("kind, body, message", CASES.values(), ids=list(CASES))
def test_a_broken_class_is_refused_by_name(distribute, kind, body, message):
    distribute("half-pkg", {kind: {"half": "half_mod:Own"}}, version="0.2",
               half_mod=HEAD.replace("BODY", body))
    with pytest.raises(InputError) as caught:
        Registry().get(kind, "half")
    assert message in str(caught.value)
    assert f"{kind} plugin 'half' of half-pkg 0.2 breaks the protocol" in str(caught.value)


def test_more_options_and_other_names_of_arguments_are_fine(distribute):
    body = ("def sample(self, block, m, _dictionary, rng, required, seed=3, *more, **options):\n"
            "        return required")
    distribute("fine-pkg", {"sampler": {"fine": "fine_mod:Own"}},
               fine_mod=HEAD.replace("BODY", body))
    assert Registry().get("sampler", "fine")().sample(None, 1, None, None, [2]) == [2]


def test_every_plugin_of_ours_keeps_its_contract():
    registry = Registry()
    checked = [(kind, p.name) for kind in CONTRACTS for p in registry.names(kind)
               if p.distribution == "sparsemor" and not breaches(
                   kind, registry.get(kind, registry.spelling(p)))]
    assert len(checked) == sum(p.distribution == "sparsemor"
                               for kind in CONTRACTS for p in registry.names(kind)) > 50


def test_a_scene_says_where_the_broken_class_is_chosen(distribute, here):
    distribute("half-pkg", {"sampler": {"half": "half_where:Own"}},
               half_where=HEAD.replace("BODY", ""))
    scene = Path("scene.yaml")
    scene.write_text(TINY.read_text().partition("reducer:")[0] + "reducer:\n  use: sparse\n"
                     "  budgets: {'*': {rows: 12, atoms: 2}}\n  sampler: half\n")
    with pytest.raises(InputError, match=r"scene.yaml:\d+:3: reducer.sampler: sampler plugin"):
        load(scene)


RETURNS: dict[str, tuple[dict[str, Any], str, str, str]] = {
    "rows": ({**SAMPLED, "reducer.sampler": "odd"}, "sampler",
             "def sample(self, block, m, dictionary, rng, required): return None",
             "reducer.sampler: sample of odd_returns.Own returned object of shape ()"),
    "far rows": ({**SAMPLED, "reducer.sampler": "odd"}, "sampler",
                 "def sample(self, block, m, dictionary, rng, required):\n"
                 "        return np.arange(m) + block.size", "distinct rows from 0 to"),
    "weights": ({**SAMPLED, "reducer.preconditioner": "odd"}, "preconditioner",
                "def check(self, rows, atoms): return ''\n    def build(self, A): return A[:1]",
                "reducer.preconditioner: build of odd_returns.Own returned float64 of shape (1, "),
    "dictionary": ({"reducer": "galerkin", "reducer.basis": "odd"}, "basis",
                   "needs_snapshots: bool = False\n    def build(self, data): return data.loads",
                   "build of odd_returns.Own returned ndarray, where a Dictionary is required"),
    "step solver": ({"reducer": "odd"}, "reducer",
                    "def prepare(self, model, integrator, h, offline, rng): return None",
                    "reducer: prepare of odd_returns.Own returned NoneType, which lacks"),
    "body": ({"bodies.bar": "odd", "joints": {}, "loads": {}, "probes": {}}, "body",
             "def build(self, name, base): return self",
             "bodies.bar: build of odd_returns.Own returned Own, which lacks blocks(), "
             "claims(layout, term), geometry(), heat_equations(layout, terms), initial()"),
    "load": ({"loads": {"wind": "odd"}}, "load", "def build(self, name, parts): return None",
             "loads.wind: build of odd_returns.Own returned NoneType, which lacks blocks()"),
    "mesh": ({"bodies.bar.mesh": "odd"}, "mesh", "def build(self, base): return 3",
             "bodies.bar.mesh: build of odd_returns.Own returned int, where a Mesh is required"),
}


@pytest.mark.parametrize("changes, kind, body, message", RETURNS.values(), ids=list(RETURNS))
def test_what_a_method_returns_is_checked_where_it_arrives(
    distribute, here, changes, kind, body, message
):
    distribute("odd-pkg", {kind: {"odd": "odd_returns:Own"}},
               odd_returns=HEAD.replace("BODY", body))
    scene = load(TINY, {"time.end": 0.002, "training.end": 0.002, **changes})
    with pytest.raises(InputError) as caught:
        checked_model(scene) if kind in ("body", "load", "mesh") else simulate(scene)
    assert message in str(caught.value)
