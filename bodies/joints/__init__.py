"""Joints in the plane and in space: constraint equations between two sides, with a multiplier each.

A plugin (pairs.py, gears.py, ...) adds `Conditions` (conditions.py) on its two `Side`s (side.py),
which build a `JointPart` (part.py).
"""
