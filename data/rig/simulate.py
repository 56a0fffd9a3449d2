"""Truth by MuJoCo: a flex of linear tetrahedra (St. Venant-Kirchhoff, stiffness damping) held by a moving hand.

Independent of physreal_core: other method (FEM), other mesh, other integrator (implicit).
"""

from dataclasses import dataclass

import numpy as np

from data.rig.mesh import TetMesh, mesh_shape
from data.rig.scene import Scene
from physreal_core.array_types import Array, Float, Int

# Direct stiffness and damping of contact and grip (MuJoCo reads negative `solref` so): with the default time constant
# the constraints of such light nodes are orders of magnitude too soft.
_STIFF = 'solref="-2e6 -2e3" solimp=".9 .95 .001"'
_NODE_RADIUS = 0.0005  # [m] collision radius of a flex node


@dataclass(frozen=True)
class Trajectory:
    """What truly happened.

    Attributes:
        mesh: the body, stress-free.
        vertices: [T, V, 3] m, node positions at frame times.
        hand: [T, 3] m, displacement of the hand since frame 0.
        gripped: indices of the nodes that the hand holds.
    """

    mesh: TetMesh
    vertices: Float[Array, "T V 3"]
    hand: Float[Array, "T 3"]
    gripped: Int[Array, " B"]


def simulate(scene: Scene, *, timestep: float = 0.001, settle: float = 0.3) -> Trajectory:
    """Runs `scene` and records it at its frame rate.

    Args:
        scene: object, hand, motion and material.
        timestep: largest step [s]; a whole number of steps fits into a frame.
        settle: time [s] before frame 0 in which the object comes to rest under its weight, the hand holding still.

    Raises:
        RuntimeError: the simulation turned non-finite.
    """
    import mujoco

    mesh = mesh_shape(scene.body, scene.mesh_spacing)
    mesh.vertices[:, 2] += max(0.0, _NODE_RADIUS - mesh.vertices[:, 2].min())  # on the table, not in it
    gripped = np.flatnonzero(scene.hand.distance(mesh.vertices) < scene.grip_reach)
    steps = int(np.ceil(1 / (scene.fps * timestep)))
    model = mujoco.MjModel.from_xml_string(_describe(scene, mesh, gripped, 1 / (scene.fps * steps)))
    data = mujoco.MjData(model)
    nodes = np.array([model.body(f"s_{i}").id for i in range(len(mesh.vertices))])
    model.body_mass[nodes] = mesh.lumped_mass(scene.material.density)
    mujoco.mj_setConst(model, data)

    dt = model.opt.timestep
    for step in range(int(settle / dt)):
        mujoco.mj_step(model, data)
        if step % 20 == 19 and step < 0.8 * settle / dt:  # kinetic relaxation: takes the energy out
            data.qvel[:] = 0
    frames, hand = [data.flexvert_xpos.copy()], [np.zeros(3)]
    for frame in range(1, scene.frames):
        for step in range(steps):
            time = (frame - 1) / scene.fps + (step + 1) * dt
            data.mocap_pos[0] = scene.motion.displacement(time)
            mujoco.mj_step(model, data)
        frames.append(data.flexvert_xpos.copy())
        hand.append(scene.motion.displacement(frame / scene.fps))
    vertices = np.stack(frames)
    if not np.isfinite(vertices).all():
        raise RuntimeError(
            f"the truth of {scene.name} turned non-finite; a smaller timestep than {timestep} s may help"
        )
    return Trajectory(mesh, vertices, np.stack(hand), gripped)


def _describe(scene: Scene, mesh: TetMesh, gripped: Int[Array, " B"], timestep: float) -> str:
    """The MuJoCo model as XML; the hand is a mocap body at the origin that carries its displacement."""
    material = scene.material
    points, elements = _numbers(mesh.vertices), " ".join(map(str, mesh.tets.ravel()))
    friction = f'friction="{material.friction_coefficient} .001 .0001"'
    held = "".join(
        f'<connect body1="hand" body2="s_{i}" anchor="{_numbers(mesh.vertices[i])}" {_STIFF}/>' for i in gripped
    )
    return f"""<mujoco>
      <option timestep="{timestep}" gravity="{_numbers(scene.gravity)}" solver="Newton" tolerance="1e-8"
              integrator="discrete" cone="elliptic"/>
      <size memory="1G"/>
      <worldbody>
        <geom type="plane" size="2 2 .1" {friction}/>
        <body name="hand" mocap="true"/>
        <flexcomp name="s" type="direct" dim="3" point="{points}" element="{elements}" radius="{_NODE_RADIUS}"
                  mass="{mesh.lumped_mass(material.density).sum()}">
          <elasticity young="{material.youngs_modulus}" poisson="{material.poissons_ratio}"
                      damping="{material.damping}"/>
          <contact selfcollide="none" condim="3" {friction} {_STIFF}/>
        </flexcomp>
      </worldbody>
      <equality>{held}</equality>
    </mujoco>"""


def _numbers(values: Float[Array, "..."]) -> str:
    return " ".join(f"{value:.9g}" for value in np.ravel(values))
