"""Which runs a study consists of, and what is wrong with one that cannot be planned."""

from pathlib import Path

import pytest

from sparsemor.core.errors import InputError
from toy_scene import TOY_SCENE
from toy_study import GRID, HEAD, planned

pytestmark = pytest.mark.usefixtures("toys")


@pytest.fixture(autouse=True)
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    Path("scene.yaml").write_text(TOY_SCENE)


def test_a_grid_is_every_combination_in_order() -> None:
    plan = planned(GRID)
    assert [run.number for run in plan.runs] == list(range(1, 25))
    assert plan.settings == (
        "reducer.sampler.mix", "bodies.a.mass", "how", "set.reducer.budgets", "set.integrator.rho",
        "seed")
    keys = ("reducer.sampler.mix", "bodies.a.mass", "how", "seed")
    points = [tuple(run.settings[k] for k in keys) for run in plan.runs]
    assert points == [(mix, mass, how, seed) for mix in (0.1, 0.2) for mass in (1, 2, 3)
                      for how in ("few", "many") for seed in (7, 4)]
    first, last = plan.runs[0], plan.runs[-1]
    assert first.scene is not None and last.scene is not None
    assert first.scene["tree"]["reducer"]["sampler"]["mix"] == 0.1
    assert last.scene["tree"]["reducer"]["budgets"] == {"a": 9}
    assert (last.scene["tree"]["integrator"]["rho"], last.scene["tree"]["seed"]) == (0.5, 4)
    assert "integrator.rho" not in first.settings


@pytest.mark.full
def test_runs_share_a_reference_when_their_physics_integrator_and_step_are_the_same() -> None:
    plan = planned(GRID)
    assert len(plan.references) == 3 * 2  # masses, and the integrator of `many`
    for run in plan.runs:
        tree = plan.references[run.reference]["tree"]
        assert tree["reducer"] == "direct"
        assert tree["bodies"]["a"]["mass"] == run.settings["bodies.a.mass"]
        assert "seed" not in tree
    assert len(planned(GRID.replace("{reducer: direct}", "{fixed: {reducer: direct}}")
                       ).references) == 1


@pytest.mark.full
def test_a_random_subset_repeats_nothing_and_knows_its_seed() -> None:
    axes = "{bodies.a.mass: [1, 2, 3, 4, 5], seed: [1, 2, 3, 4, 5]}"
    chosen = []
    for seed in (1, 1, 2):
        plan = planned(HEAD + f"random: {{count: 12, seed: {seed}, axes: {axes}}}\n")
        chosen.append([tuple(run.settings.values()) for run in plan.runs])
    assert chosen[0] == chosen[1] != chosen[2]
    assert all(len(set(points)) == 12 and points == sorted(points) for points in chosen)


def test_a_list_is_one_run_an_item() -> None:
    plan = planned(HEAD + "list:\n- {label: heavy, bodies.a.mass: 9}\n- {seed: 3}\n- {}\n")
    assert [dict(run.settings) for run in plan.runs] == [
        {"label": "heavy", "bodies.a.mass": 9}, {"seed": 3}, {}]
    assert plan.settings == ("label", "bodies.a.mass", "seed")
    assert plan.drawing.lines == ("label",)


def test_a_combination_that_only_some_values_refuse_is_a_refused_run() -> None:
    plan = planned(HEAD + "grid:\n  reducer.sampler: [grid, dice]\n"
                   "  reducer.sampler.mix: [0.5, 0.7]\n")
    assert [bool(run.refused) for run in plan.runs] == [False, False, True, True]
    assert "reducer.sampler.mix: no such option" in plan.runs[2].refused


@pytest.mark.parametrize("text, expected", [
    ("", "the file is empty: a study is a mapping"),
    ("grid: {seed: [1]}\n", "study.yaml:1:1: scene: is missing"),
    ("scene: nowhere.yaml\ngrid: {seed: [1]}\n", "study.yaml:1:1: scene: there is no such file"),
    (HEAD, "study.yaml:1:1: a study has exactly one of grid, list, random (got none)"),
    (HEAD + "grid: {seed: [1]}\nlist: [{}]\n", "study.yaml:4:1: list: a study has exactly one of"),
    (HEAD + "gird: {seed: [1]}\n", "study.yaml:3:1: gird: no such option: did you mean grid"),
    (HEAD + "set: {time.stop: 1}\ngrid: {seed: [1]}\n",
     "study.yaml:3:7: set.time.stop: no such option"),
    (HEAD + "set: [1]\ngrid: {seed: [1]}\n", "study.yaml:3:1: set: Input should be keys with"),
    (HEAD + "grid: {}\n", "study.yaml:3:1: grid: Dictionary should have at least 1 item"),
    (HEAD + "grid:\n  bodies.a.mass: []\n", "study.yaml:4:3: grid.bodies.a.mass: an axis is a"),
    (HEAD + "grid:\n  bodies.a.mass: 3\n", "study.yaml:4:3: grid.bodies.a.mass: an axis is a"),
    (HEAD + "grid:\n  bodies.a.mass: [1, -1]\n",
     "study.yaml:4:22: grid.bodies.a.mass.1: bodies.a.mass: Input should be greater than 0"),
    (HEAD + "grid:\n  bodies.a.mass: [1, 2, 1]\n",
     "study.yaml:4:25: grid.bodies.a.mass.2: the same as item 0: remove one"),
    (HEAD + "grid:\n  how:\n    a: {seed: 1}\n    b: {reducer: tund}\n",
     "study.yaml:6:9: grid.how.b.reducer: no reducer plugin is called 'tund': did you mean tuned"),
    (HEAD + "grid:\n  how: {a: 3}\n", "study.yaml:4:9: grid.how.a: an alternative is a mapping"),
    (HEAD + "grid:\n  status: {a: {seed: 1}}\n", "study.yaml:4:3: grid.status: status is a column"),
    (HEAD + "grid:\n  seed: [1]\n  how: {a: {seed: 1}}\n",
     "study.yaml:5:3: grid.how: seed is also changed by the axis seed"),
    (HEAD + "list:\n- {seed: 1}\n- {seed: -1}\n",
     "study.yaml:5:4: list.1.seed: Input should be greater than or equal to 0 (got -1)"),
    (HEAD + "list:\n- {seed: 1, label: [x]}\n", "study.yaml:4:13: list.0.label: a label is a text"),
    (HEAD + "random: {count: 3, axes: {seed: [1, 2]}}\n",
     "study.yaml:3:10: random.count: the axes have 2 combinations"),
    (HEAD + "random: {count: 0, axes: {seed: [1, 2]}}\n", "study.yaml:3:10: random.count: Input"),
    (HEAD + "seeds: [1, 1]\nlist: [{}]\n", "study.yaml:3:12: seeds.1: the same as item 0"),
    (HEAD + "seeds: [-1]\nlist: [{}]\n", "study.yaml:3:9: seeds.0: a seed is at least 0"),
    (HEAD + "seeds: [1]\ngrid: {seed: [1]}\n", "study.yaml:3:1: seeds: the seed is also changed"),
    (HEAD + "budget: mass\ngrid: {seed: [1]}\n", "study.yaml:3:1: budget: nothing of that name"),
    (HEAD + "method: [seed, x]\ngrid: {seed: [1]}\n", "study.yaml:3:16: method.1: nothing of that"),
    (HEAD + "errors_from: -1\ngrid: {seed: [1]}\n", "study.yaml:3:1: errors_from: Input should be"),
    ("scene: scene.yaml\nreference: {reducer: fulll}\ngrid: {seed: [1, 2]}\n",
     "study.yaml:2:13: reference.reducer: no reducer plugin is called 'fulll'"),
    ("scene: scene.yaml\nreference: {fixed: 1}\ngrid: {seed: [1, 2]}\n",
     "study.yaml:2:13: reference.fixed: give changes to the scene"),
    ("scene: scene.yaml\nreference: {fixed: {}, seed: 1}\ngrid: {seed: [1, 2]}\n",
     "study.yaml:2:24: reference.seed: move it under `fixed`"),
    ("scene: scene.yaml\nreference: none\nerrors_from: 0.1\ngrid: {seed: [1]}\n",
     "study.yaml:3:1: errors_from: has no effect with reference: none"),
    ("scene: scene.yaml\nreference: none\nover_time: true\ngrid: {seed: [1]}\n",
     "study.yaml:3:1: over_time: has no effect with reference: none"),
])
def test_faults_have_their_place(text: str, expected: str) -> None:
    with pytest.raises(InputError) as caught:
        planned(text)
    assert expected in str(caught.value)
    assert sorted(p.name for p in Path().iterdir() if p.suffix == ".yaml") == [
        "scene.yaml", "study.yaml"]


@pytest.mark.full
def test_faults_of_the_scene_are_told_where_they_are() -> None:
    Path("scene.yaml").write_text(TOY_SCENE.replace("mass: 1", "mass: -1"))
    with pytest.raises(InputError) as caught:
        planned(HEAD + "grid: {seed: [1, 2]}\n")
    assert str(caught.value).splitlines() == [
        "scene.yaml:3:18: bodies.a.mass: Input should be greater than 0 (got -1)"]
