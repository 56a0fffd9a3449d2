"""Truth by MuJoCo: a soft body held by a moving hand, with or without a hidden effect.

Independent of physreal_core: other method (FEM), other mesh, other integrator.
"""

from collections.abc import Callable
from functools import partial

import numpy as np

from data.rig.hidden.effect import NOTHING, Hidden
from data.rig.hidden.material import soften
from data.rig.mesh import TetMesh
from data.rig.rig_scene import RigScene
from data.rig.rope import Line
from data.rig.trajectory import Middle, Trajectory
from data.rig.world import World
from physreal_core.array_types import Array, Float
from physreal_core.checkpoints import Checkpoints, checkpoints

CHECKPOINT = "simulation"


class BlewUp(RuntimeError):
    """A simulation turned non-finite."""


ROUNDS = 2
"""How often a body that lies for long comes to rest and forgets its stress. It still sinks by up to a millimetre then."""


def simulate(
    scene: RigScene,
    *,
    timestep: float = 0.001,
    settle: float = 0.3,
    calm: float = 0.02,
    integrator: str = "discrete",
    hidden: Hidden = NOTHING,
    punctual: bool = False,
    lain: bool = False,
) -> Trajectory:
    """Runs `scene` and records it at its frame rate.

    Args:
        scene: object, hand, motion and material.
        timestep: largest step [s]; a whole number of steps fits into a frame.
        settle: time [s] before frame 0 in which the object comes to rest under its weight, the hand holding still.
        calm: time [s] between the moments at which the object is stopped while it settles (kinetic relaxation).
        integrator: of MuJoCo.
        hidden: what the scene does not tell.
        punctual: what is held keeps up with the hand, and positions are of the frame times; False: a millisecond late and one
            step early, as the published captures have them.
        lain: the object has lain for so long that it has forgotten its stress, as foam creeps, and is free of it in frame 0;
            False: it has the stress of its own weight there.

    Raises:
        BlewUp: the simulation turned non-finite.
    """
    import mujoco

    scene = hidden.changed(scene)
    place = hidden.placed
    if lain:
        place, settle = _as_it_lies(scene, timestep, integrator, hidden, settle, calm), 0.0
    world = World(scene, timestep, integrator, hidden.things(scene), hidden.elasticity(scene), place)
    if scene.soft_part is not None:
        soften(world, scene.soft_part.left)
    act = hidden.prepare(world)
    mujoco.mj_setConst(world.model, world.data)

    def step(time: float) -> None:
        world.data.qfrc_applied[:] = 0
        act(time)
        hidden.advance(world)

    times = np.arange((scene.frames - 1) * world.steps + 1) * world.timestep
    hand = scene.motion.displacement(times)
    held = hidden.held(hand, times, scene.motion)
    others = np.stack([o.motion.displacement(times) for o in scene.others], 1) if scene.others else None
    # hidden effects may have a state of their own, and so has a hand that takes and lets go
    kept = checkpoints() if hidden is NOTHING and scene.holds is None else Checkpoints()
    frames = _resumed(world, kept, held)
    if not frames:
        come_to_rest(world, step, settle, calm)
        frames = [_finite(world, punctual)]
    for number in range((len(frames) - 1) * world.steps + 1, len(times)):
        world.hold_at(held[number], ahead=punctual)
        if others is not None:
            world.hold_others_at(others[number])
        world.take_or_let_go(times[number])
        step(times[number])
        if number % world.steps == 0:
            frames.append(_finite(world, punctual))
            if kept.due(CHECKPOINT):
                kept.put(CHECKPOINT, {"state": _state(world), "frames": np.stack(frames)})
    vertices = np.stack(frames)
    further = {} if others is None else {"others": others[:: world.steps]}
    if isinstance(world.mesh, TetMesh):
        return Trajectory(world.mesh, vertices, hand[:: world.steps], world.gripped, **further)
    middle = _middle(world, vertices)
    skin = world.mesh.thickened(middle.vertices, *([middle.directors] if isinstance(world.mesh, Line) else []))
    gripped = world.mesh.skin_nodes(world.gripped)
    return Trajectory(world.mesh.skin(), skin, hand[:: world.steps], gripped, **further, middle=middle)


def _middle(world: World, recorded: Float[Array, "T R 3"]) -> Middle:
    """What `_recorded` gave, of a thin body."""
    nodes, directors = np.split(recorded, [len(world.mesh.vertices)], axis=1)
    return Middle(world.mesh.vertices, world.mesh.elements, nodes, directors, world.gripped)


def _state(world: World) -> Float[Array, " S"]:
    """All that MuJoCo's next step depends on."""
    import mujoco

    kind = mujoco.mjtState.mjSTATE_INTEGRATION
    state = np.zeros(mujoco.mj_stateSize(world.model, kind))
    mujoco.mj_getState(world.model, world.data, state, kind)
    return state


def _resumed(world: World, kept: Checkpoints, held: Float[Array, "S 3"]) -> list[Float[Array, "V 3"]]:
    """Puts the world where a simulation that was killed had come to, and gives the frames so far; none without one."""
    import mujoco

    shapes = {"state": _state(world).shape, "frames": (None, *_recorded(world, punctual=True).shape)}
    known = kept.get(CHECKPOINT, shapes)
    if known is None:
        return []
    world.hold_at(held[(len(known["frames"]) - 1) * world.steps])
    mujoco.mj_setState(world.model, world.data, known["state"], mujoco.mjtState.mjSTATE_INTEGRATION)
    return [*known["frames"]]


def _recorded(world: World, punctual: bool) -> Float[Array, "R 3"]:
    """The nodes [m]; of a rope also its segments' directors."""
    return np.concatenate([world.positions if punctual else world.data.flexvert_xpos, world.directors])


def _finite(world: World, punctual: bool) -> Float[Array, "R 3"]:
    """`_recorded`, or an error where the simulation blew up."""
    recorded = _recorded(world, punctual)
    if not np.isfinite(recorded).all():
        raise BlewUp(
            f"the truth of {world.scene.name} turned non-finite; a smaller timestep than {world.timestep} s may help"
        )
    return recorded


def _as_it_lies(
    scene: RigScene, timestep: float, integrator: str, hidden: Hidden, settle: float, calm: float
) -> Callable[[Array], Array]:
    """Puts the nodes where they lie after a long time."""
    import mujoco

    place = hidden.placed
    for _ in range(ROUNDS):
        world = World(scene, timestep, integrator, place=place)
        mujoco.mj_setConst(world.model, world.data)
        come_to_rest(world, lambda time, world=world: mujoco.mj_step(world.model, world.data), settle, calm)
        place = partial(_there, world.positions)
    return place


def _there(places: Array, points: Array) -> Array:
    """The places, whatever the points."""
    return places.copy()


def come_to_rest(world: World, step: Callable[[float], None], duration: float, calm: float) -> None:
    """Comes to rest; the last fifth of the time runs free."""
    count, every = int(duration / world.timestep), max(1, round(calm / world.timestep))
    for number in range(count):
        step((number + 1 - count) * world.timestep)
        if number % every == every - 1 and number < 0.8 * count:
            world.data.qvel[:] = 0
