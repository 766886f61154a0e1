"""A class chosen by name is checked against the protocol of its kind before anything runs."""

from pathlib import Path
from types import SimpleNamespace
from typing import Any, TypeVar

import numpy as np
import pytest
from typer.testing import CliRunner
from typing_extensions import TypeAliasType

from contract_base import with_base
from sparsemor.core import Plugin
from sparsemor.core.cli import app
from sparsemor.core.errors import InputError
from sparsemor.core.protocols.step_solver import ManySteps
from sparsemor.core.registry.contracts import CONTRACTS, breaches
from sparsemor.core.registry.registry import Registry
from sparsemor.core.registry.value_types import fits, quick_test, required_type
from sparsemor.core.scene.scene import load
from sparsemor.core.simulation.simulate import simulate
from sparsemor.core.simulation.validation import checked_model

TINY = Path(__file__).parents[1] / "scenes" / "tiny.yaml"
SAMPLED = {"reducer": "sparse", "reducer.budgets": {"*": {"rows": 12, "atoms": 2}}}
HEAD = """
import numpy as np
from sparsemor.core import BASE

class Own(BASE):
    'A plugin.'
    BODY
"""

CASES = {
    "no method": ("sampler", "", "lacks sample(block, m, dictionary, rng, required)"),
    "misspelled": (
        "sampler", "def smaple(self, block, m, dictionary, rng, required): ...",
        "lacks sample(block, m, dictionary, rng, required); smaple is not looked for: did you mean "
        "sample?"),
    "too few arguments": (
        "sampler", "def sample(self, block, m): ...",
        "sample(block, m) cannot be called as sample(block, m, dictionary, rng, required)"),
    "one too many": (
        "sampler", "def sample(self, block, m, dictionary, rng, required, more): ...",
        "missing a required argument: 'more'"),
    "another order": (
        "sampler", "def sample(self, block, dictionary, m, rng, required): ...",
        "has m and dictionary at other positions than sample(block, m, dictionary, rng, required)"),
    "a value for a method": ("preconditioner", "build = property(lambda self: 3)",
                             "build must be a method build(A)"),
    "a method for a property": (
        "basis", "def needs_snapshots(self): return False\n    def build(self, data): ...",
        "needs_snapshots must be a property or a value, and is a method"),
    "an optional argument left out": ("linear_solver", "def factorize(self, A): ...",
                                      "cannot be called as factorize(A, places=None)"),
    "near to a default": (
        "basis", "needs_snapshots = False\n    def build(self, data): ...\n"
        "    def most_atom(self, size): ...",
        "most_atom is not looked for: did you mean most_atoms?"),
    "no solve": ("sparse_solver", "def prepare(self, columns, budget): ...",
                 "lacks solve(problem, start)"),
    "no rules": ("integrator", "order = property(lambda self: 1)", "lacks rules(h)"),
    "no prepare": ("reducer", "", "lacks prepare(problem)"),
    "no value": ("function", "def rate(self, t): ...", "lacks value(t)"),
    "no build of a mesh": ("mesh", "", "lacks build(base)"),
    "a build of a body": ("body", "def build(self): ...", "cannot be called as build(name, base)"),
    "a build of a joint": ("joint", "def build(self, name): ...", "build(name, parts)"),
    "a default with other arguments": (
        "basis", "needs_snapshots = False\n    def build(self, data): ...\n"
        "    def most_atoms(self): ...",
        "most_atoms() cannot be called as most_atoms(size)"),
    "no such effect": (
        "load", "acts_on = 'heat'\n    def build(self, name, parts): ...",
        "acts_on must be 'motion' or 'temperature' (got 'heat')"),
    "no truth value": (
        "linear_solver", "direct = 'yes'\n    def factorize(self, A, places=None): ...",
        "direct must be True or False (got 'yes')"),
    "an option without a type": (
        "load", "scale = 'lin'\n    def build(self, name, parts): ...",
        "scale is a value without a type: write scale: type = value to make it an option"),
    "near to a member of the built part": (
        "load", "localised = False\n    def build(self, name, parts): ...",
        "localised is not looked for: did you mean localized?"),
    "another version": (
        "sampler", "sparsemor_api = 1\n"
        "    def sample(self, block, m, dictionary, rng, required): ...",
        "it was written for version 1 of the extension API, and this is version 3 "
        "(docs/developers/version-3.md)"),
    "version 2": (
        "sampler", "sparsemor_api = 2\n"
        "    def sample(self, block, m, dictionary, rng, required): ...",
        "it was written for version 2 of the extension API, and this is version 3 "
        "(docs/developers/version-3.md)"),
    "no observer": ("observer", "", "lacks observer()"),
    "a build of a load": ("load", "", "lacks build(name, parts)"),
}


@pytest.mark.parametrize("kind", [k for k, c in CONTRACTS.items() if issubclass(c, Plugin)])
def test_a_plugin_that_does_not_derive_is_sent_to_the_page(distribute, kind):
    distribute("old-pkg", {kind: {"old": "old_mod:Own"}},
               old_mod=HEAD.replace("BODY", "").replace("BASE", "Plugin"))
    name = CONTRACTS[kind].__name__
    with pytest.raises(InputError, match=rf"does not derive from sparsemor.core.{name}, as plugins "
                       r"do since version 3 of the extension API \(docs/developers/version-3.md\)"):
        Registry().get(kind, "old")


@pytest.mark.parametrize("kind, body, message", CASES.values(), ids=list(CASES))
def test_a_broken_class_is_refused_by_name(distribute, kind, body, message):
    distribute("half-pkg", {kind: {"half": "half_mod:Own"}}, version="0.2",
               half_mod=with_base(kind, HEAD.replace("BODY", body)))
    with pytest.raises(InputError) as caught:
        Registry().get(kind, "half")
    assert message in str(caught.value)
    assert f"{kind} plugin 'half' of half-pkg 0.2 breaks the contract" in str(caught.value)


def test_more_options_and_other_names_of_arguments_are_fine(distribute):
    body = ("def sample(self, block, m, _dictionary, rng, required, seed=3, *more, **options):\n"
            "        return required")
    distribute("fine-pkg", {"sampler": {"fine": "fine_mod:Own"}},
               fine_mod=with_base("sampler", HEAD.replace("BODY", body)))
    block = SimpleNamespace(size=3)
    assert Registry().get("sampler", "fine")().sample(block, 1, None, None, [2]) == [2]


def test_every_plugin_of_ours_keeps_its_contract():
    registry = Registry()
    checked = [(kind, p.name) for kind in CONTRACTS for p in registry.names(kind)
               if p.distribution == "sparsemor" and not breaches(
                   kind, registry.get(kind, registry.spelling(p)))]
    assert len(checked) == sum(p.distribution == "sparsemor"
                               for kind in CONTRACTS for p in registry.names(kind)) > 50


def test_a_scene_says_where_the_broken_class_is_chosen(distribute, here):
    distribute("half-pkg", {"sampler": {"half": "half_where:Own"}},
               half_where=with_base("sampler", HEAD.replace("BODY", "")))
    scene = Path("scene.yaml")
    scene.write_text(TINY.read_text().partition("reducer:")[0] + "reducer:\n  use: sparse\n"
                     "  budgets: {'*': {rows: 12, atoms: 2}}\n  sampler: half\n")
    with pytest.raises(InputError, match=r"scene.yaml:\d+:3: reducer.sampler: sampler plugin"):
        load(scene)


RETURNS: dict[str, tuple[dict[str, Any], str, str, str]] = {
    "rows": ({**SAMPLED, "reducer.sampler": "odd"}, "sampler",
             "def sample(self, block, m, dictionary, rng, required): return None",
             "sampler odd of odd-pkg 1.0: Own.sample returned None, where an array of integers"),
    "far rows": ({**SAMPLED, "reducer.sampler": "odd"}, "sampler",
                 "def sample(self, block, m, dictionary, rng, required):\n"
                 "        return np.arange(m) + block.size", "not distinct ones below 51"),
    "weights": ({**SAMPLED, "reducer.preconditioner": "odd"}, "preconditioner",
                "def check(self, rows, atoms): return ''\n    def build(self, A): return A[:1]",
                "Own.build returned an array of shape (1, "),
    "dictionary": ({"reducer": "galerkin", "reducer.basis": "odd"}, "basis",
                   "needs_snapshots = False\n    def build(self, data): return data.loads",
                   "Own.build returned an array of float64"),
    "step solver": ({"reducer": "odd"}, "reducer",
                    "def prepare(self, problem): return None",
                    "Own.prepare returned None, where a StepSolver is required"),
    "body": ({"bodies.bar": "odd", "joints": {}, "loads": {}, "probes": {}}, "body",
             "def build(self, name, base): return self",
             "bodies.bar: body odd of odd-pkg 1.0: Own.build returned an Own, where a Body is"),
    "load": ({"loads": {"wind": "odd"}}, "load", "def build(self, name, parts): return None",
             "loads.wind: load odd of odd-pkg 1.0: Own.build returned None, where a Load is"),
    "mesh": ({"bodies.bar.mesh": "odd"}, "mesh", "def build(self, base): return 3",
             "Own.build returned 3, where a Mesh is required"),
}


@pytest.mark.full
@pytest.mark.parametrize("changes, kind, body, message", RETURNS.values(), ids=list(RETURNS))
def test_what_a_method_returns_is_checked_where_it_arrives(
    distribute, here, changes, kind, body, message
):
    distribute("odd-pkg", {kind: {"odd": "odd_returns:Own"}},
               odd_returns=with_base(kind, HEAD.replace("BODY", body)))
    scene = load(TINY, {"time.end": 0.002, "training.end": 0.002, **changes})
    with pytest.raises(InputError) as caught:
        checked_model(scene) if kind in ("body", "load", "mesh") else simulate(scene)
    assert message in str(caught.value)


PART = """
from dataclasses import dataclass
from sparsemor.core import Load, LoadPlugin

@dataclass(frozen=True)
class Built(Load):
    name: str
    BODY
    def contribute(self, equations): pass

class Own(LoadPlugin):
    'A load.'
    def build(self, name, parts): return Built(name)
"""
PARTS = {
    "misspelled": ("localised: bool = False",
                   "localised is not looked for: did you mean localized?"),
    "not a value": ("def moving(self): return True", "moving must be a property or a value"),
    "no truth value": ("localized = 'no'", "localized must be True or False (got 'no')"),
}
VALIDATED = {
    "sampler": ("reducer.sampler",
                "reducer.sampler: sampler plugin 'half' of half-pkg 0.2 breaks the contract "
                "Sampler: lacks sample(block, m, dictionary, rng, required)",
                HEAD.replace("BODY", "")),
    "sparse_solver": ("reducer.solver", "sparse_solver plugin 'half' of half-pkg 0.2 breaks the "
                      "contract SparseSolver: solve(problem) cannot be called as "
                      "solve(problem, start)",
                      HEAD.replace("BODY", "def solve(self, problem): ...\n"
                                   "    def prepare(self, columns, budget): ...")),
    "load": ("loads.wind", "loads.wind: load plugin 'half' of half-pkg 0.2 breaks the contract "
             "LoadPlugin: acts_on must be 'motion' or 'temperature' (got 'heat')",
             HEAD.replace("BODY", "acts_on = 'heat'\n    def build(self, name, parts): ...")),
}


@pytest.mark.parametrize("body, message", PARTS.values(), ids=list(PARTS))
def test_a_built_load_is_checked_by_validate(distribute, here, body, message):
    distribute("half-pkg", {"load": {"half": "half_part:Own"}}, version="0.2",
               half_part=PART.replace("BODY", body))
    line = refused("--set", "loads={wind: half}")
    assert "loads.wind: build of half_part.Own returned Built" in line
    assert message in line


@pytest.mark.parametrize("kind", VALIDATED)
def test_validate_refuses_a_broken_plugin_in_one_located_line(distribute, here, kind):
    key, message, source = VALIDATED[kind]
    distribute("half-pkg", {kind: {"half": "half_valid:Own"}}, version="0.2",
               half_valid=with_base(kind, source))
    sampled = () if kind == "load" else (
        "--set", "reducer={use: sparse, budgets: {'*': {rows: 12, atoms: 2}}}")
    assert message in refused(*sampled, "--set", f"{key}=half")


def refused(*arguments: str) -> str:
    """The one line with which `sparsemor validate` refuses a scene."""
    result = CliRunner().invoke(app, ["validate", str(TINY), *arguments])
    assert result.exit_code == 2, result.output
    lines = result.stderr.strip().splitlines()
    assert len(lines) == 1, lines
    return lines[0]


RIGID = {"rigid_stage": {}, "reducer": "full"}


def test_a_body_that_cannot_follow_a_motion_is_refused_with_a_rigid_stage(distribute, here):
    distribute("still-pkg", {"body": {"still": "still_body:Own"}}, still_body="""
import numpy as np
from sparsemor.core import Body, BodyPlugin

class Still(Body):
    def __init__(self, name): self.name, self.pose = name, np.zeros(3)
    def contribute(self, equations): pass

class Own(BodyPlugin):
    'A body.'
    def build(self, name, base): return Still(name)
""")
    scene = load(TINY, {"bodies.other": "still", "time.end": 0.002, "training.end": 0.002, **RIGID})
    with pytest.raises(InputError) as caught:
        checked_model(scene)
    assert ("bodies.other: with rigid_stage, it has to follow a prescribed motion, which "
            "still_body.Still cannot: it has no with_motion(motion)") in str(caught.value)


def test_a_named_type_is_what_it_stands_for() -> None:
    """`type X = ...`, as NumPy names arrays from Python 3.12 on."""
    T = TypeVar("T", bound=np.generic)
    arrays = TypeAliasType(
        "arrays", np.ndarray[Any, np.dtype[T]], type_params=(T,))  # type: ignore[valid-type]
    floats = TypeAliasType("floats", arrays[np.float64])
    for hint in (arrays[np.float64], floats, floats | None):
        assert fits(np.ones(2), hint) and quick_test(hint)(np.ones(2))
        assert not fits(np.ones(2, dtype=int), hint) and not fits("text", hint)
        assert required_type(hint).startswith("an array of finite numbers")


def test_a_protocol_of_a_type_is_fitted_by_what_has_its_members() -> None:
    steps = SimpleNamespace(advance=lambda *_: None)
    for hint in (ManySteps[Any], ManySteps[Any] | None):
        assert fits(steps, hint) and not fits("text", hint)
