"""Twins of plain bodies that no hand holds, as the exports to other simulators are tested on."""

import dataclasses

import numpy as np
import torch

from applications.twin import Twin
from physreal_core.fitting.thin import bind_to_body
from physreal_core.geometry.mesh import Mesh
from physreal_core.simulation import Body, Clamp, rod_body, shell_body
from tests.fitting import scene

DENSITY, MODULUS, POISSON = 300.0, 3e4, 0.3


def clamped_bar(*effects) -> Twin:
    """160 x 40 x 40 mm, 40 mm of which are clamped; no table."""
    h = 0.01
    x0 = h * (np.stack(np.meshgrid(*map(np.arange, (16, 4, 4)), indexing="ij"), -1).reshape(-1, 3) + 0.5)
    body = Body(x0, np.full(len(x0), h**3), np.full(len(x0), DENSITY), h)
    import trimesh

    box = trimesh.creation.box(bounds=[[0, 0, 0], [0.16, 0.04, 0.04]]).subdivide().subdivide()
    return of_body(
        body, Mesh(np.array(box.vertices), np.array(box.faces)), effects, clamps=(Clamp((-1, -1, -1), (0.04, 1, 1)),)
    )


def of_body(body: Body, mesh: Mesh, effects=(), **problem) -> Twin:
    """A twin of one material that no hand holds, without a table."""
    model = scene.model(1, youngs_modulus=MODULUS)
    model = dataclasses.replace(model, effects=list(effects), simulation={**model.simulation, "ground_height": None})
    one = len(body.x0), 1
    near = {"patch_neighbours": torch.zeros(one, dtype=torch.long), "patch_weights": torch.ones(one).double()}
    given = scene.problem(scene.model(), with_masks=False)
    given = dataclasses.replace(
        given, body=body, grip=None, controllers=torch.zeros(40, 0, 3, dtype=torch.float64), **near, **problem
    )
    return Twin("bar", "fit_patches", given, model, None, mesh, bind_to_body(mesh.vertices, body), None, None, None)


def strip(kind: str, thickness: float, modulus: float = MODULUS) -> Twin:
    """A rope or a cloth of 120 mm, level, 40 mm of which are clamped."""
    along = np.linspace(0, 0.12, 25)
    if kind == "rope":
        body = rod_body(np.stack([along, 0 * along, 0 * along], 1), thickness / 2, DENSITY)
    else:
        u, v = np.meshgrid(along, np.linspace(0, 0.02, 5), indexing="ij")
        number = np.arange(125).reshape(25, 5)
        a, b, c, d = (part.ravel() for part in (number[:-1, :-1], number[1:, :-1], number[1:, 1:], number[:-1, 1:]))
        triangles = np.concatenate([np.stack([a, b, c], 1), np.stack([a, c, d], 1)])
        points = np.stack([u.ravel(), v.ravel(), 0 * u.ravel()], 1)
        body = shell_body(points, triangles, thickness, DENSITY, stretch_limit=None)
    twin = of_body(body, Mesh(body.x0, np.array([[0, 1, 2]])), clamps=(Clamp((-1, -1, -1), (0.041, 1, 1)),))
    fields = {**twin.model.fields, "youngs_modulus": torch.tensor([modulus]).double()}
    return dataclasses.replace(twin, model=dataclasses.replace(twin.model, fields=fields))
