"""A study of the toy scene."""

from pathlib import Path

from sparsemor.plugins.study.plan import StudyPlan

HEAD = "scene: scene.yaml\nreference: {reducer: direct}\n"
GRID = HEAD + """\
grid:
  reducer.sampler.mix: [0.1, 0.2]
  bodies.a.mass: [1, 2, 3]
  how:
    few: {reducer.budgets: {a: 1}}
    many: {reducer.budgets: {a: 9}, integrator.rho: 0.5}
seeds: [7, 4]
"""


def planned(text: str) -> StudyPlan:
    """The plan of a study in this folder, where `scene.yaml` stands."""
    Path("study.yaml").write_text(text)
    return StudyPlan.read("study.yaml")
