"""A scene in MuJoCo: a flex of linear tetrahedra (St. Venant-Kirchhoff, stiffness damping), a table, a hand that holds it.

MuJoCo's flex is exactly St. Venant-Kirchhoff: per element, energy 1/2 e M e / 2 of its six squared edge lengths e less those at
rest; `model.flex_stiffness` holds M. Hidden effects (data/rig/hidden) reach the simulation through the class here.
"""

from collections.abc import Callable

import numpy as np

from data.rig.mesh import TetMesh, mesh_shape
from data.rig.rig_scene import RigScene
from data.rig.rope import Line
from data.rig.thin_body import Directors, MiddleMesh, ThinBody, edges, end_hold_at_nodes, ends_at_nodes, held_twists
from physreal_core.array_types import Array, Float, Int

NODE_RADIUS = 0.0005  # [m] collision radius of a flex node
FRICTION_IMPEDANCE = 100  # over that of contact; with 1, what friction holds creeps by a millimetre a second
TOUCHING = 1e-6  # [m]; nodes in the surface of what the hand holds are held
CONTACT_IMPEDANCE = ".9 .95 .001"  # MuJoCo's `solimp`
HOLD_IMPEDANCE = ".99 .99 .001"  # stiffer than contact: the hold shall take nothing off a swing
STICK_MASS = 100.0  # [kg], of a hand that pushes; nothing that it pushes slows it


class World:
    """The compiled scene at time 0, at rest.

    Args:
        scene: object, hand and material.
        timestep: largest step [s]; a whole number of steps fits into a frame.
        integrator: MuJoCo's; "discrete" is implicit and damps a little, "Euler" is symplectic and needs small steps.
        further: XML of more things in the world.
        flex: XML attributes of the flex's elasticity beside the material.
        place: where the body lies, from where it would lie on a level table at z = 0.

    Attributes:
        mesh: the body, stress-free; of a thin body, its middle surface or centre line.
        model, data: MuJoCo's.
        gripped: nodes that the hand holds, [B].
        held_by_others: for every further hand, the nodes that it holds.
        bodies, dofs: of the nodes in MuJoCo's arrays, [V] and [V, 3].
        steps: number in a frame.
    """

    def __init__(
        self,
        scene: RigScene,
        timestep: float,
        integrator: str = "discrete",
        further: str = "",
        flex: str = "",
        place: Callable[[Float[Array, "V 3"]], Float[Array, "V 3"]] = np.asarray,
    ) -> None:
        import mujoco

        self.scene = scene
        self.mesh = _mesh(scene)
        self._radius = _radius(scene)
        self.mesh.vertices[:, 2] += max(0.0, self._radius - self.mesh.vertices[:, 2].min())  # on the table, not in it
        self.gripped = _held(scene, self.mesh.vertices)
        self.held_by_others = [
            np.flatnonzero(other.shape.distance(self.mesh.vertices) < other.reach) for other in scene.others
        ]
        self.mesh.vertices[:] = place(self.mesh.vertices)
        self.steps = int(np.ceil(1 / (scene.fps * timestep)))
        self.timestep = 1 / (scene.fps * self.steps)
        self._hold = rigid(self.timestep) if ends_at_nodes(scene.body) else firmness(self.timestep)
        self.model = mujoco.MjModel.from_xml_string(self._describe(integrator, further, flex))
        self.data = mujoco.MjData(self.model)
        self.bodies = np.array([self.model.body(f"s_{i}").id for i in range(len(self.mesh.vertices))])
        self.dofs = self.model.body_dofadr[self.bodies][:, None] + np.arange(3)
        if ends_at_nodes(scene.body):
            end_hold_at_nodes(self.model, self.mesh, self.gripped)
        self._directors = Directors(self.model, self.mesh) if isinstance(self.mesh, Line) else None
        self._origin = self.model.body_pos[self.bodies]  # slide joints along the world's axes: x = origin + q
        self._hand = np.zeros(3)
        # of a hand that pushes, which is no mocap body
        self._pushing = self.model.body_dofadr[self.model.body("hand").id] + np.arange(3)
        self._taken = scene.holds is None
        if not self._taken:
            self._let_hold(False)
        self.model.body_mass[self.bodies] = self.mesh.lumped_mass(scene.material.density)

    @property
    def positions(self) -> Float[Array, "V 3"]:
        """Of the nodes [m], now; MuJoCo's own `flexvert_xpos` is that of the last step's beginning."""
        return self._origin + self.data.qpos[self.dofs]

    @property
    def velocities(self) -> Float[Array, "V 3"]:
        """Of the nodes [m/s]."""
        return self.data.qvel[self.dofs]

    @property
    def directors(self) -> Float[Array, "S 3"]:
        """Of a rope's segments: unit vectors that turn with them, at the last step's beginning; of other bodies none."""
        return np.zeros((0, 3)) if self._directors is None else self._directors(self.data)

    @property
    def masses(self) -> Float[Array, " V"]:
        """Of the nodes [kg]."""
        return self.model.body_mass[self.bodies]

    def push(self, force: Float[Array, "V 3"]) -> None:
        """Adds a force [N] on each node for the coming step."""
        self.data.qfrc_applied[self.dofs] += force

    def hold_at(self, displacement: Float[Array, "3"], ahead: bool = False) -> None:
        """Puts what the hand holds at `displacement` [m] from where it was at time 0.

        MuJoCo damps what is held against the world, not against the hand, whose velocity it does not know: it follows by
        damping over stiffness late, a millisecond, unless the hand is put `ahead` by as much.
        """
        stiffness, damping = self._hold
        velocity = (displacement - self._hand) / self.timestep
        self._hand = np.array(displacement)
        if self._pushes:
            self.data.qpos[self._pushing] = displacement - self.timestep * velocity
            self.data.qvel[self._pushing] = velocity
        else:
            self.data.mocap_pos[0] = displacement + ahead * damping / stiffness * velocity

    def take_or_let_go(self, time: float) -> None:
        """Hold the body, where it is now, or let it go, as the scene says of a time [s]."""
        if self.scene.holds is None:
            return
        taken = self.scene.holds[0] <= time < self.scene.holds[1]
        if taken != self._taken:
            if taken:
                self.model.eq_data[: len(self.gripped), :3] = self.positions[self.gripped] - self.data.mocap_pos[0]
            self._let_hold(taken)
            self._taken = taken

    def _let_hold(self, holds: bool) -> None:
        """Switch the first hand's constraints on or off: those of its nodes come first, those of a rope's twist last."""
        others = sum(map(len, self.held_by_others))
        own = np.delete(np.arange(self.model.neq), len(self.gripped) + np.arange(others))
        self.model.eq_active0[own] = self.data.eq_active[own] = holds

    def hold_others_at(self, displacements: Float[Array, "A 3"]) -> None:
        """Puts what the further hands hold at their displacements [m] from where it was at time 0."""
        self.data.mocap_pos[-len(displacements) :] = displacements

    def _describe(self, integrator: str, further: str, flex: str) -> str:
        """The MuJoCo model as XML; a hand is a body at the origin that carries its displacement, a mocap body unless it pushes."""
        scene, stiff, held_fast = self.scene, firm(firmness(self.timestep)), firm(self._hold, HOLD_IMPEDANCE)
        friction = f'friction="{scene.material.friction_coefficient} .001 .0001"'
        holds = [("hand", self.gripped), *((f"hand_{n}", nodes) for n, nodes in enumerate(self.held_by_others, 1))]
        held = "".join(
            f'<connect body1="{hand}" body2="s_{i}" anchor="{_numbers(self.mesh.vertices[i])}" {held_fast}/>'
            for hand, nodes in holds
            for i in nodes
        )
        held += held_twists(self.mesh, self.gripped, held_fast)
        hands = "".join(f'<body name="{hand}" mocap="true"/>' for hand, _ in holds[self._pushes :])
        hands = (self._stick(stiff) if self._pushes else "") + hands
        return f"""<mujoco>
      <option timestep="{self.timestep}" gravity="{_numbers(scene.gravity)}" solver="Newton" tolerance="1e-8"
              iterations="1000" integrator="{integrator}" cone="elliptic" impratio="{FRICTION_IMPEDANCE}">
        <flag autoreset="disable"/>
      </option>
      <size memory="1G"/>
      <worldbody>
        <geom name="table" type="plane" size="2 2 .1" {friction}/>
        {hands}
        <flexcomp name="s" type="direct" {self._elements()} point="{_numbers(self.mesh.vertices)}" radius="{self._radius}"
                  mass="{self.mesh.lumped_mass(scene.material.density).sum()}">
          {edges(self.mesh, scene.body)}
          <elasticity {self._elasticity()} {flex}/>
          <contact selfcollide="none" condim="3" {friction} {stiff}/>
        </flexcomp>
        {further}
      </worldbody>
      <equality>{held}</equality>
      {'<contact><exclude body1="hand" body2="world"/></contact>' if self._pushes else ""}
    </mujoco>"""

    @property
    def _pushes(self) -> bool:
        return self.scene.push_friction is not None

    def _stick(self, stiff: str) -> str:
        """A hand that pushes: a heavy body whose velocity is set, which contact and its friction know, as they do not know a mocap body's."""
        slides = "".join(f'<joint type="slide" axis="{axis}"/>' for axis in ("1 0 0", "0 1 0", "0 0 1"))
        geoms = "".join(
            f'<geom type="capsule" fromto="{_numbers(np.array([c.start, c.end]))}" size="{c.radius}" mass="0" priority="1" condim="3" '
            f'friction="{self.scene.push_friction} .001 .0001" {stiff}/>'
            for c in self.scene.hand.capsules
        )
        inertial = f'<inertial pos="0 0 0" mass="{STICK_MASS}" diaginertia="1 1 1"/>'
        return f'<body name="hand" gravcomp="1">{inertial}{slides}{geoms}</body>'

    def _elements(self) -> str:
        """Attributes of the flex that say what it is made of."""
        corners = self.mesh.tets if isinstance(self.mesh, TetMesh) else self.mesh.elements
        return f'dim="{corners.shape[1] - 1}" element="{" ".join(map(str, corners.ravel()))}"'

    def _elasticity(self) -> str:
        """Attributes of the flex's elasticity: of the thin body's own material, or of the scene's."""
        body, stuff = self.scene.body, self.scene.material
        if isinstance(body, ThinBody):
            return f'{body.elasticity()} damping="{body.damping}"'
        return f'young="{stuff.youngs_modulus}" poisson="{stuff.poissons_ratio}" damping="{stuff.damping}"'


def firmness(timestep: float) -> tuple[float, float]:
    """Stiffness [1/s^2] and damping [1/s] of contact and grip.

    With MuJoCo's default time constant the constraints of such light nodes are orders of magnitude too soft. Friction is only
    as firm as the damping lets it be: it takes at most that much off a node's speed in a step.
    """
    return 2e6, max(2e3, 0.9 / timestep)


def rigid(timestep: float) -> tuple[float, float]:
    """Stiffness [1/s^2] and damping [1/s] of a hold that is as stiff as the step bears, critically damped.

    The end of a thin body weighs next to nothing, and all of the body pulls and bends it.
    """
    stiffness, damping = firmness(timestep)
    return max(stiffness, (0.45 / timestep) ** 2), damping


def firm(firmness: tuple[float, float], impedance: str = CONTACT_IMPEDANCE) -> str:
    """Attributes of contact or grip: stiffness and damping as MuJoCo reads a negative `solref`, and its impedance."""
    stiffness, damping = firmness
    return f'solref="-{stiffness:.9g} -{damping:.9g}" solimp="{impedance}"'


def _mesh(scene: RigScene) -> TetMesh | MiddleMesh:
    if isinstance(scene.body, ThinBody):
        return scene.body.mesh()
    return mesh_shape(scene.body, scene.mesh_spacing, scene.grasp)


def _radius(scene: RigScene) -> float:
    """Collision radius of the nodes [m]; a thin body's skin lies on the table, not in it."""
    return max(NODE_RADIUS, scene.body.thickness / 2) if isinstance(scene.body, ThinBody) else NODE_RADIUS


def _held(scene: RigScene, vertices: Float[Array, "V 3"]) -> Int[Array, " B"]:
    if scene.push_friction is not None:
        return np.zeros(0, int)
    if scene.grasp is not None:
        return np.flatnonzero(scene.grasp.distance(vertices) < TOUCHING)
    return np.flatnonzero(scene.hand.moved(scene.on_the_way).distance(vertices) < scene.grip_reach)


def _numbers(values: Float[Array, "..."]) -> str:
    return " ".join(f"{value:.9g}" for value in np.ravel(values))
