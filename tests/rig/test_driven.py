"""A hand that is led from outside, against the same motion of a scene."""

import dataclasses

import numpy as np

from data.rig.driven import Driven
from data.rig.rig_scene import Motion, mitten, plush_lift
from data.rig.shapes import Block
from data.rig.simulate import simulate


def small_scene():
    """A block held at one end, lifted within six frames."""
    body = Block((-0.05, -0.02, 0.0), (0.05, 0.02, 0.03))
    return dataclasses.replace(
        plush_lift(),
        body=body,
        hand=mitten((0.04, 0.0, 0.03), (0.55, 0.45, 0.75)),
        grasp=Block((0.03, -0.03, -1.0), (0.06, 0.03, 1.0)),
        motion=Motion(((0.0, 0.2, (0.0, 0.02, 0.03)),)),
        mesh_spacing=0.015,
        frames=9,
    )


def test_led_in_two_parts_it_goes_where_the_scene_goes():
    """Between frames the hand goes along cubics of its own, so the two agree to a millimetre and not to the last bit."""
    scene = small_scene()
    true = simulate(scene, punctual=True)
    driven = Driven(scene)
    assert np.abs(driven.nodes - true.vertices[0]).max() < 1e-6
    path = scene.motion.displacement(np.arange(1, 10) / scene.fps)
    seen = np.concatenate([driven.advance(path[:5]), driven.advance(path[4:])])
    assert seen.shape == true.vertices[1:].shape
    assert np.abs(seen - true.vertices[1:]).max() < 1e-3
    assert np.abs(true.vertices[-1] - true.vertices[0]).max() > 0.02
    assert np.allclose(driven.moved, path[-2])
    driven.begin_anew()
    assert np.array_equal(driven.advance(path[:5]), seen[:4])
