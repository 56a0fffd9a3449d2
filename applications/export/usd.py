"""The surface as USD with time samples (.usdc), in metres, z up, with the fitted material as attributes."""

from pathlib import Path

import numpy as np

from applications.export.moving import Moving
from physreal_core.fitting.model import UNITS

FILE = "motion.usdc"
_NAMESPACE = "physreal"


def write(moving: Moving, folder: Path) -> None:
    """`motion.usdc`: a mesh whose points have a sample a frame; means of the fitted fields under `physreal:`, each with its unit."""
    from pxr import Sdf, Usd, UsdGeom, Vt

    stage = Usd.Stage.CreateNew(str(folder / FILE))
    UsdGeom.SetStageUpAxis(stage, UsdGeom.Tokens.z)
    UsdGeom.SetStageMetersPerUnit(stage, 1.0)
    frames, mesh = len(moving.vertices), moving.twin.mesh
    stage.SetStartTimeCode(0)
    stage.SetEndTimeCode(frames - 1)
    stage.SetTimeCodesPerSecond(moving.fps)
    stage.SetFramesPerSecond(moving.fps)
    surface = UsdGeom.Mesh.Define(stage, "/twin")
    stage.SetDefaultPrim(surface.GetPrim())
    surface.CreateFaceVertexCountsAttr(Vt.IntArray.FromNumpy(np.full(len(mesh.faces), 3, np.int32)))
    surface.CreateFaceVertexIndicesAttr(Vt.IntArray.FromNumpy(mesh.faces.astype(np.int32).ravel()))
    surface.CreateSubdivisionSchemeAttr(UsdGeom.Tokens.none)
    points, extent = surface.CreatePointsAttr(), surface.CreateExtentAttr()
    for frame, now in enumerate(moving.vertices.astype(np.float32)):
        points.Set(Vt.Vec3fArray.FromNumpy(now), frame)
        extent.Set(Vt.Vec3fArray.FromNumpy(np.stack([now.min(0), now.max(0)])), frame)
    if mesh.colours is not None:
        colours = surface.CreateDisplayColorPrimvar(UsdGeom.Tokens.vertex)
        colours.Set(Vt.Vec3fArray.FromNumpy(mesh.colours.astype(np.float32)))
    for name, value, unit in _material(moving):
        attribute = surface.GetPrim().CreateAttribute(f"{_NAMESPACE}:{name}", Sdf.ValueTypeNames.Double)
        attribute.Set(value)
        attribute.SetDocumentation(unit)
    stage.GetRootLayer().Save()


def _material(moving: Moving) -> list[tuple[str, float, str]]:
    """Name, mean and unit of what the model knows of the material."""
    fields = moving.twin.model.fields
    plain = ("youngs_modulus", "poissons_ratio", "friction_coefficient")
    found = [(name, float(fields[name].mean()), UNITS[name]) for name in plain if name in fields]
    return [*found, ("density", moving.twin.density, "kg/m3")]
