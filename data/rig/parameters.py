"""From the `rig` block of params.yaml to a scene."""

from dataclasses import replace

from data.rig.bars import BARS
from data.rig.rig_scene import SCENES, Material, Noise, RigScene
from physreal_core.errors import InputError
from pipeline.config.rig import Rig

__all__ = ["Rig", "build_scene"]


def build_scene(name: str, parameters: Rig) -> RigScene:
    """The scene `name` with the material, camera size and noise of `parameters`.

    Raises:
        InputError: no such scene.
    """
    if name not in SCENES:
        raise InputError(
            f"no scene named {name!r}",
            where="rig",
            expected=f"one of {sorted([*SCENES, *BARS])}",
            remedy="name another in params.yaml or add one to data/rig/scene.py",
        )
    scene, p = SCENES[name](), parameters
    shrink = p.width / scene.view.width
    return replace(
        scene,
        material=Material(p.youngs_modulus, p.poissons_ratio, p.density, p.damping, p.friction_coefficient),
        view=replace(scene.view, width=p.width, height=p.height, focal=scene.view.focal * shrink),
        noise=Noise(p.colour_noise, p.depth_noise_base, p.depth_noise_slope, p.depth_holes),
        mesh_spacing=p.mesh_spacing,
        frames=p.frames,
        observed=p.observed,
        fps=p.fps,
    )
