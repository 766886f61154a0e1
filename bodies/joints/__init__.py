"""Joints in the plane and in space: constraint rows between two sides, with a multiplier each.

A plugin (revolute.py, ...) says by `Conditions` (conditions.py) what its two `Side`s (side.py) keep
in common; that makes a `JointPart` (part.py).
"""
