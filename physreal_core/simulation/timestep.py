"""Substeps per frame from elastic waves, viscosity, and the stiffness of forces, with the configured Courant number."""

import math
from dataclasses import replace

import torch

from physreal_core.array_types import Tensor
from physreal_core.errors import InputError
from physreal_core.simulation.body import Body
from physreal_core.simulation.config import SimulationConfig
from physreal_core.simulation.parameters import Parameters

LARGEST_COURANT = 0.85
"""Courant number of the elastic wave at which steps go unstable: with w its fastest grid mode, w dt = 2 there. Nearly
incompressible bodies do so earlier: a Poisson's ratio of 0.45 holds up to 0.65."""
FIBRE_STRETCH, STIFFENING_STRETCH, BRANCH_STRETCH = 1.2, 1.3, 1.2
"""Stretches up to which the stiffness of fibres, of stiffening and of Maxwell branches is counted."""
FASTEST = 5.0
"""Speed [m/s] up to which quadratic drag is counted."""
HARDEST, SLOW = 50.0, 5e-3
"""Acceleration [m/s2] with which a tool may push, and the speed [m/s] at which its friction holds (laws/tool.h)."""
MEMORY, LATE = 8, 0.05
"""Substeps over which viscosity may average the rate of deformation: so many is its stress late; or more of them, while
that is less than this share of a frame."""
SHARE_OF_ELASTIC = 0.7
"""Share of the elastic substep that a longer memory is to save."""

USUAL_SUBSTEPS = 1000
"""Substeps of a frame up to which nothing is said: twenty times those of the example, whose fits would take a quarter of an
hour each."""
LARGEST_SUBSTEPS = 20_000
"""Substeps of a frame beyond which nothing is simulated. A particle at 0.1 m/s then moves by as much in a substep as its position
is rounded by in float32, and a rollout of a small body takes minutes."""
_USUAL = {"youngs_modulus": 1e6, "poissons_ratio": 0.3, "density": 300.0, "cell": 0.016, "fps": 30.0, "courant": 0.6}
"""Values beside which a parameter is said to be the cause of short substeps."""


def elastic_step(body: Body, config: SimulationConfig, parameters: Parameters) -> float:
    """Courant number times the time in which the fastest elastic wave crosses a cell [s].

    Of a thin body that share of the longest stable step of its elements, where a volume's is at LARGEST_COURANT. Contact of the body with
    itself adds its own frequency, in squares.
    The speed is sqrt((lambda + 2 mu) / rho), in a body that starts stretched as many times that as its largest stretch;
    neural residuals may add their bounded share to the stress, fibres, stiffening and Maxwell branches their tangent modulus
    at a moderate stretch.
    """
    if body.elements is not None:
        return _thin_step(body, config, replace(parameters, viscosity=None))[0]
    squared_speed = _stiffness(config, parameters) / _density(body, parameters)
    if parameters.initial_deformation is not None:
        stretch = torch.linalg.matrix_norm(parameters.initial_deformation.detach().double(), ord=2)
        squared_speed = squared_speed * stretch**2
    step = config.courant * body.cell / math.sqrt(float(squared_speed.max()))
    if not config.self_contact:
        return step
    safety = config.courant / LARGEST_COURANT
    mass = torch.as_tensor(body.volume, device=parameters.youngs_modulus.device) * _density(body, parameters)
    on_contact = body.surface.squared_frequency(parameters.youngs_modulus, mass)
    return 2.0 * safety / math.sqrt((2.0 * safety / step) ** 2 + on_contact)


def viscous_step(body: Body, config: SimulationConfig, parameters: Parameters) -> float:
    """Substep [s] of elastic and viscous stresses together, the elastic one without viscosity.

    With a rate of deformation averaged over n substeps (`rate_memory`), a mode of frequency w that decays with g is stable
    while
        (w dt)^2 + 2 g dt / (2 n + 1) < 4
    (at the limit its amplification is -1). Of the fastest grid mode w dt = 2 at LARGEST_COURANT.
    """
    if parameters.viscosity is None:
        return elastic_step(body, config, parameters)
    elastic, decay = _step_and_decay(body, config, parameters)
    decay = decay / (2 * _memory(config, elastic, decay) + 1)
    safety = config.courant / LARGEST_COURANT
    frequency = 2.0 * safety / elastic
    # dt of (w dt)^2 + 2 g dt = 4 safety^2, in a form without a difference
    return 4.0 * safety**2 / (decay + math.sqrt(decay**2 + (2.0 * safety * frequency) ** 2))


def rate_memory(body: Body, config: SimulationConfig, parameters: Parameters) -> int:
    """Substeps n over which viscosity averages the rate of deformation, a shell's the velocities, with weights that fade as (n / (n + 1))^k.

    Steps of an explicit viscous stress must be short, as dx^2; the average makes them 2 n + 1 times longer. n is the
    smallest that leaves the substep SHARE_OF_ELASTIC of the elastic one, as far as MEMORY and LATE allow it.
    """
    return 0 if parameters.viscosity is None else _memory(config, *_step_and_decay(body, config, parameters))


def _memory(config: SimulationConfig, elastic: float, decay: float) -> int:
    """The same with the elastic substep [s] and the fastest decay [1/s]."""
    squared_safety = (config.courant / LARGEST_COURANT) ** 2
    step = SHARE_OF_ELASTIC * elastic
    needed = 2.0 * decay * step / (4.0 * (1.0 - SHARE_OF_ELASTIC**2) * squared_safety)  # 2 n + 1
    # n dt <= LATE / fps with the viscous dt = 2 safety^2 (2 n + 1) / g, which the elastic stress only shortens
    allowed = (math.sqrt(1.0 + 4.0 * LATE / config.fps * decay / squared_safety) - 1.0) / 4.0
    return min(max(MEMORY, int(allowed)), max(0, math.ceil((needed - 1.0) / 2.0)))


def _step_and_decay(body: Body, config: SimulationConfig, parameters: Parameters) -> tuple[float, float]:
    """The elastic substep [s] and the decay rate of the fastest mode under viscosity [1/s]: of a volume's grid
    (w / c)^2 (2 mu_v + lambda_v) / rho."""
    if body.elements is not None:
        return _thin_step(body, config, parameters)
    shear, bulk = parameters.viscosity.detach().double().abs().unbind(-1)
    diffusivity = float(((2.0 * shear + bulk) / _density(body, parameters)).max())
    return elastic_step(body, config, parameters), (2.0 / (LARGEST_COURANT * body.cell)) ** 2 * diffusivity


def _thin_step(body: Body, config: SimulationConfig, parameters: Parameters) -> tuple[float, float]:
    """Of a thin body."""
    mass = torch.as_tensor(body.volume, device=parameters.youngs_modulus.device) * _density(body, parameters)
    squared, decay = body.elements.fastest(parameters, mass)
    if config.elastic_residual is not None:
        squared *= 1.0 + config.elastic_residual.beta_elastic
    if config.self_contact:
        squared += body.surface.squared_frequency(parameters.youngs_modulus, mass)
    return 2.0 * config.courant / LARGEST_COURANT / math.sqrt(squared), decay


def _density(body: Body, parameters: Parameters) -> Tensor:
    """Densities of the particles [kg/m3], of one rollout or of many."""
    if parameters.density is not None:
        return parameters.density.detach().double()
    return torch.as_tensor(body.density, device=parameters.youngs_modulus.device)


def _stiffness(config: SimulationConfig, parameters: Parameters) -> Tensor:
    """Largest tangent modulus of every particle's stress [Pa], of one rollout or of many."""
    E, nu = parameters.youngs_modulus.detach().double(), parameters.poissons_ratio.detach().double()
    share = 1.0 if config.elastic_residual is None else 1.0 + config.residual.beta_elastic
    modulus = share * E * (1 - nu) / ((1 + nu) * (1 - 2 * nu))
    if parameters.fibre_modulus is not None:
        square = FIBRE_STRETCH**2
        modulus = modulus + (2.0 * square - 1.0) * square * parameters.fibre_modulus.detach().double().clamp(min=0.0)
    if parameters.stiffening is not None:
        # of an isochoric stretch: d tau / d log(stretch) = 4 c (I1' dev + (I1 - 3) dev')
        square, across = STIFFENING_STRETCH**2, 1.0 / STIFFENING_STRETCH
        excess, deviator = square + 2.0 * across - 3.0, 2.0 / 3.0 * (square - across)
        tangent = 2.0 * (square - across) * deviator + excess * 2.0 / 3.0 * (2.0 * square + across)
        modulus = modulus + 4.0 * tangent * parameters.stiffening.detach().double().clamp(min=0.0)
    # of a branch too fast to relax, m dev(b): d tau / d log(stretch) = 2/3 m (2 stretch^2 + 1 / stretch), and a strain
    # along one axis is two thirds of a stretch without change of volume; 4/3 m where nothing is stretched
    branch = 4.0 / 9.0 * (2.0 * BRANCH_STRETCH**2 + 1.0 / BRANCH_STRETCH)
    if parameters.relaxation_modulus is not None:
        modulus = modulus + branch * parameters.relaxation_modulus.detach().double().clamp(min=0.0)
    if parameters.hysteresis_modulus is not None:
        modulus = modulus + branch * parameters.hysteresis_modulus.detach().double().clamp(min=0.0).sum(-1)
    return modulus


def force_step(body: Body, config: SimulationConfig, parameters: Parameters) -> float:
    """Courant number times 2 / (omega + gamma) of a particle's fastest motion under drag, adhesion, an obstacle, a tool and solids [s]."""
    mass = torch.as_tensor(body.volume, device=parameters.youngs_modulus.device) * _density(body, parameters)
    stiffness, damping = torch.zeros_like(mass), torch.zeros_like(mass)
    for drag, slope in ((parameters.linear_drag, 1.0), (parameters.quadratic_drag, 2.0 * FASTEST)):
        if drag is not None:
            damping = damping + slope * drag.detach().double().abs() / mass
    if parameters.surface_drag is not None:
        area = torch.as_tensor(body.elements.drag_area, device=mass.device)
        damping = damping + 2.0 * FASTEST * area * parameters.surface_drag.detach().double() / mass
    if parameters.adhesion is not None:
        slope = math.e * parameters.adhesion.abs() / parameters.adhesion_range[..., None]
        stiffness = stiffness + slope.detach().double() / mass
    if parameters.obstacle is not None:
        stiffness = stiffness + parameters.obstacle.detach().double()[..., 7:].clamp(min=0.0)
    for push, friction in (
        (parameters.tool_stiffness, parameters.tool_friction),
        (parameters.solid_stiffness, parameters.solid_friction),
    ):
        if push is not None:
            stiffness = stiffness + push.detach().double()[..., None]
            damping = damping + friction.detach().double()[..., None] * HARDEST / SLOW
    rate = float((stiffness.sqrt() + damping).max())
    return config.courant * 2.0 / rate if rate > 0 else math.inf


def needed_substeps(body: Body, config: SimulationConfig, parameters: Parameters) -> float:
    """Substeps that a frame takes, of many rollouts the largest number, before it is rounded up; however many these are."""
    step = min(viscous_step(body, config, parameters), force_step(body, config, parameters))
    return 1.0 / (config.fps * step) if step > 0.0 else math.inf


def substeps_per_frame(body: Body, config: SimulationConfig, parameters: Parameters) -> int:
    """Number of equal substeps of a frame, of many rollouts the largest; not differentiated. A grip asks for none
    (`grip_inertia`).

    Raises:
        InputError: more than LARGEST_SUBSTEPS, naming the parameter that causes it.
    """
    count = needed_substeps(body, config, parameters)
    if not count <= LARGEST_SUBSTEPS:
        speed = config.courant * body.cell / max(elastic_step(body, config, parameters), 1e-300)
        raise InputError(
            f"{count:.3g} substeps a frame (waves of {speed:.3g} m/s in cells of {1e3 * body.cell:.3g} mm,"
            f" frames of {1e3 / config.fps:.3g} ms)",
            where="the simulator's time step",
            expected=f"at most {LARGEST_SUBSTEPS}",
            remedy=_remedy(body, config, parameters),
        )
    return max(1, math.ceil(count))


def _remedy(body: Body, config: SimulationConfig, parameters: Parameters) -> str:
    """What to change: the parameter that shortens the substep most, beside its usual value."""
    elastic = elastic_step(body, config, parameters)
    if force_step(body, config, parameters) < elastic:
        return "weaken the drag, adhesion or obstacle that acts on the particles"
    if viscous_step(body, config, parameters) < 0.5 * elastic:
        return "lower the viscosity"
    E, nu = float(parameters.youngs_modulus.max()), float(parameters.poissons_ratio.max())
    density = float(_density(body, parameters).min())
    modulus = lambda nu: (1 - nu) / ((1 + nu) * (1 - 2 * nu))
    stress = float(_stiffness(config, parameters).max()) / (E * modulus(nu))
    causes = {
        f"lower youngs_modulus, which is {E:.3g} Pa (in a fit, its bound `upper` in params.yaml)": (
            E / _USUAL["youngs_modulus"]
        )
        ** 0.5,
        f"lower poissons_ratio, which is {nu:.6g} (in a fit, its bound `upper` in params.yaml)": (
            modulus(nu) / modulus(_USUAL["poissons_ratio"])
        )
        ** 0.5,
        f"raise the density, which is {density:.3g} kg/m3 (density in capture.json, or sample_particles.density)": (
            _USUAL["density"] / density
        )
        ** 0.5,
        f"raise the particles' spacing, which is {body.spacing:.3g} m (sample_particles.spacing)": (
            _USUAL["cell"] / body.cell
        ),
        f"check fps, which is {config.fps:.3g} (fps in capture.json)": _USUAL["fps"] / config.fps,
        f"raise courant, which is {config.courant:.3g} (simulation.courant)": _USUAL["courant"] / config.courant,
        "lower the fibres' modulus, the stiffening or that of Maxwell branches": stress**0.5,
    }
    return max(causes, key=causes.get)
