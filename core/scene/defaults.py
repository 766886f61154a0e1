"""Names of plugins that a scene takes where it names none: the only ones that core knows."""

FULL_ORDER = "full"
"""Reducer of training runs, references and rigid stages."""
PROJECTION = "galerkin"
"""Reducer that projects, by which the stability of others is judged."""
COMPARED = "full,galerkin,sparse"
"""Reducers that `sparsemor compare` runs."""
