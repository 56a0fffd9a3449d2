"""A twin as MuJoCo's `MjSpec`: slide joints at the nodes, a flex between them, a table, and a mocap body for the hand."""

import math

import numpy as np

from applications.export.body.hand import Hand
from applications.export.body.material import Material
from applications.export.body.nodes import Nodes
from applications.twin import Twin
from data.rig.world import FRICTION_IMPEDANCE, firmness, rigid
from physreal_core.array_types import Array, Float, Int

NAME, HAND = "twin", "hand"
STEP = 1e-3  # [s]; implicit, and damps as a retardation time of as much
_SHARE = 1 / 4  # of the time that a wave in a rope takes from node to node: an explicit step
_IMPEDANCE = (0.9, 0.95, 0.001, 0.5, 2.0)  # MuJoCo's `solimp`
_HOLD_IMPEDANCE = (0.99, 0.99, 0.001, 0.5, 2.0)
_SEEN = 0.006  # [m], size of what is drawn of the hand
_SOME = 1e-9  # [s]; MuJoCo takes a flex without any damping for one without forces, and warns
_LIGHT = 1e-9  # [kg] of the body that carries the twist of a rope's segment


def described(twin: Twin, nodes: Nodes, material: Material, hand: Hand | None):
    """The scene at frame 0, ready to be compiled.

    Args:
        twin: for the table and the tool.
        nodes: of the body.
        material: of it.
        hand: whose place in frame 0 is that of the mocap body; None where nothing was filmed that moves the body.
    """
    import mujoco

    spec = mujoco.MjSpec()
    spec.modelname = twin.sequence
    spec.memory = 1 << 30
    _options(spec, nodes, material)
    ground = twin.model.simulation.get("ground_height")
    if ground is not None:
        _table(spec, ground - (nodes.radius if nodes.dimension == 3 else 0.0), material, spec.option.timestep)
    if hand is not None:
        _hand(spec, twin, hand)
    _bodies(spec, nodes)
    _hold(spec, nodes, np.zeros(3) if hand is None else hand.places[0])
    for number, part in enumerate(nodes.parts):
        _flex(spec, f"{NAME}_{number}" if number else NAME, part, nodes, material)
    _start(spec, nodes)
    return spec


def _options(spec, nodes: Nodes, material: Material) -> None:
    import mujoco

    option, rope = spec.option, nodes.dimension == 1
    option.timestep = _rope_step(nodes, material) if rope else STEP
    option.gravity = material.gravity
    option.integrator = mujoco.mjtIntegrator.mjINT_EULER if rope else mujoco.mjtIntegrator.mjINT_DISCRETE
    option.solver, option.cone = mujoco.mjtSolver.mjSOL_NEWTON, mujoco.mjtCone.mjCONE_ELLIPTIC
    option.impratio = FRICTION_IMPEDANCE


def _rope_step(nodes: Nodes, material: Material) -> float:
    """A stable explicit step [s]: see `data.rig.thin_body.stable_step`."""
    area, spacing = math.pi * nodes.radius**2, _spacing(nodes.rest, nodes.parts[0])
    per_length = nodes.mass.sum() * area / nodes.volume
    stretching = material.youngs_modulus * area
    bending = material.bending_ratio * material.youngs_modulus * area * nodes.radius**2 / 4
    across = spacing**2 / math.sqrt(bending / per_length) / 2
    return _SHARE * min(spacing / math.sqrt(stretching / per_length), across)


def _spacing(points: Float[Array, "V 3"], segments: Int[Array, "M 2"]) -> float:
    return float(np.linalg.norm(np.diff(points[segments], axis=1), axis=-1).mean())


def _contact(thing, step: float, friction: float) -> None:
    stiffness, damping = firmness(step)
    thing.solref, thing.solimp = [-stiffness, -damping], _IMPEDANCE
    thing.friction, thing.condim = [friction, 1e-3, 1e-4], 3


def _table(spec, height: float, material: Material, step: float) -> None:
    import mujoco

    table = spec.worldbody.add_geom(
        name="table", type=mujoco.mjtGeom.mjGEOM_PLANE, size=[1, 1, 0.1], pos=[0, 0, height]
    )
    _contact(table, step, material.friction_coefficient)
    spec.worldbody.add_light(pos=[0, 0, 2])


def _hand(spec, twin: Twin, hand: Hand) -> None:
    """The mocap body; what a viewer shows of it touches nothing, unless it is a tool."""
    import mujoco

    body, tool = spec.worldbody.add_body(name=HAND, mocap=True, pos=hand.places[0]), twin.problem.tool
    if tool is None:
        body.add_geom(size=[_SEEN, 0, 0], contype=0, conaffinity=0, mass=0, rgba=[0.9, 0.5, 0.2, 1])
        return
    friction = float(twin.model.fields["tool_friction"])
    points = twin.problem.controllers[0].numpy() - hand.places[0]
    for (one, other), radius in zip(tool.ends, tool.radius, strict=True):
        kind = {"size": [radius, 0, 0], "pos": points[one]}
        if one != other:
            ends = [*points[one], *points[other]]
            kind = {"type": mujoco.mjtGeom.mjGEOM_CAPSULE, "size": [radius, 0, 0], "fromto": ends}
        _contact(body.add_geom(mass=0, priority=1, **kind), spec.option.timestep, friction)


def _hold(spec, nodes: Nodes, place: Float[Array, "3"]) -> None:
    """Every held node stays where it is in the hand, which is at a place [m], or in the world. MuJoCo takes no elastic nodes of a mocap
    body itself, and of a rope not all that stand still."""
    import mujoco

    for n in np.flatnonzero(nodes.held | nodes.fixed):
        hold = spec.add_equality(type=mujoco.mjtEq.mjEQ_CONNECT, objtype=mujoco.mjtObj.mjOBJ_BODY, name=f"hold_{n}")
        hold.name1, hold.name2 = "world" if nodes.fixed[n] else HAND, _name(n)
        hold.data[:3] = nodes.rest[n] - (0.0 if nodes.fixed[n] else place)
        _firm(hold, spec.option.timestep, nodes)


def _firm(hold, step: float, nodes: Nodes) -> None:
    """As stiff as the step bears: all of a thin body pulls at the light nodes that are held."""
    stiffness, damping = firmness(step) if nodes.dimension == 3 else rigid(step)
    hold.solref, hold.solimp = [-stiffness, -damping], _HOLD_IMPEDANCE


def _name(node: int) -> str:
    return f"node_{node}"


def _bodies(spec, nodes: Nodes) -> None:
    """A body for each node, with three slide joints."""
    import mujoco

    for n, (place, mass) in enumerate(zip(nodes.rest, nodes.mass, strict=True)):
        body = spec.worldbody.add_body(name=_name(n), pos=place)
        _with_mass(body, mass, nodes.radius)
        for axis in np.eye(3):
            body.add_joint(type=mujoco.mjtJoint.mjJNT_SLIDE, axis=axis)


def _with_mass(body, mass: float, radius: float) -> None:
    """Gives a body a mass [kg], and that of gyration of a radius [m]."""
    body.mass, body.inertia, body.explicitinertial = mass, np.full(3, mass * radius**2), True
    body.ipos = np.zeros(3)


def _flex(spec, name: str, part: Int[Array, "M C"], nodes: Nodes, material: Material) -> None:
    import mujoco

    used, local = np.unique(part, return_inverse=True)
    flex = spec.add_flex(name=name, dim=nodes.dimension, radius=nodes.radius)
    flex.vertbody = [_name(n) for n in used]
    flex.elem = local.reshape(part.shape).ravel().tolist()
    flex.selfcollide = mujoco.mjtFlexSelf.mjFLEXSELF_NONE
    _contact(flex, spec.option.timestep, material.friction_coefficient)
    {1: _rope, 2: _cloth, 3: _solid}[nodes.dimension](spec, flex, part, nodes, material)


def _solid(spec, flex, part: Array, nodes: Nodes, material: Material) -> None:
    flex.young, flex.poisson = material.youngs_modulus, material.poissons_ratio
    flex.damping = max(material.retardation - STEP, _SOME)


def _cloth(spec, flex, part: Array, nodes: Nodes, material: Material) -> None:
    """The homogeneous sheet that has the stiffness of both membrane and bending: of another thickness, if need be."""
    _solid(spec, flex, part, nodes, material)
    thinner = math.sqrt(material.bending_ratio)
    flex.thickness, flex.young = 2 * nodes.radius * thinner, material.youngs_modulus / thinner
    flex.elastic2d = 3  # both


def _rope(spec, flex, part: Array, nodes: Nodes, material: Material) -> None:
    """MuJoCo's rod bends by `young` and twists by `shear`, each segment by a hinge of its own; springs stretch it."""
    shear = material.youngs_modulus / (2 * (1 + material.poissons_ratio))
    flex.young, flex.shear = material.bending_ratio * material.youngs_modulus, material.twisting_ratio * shear
    flex.damping = max(material.retardation, _SOME)
    flex.edgestiffness = material.youngs_modulus * math.pi * nodes.radius**2 / _spacing(nodes.rest, part)
    for number, ends in enumerate(part):
        last = number == len(part) - 1
        _twist(spec, f"{flex.name}_twist" if last else f"{flex.name}_twist_{number}", ends, nodes)


def _twist(spec, name: str, ends: Int[Array, "2"], nodes: Nodes) -> None:
    """The hinge by which a segment turns about itself, by the name that MuJoCo looks for; in a hold it does not."""
    import mujoco

    body = spec.worldbody.add_body(name=name)
    _with_mass(body, _LIGHT, nodes.radius)
    body.inertia = np.full(3, nodes.mass[ends].mean() * nodes.radius**2 / 2)
    body.add_joint(name=name, axis=nodes.rest[ends[1]] - nodes.rest[ends[0]])
    if (nodes.held | nodes.fixed)[ends].all():
        hold = spec.add_equality(type=mujoco.mjtEq.mjEQ_JOINT, name=f"hold_{name}", name1=name)
        _firm(hold, spec.option.timestep, nodes)


def _start(spec, nodes: Nodes) -> None:
    """A keyframe with the body as it lies in frame 0, where that is not its shape without stress."""
    way = nodes.start - nodes.rest
    if np.abs(way).max(initial=0.0) < 1e-9:
        return
    twists = len(spec.joints) - way.size
    spec.add_key(name="frame_0", qpos=np.concatenate([way.ravel(), np.zeros(twists)]))
