"""What holds the body, as the pictures show it."""

from dataclasses import dataclass

from physreal_core.array_types import Float, Tensor


@dataclass(frozen=True)
class Look:
    """Gaussians of a gripper or an arm, all round and of one size.

    Attributes:
        places: [m].
        normals: of the surface there; None where light is not to fall on it.
        colours: RGB, before the light.
        size: standard deviation [m].
    """

    places: Float[Tensor, "frames gaussians 3"]
    normals: Float[Tensor, "frames gaussians 3"] | None
    colours: Float[Tensor, "gaussians 3"]
    size: float
