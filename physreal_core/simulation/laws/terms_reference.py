"""Plain torch twins of the optional terms' laws (`terms.TERMS`): what tests hold the kernels to, and what a notebook plots.

Forces [N] act on particles; stresses are Kirchhoff's [Pa], added to the expert law's; friction acts on ground nodes.
Every function takes any leading axes and is differentiable in all of its arguments.
"""

import torch

from physreal_core.array_types import Float, Tensor

OBSTACLE_SOFTENING = 1e-6
"""Length [m] below which an obstacle's middle has no outward direction."""
SLOPE_SOFTENING = 1e-6
"""Slope of the distance from solids below which they have no outward direction."""
SLOW = 5e-3
"""Speed [m/s] of which a share is left where the friction of solids holds."""


def drag(v: Float[Tensor, "... 3"], linear: Tensor, quadratic: Tensor) -> Float[Tensor, "... 3"]:
    """-(c1 + c2 |v|) v, Stokes' and Newton's drag.

    Args:
        v: velocity [m/s].
        linear, quadratic: c1 [N s/m] and c2 [N s2/m2].
    """
    speed = torch.linalg.vector_norm(v, dim=-1)
    return -(linear + quadratic * speed)[..., None] * v


def adhesion(height: Float[Tensor, "..."], peak: Tensor, reach: Tensor) -> Float[Tensor, "... 3"]:
    """Pull towards the ground -a e (u / d) exp(-u / d) along z, for u > 0.

    Normal traction of a cohesive zone: Xu and Needleman, "Void nucleation by inclusion debonding in a crystal matrix",
    Modelling Simul. Mater. Sci. Eng. 1(2), 1993. The largest pull, a, is at u = d; the work of separation is e a d.

    Args:
        height: u, above where the particle started [m].
        peak: a [N].
        reach: d [m].
    """
    u = (height / reach).clamp(min=0.0)
    pull = peak * u * (1.0 - u).exp()
    return torch.stack([torch.zeros_like(pull), torch.zeros_like(pull), -pull], -1)


def obstacle(x: Float[Tensor, "... 3"], mass: Tensor, capsule: Float[Tensor, "8"]) -> Float[Tensor, "... 3"]:
    """Penalty m k max(0, -phi) grad phi of a capsule's signed distance phi; smooth walls, no friction.

    Args:
        x: position [m].
        mass: m [kg].
        capsule: centre [m], half axis [m] (zero for a ball), radius [m], stiffness k [1/s2].
    """
    centre, axis, radius, stiffness = capsule[:3], capsule[3:6], capsule[6], capsule[7]
    square = axis @ axis
    arm = x - centre
    along = ((arm @ axis) / square).clamp(-1.0, 1.0) if square > 0 else torch.zeros_like(arm[..., 0])
    out = arm - along[..., None] * axis
    length = (out.square().sum(-1) + OBSTACLE_SOFTENING**2).sqrt()
    depth = (radius - length).clamp(min=0.0)
    return (mass * stiffness * depth / length)[..., None] * out


def solids(
    distance: Tensor,
    x: Float[Tensor, "... 3"],
    v: Float[Tensor, "... 3"],
    mass: Tensor,
    reach: Tensor,
    stiffness: Tensor,
    friction: Tensor,
) -> Float[Tensor, "... 3"]:
    """Penalty of a signed distance phi and Coulomb's friction: with g = grad phi, n = g / |g| and the depth d = reach - phi > 0,
    m k d g - mu N u / sqrt(|u|^2 + slow^2), N = m k d |g| and u = v - (v . n) n.

    Args:
        distance: phi at x [m], a function of it that autograd knows.
        x, v: place [m] and velocity [m/s]; x requires a gradient.
        mass: m [kg].
        reach: how far from the surface a particle is pushed [m].
        stiffness: k [1/s2].
        friction: mu.
    """
    (g,) = torch.autograd.grad(distance.sum(), x, create_graph=True)
    depth = (reach - distance).clamp(min=0.0)
    steep = (g.square().sum(-1) + SLOPE_SOFTENING**2).sqrt()
    n = g / steep[..., None]
    u = v - (v * n).sum(-1, keepdim=True) * n
    rubbing = friction * steep / (u.square().sum(-1) + SLOW**2).sqrt()
    return (mass * stiffness * depth)[..., None] * (g - rubbing[..., None] * u)


def viscosity(
    F: Float[Tensor, "... 3 3"], rate: Float[Tensor, "... 3 3"], coefficients: Float[Tensor, "... 2"]
) -> Float[Tensor, "... 3 3"]:
    """J (2 mu_v D + lambda_v tr(D) 1): a Newtonian fluid beside the elastic law, together a Kelvin-Voigt solid.

    Args:
        F: deformation gradient.
        rate: symmetric rate of deformation D [1/s].
        coefficients: mu_v and lambda_v [Pa s].
    """
    shear, bulk = (coefficients[..., i, None, None] for i in (0, 1))
    trace = rate.diagonal(dim1=-2, dim2=-1).sum(-1)[..., None, None]
    J = torch.linalg.det(F)[..., None, None]
    return J * (2.0 * shear * rate + bulk * trace * torch.eye(3, dtype=F.dtype))


def stiffening(F: Float[Tensor, "... 3 3"], modulus: Tensor) -> Float[Tensor, "... 3 3"]:
    """Stress of the energy c (I1_bar - 3)^2 with I1_bar = J^(-2/3) |F|^2: 4 c (I1_bar - 3) J^(-2/3) dev(F F^T).

    The second term of Yeoh, "Some forms of the strain energy function for rubber", Rubber Chem. Technol. 66(5), 1993.

    Args:
        F: deformation gradient.
        modulus: c [Pa].
    """
    b = torch.linalg.det(F)[..., None, None] ** (-2.0 / 3.0) * (F @ F.mT)
    I1 = b.diagonal(dim1=-2, dim2=-1).sum(-1)[..., None, None]
    return 4.0 * modulus[..., None, None] * (I1 - 3.0) * (b - I1 / 3.0 * torch.eye(3, dtype=F.dtype))


def fibres(F: Float[Tensor, "... 3 3"], modulus: Tensor, direction: Float[Tensor, "... 3"]) -> Float[Tensor, "... 3 3"]:
    """Stress of the energy k / 8 (|F a|^2 - 1)^2: k / 2 (|F a|^2 - 1) (F a) (F a)^T, in tension and compression.

    The standard reinforcing model with Green's strain along a: Holzapfel, "Nonlinear Solid Mechanics", 2000, ch. 6.7.

    Args:
        F: deformation gradient.
        modulus: k [Pa], what Young's modulus along a gains.
        direction: unit vector a of the undeformed body.
    """
    g = (F @ direction[..., None])[..., 0]
    stretch = (g * g).sum(-1) - 1.0
    return (0.5 * modulus * stretch)[..., None, None] * (g[..., :, None] * g[..., None, :])


def branch_step(A: Float[Tensor, "... 3 3"], step: Float[Tensor, "... 3 3"], kept: Tensor) -> Float[Tensor, "... 3 3"]:
    """The strain A = b - 1 of a Maxwell branch's spring after a substep: half relaxed, carried along, half relaxed.

    b' = L b + b L^T - (b - 1) / t with L the deviator of the velocity gradient, the relaxation of an upper-convected Maxwell
    fluid; b carried by J^(-1/3) (1 + s) as in Simo, "On a fully three-dimensional finite-strain viscoelastic damage model",
    CMAME 60(2), 1987. Strang splitting.

    Args:
        A: symmetric, zero where the branch is relaxed.
        step: s = dt grad v.
        kept: exp(-dt / 2 t), of half a substep.
    """
    one = torch.eye(3, dtype=A.dtype)
    f = torch.linalg.det(one + step)[..., None, None] ** (-1.0 / 3.0) * (one + step)
    return kept * (f @ (one + kept * A) @ f.mT - one)


def branches(A: Float[Tensor, "... branches 3 3"], modulus: Float[Tensor, "... branches"]) -> Float[Tensor, "... 3 3"]:
    """Sum of m dev(A) over Maxwell branches: of each the stress of the energy m/2 (tr b - 3 - log det b), b = 1 + A.

    Reese and Govindjee, "A theory of finite viscoelasticity and numerical aspects", Int. J. Solids Struct. 35, 1998: a spring
    on the part of the strain that has not relaxed; here without volume.

    Args:
        A: strain of each branch's spring.
        modulus: m, its shear modulus [Pa].
    """
    tau = (modulus[..., None, None] * A).sum(-3)
    trace = tau.diagonal(dim1=-2, dim2=-1).sum(-1)[..., None, None]
    return tau - trace / 3.0 * torch.eye(3, dtype=A.dtype)


def friction_coefficient(dynamic: Tensor, law: Float[Tensor, "3"], speed: Float[Tensor, "..."]) -> Float[Tensor, "..."]:
    """mu(s) = max(0, mu_f + excess exp(-s / static speed) + rate s): Coulomb's with a static peak and a slope.

    The exponential form of Bo and Pavelescu, "The friction-speed relation and its influence on the critical velocity of
    stick-slip motion", Wear 82(3), 1982, linear in s.

    Args:
        dynamic: mu_f.
        law: static excess, static speed [m/s], rate [s/m].
        speed: s, of sliding [m/s].
    """
    return (dynamic + law[0] * (-speed / law[1]).exp() + law[2] * speed).clamp(min=0.0)
