"""Error bound / true error where z* is known (no row "solve": all answers were exact to rounding)."""

import numpy as np

import icpmodel as icp

from .harness import scene

#: how far z is from z*, in units of the largest entry of z*
DISTANCES = (1e-10, 1e-6, 1e-2, 1.0)


def table(n=900, trials=10):
    """Error bound over true error, max-norm, on every scene with an exact answer.

    z is z* plus uniform noise of the sizes 1e-10, 1e-6, 1e-2 and 1 times max|z*|, and answers of `solve` with rtol =
    1e-2, 1e-4, …, 1e-10 as far as they are not exact to rounding themselves. "plain" is the bound of z itself, "sharp"
    the one that looks for a better point.

    Parameters
    ----------
    n : wanted unknowns of the scenes that have a size
    trials : points at each distance
    """
    yield "scene", "n", "z", "plain, median", "sharp, median", "lowest", "highest sharp"
    random = np.random.default_rng(0)
    for name in icp.scenes.names():
        if icp.scenes.scene(name).z_exact is None:
            continue
        one = scene(name, n)
        problem, exact = one.problem, np.asarray(one.z_exact)
        size = np.abs(exact).max()
        noisy = [exact + d * size * random.uniform(-1, 1, exact.size) for d in DISTANCES for _ in range(trials)]
        solved = [problem.solve(rtol=10.0**-k, raise_on_failure=False).z for k in (2, 4, 6, 8, 10)]
        solved = [z for z in solved if np.abs(z - exact).max() > 1e-12 * size]
        for kind, points in (("noise", noisy), ("solve", solved)):
            if points:
                yield name, problem.n, kind, *ratios(problem, exact, points)


def ratios(problem, exact, points):
    """Medians of the plain and of the sharp ratio, the lowest of all, the highest sharp one; None without a bound."""
    both = []
    for z in points:
        bounds = [icp.error_bound(problem, z, sharp=sharp).value for sharp in (False, True)]
        if None in bounds:
            return (None,) * 4
        both.append(np.array(bounds) / np.abs(z - exact).max())
    plain, sharp = np.median(both, axis=0)
    return float(plain), float(sharp), float(np.min(both)), float(np.max(both, axis=0)[1])
