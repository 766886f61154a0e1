"""Contact of two surfaces made of facets, in the plane and in space.

`polygonal` is the plugin (scene options). It builds `part`, the contact of a scene; `term` is its
contribution to the equations of a time step, `along_motion` the loads of rigid surfaces under a
prescribed motion. Both proceed from the positions of the surfaces (`kinematics`) over the search
for close facets (`broad_phase`) and their overlaps (`pieces`, with `planes`, `cells`, `clipping`)
to the tractions (`tractions`), integrated to nodal forces and heat; `tangent` and `edges` are the
derivatives.
"""
