"""Bodies of the hidden-effect captures, each with a size from the seed: a bar, an L, a slab, a thick plush and a fork; a rope and a cloth.

All lie on the table at z = 0 with their centre of volume above the origin. The hand holds the end at +x and the rest is free, so
that an effect's place can be drawn for any of them. Boxes are six elements through their thickness.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from data.rig.rope import Rope
from data.rig.shapes import Block, Blocks, Capsule, RoundedShape, Solid
from data.rig.thin import Cloth
from data.rig.thin_body import ThinBody
from data.rig.thin_scenes import AGAINST_CHATTER
from physreal_core.array_types import Array, Float

THICKNESS = 0.044  # of the bar and of the limbs of the L [m]
_THIN_SPOT = 0.12  # of the free length of a rope or a cloth
_SIZES = (0.93, 1.07)  # lengths of a body other than the bar, over those written here


@dataclass(frozen=True)
class Body:
    """A shape, and where a hand holds it.

    Args:
        name: in `BODIES` or `THIN_BODIES`.
        description: what a person would call it.
        shape: as it lies on the table [m].
        held: length of the end at +x that the hand holds [m].
        thickness: of its thinnest part, in the plane in which gravity bends it [m].
        softness: Young's modulus over that of a bar, so that it sags by a centimetre or more, too; a thin body has its own stiffnesses.
    """

    name: str
    description: str
    shape: Solid | ThinBody
    held: float
    thickness: float
    softness: float

    @property
    def lower(self) -> Float[Array, "3"]:
        """Corner of the box around it [m]."""
        return self.shape.bounds()[0]

    @property
    def upper(self) -> Float[Array, "3"]:
        """The opposite corner [m]."""
        return self.shape.bounds()[1]

    @property
    def length(self) -> float:
        """Of what is free, along x [m]."""
        return float(self.upper[0] - self.lower[0]) - self.held

    @property
    def volume(self) -> float:
        """[m^3], of a rounded shape to a percent."""
        if self.is_thin:
            return float(self.shape.mesh().volumes().sum())
        if isinstance(self.shape, RoundedShape):
            return _volume_of(self.shape)
        parts = self.shape.parts if isinstance(self.shape, Blocks) else (self.shape,)
        return float(sum(np.prod(np.subtract(part.upper, part.lower)) for part in parts))

    @property
    def is_thin(self) -> bool:
        """Whether it is a rope or a cloth."""
        return isinstance(self.shape, ThinBody)

    @property
    def spot(self) -> float:
        """Radius of what is local in it [m]."""
        return _THIN_SPOT * self.length if self.is_thin else 0.8 * self.thickness

    def grasp(self, above: float) -> Block:
        """The box in which the hand holds it: its end, from the height `above` [m] on."""
        return Block((float(self.upper[0]) - self.held, -1.0, above), (1.0, 1.0, 1.0))

    def is_inside(self, points: Float[Array, "P 3"]) -> Array:
        """Which points [m] lie in it."""
        return self.shape.distance(points) < 0

    def place(self, random: np.random.Generator, along: tuple[float, float], inside: float) -> Float[Array, "3"]:
        """A place in the free part [m], at least `inside` [m] below the surface.

        Args:
            random: draws it.
            along: where, in shares of the free length from the free end on.
            inside: [m]; of bodies of boxes, the distance to the nearest side of one of the boxes.
        """
        low, high = self.lower.copy(), self.upper.copy()
        low[0], high[0] = (self.lower[0] + share * self.length for share in along)
        for _ in range(10_000):
            place = random.uniform(low, high)
            if self.shape.distance(place) < -inside:
                return place
        raise RuntimeError(f"no place {inside} m inside of the {self.name}")


def bar(size: np.random.Generator) -> Body:
    """A square bar of 0.24 m, always of one size."""
    shape = Block((-0.12, -THICKNESS / 2, 0.0), (0.12, THICKNESS / 2, THICKNESS))
    return Body("bar", "a foam bar", shape, 0.045, THICKNESS, 1.0)


def angle(size: np.random.Generator) -> Body:
    """An L: a bar whose free end goes on sideways, so that it twists where it is lifted."""
    length, side, t = 0.2 * _share(size), 0.075 * _share(size), THICKNESS
    turn = size.choice([-1, 1])
    foot = sorted([turn * t / 2, turn * (t / 2 + side)])
    parts = (Block((0.0, -t / 2, 0.0), (length, t / 2, t)), Block((0.0, foot[0], 0.0), (t, foot[1], t)))
    return Body("angle", "an L-shaped piece of foam", _centred(Blocks(parts)), 0.045, t, 0.9)


def slab(size: np.random.Generator) -> Body:
    """A wide plate."""
    length, width, t = 0.19 * _share(size), 0.1 * _share(size), 0.042
    shape = Block((0.0, 0.0, 0.0), (length, width, t))
    return Body("slab", "a foam slab", _centred(shape), 0.04, t, 0.6)


def plush(size: np.random.Generator) -> Body:
    """A thick rounded toy: a head in the hand, a belly, and two legs."""
    s = 0.96 * _share(size)
    capsules = [Capsule((0.075, 0.0, 0.03), (0.075, 0.0, 0.03), 0.03)]
    capsules += [Capsule((-0.02, 0.0, 0.03), (0.05, 0.0, 0.03), 0.03)]
    capsules += [Capsule((-0.03, 0.02 * a, 0.026), (-0.09, 0.042 * a, 0.026), 0.026) for a in (-1, 1)]
    scaled = [Capsule(_times(c.start, s), _times(c.end, s), c.radius * s) for c in capsules]
    return Body("plush", "a stuffed toy", _centred(RoundedShape(tuple(scaled), 0.022)), 0.05, 0.052 * s, 0.8)


def fork(size: np.random.Generator) -> Body:
    """Two prongs on a base, not convex."""
    base, prong, t = 0.06, 0.125 * _share(size), 0.042
    gap = size.uniform(0.022, 0.034)
    out = gap / 2 + t
    ends = [(-out, -gap / 2), (-gap / 2, gap / 2), (gap / 2, out)]
    roots = [Block((0.0, low, 0.0), (base, high, t)) for low, high in ends]
    prongs = [Block((-prong, low, 0.0), (0.0, high, t)) for low, high in (ends[0], ends[2])]
    return Body("fork", "a foam fork", _centred(Blocks((*roots, *prongs))), 0.04, t, 0.5)


def rope(size: np.random.Generator) -> Body:
    """A soft kernmantle rope; the numbers are about those of `thin_scenes.ROPE`."""
    length, t = 0.3 * _share(size), 0.01
    shape = Rope(
        start=(-length / 2, 0.0, t / 2),
        end=(length / 2, 0.0, t / 2),
        spacing=0.005,
        thickness=t,
        stretching_stiffness=500.0,
        bending_stiffness=6e-4,
        twisting_stiffness=4e-4,
        mass_per_length=0.064,
        damping=AGAINST_CHATTER,
    )
    return Body("rope", "a rope", shape, 0.04, t, 1.0)


def cloth(size: np.random.Generator) -> Body:
    """A mat of felt 3 mm thick, of 0.2 g/cm^3 and 1.6 MPa, as wool felts of that density have: softer cloths flap without order, in which
    two simulators part."""
    length, width, t = 0.24 * _share(size), 0.12 * _share(size), 0.003
    shape = Cloth(
        centre=(0.0, 0.0, t / 2),
        size=(length, width),
        spacing=0.009,
        thickness=t,
        membrane_stiffness=4800.0,
        bending_stiffness=3.6e-3,
        poissons_ratio=0.3,
        areal_density=0.6,
        damping=0.0,  # beside the step's own
        equilateral=True,
    )
    return Body("cloth", "a mat of felt", shape, 0.04, t, 1.0)


BODIES: dict[str, Callable[[np.random.Generator], Body]] = {
    "bar": bar,
    "angle": angle,
    "slab": slab,
    "plush": plush,
    "fork": fork,
}
"""Volumes by name: from a generator for its size to a body."""

THIN_BODIES: dict[str, Callable[[np.random.Generator], Body]] = {"rope": rope, "cloth": cloth}
"""The same of thin bodies."""


def _share(size: np.random.Generator) -> float:
    return float(size.uniform(*_SIZES))


def _times(place: tuple[float, float, float], factor: float) -> tuple[float, float, float]:
    return tuple(factor * value for value in place)


def _centred(shape: Solid) -> Solid:
    """The shape with its centre of volume above the origin, on the table."""
    x, y, _ = shape.middle()
    return shape.moved(np.array([-x, -y, -_underside(shape)]))


def _underside(shape: Solid) -> float:
    """Height of its lowest point [m]; where capsules flow into one another, that is below all of them."""
    if isinstance(shape, RoundedShape):
        inside, spacing = _lattice_inside(shape)
        return float(inside[:, 2].min() - spacing / 2)
    return float(shape.bounds()[0][2])


def _volume_of(shape: RoundedShape) -> float:
    inside, spacing = _lattice_inside(shape)
    return len(inside) * spacing**3


def _lattice_inside(shape: RoundedShape, spacing: float = 0.003) -> tuple[Float[Array, "P 3"], float]:
    """Points of a lattice inside of a shape [m], and its spacing [m]."""
    points = shape.lattice(spacing)
    return points[shape.distance(points) < 0], spacing
