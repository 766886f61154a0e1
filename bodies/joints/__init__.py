"""Joints in the plane and in space: constraint equations between two sides, with a multiplier each.

A plugin (kinematic_pairs.py, gears.py, ...) adds `Conditions` (constraint_conditions.py) on its two
`Side`s (joint_sides.py), which build a `JointPart` (built_joint.py).
"""
