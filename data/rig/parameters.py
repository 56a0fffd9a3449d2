"""From the `rig` block of params.yaml to a scene."""

from dataclasses import replace

from data.rig.bars import BARS
from data.rig.rig_scene import SCENES, Material, Noise, RigScene
from data.rig.thin_scenes import THIN_SCENES
from physreal_core.errors import InputError
from pipeline.config.rig import Rig

__all__ = ["Rig", "build_scene"]


def build_scene(name: str, parameters: Rig) -> RigScene:
    """The scene `name` with the camera size and noise of `parameters`, and with the material and mesh of a solid body.

    A thin body keeps its own material: `parameters` has none of its kind.

    Raises:
        InputError: no such scene.
    """
    scenes = SCENES | THIN_SCENES
    if name not in scenes:
        raise InputError(
            f"no scene named {name!r}",
            where="rig",
            expected=f"one of {sorted([*scenes, *BARS])}",
            remedy="name another in params.yaml or add one to data/rig/scene.py",
        )
    scene, p = scenes[name](), parameters
    shrink = p.width / scene.view.width
    filmed = replace(
        scene,
        view=replace(scene.view, width=p.width, height=p.height, focal=scene.view.focal * shrink),
        noise=Noise(p.colour_noise, p.depth_noise_base, p.depth_noise_slope, p.depth_holes),
        frames=p.frames,
        observed=p.observed,
        fps=p.fps,
    )
    if name in THIN_SCENES:
        return filmed
    material = Material(p.youngs_modulus, p.poissons_ratio, p.density, p.damping, p.friction_coefficient)
    return replace(filmed, material=material, mesh_spacing=p.mesh_spacing)
