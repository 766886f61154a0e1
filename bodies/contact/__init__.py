"""Contact of two surfaces made of facets, in the plane and in space.

`polygonal` is the plugin (scene options). It builds `built_contact`, the contact of a scene;
`contact_term` is its contribution to the equations of a time step, `along_prescribed_motion` the
loads of rigid surfaces under a prescribed motion. Both proceed from the positions of the surfaces
(`kinematics`) over the search for close facets (`surface`) and their overlaps (`overlaps`, by
`clipping`) to the tractions (`tractions`, by `contact_laws`), integrated to nodal forces and heat;
`tangent` has the derivatives, `bristles` static friction.
"""
