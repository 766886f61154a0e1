"""Plugins that raise, or return None, no numbers, complex numbers or arrays of another shape: one
line with distribution, plugin, method and place, and never a traceback, in every kind."""

import json
import os
import re
import subprocess
import sys
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest
from typer.testing import CliRunner

from contract_base import with_base
from small_scenes import SCENES, tiny
from sparsemor import InputError, SolveFailed, load, simulate
from sparsemor.core.cli import app
from sparsemor.core.registry.boundary import read_only
from sparsemor.core.registry.contracts import CONTRACTS
from sparsemor.core.registry.hooks import new_manager
from sparsemor.core.registry.registry import Registry
from sparsemor.core.status import Status

HEAD = """
from dataclasses import fields
from typing import Any
import numpy as np
from sparsemor.core import (
    BASE, Dictionary, LinearOutcome, Load, MaterialProperties, Mesh, Selection, State, Status,
    StepOutcome, UpdateRule, UpdateRules)
from sparsemor.core import Term as ATerm

class Own(BASE):
    'A plugin.'
"""
SAMPLED = {"use": "sparse", "budgets": {"*": {"rows": 12, "atoms": 2}}}
CONTACT = "small_slider.yaml"


class Kind(NamedTuple):
    """A kind of plugin in a scene. before: other members of the class; method: that misbehaves,
    with its arguments; values: what it returns, by misbehaviour."""

    changes: dict[str, Any]
    method: str
    values: dict[str, str]
    before: str = ""
    scene: str = "tiny.yaml"
    after: str = ""


def of_array(shape: str, wrong: str = "np.ones((3, 1, 2))") -> dict[str, str]:
    """Values of a method that returns an array."""
    return {"nan": f"np.full({shape}, np.nan)", "complex": f"np.ones({shape}) * 1j",
            "shape": wrong}


def of_object(*others: str) -> dict[str, str]:
    """Values of a method that returns an object."""
    return {"nan": "float('nan')", "complex": "1j", "shape": "np.ones(3)",
            **{f"other {i}": other for i, other in enumerate(others)}}


RULE = "UpdateRule(np.array([1.0, 1.0, 1.0]) * {0}, np.zeros(({1}, 3)))"
RULES = f"UpdateRules({RULE}, {RULE})"
KINDS: dict[str, Kind] = {
    "basis": Kind({"reducer": {"use": "galerkin", "basis": "odd"}}, "build(self, data)", {
        f: f"Dictionary({atoms}, np.zeros(data.size), ('a', 'b'))" for f, atoms in {
            **of_array("(data.size, 2)"), "short": "np.ones((2, 2))"}.items()},
        "needs_snapshots = False"),
    "body": Kind({"bodies.bar": "odd", "joints": {}, "loads": {}}, "build(self, name, base)",
                 of_object("self")),
    "contact": Kind({"contacts": {"pad": "odd"}}, "build(self, name, parts)", of_object("self")),
    "friction_law": Kind(
        {"contacts.sole.friction": "odd"}, "ratio(self, slip)", {
            f: f"({v}, np.zeros(slip.shape))" for f, v in of_array("slip.shape").items()},
        "", CONTACT),
    "function": Kind({"loads.heating.flux": "odd"}, "value(self, t)", of_array("()"),
                     after="def rate(self, t): return 0.0"),
    "integrator": Kind({"integrator": "odd"}, "rules(self, h)", {
        "nan": RULES.format("np.nan", 3), "complex": RULES.format("1j", 3),
        "shape": RULES.format("1.0", 2)},
        "order = property(lambda self: 1)\n    def start(self, layout, state): return state"),
    "joint": Kind({"joints": {"pin": "odd"}}, "build(self, name, parts)", of_object("self")),
    "linear_solver": Kind({"linear_solver": "odd", "reducer": "full"},
                          "factorize(self, A, places=None)", of_object("self")),
    "load": Kind({"loads": {"wind": "odd"}}, "build(self, name, parts)", of_object("self")),
    "material": Kind({"bodies.bar.material": "odd"}, "properties(self)", {
        f: f"MaterialProperties({v}, 1.0, 0.3, 0.0, 1.0, 1.0)"
        for f, v in of_array("()").items()}),
    "mesh": Kind({"bodies.bar.mesh": "odd"}, "build(self, base)", {
        f: f"Mesh({v}, np.array([[0, 1, 2]]))" for f, v in of_array("(3, 2)").items()}
        | {"corners": "Mesh(np.eye(3)[:, :2], np.array([[0, 1, 7]]))"}),
    "normal_law": Kind(
        {"contacts.sole.normal": "odd"}, "pressure(self, depth, rate)", {
            f: f"({v}, np.zeros(depth.shape), np.zeros(depth.shape))"
            for f, v in of_array("depth.shape").items()},
        "", CONTACT),
    "observer": Kind({}, "observer(self)", of_object("self")),
    "preconditioner": Kind(
        {"reducer": {**SAMPLED, "preconditioner": "odd"}}, "build(self, A)",
        of_array("(len(A), len(A))", "A[:1]"), "def check(self, rows, atoms): return ''"),
    "reducer": Kind({"reducer": "odd"}, "prepare(self, problem)", of_object("self")),
    "sampler": Kind({"reducer": {**SAMPLED, "sampler": "odd"}},
                    "sample(self, block, m, dictionary, rng, required)", {
                        **of_array("m"), "range": "np.arange(m) + block.size",
                        "twice": "np.zeros(m, int)"}),
    "sparse_solver": Kind(
        {"reducer": {**SAMPLED, "solver": "odd"}}, "prepare(self, columns, budget)",
        of_object("self"), "def solve(self, problem, start): return None"),
}
MISBEHAVIOURS = ("raises", "exits", "none", "nan", "complex", "shape")
EACH = [(kind, how) for kind, k in KINDS.items()
        for how in dict.fromkeys((*MISBEHAVIOURS, *k.values))]
FAST = {("basis", "nan"), ("sampler", "raises"), ("function", "complex"), ("mesh", "none"),
        ("material", "shape"), ("body", "exits")}


def text_of(name: str, how: str) -> str:
    """Module of a plugin that misbehaves in its one method."""
    kind = KINDS[name]
    does = {"raises": "raise ZeroDivisionError('no good')", "exits": "raise SystemExit(0)",
            "none": "return None"}.get(how) or f"return {kind.values[how]}"
    text = f"{HEAD}    {kind.before}\n    def {kind.method}:\n        {does}\n    {kind.after}\n"
    return with_base(name, text.replace("@property\n\n", "@property\n"))


def run(kind: str) -> None:
    if kind == "observer":
        plugin: Any = Registry().get(kind, "odd")()
        new_manager([plugin.observer()])
        return
    k = KINDS[kind]
    ends = {} if k.scene == CONTACT else {"time.end": 0.002, "training.end": 0.002}
    scene = load(SCENES / k.scene, {**ends, **k.changes})
    simulate(scene)


@pytest.mark.parametrize(("kind", "how"), [
    pytest.param(*one, marks=() if one in FAST else pytest.mark.full) for one in EACH])
def test_a_plugin_that_misbehaves_is_named_in_one_line(
    distribute: Any, kind: str, how: str
) -> None:
    text = text_of(kind, how)
    distribute("odd-pkg", {kind: {"odd": "odd_plugin:Own"}}, odd_plugin=text)
    with pytest.raises((InputError, SolveFailed)) as caught:
        run(kind)
    error = caught.value
    line, method = str(error), KINDS[kind].method.partition("(")[0]
    assert "\n" not in line
    if isinstance(error, SolveFailed):
        assert error.status is Status.PLUGIN_FAILED and error.result is not None
    defined = next(i for i, t in enumerate(text.splitlines(), 1) if f"def {method}" in t)
    at = {defined, defined + 1, defined - 1}
    assert f"{kind} odd of odd-pkg 1.0: Own.{method} " in line
    assert any(f"odd_plugin.py:{n})" in line for n in at), line
    assert "raised ZeroDivisionError: no good" in line or how != "raises"


def test_every_kind_is_tried() -> None:
    assert set(KINDS) == set(CONTRACTS)
    assert all({"nan", "complex", "shape"} <= set(k.values) for k in KINDS.values())


WITHIN: dict[str, tuple[str, dict[str, Any], str, str]] = {
    "linear solver": ("linear_solver", {"linear_solver": "odd", "reducer": "full"}, """
    def factorize(self, A, places=None):
        found = Registry().get("linear_solver", "splu")().factorize(A, places)
        class Odd:
            solver, note, memory, iterative = "odd", "", 0, False
            status = found.status
            def solve(self, b, start=None): VALUE
            def outcome(self, b, start=None): VALUE
        return Odd()""", "Odd.solve"),
    "recovery": ("sparse_solver", {"reducer": {**SAMPLED, "solver": "odd"}}, """
    def solve(self, problem, start): return None
    def prepare(self, columns, budget):
        class Odd:
            def select(self, r, c, support): VALUE
        return Odd()""", "Odd.select"),
    "step solver": ("reducer", {"reducer": "odd"}, """
    def prepare(self, problem):
        made = Registry().get("reducer", "full")().prepare(problem)
        class Odd(type(made)):
            def solve(self, step, memory): VALUE
        return Odd(**{f.name: getattr(made, f.name) for f in fields(made) if f.init})""",
        "Odd.solve"),
    "load": ("load", {"loads": {"wind": "odd"}}, """
    def build(self, name, parts):
        class Odd(Load):
            def contribute(self, equations):
                def value(): VALUE
                equations.vector("bar.thermal", value())
        made = Odd()
        made.name = name
        return made""", "wind|Odd.contribute"),
    "term": ("load", {"loads": {"wind": "odd"}, "reducer": "full"}, """
    def build(self, name, parts):
        class Term(ATerm):
            def residual(self, x, v, a, t): VALUE
            def jacobian(self, x, v, a, t, c1, c2): VALUE
            def restrict(self, keep): return self
            def compress(self, trial, left): VALUE
        class Odd(Load):
            def contribute(self, equations):
                term = Term()
                term.rows = term.columns = equations.numbers("bar.thermal")
                equations.local(["bar.thermal"], term)
        made = Odd()
        made.name = name
        return made""", "Term"),
}


@pytest.mark.full
@pytest.mark.parametrize("does", [
    "raise ZeroDivisionError('no good')", "return None", "return np.full(3, np.nan)",
    "return np.ones(3) * 1j", "return np.ones((7, 1, 2))"])
@pytest.mark.parametrize("name", WITHIN)
def test_what_a_plugin_has_built_misbehaves(distribute: Any, name: str, does: str) -> None:
    kind, changes, body, method = WITHIN[name]
    head = HEAD.replace("UpdateRules)", "UpdateRules, Registry, Load)")
    text = with_base(kind, head + body.replace("VALUE", does))
    distribute("odd-pkg", {kind: {"odd": "odd_within:Own"}}, odd_within=text)
    ends = {"time.end": 0.002, "training.end": 0.002}
    with pytest.raises((InputError, SolveFailed)) as caught:
        simulate(load(SCENES / "tiny.yaml", {**ends, **changes}))
    line = str(caught.value)
    assert "\n" not in line and re.search(method, line), line
    assert "odd-pkg 1.0" in line or "loads.wind" in line, line


SCRIBBLES = """
    needs_snapshots = True

    def build(self, data):
        data.snapshots[:] *= 1e6
"""


@pytest.mark.full
def test_arrays_are_handed_over_read_only(distribute: Any) -> None:
    distribute("odd-pkg", {"basis": {"odd": "odd_writes:Own"}},
               odd_writes=with_base("basis", HEAD + SCRIBBLES))
    with pytest.raises(InputError, match=r"Own.build raised ValueError: .*read-only \(.*"
                                         r"odd_writes.py:16\)"):
        run("basis")


def test_the_arrays_of_the_caller_stay_as_they_are() -> None:
    own = np.zeros(3)
    given = read_only(own)
    with pytest.raises(ValueError, match="read-only"):
        given[0] = 1.0
    own[0] = 2.0
    assert given[0] == 2.0 and own.flags.writeable
    assert read_only(given) is given


LATE = """
from sparsemor.core import hookimpl

class Late:
    @hookimpl
    def on_step(self, step):
        if step == 3:
            raise ZeroDivisionError("in the third step")

class Own(BASE):
    'An observer that fails later.'
    def observer(self): return Late()
"""


@pytest.mark.full
def test_a_run_keeps_what_it_had_before_a_plugin_failed(distribute: Any, tmp_path: Path) -> None:
    distribute("odd-pkg", {"observer": {"odd": "odd_late:Own"}},
               odd_late=with_base("observer", HEAD.partition("class Own")[0] + LATE))
    plugin: Any = Registry().get("observer", "odd")()
    with pytest.raises(SolveFailed) as caught:
        simulate(tiny(), out=tmp_path / "run", observers=[plugin.observer()])
    result: Any = caught.value.result
    assert caught.value.status is Status.PLUGIN_FAILED
    assert "odd-pkg 1.0: Late.on_step raised ZeroDivisionError: in the third" in str(caught.value)
    assert len(result.times) == 4 and np.isfinite(result.block("bar.thermal")).all()


PRINTS = """
import os
print("printed by an import")

class Own(BASE):
    'A function of time that prints.'
    def value(self, t):
        print("printed by a method")
        os.write(1, b"written to the file descriptor\\n")
        return 1.0
    def rate(self, t): return 0.0
"""


@pytest.mark.full
@pytest.mark.parametrize("command", ["run", "validate", "schema"])
def test_what_plugins_print_is_not_in_the_json(
    distribute: Any, tmp_path: Path, command: str
) -> None:
    distribute("odd-pkg", {"function": {"odd": "odd_prints:Own"}},
               odd_prints=with_base("function", HEAD.partition("class Own")[0] + PRINTS))
    scene = [] if command == "schema" else [
        str(SCENES / "tiny.yaml"), "--set", "loads.heating.flux=odd", "--json"]
    end = ["--set", "time.end=0.002", "--out", str(tmp_path / "out")] if command == "run" else []
    done = subprocess.run(
        [sys.executable, "-c", "from sparsemor.core.cli import main; main()", command, *scene,
         *end], capture_output=True, text=True, check=False,
        env={**os.environ, "PYTHONPATH": str(tmp_path / "site-odd-pkg")})
    assert done.returncode == 0, done.stderr
    assert isinstance(json.loads(done.stdout), dict)
    assert "printed by an import" in done.stderr
    if command == "run":
        assert "printed by a method" in done.stderr and "written to the file" in done.stderr


def test_a_command_ends_with_the_line(distribute: Any) -> None:
    distribute("odd-pkg", {"mesh": {"odd": "odd_mesh:Own"}},
               odd_mesh=text_of("mesh", "raises"))
    done = CliRunner().invoke(app, [
        "validate", str(SCENES / "tiny.yaml"), "--set", "bodies.bar.mesh=odd", "--json"])
    assert done.exit_code == 2
    found = json.loads(done.stdout)
    assert found["status"] == "bad_input" and len(found["errors"]) == 1
    assert "mesh odd of odd-pkg 1.0: Own.build raised ZeroDivisionError" in found["errors"][0]
