"""Header of a result: layout of the unknowns, bases, bodies, probes, and what the run was made
with."""

from dataclasses import replace
from importlib.metadata import version

from sparsemor.core.linalg.threads import described
from sparsemor.core.model.model import Model, distinct_names
from sparsemor.core.protocols import StepSolver
from sparsemor.core.registry.installed import entry_points
from sparsemor.core.results.metadata import RunHeader
from sparsemor.core.results.probes import ProbeReader
from sparsemor.core.scene.run_identity import Identity
from sparsemor.core.scene.scene import Scene


def multiplier_components(model: Model) -> dict[str, tuple[tuple[str, str], ...]]:
    """Multiplier block of a joint -> name and unit of each Lagrange multiplier, for joints that
    name them."""
    found = {}
    for name, joint in model.joints.items():
        block = model.layout.multipliers(name)
        if block is not None and joint.components:
            names, units = zip(*joint.components, strict=True)
            found[block.name] = tuple(zip(distinct_names(list(names)), units, strict=True))
    return found


def header_of(
    scene: Scene, model: Model, solver: StepSolver, steps: int, estimates: tuple[str, ...] = ()
) -> RunHeader:
    """Header of the result of a run of `steps` steps. estimates: blocks whose error is
    estimated."""
    return replace(
        full_order_header(scene, model, steps), layout=solver.layout,
        dictionaries=solver.dictionaries, rows=solver.rows,
        probes=tuple(ProbeReader.of(p, solver.layout, solver.dictionaries).header()
                     for p in model.probes),
        stage=model.stage,
        contacts={a.name: a.term.histories for a in solver.resultant_sources(None)}
        if model.stage is None else {}, estimates=estimates)


def full_order_header(scene: Scene, model: Model, steps: int) -> RunHeader:
    """Header of a result in the unknowns of the model, without resultants of contacts."""
    # one reading of metadata for each distribution, not for each of its plugins
    offering = {e.dist for e in entry_points() if e.dist is not None}
    names = {"sparsemor", "numpy", "scipy", "scikit-fem", "pydantic", *(d.name for d in offering)}
    import platform

    return RunHeader(
        scene=scene.dump(), scene_digest=scene.digest(), seed=scene.seed,
        identity=Identity.of(scene).plain(), platform=described(),
        versions={"python": platform.python_version()} | {n: version(n) for n in sorted(names)},
        reducer=scene.reducer_name, layout=model.layout, full_layout=model.layout,
        step=scene.time.step, steps_planned=steps, bodies=model.shapes(),
        probes=tuple(ProbeReader.of(p, model.layout, {}).header() for p in model.probes),
        multipliers=multiplier_components(model),
        forces={n: joint.force.component for n, joint in model.joints.items()
                if joint.force is not None},
    )
