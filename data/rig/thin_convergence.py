"""How truly the rig's cloth and rope bend, stretch, twist and swing, against closed forms, with finer and finer elements.

A strip and a rope are held level at one end, as the hand holds them in the captures. Printed are the errors of what is measured, over
the closed form, in per cent.

    python -m data.rig.thin_convergence
    python -m data.rig.thin_convergence --scenes

The second prints how far a finer time step or finer elements move the captures (half an hour).
"""

import math
import sys
from collections.abc import Callable
from dataclasses import replace

import numpy as np
from scipy.integrate import solve_bvp

from data.rig.rig_scene import Motion, RigScene
from data.rig.rope import Rope
from data.rig.shapes import Block, Capsule, RoundedShape
from data.rig.thin import Cloth
from data.rig.thin_body import ThinBody, stable_step, twist_joint
from data.rig.thin_scenes import CLOTH, PLATE_RATIO, ROPE, THIN_SCENES
from data.rig.thin_simulate import run
from data.rig.world import World
from physreal_core.array_types import Array, Float

LENGTH = 0.1  # of what is not held [m]
_HELD = 0.02  # [m], at least
_HEIGHT = 1.0  # above the table [m]
_SMALL = 0.01  # of the length: a deflection that is small
_STRAIN = 1e-3  # of the whole, where it is stretched
_GRAVITY = 9.81
_STILL = Motion(((0.0, 1.0, (0.0, 0.0, 0.0)),))
_NOWHERE = RoundedShape((Capsule((5, 5, 5), (5, 5, 5), 0.01),))


def rope(spacing: float, length: float = LENGTH) -> Rope:
    """The rope of the captures, from x = 0 on, with a held part before it."""
    held = math.ceil(_HELD / spacing) * spacing
    return replace(ROPE, start=(-held, 0.0, _HEIGHT), end=(length, 0.0, _HEIGHT), spacing=spacing, damping=0.0)


def strip(spacing: float, width: float, length: float = LENGTH) -> Cloth:
    """A strip of the cloth of the captures, from x = 0 on, with a held part before it."""
    row = length / round(length / (spacing * math.sqrt(3) / 2))
    held = math.ceil(_HELD / row) * row
    size = length + held, width
    middle = (length - held) / 2, 0.0, _HEIGHT
    return replace(CLOTH, centre=middle, size=size, spacing=row * 2 / math.sqrt(3), turn=0.0, damping=0.0)


def held_world(body: ThinBody, gravity: tuple[float, float, float]) -> World:
    """The body, held up to x = 0, in explicit steps without damping."""
    import mujoco

    grasp = Block((-9.0, -9.0, -9.0), (1e-6, 9.0, 9.0))
    scene = RigScene("held", "", body, _NOWHERE, _STILL, gravity=gravity, grasp=grasp)
    world = World(scene, stable_step(body), "Euler")
    mujoco.mj_setConst(world.model, world.data)
    return world


def at_rest(world: World, calm: float = 1e-5, limit: int = 400_000) -> World:
    """Kinetic relaxation: the body is stopped whenever its kinetic energy falls, until stops move it by less than `calm` of its way.

    Raises:
        RuntimeError: it has not come to rest.
    """
    import mujoco

    start, before, energy = world.positions, world.positions, 0.0
    for _ in range(limit):
        mujoco.mj_step(world.model, world.data)
        now = float(world.masses @ (world.velocities**2).sum(axis=1))
        if now < energy:
            world.data.qvel[:] = now = 0.0
            here = world.positions
            if np.abs(here - before).max() < calm * np.abs(here - start).max():
                return world
            before = here
        energy = now
    raise RuntimeError(f"{world.scene.name} is not at rest after {limit} steps")


def tip(world: World) -> Float[Array, "3"]:
    """The mean of the nodes of the free end [m], from where the hold ends."""
    end = world.mesh.vertices[:, 0] > world.mesh.vertices[:, 0].max() - 1e-9
    return world.positions[end].mean(axis=0) - (0.0, 0.0, _HEIGHT)


def weight(body: ThinBody) -> float:
    """Mass of a metre of rope [kg/m], or of a square metre of cloth [kg/m^2]."""
    return body.mass_per_length if isinstance(body, Rope) else body.areal_density


def stretching(body: ThinBody) -> float:
    """E A [N], or E t [N/m]."""
    return body.stretching_stiffness if isinstance(body, Rope) else body.membrane_stiffness


def small_sag(body: ThinBody) -> float:
    """Sag of the tip where it is a hundredth of the length, over q L^4 / 8 E I (of a rope, or of a strip in a cylinder, D for E I)."""
    gravity = _SMALL * 8 * body.bending_stiffness / (weight(body) * LENGTH**3)
    return -tip(at_rest(held_world(body, (0.0, 0.0, -gravity))))[2] / (_SMALL * LENGTH)


def plate(width: float, ratio: float = PLATE_RATIO, order: int = 9) -> tuple[float, float]:
    """A plate [LENGTH, width] held at one end, over a beam with D for E I: sag of its end, and first frequency.

    Kirchhoff's plate by the method of Ritz, with polynomials.

    Args:
        width: [m].
        ratio: Poisson's ratio of bending.
        order: of the polynomials along the plate.
    """
    x, along = np.polynomial.legendre.leggauss(16)
    side = width / LENGTH
    u, v = np.meshgrid((x + 1) / 2, x / 2 * side, indexing="ij")
    area = np.outer(along / 2, along / 2 * side)
    powers = [(i, j) for i in range(2, order + 1) for j in range(0, 9, 2)]
    w = np.array([u**i * v**j for i, j in powers])
    xx = np.array([i * (i - 1) * u ** (i - 2) * v**j for i, j in powers])
    yy = np.array([j * (j - 1) * u**i * v ** max(j - 2, 0) for i, j in powers])
    xy = np.array([i * j * u ** (i - 1) * v ** max(j - 1, 0) for i, j in powers])
    terms = [(1, xx, xx), (1, yy, yy), (ratio, xx, yy), (ratio, yy, xx), (2 * (1 - ratio), xy, xy)]
    stiffness = sum(factor * np.einsum("aij,bij,ij->ab", a, b, area) for factor, a, b in terms)
    mass = np.einsum("aij,bij,ij->ab", w, w, area)
    end = np.array([(along / 2 * (x / 2 * side) ** j).sum() for _, j in powers])  # mean over the end
    sag = 8 * np.linalg.lstsq(stiffness, np.einsum("aij,ij->a", w, area), rcond=1e-13)[0] @ end
    size, turned = np.linalg.eigh(mass)
    kept = turned[:, size > 1e-11 * size[-1]] / np.sqrt(size[size > 1e-11 * size[-1]])  # powers are nearly dependent
    return float(sag), math.sqrt(np.linalg.eigvalsh(kept.T @ stiffness @ kept)[0]) / 1.875104**2


def heavy_elastica(load: float) -> Float[Array, "2"]:
    """The free end of an inextensible rod of unit length that is held level, at (x, z); `load` is q L^3 / E I.

    theta'' = load (1 - s) cos(theta), theta(0) = 0, theta'(1) = 0, theta downwards (the heavy elastica).
    """

    def slopes(s: Array, y: Array) -> Array:
        return np.stack([y[1], -load * (1 - s) * np.cos(y[0]), np.cos(y[0]), -np.sin(y[0])])

    def ends(a: Array, b: Array) -> Array:
        return np.array([a[0], b[1], a[2], a[3]])

    s = np.linspace(0, 1, 201)
    guess = np.stack([1.2 * s * (2 - s) / 1, 2.4 * (1 - s), s, -s / 2])
    found = solve_bvp(slopes, ends, s, guess, tol=1e-8, max_nodes=20_000)
    if not found.success:
        raise RuntimeError(f"heavy elastica of load {load}: {found.message}")
    return found.y[2:, -1]


def large_sag(body: ThinBody, length: float) -> float:
    """Distance of the tip from the heavy elastica's, as a share of the sag, signed as the sag is."""
    load = weight(body) * _GRAVITY * length**3 / body.bending_stiffness
    x, z = length * heavy_elastica(load)
    found = tip(at_rest(held_world(body, (0.0, 0.0, -_GRAVITY))))
    return 1 + math.copysign(math.hypot(found[0] - x, found[2] - z), z - found[2]) / -z


def own_stretch(body: ThinBody) -> float:
    """Elongation under own weight along the body, over q L^2 / 2 E A."""
    gravity = _STRAIN * 2 * stretching(body) / (weight(body) * LENGTH)
    return (tip(at_rest(held_world(body, (gravity, 0.0, 0.0))))[0] / LENGTH - 1) / _STRAIN


def swing(body: ThinBody, periods: float) -> tuple[Float[Array, " T"], float, float]:
    """Height of the end [m] over so many periods after it is let go without weight, the step [s], and the frequency of a beam with the
    body's bending stiffness, 1.8751^2 sqrt(E I / m L^4) / 2 pi [1/s]."""
    import mujoco

    gravity = _SMALL * 8 * body.bending_stiffness / (weight(body) * LENGTH**3)
    world = at_rest(held_world(body, (0.0, 0.0, -gravity)))
    world.model.opt.gravity[:] = 0
    expected = 1.875104**2 * math.sqrt(body.bending_stiffness / weight(body) / LENGTH**4) / (2 * math.pi)
    height = []
    for _ in range(int(periods / expected / world.timestep)):
        mujoco.mj_step(world.model, world.data)
        height.append(tip(world)[2])
    return np.array(height), world.timestep, expected


def frequency(body: ThinBody) -> float:
    """First bending frequency, over a beam's."""
    height, timestep, expected = swing(body, 3.4)
    before = np.flatnonzero(height[:-1] * height[1:] < 0)
    crossing = before + height[before] / (height[before] - height[before + 1])
    return (len(crossing) - 1) / 2 / ((crossing[-1] - crossing[0]) * timestep) / expected


def damping_ratio(body: ThinBody, periods: int = 12) -> float:
    """Of the first bending mode: how the oscillation of its frequency shrinks from the first third to the last."""
    height, timestep, expected = swing(body, periods)
    third = len(height) // 3
    turn = 2j * math.pi * expected * frequency(body) * timestep
    first, last = (np.abs(part @ np.exp(-turn * np.arange(third))) for part in (height[:third], height[-third:]))
    return float(np.log(first / last) / (turn.imag * (len(height) - third)))


def torsion(body: Rope, torque: float = 1e-3) -> float:
    """Angle of the free end under a torque [N m], over T L / G J; half a segment is beyond the last segment's middle."""
    import mujoco

    world = held_world(body, (0.0, 0.0, 0.0))
    joint = world.model.joint(twist_joint(world.mesh, len(world.mesh.elements) - 1))
    world.data.qfrc_applied[joint.dofadr] = torque
    world.model.dof_damping[joint.dofadr[0]] = 0
    length = LENGTH - world.mesh.spacing / 2
    hinges = np.array(
        [world.model.joint(twist_joint(world.mesh, s)).dofadr[0] for s in range(len(world.mesh.elements))]
    )
    energy = 0.0
    for _ in range(int(0.5 / world.timestep)):
        mujoco.mj_step(world.model, world.data)
        now = float((world.data.qvel[hinges] ** 2).sum())
        if now < energy:
            world.data.qvel[:] = now = 0.0
        energy = now
    return float(world.data.qpos[joint.qposadr][0]) / (torque * length / body.twisting_stiffness)


NARROW, WIDE = LENGTH / 2, 2 * LENGTH
"""Of strips [m]. A wide one bends in a cylinder, but for its free edges; how a narrow one curves across is in `plate`."""

Measures = dict[str, Callable[[float], float]]

OF_CLOTH: Measures = {
    "sag under a small load (plate)": lambda h: small_sag(strip(h, NARROW)) / plate(NARROW)[0],
    "place of the end under own weight (heavy elastica)": lambda h: large_sag(strip(h, WIDE), LENGTH),
    "stretch under a load along it, Poisson's ratio 0": lambda h: own_stretch(
        replace(strip(h, NARROW), poissons_ratio=0.0)
    ),
    "first bending frequency (plate)": lambda h: frequency(strip(h, NARROW)) / plate(NARROW)[1],
}
OF_ROPE: Measures = {
    "sag under a small load (beam)": lambda h: small_sag(rope(h)),
    "place of the end under own weight, 0.3 m (heavy elastica)": lambda h: large_sag(rope(h, 3 * LENGTH), 3 * LENGTH),
    "stretch under a load along it": lambda h: own_stretch(rope(h)),
    "first bending frequency (beam)": lambda h: frequency(rope(h)),
    "twist under a torque": lambda h: torsion(rope(h)),
}
"""What is measured over its closed form, for a spacing [m]."""

SPACINGS = {"cloth": (0.02, 0.0125, CLOTH.spacing), "rope": (0.02, 0.01, ROPE.spacing)}
"""[m]; the last ones are the captures'."""


def _print(title: str, measures: Measures, spacings: tuple[float, ...]) -> None:
    print(f"| {title} | " + " | ".join(f"{1e3 * h:g} mm" for h in spacings) + " |")
    print("|---|" + "--:|" * len(spacings))
    for name, measure in measures.items():
        print(f"| {name} | " + " | ".join(f"{100 * (measure(h) - 1):+.2f} %" for h in spacings) + " |", flush=True)
    print()


def moved(scene: RigScene, every: int = 1, share: float = 1.0) -> tuple[float, float]:
    """How far the nodes move with elements 1 / `every` as long (of a rope) and a `share` of the step: mean, and mean of the worst
    frame [m]."""
    finer = replace(scene, body=replace(scene.body, spacing=scene.body.spacing / every))
    before, after = run(scene).middle.vertices, run(finer, share).middle.vertices[:, ::every]
    by_frame = np.linalg.norm(before - after, axis=-1).mean(axis=1)
    return float(by_frame.mean()), float(by_frame.max())


def moved_by_mesh(scene: RigScene, spacing: float) -> tuple[float, float]:
    """The same of a cloth with elements of another spacing [m], at the places of the scene's own nodes."""
    from scipy.spatial import Delaunay

    own, other = (run(each).middle for each in (scene, replace(scene, body=replace(scene.body, spacing=spacing))))
    cells = Delaunay(other.rest[:, :2])
    inwards = 1 - 1e-6  # nodes on the rim lie in a triangle, too
    places = own.rest[:, :2].mean(axis=0) + inwards * (own.rest[:, :2] - own.rest[:, :2].mean(axis=0))
    cell = cells.find_simplex(places)
    shares = np.einsum("nij,nj->ni", cells.transform[cell, :2], places - cells.transform[cell, 2])
    shares = np.c_[shares, 1 - shares.sum(axis=1)]
    there = (other.vertices[:, cells.simplices[cell]] * shares[..., None]).sum(axis=2)
    by_frame = np.linalg.norm(there - own.vertices, axis=-1)[:, cell >= 0].mean(axis=1)
    return float(by_frame.mean()), float(by_frame.max())


def _print_scenes() -> None:
    lift, cloth, corner = (THIN_SCENES[name]() for name in ("rope_lift", "cloth_lift", "corner_lift"))
    coarse = replace(cloth, body=replace(cloth.body, spacing=0.0125))
    print("| | mean | worst frame |\n|---|--:|--:|")
    cases = {
        "`rope_lift`, half the time step": lambda: moved(lift, share=0.5),
        "`rope_lift`, segments of half the length": lambda: moved(lift, every=2),
        "`cloth_lift` in elements of 12.5 mm, half the time step": lambda: moved(coarse, share=0.5),
        "`cloth_lift`, elements of 6 mm in place of 8": lambda: moved_by_mesh(cloth, 0.006),
        "`corner_lift`, half the time step": lambda: moved(corner, share=0.5),
        "`corner_lift`, elements of 6 mm in place of 8": lambda: moved_by_mesh(corner, 0.006),
    }
    for name, measure in cases.items():
        print(f"| {name} | " + " | ".join(f"{1e3 * way:.2f} mm" for way in measure()) + " |", flush=True)


if __name__ == "__main__":
    if "--scenes" in sys.argv[1:]:
        _print_scenes()
        sys.exit()
    _print("cloth", OF_CLOTH, SPACINGS["cloth"])
    _print("rope", OF_ROPE, SPACINGS["rope"])
    for name, body in {"cloth": strip(0.0125, NARROW), "rope": rope(0.01)}.items():
        print(f"{name}: a swing decays by {100 * damping_ratio(body):.3f} % of critical, without damping", flush=True)
