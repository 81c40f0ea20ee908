"""The reference numbers in the gallery, derived again from the equations that define them."""

import numpy as np
from scipy.integrate import quad, solve_ivp
from scipy.optimize import brentq, root

from icpmodel import scenes
from icpmodel.scenes import contact, equilibria, lubrication, nonlinear_forces
from icpmodel.scenes import impulse_control as control


def test_the_ball_touches_where_the_radial_equation_says():
    a = brentq(lambda a: a**2 * np.log(2 / a) - (1 - a**2), 0.5, 0.9, xtol=1e-15)
    level = contact.ball_solution(np.array([[1.0, 0.0]]))
    np.testing.assert_allclose(
        [contact.contact_radius(), *level], [a, a**2 / np.sqrt(1 - a**2) * np.log(2)], rtol=1e-13
    )


def test_the_obstacle_in_space_is_left_smoothly():
    a = contact.RADIUS_3D
    level = contact.obstacle_3d_solution(np.array([[0.0, 0.0, 1.0]])) - a
    np.testing.assert_allclose([a / a + level[0], -a / a**2], [1 - 2 * a**2, -4 * a], rtol=1e-15)


def test_the_bearing_solves_the_integrated_equation():
    # H^3 p' = H - H(theta_c) in the film, p = 0 at both its ends
    H = lambda t: 1 + 0.5 * np.cos(t)  # noqa: E731
    pressure = lambda end, c: quad(lambda t: (H(t) - H(c)) / H(t) ** 3, 0, end, epsabs=1e-12, epsrel=1e-12)[0]  # noqa: E731
    c = brentq(lambda c: pressure(c, c), 3.3, 4.5, xtol=1e-14)
    np.testing.assert_allclose(lubrication.film_solution(), (pressure(2 * np.pi - c, c), c), rtol=1e-12)


def test_the_dividend_satisfies_its_equation_and_the_smooth_fit():
    """V from V(0) = 0 on solves the equation at rest; between y* and x* its slope is on average that of a payment."""
    target, boundary, value_at_1 = control.dividend_solution()
    a, b, rho = 0.5 * control.VOLATILITY**2, control.DRIFT, control.DISCOUNT
    up, down = sorted(np.roots([a, b, -rho]), reverse=True)
    f = lambda x: np.exp(up * x) - np.exp(down * x)  # noqa: E731
    f_slope = lambda x: up * np.exp(up * x) - down * np.exp(down * x)  # noqa: E731
    bend = 2 * np.log(-down / up) / (up - down)

    def touching(C):
        level = control.WORTH / C
        ends = [brentq(lambda x: f_slope(x) - level, lo, hi, xtol=1e-15) for lo, hi in ((0, bend), (bend, 30))]
        return ends, C * (f(ends[1]) - f(ends[0])) - control.WORTH * (ends[1] - ends[0] - control.COST)

    most = control.WORTH / f_slope(bend)
    C = brentq(lambda C: touching(C)[1], 1.5 * control.WORTH / f_slope(0), most * (1 - 1e-9), xtol=1e-15)
    np.testing.assert_allclose([target, boundary], touching(C)[0], rtol=1e-11)
    np.testing.assert_allclose(value_at_1, C * f(1.0), rtol=1e-12)
    reserve = lambda x, V: [V[1], (control.DISCOUNT * V[0] - control.DRIFT * V[1]) * 2 / control.VOLATILITY**2]  # noqa: E731
    path = solve_ivp(reserve, (0, boundary), [0, 1], dense_output=True, method="DOP853", rtol=1e-12, atol=1e-12).sol
    slope = path(target)[1] / control.WORTH
    np.testing.assert_allclose(path(boundary)[1], path(target)[1], rtol=1e-9)
    np.testing.assert_allclose(path(1.0)[0], slope * value_at_1, rtol=1e-9)
    paid = control.WORTH * (boundary - target - control.COST)
    np.testing.assert_allclose(path(boundary)[0] - path(target)[0], slope * paid, rtol=1e-9)


def test_the_five_firms_are_where_no_marginal_profit_is_left():
    found = root(equilibria.marginal_loss, np.full(5, 40.0), tol=1e-14)
    outputs = [36.93251081574, 41.81814166044, 43.70657852227, 42.65923974331, 39.17895251663]
    np.testing.assert_allclose(outputs, found.x, rtol=1e-9)
    assert scenes.five_firms().errors(outputs)["z"] < 1e-9


def test_the_tops_of_bratu_solve_its_textbook_equation_and_meet_at_the_fold():
    """θ = √(2λ) cosh(θ/4), u(½) = 2 ln cosh(θ/4); the fold is at λ = 3.513830719…."""
    for heat in (0.1, 1.0, 3.5):
        for top in nonlinear_forces.free_tops(heat):
            theta = 4 * np.arccosh(np.exp(top / 2))
            np.testing.assert_allclose(theta, np.sqrt(2 * heat) * np.cosh(theta / 4), rtol=1e-9)
    low, high = nonlinear_forces.free_tops(3.513830)
    np.testing.assert_allclose(low, high, rtol=2e-3)
    assert nonlinear_forces.free_tops(3.513831) == []
