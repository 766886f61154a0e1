"""Law kit: checks, on seeded random inputs, that a plugin satisfies the contract of its kind.

A plugin author calls the check of its kind in one test. Each check raises AssertionError that
describes the first violated law, and returns nothing. Plain numpy: no test framework is needed.
`scene_of` builds a scene from plain data, as a scene file contains it; `march` runs a scene in
memory; `reduced_problem` is what a reducer prepares its step solver from.
"""

from sparsemor.core.testing.basis import check_basis as check_basis
from sparsemor.core.testing.body import check_body as check_body
from sparsemor.core.testing.check import check_check as check_check
from sparsemor.core.testing.contact_laws import check_friction_law as check_friction_law
from sparsemor.core.testing.contact_laws import check_normal_law as check_normal_law
from sparsemor.core.testing.function import check_function as check_function
from sparsemor.core.testing.in_memory_run import March as March
from sparsemor.core.testing.in_memory_run import march as march
from sparsemor.core.testing.in_memory_run import reduced_problem as reduced_problem
from sparsemor.core.testing.in_memory_run import scene_of as scene_of
from sparsemor.core.testing.installed import installed as installed
from sparsemor.core.testing.integrator import check_integrator as check_integrator
from sparsemor.core.testing.joints_contacts_loads import check_contact as check_contact
from sparsemor.core.testing.joints_contacts_loads import check_joint as check_joint
from sparsemor.core.testing.joints_contacts_loads import check_load as check_load
from sparsemor.core.testing.joints_contacts_loads import check_parts as check_parts
from sparsemor.core.testing.linear_solver import check_linear_solver as check_linear_solver
from sparsemor.core.testing.material import check_material as check_material
from sparsemor.core.testing.mesh import check_mesh_plugin as check_mesh_plugin
from sparsemor.core.testing.observer import check_observer as check_observer
from sparsemor.core.testing.preconditioner import check_preconditioner as check_preconditioner
from sparsemor.core.testing.reducer import check_reducer as check_reducer
from sparsemor.core.testing.sampler import check_sampler as check_sampler
from sparsemor.core.testing.sparse_solver import check_sparse_solver as check_sparse_solver
from sparsemor.core.testing.term import check_term as check_term
