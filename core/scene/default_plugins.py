"""Default plugins, by name, of scenes that name none: the only plugin names in core."""

MOTION, HEAT = "generalized_alpha", "bdf2"
"""Integrators of second order: of scenes in which something moves, and of heat alone."""
FULL_ORDER = "full"
"""Reducer of reference solutions and rigid-body pre-simulations."""
LARGEST_ERROR = 1e-11
"""Tolerance of a step of training runs (its option `remaining`): the second iteration of tighter
ones proves what the first one has reached, and takes as long (decision 0044)."""
SAMPLED = "sparse"
"""Reducer with a sampler, preconditioner and sparse solver, which a scene takes when an override
sets such an option that its own reducer lacks."""
TABLE = "table"
"""Function of time of the loads of training runs that vary."""
BASIS = "pod"
"""Basis of blocks that the shared basis of a reducer does not fit."""
