"""Kinds of fields of the bodies and joints."""

from sparsemor.core import FieldKind, Quantity

RIGID = FieldKind(
    "rigid", order=2, unit="m, rad", quantity=Quantity.POSE, title="rigid motion",
    scale=1.0, smallest=1.0, change=3e-4, central=True)
"""Rigid coordinates of a moving body frame. They give a nearly defective pair of eigenvalues at 1
of the time-step map, which therefore is differentiated by central differences."""
ELASTIC = FieldKind(
    "elastic", order=2, unit="m", quantity=Quantity.DISPLACEMENT, reducible=True,
    title="elastic displacement", scale=1e-3, smallest=1e-6, change=1e-2)
"""Displacement field: free nodal displacements in the body frame."""
THERMAL = FieldKind(
    "thermal", order=1, unit="K", quantity=Quantity.TEMPERATURE, reducible=True,
    title="temperature", scale=100.0, smallest=1e-3, change=1e-4)
"""Temperature field: free nodal temperatures."""
MULTIPLIER = FieldKind("multiplier", order=0, unit="N, N m")
"""Lagrange multipliers of a joint's constraints: its forces and moments."""

BODY_KINDS = (RIGID, ELASTIC, THERMAL)
"""Fields that a body may have; result tables have a column for each, in every scene."""
