"""A chain of masses on springs hung from a hand that shakes it: truth with a force in it, simulation without; by scipy."""

from functools import cache

import numpy as np
from scipy.integrate import solve_ivp

from physreal_core.gap.lead.departure import Departure
from physreal_core.gap.lead.responses import Responses

FPS, FRAMES, MASSES, TRACKS, SIGMA, TRAIN = 30.0, 60, 6, 90, 0.001, 42
GRAVITY = np.array([0.0, 0.0, -9.81])
_STIFFNESS = 900.0  # 1/s2, of each spring; the first mass hangs from the hand
_K = _STIFFNESS * (2 * np.eye(MASSES) - np.eye(MASSES, k=1) - np.eye(MASSES, k=-1))
_K[-1, -1] = _STIFFNESS
_REST = np.stack([0.04 * np.arange(1, MASSES + 1), np.zeros(MASSES), np.zeros(MASSES)], -1)
_SAG = np.linalg.solve(_K, np.tile(GRAVITY, (MASSES, 1)))


def hand(t, direction):
    """Displacement of the hand [m]: two seconds of a growing and dying shake."""
    return 0.05 * np.sin(8 * t) * np.sin(np.pi * t / 2.0) * np.asarray(direction)


def simulate(force, direction=(0.0, 1.0, 0.5)):
    """Masses' positions [T, M, 3] m under gravity, the hand and `force(x, v, t)` [m/s2], from rest."""

    def rate(t, state):
        x, v = state.reshape(2, MASSES, 3)
        pull = np.zeros((MASSES, 3))
        pull[0] = _STIFFNESS * hand(t, direction)
        return np.concatenate([v, GRAVITY + pull - _K @ (x - _REST) + force(x, v, t)]).ravel()

    start = np.concatenate([_REST + _SAG, np.zeros((MASSES, 3))]).ravel()
    times = np.arange(FRAMES) / FPS
    found = solve_ivp(rate, (0, times[-1]), start, t_eval=times, rtol=1e-8, atol=1e-10)
    return found.y.T.reshape(FRAMES, 2, MASSES, 3)[:, 0]


def weights():
    """Share of each mass in tracks spread along the chain, shape [J, M]."""
    along = np.linspace(0.0, MASSES - 1.0, TRACKS)
    return np.maximum(0.0, 1.0 - np.abs(along[:, None] - np.arange(MASSES)[None]))


@cache
def responses():
    """Step responses of the tracks."""
    quiet = simulate(lambda x, v, t: 0.0, (0.0, 0.0, 0.0))
    step = np.stack([
        [simulate(lambda x, v, t, m=m, a=a: np.eye(MASSES)[m][:, None] * np.eye(3)[a], (0.0,) * 3) - quiet for a in range(3)]
        for m in range(MASSES)
    ])  # fmt: skip
    return Responses(np.einsum("jr,matrc->matjc", weights(), step))


def departure(force, seed=0, direction=(0.0, 1.0, 0.5)):
    """What is measured with the force and simulated without, a third missing; the later frames held out."""
    rng = np.random.default_rng(seed)
    truth, simulated = (
        np.einsum("jr,trc->tjc", weights(), simulate(f, direction)) for f in (force, lambda x, v, t: 0.0)
    )
    valid = rng.random(truth.shape[:2]) > 0.3
    measured = np.where(valid[..., None], truth + SIGMA * rng.standard_normal(truth.shape), np.nan)
    early = valid & (np.arange(FRAMES) < TRAIN)[:, None]
    return Departure(simulated, measured, valid, FPS, responses(), weights(), _whiten(early), _whiten(valid & ~early))


def _whiten(entries):
    return lambda fields: fields[:, entries].reshape(len(fields), -1).T / SIGMA
