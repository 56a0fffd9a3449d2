"""Sequences for judging perception: soft bodies, cloths and ropes under one or two hands, with what makes them hard.

Each is a function of a seed, which varies pattern, direction and size of the motion, and the light. They are small enough
to be made when they are needed: a coarse mesh, 36 frames of 320 x 240 pixels.
"""

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from data.rig.rig_scene import FurtherHand, Look, Material, Motion, RigScene, View, bare_hand, plush_body
from data.rig.shapes import RoundedShape
from data.rig.thin import Cloth, rope_body

FRAMES, OBSERVED = 36, 26
TIMESTEP = 0.002
"""Largest step of the simulation [s]."""
SETTLE = 0.15
"""Time before frame 0 in which the body comes to rest [s]."""
_MESH = 0.012  # [m]
_ROPE = Material(youngs_modulus=5e4, density=400.0, damping=0.004)
_ROPE_MESH = 0.0055  # [m]
_LOW_LAMP = {"lamp": (-0.75, -0.25, 0.42), "ambient": 0.30, "diffuse": 1.0, "shade": 0.06}
_SHUTTER = 0.6

_FINGERTIPS = 0.006  # nodes this near to a hand are held [m]
_HAND_MESH = 0.0045  # [m]; fingers are thin

Stroke = tuple[float, float, tuple[float, float, float]]


def _motion(random: np.random.Generator, *strokes: Stroke) -> Motion:
    """The strokes, each of a length that differs between seeds by up to a tenth."""
    return Motion(
        tuple((a, b, tuple(float(x) * float(random.uniform(0.9, 1.1)) for x in vector)) for a, b, vector in strokes)
    )


def _towards(grasp: tuple[float, float, float]) -> tuple[float, float, float]:
    """Where the forearm of a hand leaves that holds something right or left of the middle: backwards and up."""
    return (0.55 if grasp[0] >= 0 else -0.55), 0.45, 0.75


def _plush(seed: int, name: str, *strokes: Stroke, grasp: tuple[float, float, float], **further) -> RigScene:
    random = np.random.default_rng([seed, 0])
    return RigScene(
        name=name,
        description="a stuffed animal",
        body=plush_body(),
        hand=bare_hand(grasp, _towards(grasp), left=grasp[0] < 0),
        motion=_motion(random, *strokes),
        view=View(target=(0.0, 0.0, 0.06)),
        frames=FRAMES,
        observed=OBSERVED,
        mesh_spacing=_MESH,
        look=Look(hand="skin", seed=seed),
        grip_reach=_FINGERTIPS,
        hand_spacing=_HAND_MESH,
        **further,
    )


HEAD, HIPS = (0.080, 0.0, 0.030), (-0.045, 0.0, 0.030)
_LIFT: tuple[Stroke, ...] = ((0.05, 0.7, (-0.02, 0.0, 0.10)), (0.7, 1.1, (0.0, 0.03, 0.0)))


def plush_lifted(seed: int) -> RigScene:
    """An animal lifted by its head."""
    return _plush(seed, "plush_lifted", *_LIFT, grasp=HEAD)


def plush_pushed(seed: int) -> RigScene:
    """An animal pushed over the table by its hips."""
    strokes = (0.05, 0.3, (0.0, 0.0, -0.006)), (0.2, 1.1, (0.05, 0.05, 0.0))
    return _plush(seed, "plush_pushed", *strokes, grasp=HIPS)


def plush_two_hands(seed: int) -> RigScene:
    """An animal raised by head and hips, which come nearer to each other: its middle sags."""
    random = np.random.default_rng([seed, 1])
    other = FurtherHand(
        bare_hand(HIPS, _towards(HIPS), left=True), _motion(random, (0.05, 0.8, (0.03, 0.0, 0.06))), _FINGERTIPS
    )
    return _plush(seed, "plush_two_hands", (0.05, 0.8, (-0.02, 0.0, 0.09)), grasp=HEAD, others=(other,))


def plush_plain_table(seed: int) -> RigScene:
    """The lift over a table of one colour."""
    return _looking(replace(plush_lifted(seed), name="plush_plain_table"), table="plain")


def plush_shadow(seed: int) -> RigScene:
    """The push under a low lamp: a long dark shadow moves with the animal, over a table of one colour."""
    return _looking(replace(plush_pushed(seed), name="plush_shadow"), table="plain", **_LOW_LAMP)


def plush_blurred(seed: int) -> RigScene:
    """A quick lift with an open shutter."""
    strokes = (0.05, 0.4, (-0.02, 0.0, 0.10)), (0.45, 0.7, (0.0, 0.04, -0.03)), (0.75, 1.1, (0.03, -0.03, 0.02))
    return _looking(_plush(seed, "plush_blurred", *strokes, grasp=HEAD), shutter=_SHUTTER)


def plush_hand_in_front(seed: int) -> RigScene:
    """The lift, while another arm passes between it and the camera."""
    return replace(plush_lifted(seed), name="plush_hand_in_front", others=(_passing(seed),))


def _passing(seed: int) -> FurtherHand:
    """An arm that comes in from a side near the camera, passes over the middle and leaves again; it touches nothing."""
    side = 1.0 if seed % 2 == 0 else -1.0
    shape = bare_hand((0.26 * side, -0.28, 0.17), (0.9 * side, -0.25, 0.25), left=side < 0)
    away = (-0.30 * side, 0.0, 0.0)
    return FurtherHand(shape, Motion(((0.2, 0.55, away), (0.7, 1.1, _times(away, -1.0)))))


def _times(vector: tuple[float, float, float], factor: float) -> tuple[float, float, float]:
    return vector[0] * factor, vector[1] * factor, vector[2] * factor


def _looking(scene: RigScene, **changes) -> RigScene:
    return replace(scene, look=replace(scene.look, **changes))


def _cloth(seed: int, name: str, *strokes: Stroke, corner: tuple[float, float], **further) -> RigScene:
    """A cloth whose corner (-1 to 1 along its edges) a hand holds."""
    random = np.random.default_rng([seed, 0])
    cloth = Cloth(turn=float(random.uniform(-0.25, 0.25)))
    return RigScene(
        name=name,
        description="a cloth",
        body=cloth,
        hand=_pinching(cloth, corner),
        motion=_motion(random, *strokes),
        material=Material(density=cloth.density, friction_coefficient=0.4),
        view=View(eye=(0.0, -0.62, 0.50), target=(0.0, 0.0, 0.03), focal=500.0),
        frames=FRAMES,
        observed=OBSERVED,
        look=Look(body="print" if seed % 2 == 0 else "towel", hand="skin", seed=seed),
        grip_reach=_FINGERTIPS,
        hand_spacing=_HAND_MESH,
        **further,
    )


def _pinching(cloth: Cloth, corner: tuple[float, float]) -> RoundedShape:
    """A hand around a corner of a cloth, its arm leaving outwards; the fingertips reach below the cloth."""
    x, y = 0.43 * cloth.size[0] * corner[0], 0.43 * cloth.size[1] * corner[1]
    cos, sin = np.cos(cloth.turn), np.sin(cloth.turn)
    at = cos * x - sin * y, sin * x + cos * y
    return bare_hand((*map(float, at), 0.004), _towards((corner[0], 0.0, 0.0)), left=corner[0] < 0)


def cloth_lifted(seed: int) -> RigScene:
    """A cloth lifted by a far corner; the rest hangs and drags."""
    return _cloth(seed, "cloth_lifted", (0.05, 0.8, (-0.05, -0.03, 0.11)), corner=(1, 1))


def cloth_folded(seed: int) -> RigScene:
    """A corner carried over the cloth: the lower side comes to be seen."""
    strokes = (0.05, 0.5, (-0.03, -0.01, 0.06)), (0.4, 1.1, (-0.10, -0.06, -0.01))
    return _cloth(seed, "cloth_folded", *strokes, corner=(1, 1))


def cloth_dragged(seed: int) -> RigScene:
    """A cloth pulled over a table of one colour by a corner, which wrinkles it."""
    strokes = (0.05, 0.3, (0.0, 0.0, 0.02)), (0.2, 1.1, (0.04, 0.08, 0.01))
    return _looking(_cloth(seed, "cloth_dragged", *strokes, corner=(-1, 1)), table="plain")


def cloth_two_hands(seed: int) -> RigScene:
    """A cloth raised by its two far corners, which come nearer to each other."""
    random = np.random.default_rng([seed, 1])
    scene = _cloth(seed, "cloth_two_hands", (0.05, 0.9, (-0.03, -0.02, 0.10)), corner=(1, 1))
    other = FurtherHand(_pinching(scene.body, (-1, 1)), _motion(random, (0.05, 0.9, (0.03, -0.02, 0.10))), _FINGERTIPS)
    return replace(scene, others=(other,))


def cloth_shadow(seed: int) -> RigScene:
    """A lift by the other far corner under a low lamp over a table of one colour."""
    scene = _cloth(seed, "cloth_shadow", (0.05, 0.8, (0.05, -0.03, 0.11)), corner=(-1, 1))
    return _looking(scene, table="plain", **_LOW_LAMP)


def cloth_hand_in_front(seed: int) -> RigScene:
    """The lift, while another arm passes between it and the camera."""
    return replace(cloth_lifted(seed), name="cloth_hand_in_front", others=(_passing(seed),))


def _rope(seed: int, name: str, *strokes: Stroke, held: float, **further) -> RigScene:
    """A rope in a gentle curve, held at a place along it (0 to 1)."""
    random = np.random.default_rng([seed, 0])
    x = np.linspace(-0.15, 0.15, 16)
    path = np.stack([x, 0.03 * np.sin(2 * np.pi * x / 0.3 + random.uniform(0, 2 * np.pi))], axis=1)
    at = path[round(held * (len(path) - 1))]
    return RigScene(
        name=name,
        description="a rope",
        body=rope_body(path),
        hand=bare_hand((float(at[0]), float(at[1]), 0.006), _towards((float(at[0]), 0.0, 0.0)), left=bool(at[0] < 0)),
        motion=_motion(random, *strokes),
        material=_ROPE,
        view=View(eye=(0.0, -0.62, 0.45), target=(0.0, 0.0, 0.03), focal=500.0),
        frames=FRAMES,
        observed=OBSERVED,
        mesh_spacing=_ROPE_MESH,
        look=Look(body="rope", hand="skin", seed=seed),
        grip_reach=_FINGERTIPS,
        hand_spacing=_HAND_MESH,
        **further,
    )


def rope_lifted(seed: int) -> RigScene:
    """A rope lifted near an end."""
    return _rope(seed, "rope_lifted", (0.05, 0.8, (-0.04, 0.0, 0.10)), (0.8, 1.1, (-0.02, 0.02, 0.0)), held=0.8)


def rope_pushed(seed: int) -> RigScene:
    """A rope pushed along a table of one colour under a low lamp: it bends in the plane."""
    scene = _rope(seed, "rope_pushed", (0.05, 1.1, (0.03, -0.09, 0.004)), held=0.4)
    return _looking(scene, table="plain", **_LOW_LAMP)


def rope_blurred(seed: int) -> RigScene:
    """A rope swung to and fro with an open shutter."""
    strokes = (0.05, 0.4, (-0.03, 0.0, 0.08)), (0.4, 0.7, (0.0, 0.05, 0.0)), (0.75, 1.1, (0.04, -0.06, 0.0))
    return _looking(_rope(seed, "rope_blurred", *strokes, held=0.75), shutter=_SHUTTER)


def rope_hand_in_front(seed: int) -> RigScene:
    """The lift, while another arm passes between it and the camera."""
    return replace(rope_lifted(seed), name="rope_hand_in_front", others=(_passing(seed),))


SEQUENCES: dict[str, Callable[[int], RigScene]] = {
    make.__name__: make
    for make in (
        plush_lifted, plush_pushed, plush_two_hands, plush_plain_table, plush_shadow, plush_blurred, plush_hand_in_front,
        cloth_lifted, cloth_folded, cloth_dragged, cloth_two_hands, cloth_shadow, cloth_hand_in_front,
        rope_lifted, rope_pushed, rope_blurred, rope_hand_in_front,
    )
}  # fmt: skip
"""Scenes by name, each a function of the seed."""
