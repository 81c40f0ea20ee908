"""Dry friction."""

from __future__ import annotations

import numpy as np

from ..icp import ICP
from ..numerics.arrays import as_number
from ..problem.affine import Affine
from .registry import Quantity, Scene, register


@register
def coulomb(alpha: float = 30.0, mu: float = 0.3, mass: float = 1.0, g: float = 9.81, dt: float = 0.1) -> Scene:
    """A block on a slope with dry friction.

    One time step from rest of a block on a plane of slope α, which can slip downhill only. Unknowns are the impulses
    z = (λ_n, λ_t) of contact and friction; p = z/m + gΔt(−cos α, sin α) is the velocity off the plane and downhill;
    λ_n ≥ 0, and Coulomb's law bounds friction by the normal impulse: λ_t ≥ −μλ_n, so ψ(z) = (0, −μλ_n).
    λ_n = m g Δt cos α; the block slips iff tan α > μ, and then λ_t = −μλ_n, else λ_t = −m g Δt sin α (z is negative).
    Parameters: `alpha` in degrees, 0 ≤ α ≤ 89; `mu` ≥ 0 (no unit); `mass` in kg; `g` in m/s²; `dt` in s. z is in N s,
    p in m/s. Quantity: "slip speed" in m/s, exact.
    Reference: Acary and Brogliato, Numerical Methods for Nonsmooth Dynamical Systems (2008).
    """
    slope = np.deg2rad(as_number(alpha, "alpha", least=0, most=89))
    mu, mass = as_number(mu, "mu", least=0), as_number(mass, "mass", above=0)
    push = as_number(g, "g", above=0) * as_number(dt, "dt", above=0)
    sine, cosine = float(np.sin(slope)), float(np.cos(slope))
    normal = mass * push * cosine
    z = np.array([normal, -min(mass * push * sine, mu * normal)])
    problem = ICP(np.eye(2) / mass, push * np.array([-cosine, sine]), Affine([[0.0, 0.0], [-mu, 0.0]]))
    speed = Quantity(max(0.0, push * (sine - mu * cosine)), lambda z: float(problem.p(z)[1]), order=None)
    models = "Whether a block put on a slope stays or slips within one time step, and the impulses that decide it."
    return Scene(problem=problem, models=models, z_exact=z, quantities={"slip speed": speed})
