"""Law kit: checks, on seeded random inputs, that a plugin satisfies the contract of its kind.

A plugin author calls the check of its kind in one test. Each check raises AssertionError that
describes the first violated law, and returns nothing. Plain numpy: no test framework is needed.
`scene_of` builds a scene from plain data, as a scene file contains it; `march` runs a scene in
memory; `reduced_problem` is what a reducer prepares its step solver from.
"""

from sparsemor.core.testing.basis import check_basis
from sparsemor.core.testing.body import check_body
from sparsemor.core.testing.check import check_check
from sparsemor.core.testing.contact import check_contact
from sparsemor.core.testing.contact_laws import check_friction_law, check_normal_law
from sparsemor.core.testing.function import check_function
from sparsemor.core.testing.in_memory_run import March, march, reduced_problem, scene_of
from sparsemor.core.testing.installed import installed
from sparsemor.core.testing.integrator import check_integrator
from sparsemor.core.testing.joint import check_joint
from sparsemor.core.testing.linear_solver import check_linear_solver
from sparsemor.core.testing.load import check_load
from sparsemor.core.testing.material import check_material
from sparsemor.core.testing.mesh import check_mesh_plugin
from sparsemor.core.testing.observer import check_observer
from sparsemor.core.testing.parts import check_parts
from sparsemor.core.testing.preconditioner import check_preconditioner
from sparsemor.core.testing.reducer import check_reducer
from sparsemor.core.testing.sampler import check_sampler
from sparsemor.core.testing.sparse_solver import check_sparse_solver
from sparsemor.core.testing.term import check_term

__all__ = [
    "March",
    "check_basis",
    "check_body",
    "check_check",
    "check_contact",
    "check_friction_law",
    "check_function",
    "check_integrator",
    "check_joint",
    "check_linear_solver",
    "check_load",
    "check_material",
    "check_mesh_plugin",
    "check_normal_law",
    "check_observer",
    "check_parts",
    "check_preconditioner",
    "check_reducer",
    "check_sampler",
    "check_sparse_solver",
    "check_term",
    "installed",
    "march",
    "reduced_problem",
    "scene_of",
]
