"""The twin as a model for Newton: a deformable body in USD with the fitted material, a table, and a kinematic body that holds what the hand held.

The schema is that of deformable bodies which the Alliance for OpenUSD proposes and Newton 1.8 reads (`ModelBuilder.add_usd`); its names are not
yet in usd-core, so they are written as they stand.
"""

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from applications.export.body.hand import Hand
from applications.export.body.material import NEWTON, Material
from applications.export.body.nodes import Nodes
from applications.export.body.told import told
from applications.export.moving import Moving
from applications.twin import Twin
from physreal_core.array_types import Array, Float
from physreal_core.simulation import Tool

FILE = "twin.usda"
BODY, SIMULATED, HAND, CLAMP, MATERIAL = (
    "/World/twin",
    "/World/twin/sim",
    "/World/hand",
    "/World/clamp",
    "/World/material",
)
_TABLE = "/World/table"

_FAMILY = {1: "Curves", 2: "Surface", 3: "Volume"}
_SHEAR_OF_A_ROD = 0.9
"""Share of a round section that carries shear (Timoshenko)."""

_MASS = 0.1
"""Of the bodies that hold nodes [kg]; kinematic, so it moves nothing."""


def write(moving: Moving, folder: Path) -> list[str]:
    """`twin.usda`, the body as it lies in frame 0, and `hand.csv`, the way of the body `hand`; returns what the model does not hold.

    Raises:
        InputError: as of `tetrahedra`.
    """
    from pxr import Usd, UsdGeom

    twin = moving.twin
    material = Material.of(twin, NEWTON)
    nodes, hand = Nodes.of(twin, material.density), Hand.of(material.hand)
    sentences = [*told(nodes, material, hand), *_of_newton(nodes, material)]
    stage = Usd.Stage.CreateNew(str(folder / FILE))
    stage.SetMetadata("comment", "\n".join(sentences))
    UsdGeom.SetStageUpAxis(stage, UsdGeom.Tokens.z)
    UsdGeom.SetStageMetersPerUnit(stage, 1.0)
    stage.SetDefaultPrim(UsdGeom.Xform.Define(stage, "/World").GetPrim())
    _scene(stage, twin, material)
    _body(stage, nodes, material)
    if hand is not None:
        _kinematic(stage, HAND, hand.places[0])
        _hold(stage, "/World/hold", HAND, nodes, nodes.held & ~nodes.fixed, hand.places[0])
        if twin.problem.tool is not None:
            _tool(stage, twin.problem.tool, twin.problem.controllers[0].numpy() - hand.places[0])
        hand.save(folder, moving.fps)
    if nodes.fixed.any():
        _kinematic(stage, CLAMP, np.zeros(3))
        _hold(stage, "/World/fixed", CLAMP, nodes, nodes.fixed, np.zeros(3))
    stage.GetRootLayer().Save()
    return sentences


def _of_newton(nodes: Nodes, material: Material) -> list[str]:
    """What Newton's files cannot tell its solvers."""
    sentences = [
        f"Newton takes the friction of deformable bodies from `model.soft_contact_mu`: set {material.friction_coefficient:.3g}."
    ]
    if material.retardation > 0:
        sentences.append(
            f"The retardation time of {material.retardation:.3g} s is left out: the schema has no damping of a volume."
        )
    if np.ptp(material.density) > 1e-3 * material.density.mean():
        sentences.append(
            "The density has one value, which gives the body its mass; the twin's differs from place to place."
        )
    if nodes.dimension == 2:
        sentences.append(
            f"Newton 1.8 bends a cloth as if its triangles were 1 m high: multiply `edge_bending_properties` by {1 / _height(nodes):.0f}."
        )
    return sentences


def _height(nodes: Nodes) -> float:
    """Mean height of the triangles on either side of an edge [m]: a hinge as stiff, per length, as the sheet over that height bends like it."""
    corners = nodes.rest[nodes.parts[0]]
    sides = np.linalg.norm(np.roll(corners, -1, axis=1) - corners, axis=2)
    areas = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1) / 2
    return float((2 * areas[:, None] / sides).mean())


def _scene(stage: Any, twin: Twin, material: Material) -> None:
    """Gravity and the table."""
    from pxr import Gf, UsdGeom, UsdPhysics, UsdShade

    scene, size = UsdPhysics.Scene.Define(stage, "/World/scene"), float(np.linalg.norm(material.gravity))
    scene.CreateGravityMagnitudeAttr(size)
    scene.CreateGravityDirectionAttr(Gf.Vec3f(*map(float, material.gravity / max(size, 1e-12))))
    height = twin.model.simulation.get("ground_height")
    if height is None:
        return
    plane = UsdGeom.Plane.Define(stage, _TABLE)
    plane.CreateAxisAttr("Z")
    # The nodes of a solid lie on its surface; a thin body's lie within it, half its thickness above the table.
    plane.AddTranslateOp().Set(Gf.Vec3d(0, 0, float(height)))
    UsdPhysics.CollisionAPI.Apply(plane.GetPrim())
    rough = UsdShade.Material.Define(stage, f"{_TABLE}_material")
    contact = UsdPhysics.MaterialAPI.Apply(rough.GetPrim())
    contact.CreateDynamicFrictionAttr(material.friction_coefficient)
    contact.CreateStaticFrictionAttr(material.friction_coefficient)
    UsdShade.MaterialBindingAPI.Apply(plane.GetPrim()).Bind(rough, UsdShade.Tokens.weakerThanDescendants, "physics")


def _body(stage: Any, nodes: Nodes, material: Material) -> None:
    from pxr import Sdf, UsdGeom, UsdPhysics, UsdShade, Vt

    UsdGeom.Xform.Define(stage, BODY).GetPrim().AddAppliedSchema("PhysicsDeformableBodyAPI")
    family = _FAMILY[nodes.dimension]
    shape = {1: _curves, 2: _triangles, 3: _tetrahedra}[nodes.dimension](stage, nodes)
    shape.CreatePointsAttr(Vt.Vec3fArray.FromNumpy(nodes.start.astype(np.float32)))
    prim = shape.GetPrim()
    prim.AddAppliedSchema(f"Physics{family}DeformableSimAPI")
    UsdPhysics.CollisionAPI.Apply(prim)
    if np.abs(nodes.start - nodes.rest).max(initial=0.0) > 1e-9:
        rest = prim.CreateAttribute("physics:restShapePoints", Sdf.ValueTypeNames.Point3fArray, custom=False)
        rest.Set(Vt.Vec3fArray.FromNumpy(nodes.rest.astype(np.float32)))
    if nodes.dimension < 3:
        thick = prim.CreateAttribute("physics:thicknesses", Sdf.ValueTypeNames.FloatArray, custom=False)
        thick.Set([2 * nodes.radius])
        prim.CreateAttribute("physics:thicknesses:elementType", Sdf.ValueTypeNames.Token, custom=False).Set("constant")
    made = UsdShade.Material.Define(stage, MATERIAL)
    made.GetPrim().AddAppliedSchema(f"Physics{family}DeformableMaterialAPI")
    for name, value in stiffness(nodes, material).items():
        made.GetPrim().CreateAttribute(f"physics:{name}", Sdf.ValueTypeNames.Float, custom=False).Set(float(value))
    UsdShade.MaterialBindingAPI.Apply(prim).Bind(made, UsdShade.Tokens.weakerThanDescendants, "physics")


def stiffness(nodes: Nodes, material: Material) -> Mapping[str, float]:
    """What the schema asks of a material, by its names: a solid's moduli [Pa], a cloth's per width [N/m, N m], a rope's whole [N, N m2]."""
    E, nu = material.youngs_modulus, material.poissons_ratio
    density = {"density": nodes.mass.sum() / nodes.volume}
    if nodes.dimension == 3:
        return {"youngsModulus": E, "poissonsRatio": nu, **density}
    shear, r = E / (2 * (1 + nu)), nodes.radius
    if nodes.dimension == 2:
        h = 2 * r
        bending = material.bending_ratio * E * h**3 / (12 * (1 - nu**2))
        return {
            "surfaceStretchStiffness": E * h / (1 - nu**2),
            "surfaceShearStiffness": shear * h,
            "surfaceBendStiffness": bending,
            **density,
        }
    area = math.pi * r**2
    return {
        "curvesStretchStiffness": E * area,
        "curvesShearStiffness": _SHEAR_OF_A_ROD * shear * area,
        "curvesBendStiffness": material.bending_ratio * E * area * r**2 / 4,
        "curvesTwistStiffness": material.twisting_ratio * shear * area * r**2 / 2,
        **density,
    }


def _tetrahedra(stage: Any, nodes: Nodes) -> Any:
    from pxr import UsdGeom, Vt

    shape, tets = UsdGeom.TetMesh.Define(stage, SIMULATED), nodes.parts[0]
    shape.CreateTetVertexIndicesAttr(Vt.Vec4iArray.FromNumpy(tets.astype(np.int32)))
    faces = UsdGeom.TetMesh.ComputeSurfaceFaces(shape)
    shape.CreateSurfaceFaceVertexIndicesAttr(faces)
    return shape


def _triangles(stage: Any, nodes: Nodes) -> Any:
    from pxr import UsdGeom, Vt

    shape, triangles = UsdGeom.Mesh.Define(stage, SIMULATED), nodes.parts[0]
    shape.CreateFaceVertexCountsAttr(Vt.IntArray.FromNumpy(np.full(len(triangles), 3, np.int32)))
    shape.CreateFaceVertexIndicesAttr(Vt.IntArray.FromNumpy(triangles.astype(np.int32).ravel()))
    shape.CreateSubdivisionSchemeAttr(UsdGeom.Tokens.none)
    return shape


def _curves(stage: Any, nodes: Nodes) -> Any:
    """A curve for each rope; their nodes follow each other in the order of the parts."""
    from pxr import UsdGeom

    shape = UsdGeom.BasisCurves.Define(stage, SIMULATED)
    shape.CreateTypeAttr(UsdGeom.Tokens.linear)
    shape.CreateCurveVertexCountsAttr([len(part) + 1 for part in nodes.parts])
    shape.CreateWidthsAttr([2 * nodes.radius])
    shape.SetWidthsInterpolation(UsdGeom.Tokens.constant)
    return shape


def _kinematic(stage: Any, path: str, place: Float[Array, " 3"]) -> None:
    """A body that is led and not pushed, at a place [m]."""
    from pxr import Gf, UsdGeom, UsdPhysics

    body = UsdGeom.Xform.Define(stage, path)
    body.AddTranslateOp().Set(Gf.Vec3d(*map(float, place)))
    UsdPhysics.RigidBodyAPI.Apply(body.GetPrim()).CreateKinematicEnabledAttr(True)
    mass = UsdPhysics.MassAPI.Apply(body.GetPrim())
    mass.CreateMassAttr(_MASS)
    mass.CreateDiagonalInertiaAttr(Gf.Vec3f(*[_MASS * 1e-4] * 3))


def _hold(stage: Any, path: str, by: str, nodes: Nodes, which: Array, place: Float[Array, " 3"]) -> None:
    """Some nodes stay where they are in a body at a place [m]."""
    from pxr import Sdf, Vt

    numbers = np.flatnonzero(which)
    if not len(numbers):
        return
    prim = stage.DefinePrim(path, "PhysicsAttachment")
    for name, target in (("src0", SIMULATED), ("src1", by)):
        prim.CreateRelationship(f"physics:{name}", custom=False).SetTargets([Sdf.Path(target)])
    kinds, floats = Sdf.ValueTypeNames.Token, Sdf.ValueTypeNames.Vector3fArray
    prim.CreateAttribute("physics:type0", kinds, custom=False).Set("point")
    prim.CreateAttribute("physics:type1", kinds, custom=False).Set("xform")
    prim.CreateAttribute("physics:indices0", Sdf.ValueTypeNames.IntArray, custom=False).Set(numbers.tolist())
    local = (nodes.start[numbers] - place).astype(np.float32)
    prim.CreateAttribute("physics:coords1", floats, custom=False).Set(Vt.Vec3fArray.FromNumpy(local))


def _tool(stage: Any, tool: Tool, points: Float[Array, "C 3"]) -> None:
    """Balls and capsules of a hand that pushes, between its points [m]."""
    from pxr import Gf, UsdGeom, UsdPhysics

    for number, ((one, other), radius) in enumerate(zip(tool.ends, tool.radius, strict=True)):
        way, middle = points[other] - points[one], (points[other] + points[one]) / 2
        length = float(np.linalg.norm(way))
        shape = UsdGeom.Capsule.Define(stage, f"{HAND}/finger_{number}")
        shape.CreateRadiusAttr(float(radius))
        shape.CreateHeightAttr(length)
        shape.AddTranslateOp().Set(Gf.Vec3d(*map(float, middle)))
        if length > 0:
            turn = Gf.Rotation(Gf.Vec3d(0, 0, 1), Gf.Vec3d(*map(float, way))).GetQuat()
            shape.AddOrientOp().Set(Gf.Quatf(turn))
        UsdPhysics.CollisionAPI.Apply(shape.GetPrim())
