"""Memory and disk space that a run needs, estimated before it starts, and refusal if it would not
fit.

Large arrays are counted: matrices and factors of full order, snapshots, atoms, tables and stored
results. Before the scene is assembled, its memory is estimated from the sizes of its meshes
(`check_memory`): too fine a mesh would fill the machine during assembly. Sizes that need the
matrices (fill of factors) or the cache (whether the training run is in it) are counted after it.
"""

import shutil
from collections.abc import Iterable, Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass
from math import inf, log2
from pathlib import Path

from sparsemor.core.arrays import Csr
from sparsemor.core.errors import InputError
from sparsemor.core.linalg.snapshots import HELD
from sparsemor.core.model.block_patterns import matched_option
from sparsemor.core.model.fitting_bases import fitted_bases
from sparsemor.core.model.model import Model
from sparsemor.core.protocols.basis import Basis
from sparsemor.core.protocols.mesh import BodySize
from sparsemor.core.results.probes import ProbeReader
from sparsemor.core.scene.scene import Scene
from sparsemor.core.simulation.memory.limits import LIMIT, ceiling, gb, resident
from sparsemor.core.simulation.offline import Offline, snapshot_count, step_count

ENTRY = 12
"""Bytes per entry of a sparse matrix or factor: a value and its index."""
START = 5
"""Additional copies of each operator entry while the consistent initial state is computed."""
VECTORS = 40
"""Number of vectors of all unknowns in a full-order run: states, predictor, right-hand sides."""
UNKNOWN_ATOMS = 200
"""Assumed number of atoms when the basis does not state one."""
COPIES = 3
"""Number of arrays of the snapshots' size during a decomposition of all snapshots at once."""
STEP_RECORD = 60
"""Bytes of memory for the record of one step: its wall time, iterations and remaining error."""
STEP_SECONDS = 2.5e-5
"""Smallest wall time of a step, s: that of a single rigid body."""
MOST_STEPS = 1e10
"""Number of steps above which every run is refused: it would take three days at least."""
ROUGH = 0.5
"""Share of the memory limit up to which a rough estimate is accepted without an exact count."""
CELL = {2: 400, 3: 500}
"""Spatial dimension -> bytes per cell: numbers of its points, and facets during the mesh check and
the location of loads."""
OPERATOR_COPIES = 7
"""Copies of each entry of operators on displacements: in the body, in terms, in separated form, and
memory that the process does not return after assembly."""
SCALAR_COPIES = 4
"""Copies of each entry of mass, capacity and conductivity, initial state included."""


@dataclass(frozen=True, slots=True)
class MemoryItem:
    """Large item of a run's memory: what it is, its size in bytes, and advice how to reduce it."""

    what: str
    size: float
    advice: str


@dataclass(frozen=True, slots=True)
class Estimate:
    """Memory estimate of a run, bytes.

    base: memory in use already; phases: additional items of each phase; phases do not overlap in
    time. exact: True if entries of matrix factors were counted, False if they were bounded.
    """

    base: int
    phases: dict[str, tuple[MemoryItem, ...]]
    exact: bool

    @property
    def largest(self) -> str:
        return max(self.phases, key=lambda p: sum(i.size for i in self.phases[p]))

    @property
    def total(self) -> float:
        return self.base + max(sum(i.size for i in items) for items in self.phases.values())


def fitting(scene: Scene, model: Model, offline: Offline) -> Estimate:
    """Memory estimate of a run that fits. Raises InputError for one that would not."""
    limit = ceiling()
    expected = estimate(scene, model, offline, exact=False)
    if expected.total > ROUGH * limit:
        expected = estimate(scene, model, offline, exact=True)
    if expected.total > limit:
        raise InputError(refusal(expected, limit))
    return expected


def estimate(scene: Scene, model: Model, offline: Offline, exact: bool) -> Estimate:
    """Estimated memory of a run in each of its phases, bytes. exact: entries of the matrix factors
    are counted, which takes longer than the bound that is used otherwise."""
    blocks = block_sizes(model)
    # trained: a basis needs a training run; own: the run itself is of full order
    trained, own = trains(scene, blocks, model), scene.reducer.full_order
    snapshots = snapshot_count(scene) if trained else 0
    start = _start(model)
    phases = {"steps": (*_full(model, exact), start) if own else (
        *reduced(scene, blocks), *_points(scene, model, blocks))}
    if not own:
        phases["start"] = (start,)
    if trained and not offline.has_training():
        phases["training run"] = (
            MemoryItem("the model of the training run", _matrices(model), "a coarser mesh"),
            *_full(model, exact), start, *_held_snapshots(snapshots, blocks))
    if trained:
        phases["bases"] = tuple(bases(scene, snapshots, blocks))
    return Estimate(resident(), phases, exact)


def trains(scene: Scene, blocks: Mapping[str, int], model: Model | None = None) -> bool:
    """True if any basis of the reducer, of unknowns or of forces, needs snapshots."""
    used = (*chosen_bases(scene, blocks, model).values(), *scene.reducer.force_bases_used())
    return any(b.needs_snapshots for b in used)


def block_sizes(model: Model) -> dict[str, int]:
    """Number of unknowns of each reducible block."""
    return {n: int(model.layout[n].stop - model.layout[n].start) for n in model.reducible()}


def chosen_bases(
    scene: Scene, blocks: Iterable[str], model: Model | None = None
) -> Mapping[str, Basis]:
    """The basis of each block, {} for a reducer without bases; without the assembled model a shared
    basis counts as one that fits every block."""
    if model is not None:
        return fitted_bases(model, scene.reducer).bases
    chosen = scene.reducer.trial_bases()
    return {} if chosen is None else {
        name: matched_option(name, chosen.others, chosen.shared) for name in blocks}


def _operators(model: Model) -> Iterator[tuple[str, Csr]]:
    """Matrices with the sparsity pattern of the linear systems of a step, by block."""
    for h in model.separated.heat:
        yield h.thermal, h.capacity + h.conductivity
    for m in model.separated.moving:
        if m.operators is not None:
            yield m.elastic, m.operators.stiffness + m.operators.mass


def _full(model: Model, exact: bool) -> list[MemoryItem]:
    """Memory of full-order steps: states and the linear solver of each block. Without a count of
    the factor's entries, an estimate for nested dissection in space, 2 n^1.6."""
    found = [states(model.layout.size)]
    for name, A in _operators(model):
        solver = model.linear_solver(name)
        n = A.shape[0]
        known = solver.expected(A, model.places(name)) if exact else None
        # twice: the factor, and as much for frontal matrices and copies; also of the matrix A below
        size = 2 * ENTRY * min(n * (n + 1) / 2, 2 * n**1.6) if known is None else known
        found.append(MemoryItem(
            f"the linear solver of {name}", size + 2 * ENTRY * A.nnz,
            f'linear_solvers: {{"{name}": amg}} (or cg for heat), which hold no factors'))
    return found


def _start(model: Model) -> MemoryItem:
    """Memory of the consistent initial state: two Jacobians of the whole model and their parts
    (model/initial_state.py)."""
    entries = sum(A.nnz for _, A in _operators(model))
    entries += sum(m.operators.coupling.nnz for m in model.separated.moving
                   if m.operators is not None and m.operators.coupling is not None)
    return MemoryItem(
        "all operators once more, at the start", START * ENTRY * entries, "a coarser mesh")


def states(size: int) -> MemoryItem:
    """Memory of vectors of all `size` unknowns in full-order steps."""
    return MemoryItem("states and right-hand sides", 8 * VECTORS * size, "a coarser mesh")


def reduced(scene: Scene, blocks: Mapping[str, int]) -> list[MemoryItem]:
    """Memory of the atoms (basis vectors) and of the operators times them during projection."""
    found = []
    for name, basis in chosen_bases(scene, blocks).items():
        n, k = blocks[name], most_atoms(basis, blocks[name])
        found.append(MemoryItem(f"{k} atoms of {name}, and operators times them", 8 * 12 * n * k,
                          "fewer atoms (count), or a coarser mesh"))
    return found


def _points(scene: Scene, model: Model, blocks: Mapping[str, int]) -> Iterator[MemoryItem]:
    """Memory of the atoms at the quadrature points of local terms, all elements counted."""
    for name, basis in chosen_bases(scene, blocks).items():
        k, at = most_atoms(basis, blocks[name]), model.layout[name]
        values = sum(t.point_values for t in model.terms if t.point_values
                     and ((t.columns >= at.start) & (t.columns < at.stop)).any())
        if values:
            yield MemoryItem(f"{k} atoms of {name} at the quadrature points", 8 * values * k,
                       "fewer atoms (count), or a coarser mesh")


def bases(scene: Scene, snapshots: int, blocks: Mapping[str, int]) -> list[MemoryItem]:
    """Memory of the computation of bases, block by block: snapshots and atoms of the largest
    block. snapshots: their number."""
    largest: list[MemoryItem] = []
    copies = scene.reducer.snapshot_copies or COPIES
    for name, basis in chosen_bases(scene, blocks).items():
        n, k = blocks[name], most_atoms(basis, blocks[name])
        whole = 8 * n * snapshots
        # more than HELD bytes stay on disk and are read in chunks, but for a reducer that wants
        # forces and has them as a whole, however large
        held = copies * whole if whole <= HELD or copies > COPIES else HELD / 2
        # of the atoms six arrays of their size
        one = [MemoryItem(f"snapshots of {name}", held, "a larger training.every"),
               MemoryItem(f"{k} atoms of {name}", 8 * 6 * n * k, "fewer atoms (count)")]
        if sum(i.size for i in one) > sum(i.size for i in largest):
            largest = one
    return largest


def _held_snapshots(snapshots: int, blocks: Mapping[str, int]) -> list[MemoryItem]:
    """Memory of the snapshots of blocks that are not written to disk; snapshots: their number."""
    sizes = {name: 8 * n * snapshots for name, n in blocks.items()}
    return [MemoryItem(f"snapshots of {name}", size, "a larger training.every")
            for name, size in sizes.items() if size <= HELD]


def grid_refusal(end: float, step: float) -> str:
    """Reason why a time grid of steps of `step` up to `end` (s) has too many steps, with their
    memory and duration; "" if it is acceptable."""
    steps, limit = end / step, ceiling()
    if steps <= MOST_STEPS and STEP_RECORD * steps <= limit:
        return ""
    if STEP_RECORD * steps == inf:
        return f"more than 1e300 steps of {step:g} s up to {end:g} s: take a larger time.step"
    return (f"{steps:.3g} steps of {step:g} s up to {end:g} s would take {duration(steps)} at the "
            f"least, and the record of their cost alone {gb(STEP_RECORD * steps)} of memory, of "
            f"which {gb(limit)} are there: take a larger time.step or an earlier time.end")


def duration(steps: float) -> str:
    """Least wall time of a number of steps, in words."""
    seconds = STEP_SECONDS * steps
    for unit, name in ((365.25 * 86400, "years"), (86400, "days"), (3600, "hours"),
                       (60, "minutes")):
        if seconds >= 2 * unit:
            return f"{seconds / unit:.3g} {name}"
    return f"{seconds:.3g} seconds"


def most_atoms(basis: Basis, size: int) -> int:
    """Largest number of atoms of a basis for a block with `size` unknowns."""
    bound = basis.most_atoms(size)
    return min(size, UNKNOWN_ATOMS if bound is None else bound)


def _matrices(model: Model) -> int:
    """Bytes of the constant matrices of a second model: that of the training run."""
    found = 0
    for h in model.separated.heat:
        found += _bytes(h.capacity) + _bytes(h.conductivity)
    for m in model.separated.moving:
        o = m.operators
        if o is not None:
            parts = [o.mass, o.damping, o.stiffness, *o.generators]
            found += sum(map(_bytes, parts)) + (0 if o.coupling is None else _bytes(o.coupling))
            found += o.directions.nbytes + o.loads.nbytes
    return 2 * found  # terms hold them once more


def _bytes(A: Csr) -> int:
    """Bytes of a sparse matrix."""
    return int(A.data.nbytes + A.indices.nbytes + A.indptr.nbytes)


def refusal(expected: Estimate, limit: int) -> str:
    """Message for a run above the memory limit, bytes, with the largest items of its largest phase
    and advice."""
    items = sorted(expected.phases[expected.largest], key=lambda i: -i.size)[:3]
    parts = "; ".join(f"{i.what}: {gb(i.size)}" for i in items)
    return (f"this run would hold about {gb(expected.total)} of memory ({expected.largest}: "
            f"{parts}; held already: {gb(expected.base)}), and {gb(limit)} are there for it (the "
            f"machine's, or {LIMIT}): take {items[0].advice}")


# ------------------------------------------------------------------ before assembly


def check_memory(scene: Scene) -> None:
    """Checks that a run fits in memory, whatever is in the cache. Raises InputError. Bodies that do
    not know their size in advance are left out."""
    expected, limit = precheck_memory(scene), ceiling()
    if expected is not None and expected.total > limit:
        raise InputError(refusal(expected, limit))


def precheck_memory(scene: Scene) -> Estimate | None:
    """Memory estimate from mesh sizes alone; None if no body knows its size in advance."""
    bodies = {name: size for name, plugin in scene.bodies.items()
              if (size := plugin.expected()) is not None}
    if not bodies:
        return None
    blocks = {f"{name}.{field}": n for name, size in bodies.items()
              for field, n in size.unknowns.items()}
    assembled = [item for name, size in bodies.items() for item in _assembly(name, size)]
    start = [MemoryItem("all operators once more, at the start", START * ENTRY * sum(
        b.vector_entries for b in bodies.values()), "a coarser mesh")]
    if scene.reducer.full_order:
        factors = [i for name, size in bodies.items() for i in _factors(scene, name, size)]
        phases = {"steps": [*assembled, states(sum(blocks.values())), *factors, *start]}
    else:
        phases = {"start": [*assembled, *start], "steps": [*assembled, *reduced(scene, blocks)]}
    if trains(scene, blocks):
        with suppress(InputError):  # an impossible training run is reported elsewhere
            phases["bases"] = [*assembled, *bases(scene, snapshot_count(scene), blocks)]
    return Estimate(resident(), {name: tuple(items) for name, items in phases.items()}, False)


def _assembly(name: str, size: BodySize) -> list[MemoryItem]:
    """Memory of the mesh and the assembled operators of a body of known size."""
    return [
        MemoryItem(f"the mesh of {name}, {size.mesh.cells} cells",
             CELL[size.mesh.dimension] * size.mesh.cells, "a coarser mesh"),
        MemoryItem(f"the operators of {name}",
             ENTRY * (OPERATOR_COPIES * size.vector_entries + SCALAR_COPIES * size.scalar_entries),
             "a coarser mesh")]


def _factors(scene: Scene, name: str, size: BodySize) -> list[MemoryItem]:
    """Least memory of the factors of blocks with a direct solver: n log2 n entries in the plane,
    n^(4/3) in space (Lipton, Rose and Tarjan 1979, doi 10.1137/0716027), with a constant of 1,
    small enough for long and thin bodies, which have less fill."""
    found = []
    for field, n in size.unknowns.items():
        block = f"{name}.{field}"
        solver = matched_option(block, scene.linear_solvers, scene.linear_solver)
        if not solver.direct:
            continue
        fill = n * log2(n + 1) if size.mesh.dimension == 2 else n ** (4 / 3)
        # twice: the factor, and as much for frontal matrices and copies
        found.append(MemoryItem(f"the factors of {block}, at least", 2 * ENTRY * fill,
                          f'linear_solvers: {{"{block}": amg}} (or cg for heat), which hold no '
                          "factors"))
    return found


# ------------------------------------------------------------------ disk


def room_for_snapshots(scene: Scene, model: Model, offline: Offline) -> None:
    """Checks that snapshots that are written to disk fit there. Raises InputError."""
    cache = offline.products.cache
    blocks = block_sizes(model)
    if not trains(scene, blocks, model) or offline.has_training() or cache is None:
        return
    M = snapshot_count(scene)
    sizes = [8 * n * M for n in blocks.values()]
    wanted = sum(size for size in sizes if size > HELD)  # smaller ones stay in memory
    place = _existing(cache.root)
    free = shutil.disk_usage(place).free
    if wanted > free:
        raise InputError(
            f"the snapshots of the training run would take {gb(wanted)}, and {place} has "
            f"{gb(free)} left: use a larger training.every, or set SPARSEMOR_CACHE to another "
            "directory")


def room_for_result(scene: Scene, model: Model, out: Path) -> None:
    """Checks that the stored steps of a run, each of `per_step` numbers of 8 bytes, fit on the disk
    of `out`. Raises InputError."""
    blocks = block_sizes(model)
    # rigid coordinates and multipliers; then time, iterations, error and seconds
    per_step = model.layout.size - sum(blocks.values()) + 4
    per_step += sum(len(ProbeReader.at_place(p, model.layout, {}).header().components)
                    for p in model.probes)
    bases = chosen_bases(scene, blocks)
    per_step += sum(most_atoms(bases[n], size) if n in bases else size
                    for n, size in blocks.items())
    stored_steps = step_count(scene) // scene.output.every + 2  # with the first and the last
    free = shutil.disk_usage(_existing(out)).free
    if 8 * per_step * stored_steps > free:
        raise InputError(
            f"the result would take about {gb(8 * per_step * stored_steps)} on the disk "
            f"({stored_steps:.3g} stored steps of {per_step} numbers), which has {gb(free)} "
            f"left, and the run {duration(step_count(scene))} at the least: take a larger "
            "output.every, a larger time.step or an earlier time.end", "time.step")


def _existing(path: Path) -> Path:
    """The path, or the first folder above it that exists."""
    return next((p for p in (path, *path.absolute().parents) if p.exists()), Path("/"))
