"""Lower estimate of a run's memory, from the sizes of its meshes before meshing.

A scene with too fine a mesh would fill the machine during its assembly; it is refused here in
advance. Sizes that need the matrices (fill of factors) or the cache (whether the training run is in
it) are left to `estimate.py`, after assembly.
"""

from math import log2

from sparsemor.core.errors import Gather, InputError
from sparsemor.core.model.block_patterns import matched_option
from sparsemor.core.protocols.mesh import BodySize
from sparsemor.core.scene.scene import Scene
from sparsemor.core.simulation.memory.estimate import (
    ENTRY,
    START,
    Estimate,
    MemoryItem,
    bases,
    reduced,
    refusal,
    states,
    trains,
)
from sparsemor.core.simulation.memory.limits import ceiling, resident

CELL = {2: 400, 3: 500}
"""Spatial dimension -> bytes per cell: numbers of its points, and facets during the mesh check and
the location of loads."""
HELD = 7
"""Copies of each entry of operators on displacements: in the body, in terms, in separated form, and
memory that the process does not return after assembly."""
SCALAR = 4
"""Copies of each entry of mass, capacity and conductivity, initial state included."""


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
    assembled = [item for name, size in bodies.items() for item in _assembled(name, size)]
    start = [MemoryItem("all operators once more, at the start", START * ENTRY * sum(
        b.vector_entries for b in bodies.values()), "a coarser mesh")]
    if scene.reducer.full_order:
        factors = [i for name, size in bodies.items() for i in _factors(scene, name, size)]
        phases = {"steps": [*assembled, states(sum(blocks.values())), *factors, *start]}
    else:
        phases = {"start": [*assembled, *start], "steps": [*assembled, *reduced(scene, blocks)]}
    if trains(scene, blocks):  # an impossible training run is reported elsewhere
        phases["bases"] = [*assembled, *(Gather()("", bases, scene, blocks) or [])]
    return Estimate(resident(), {name: tuple(items) for name, items in phases.items()}, False)


def _assembled(name: str, size: BodySize) -> list[MemoryItem]:
    return [
        MemoryItem(f"the mesh of {name}, {size.mesh.cells} cells",
             CELL[size.mesh.dimension] * size.mesh.cells, "a coarser mesh"),
        MemoryItem(f"the operators of {name}",
             ENTRY * (HELD * size.vector_entries + SCALAR * size.scalar_entries),
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
        found.append(MemoryItem(f"the factors of {block}, at least", 2 * ENTRY * fill,
                          f'linear_solvers: {{"{block}": amg}} (or cg for heat), which hold no '
                          "factors"))
    return found
