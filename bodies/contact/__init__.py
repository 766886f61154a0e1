"""Contact of two surfaces, in the plane and in space.

`polygonal` is the plugin; it builds a `part`, whose `term` acts inside the step and whose
`along_motion` gives loads of rigid surfaces on a prescribed motion. Both go from `kinematics` over
`broad_phase`, `pieces` (with `planes`, `cells`, `clipping`) and `tractions` to forces and heat at
nodes; `tangent` and `edges` are their derivatives.
"""
