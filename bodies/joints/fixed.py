"""Fixed joint: two attachments keep their relative position and rotation."""

from sparsemor.bodies.joints.between import Between
from sparsemor.bodies.joints.conditions import Conditions


class Fixed(Between):
    """Fixed joint: the centres of two sets coincide and their relative rotation is constant.

    Multipliers: force on the first side (N, space axes) and moment (N m); in space three moments,
    about axes that coincide with the space axes at the start and rotate with the bodies.
    """

    relative = (3,)

    def constrain(self, sides: Conditions) -> None:
        sides.meet()
        sides.no_turn()
