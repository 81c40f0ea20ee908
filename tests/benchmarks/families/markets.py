"""Economics: prices from input and output, trade between places, firms that compete, traffic.

Leontief: A = I − T with T ≥ 0 and row sums below 1 is an M-matrix; Cournot: A is positive definite: one solution each.
Trade, prices and traffic: A is semidefinite, and there is a z ≥ 0 with p ≥ 0, large flows on all routes; a monotone LCP
with a feasible point has a solution (Cottle, Pang and Stone, 1992, theorem 3.1.2).
"""

import numpy as np
import scipy.sparse as sp

from .draw import scattered, some

#: the largest number of entries of a matrix, which is a quarter of a gigabyte
_ENTRIES = 2e7


def leontief(n, rng):
    """Prices z that cover the inputs, at prices z, and the wages, above floors for some: p = (I − T)z − wages.

    Few goods are inputs of many: their numbers follow a power law.
    """
    each, popular = some(rng, 3, 20), rng.uniform(1.0, 3.0)
    inputs = np.minimum((n * rng.random(n * each) ** popular).astype(np.int64), n - 1)
    T = sp.csr_array((rng.random(n * each), (np.repeat(np.arange(n), each), inputs)), (n, n))
    share = 1.0 - scattered(rng, 0.02, 0.5)
    T = sp.diags_array(share * rng.uniform(0.7, 1.0, n) / T.sum(axis=1)) @ T
    wages = rng.uniform(0.5, 1.5, n)
    floors = rng.uniform(0.5, 1.3, n) / (1.0 - 0.85 * share)
    return sp.csr_array(sp.eye_array(n) - T), floors, -wages


def trade(n, rng):
    """Spatial price equilibrium: flows z from places of supply to those of demand near them.

    p = supply price + transport − demand price, prices linear in what a place sells or buys: A = SᵀbS + DᵀfD with a
    column of S and D per route, q = lowest supply price + transport − highest demand price; large flows have p > 0.
    Reference: Samuelson, Am. Econ. Rev. 42 (1952).
    """
    sold, bought, distance = _routes(n, rng)
    S, D = _incidence(sold), _incidence(bought)
    b, f = (10.0 ** rng.uniform(-1.0, 1.0, of.shape[0]) for of in (S, D))
    lowest, highest = rng.uniform(1.0, 8.0, S.shape[0]), rng.uniform(6.0, 15.0, D.shape[0])
    A = S.T @ sp.diags_array(b) @ S + D.T @ sp.diags_array(f) @ D
    q = lowest[sold] + scattered(rng, 0.3, 3.0) * distance - highest[bought]
    return sp.csr_array(A), np.zeros(sold.size), q


def prices(n, rng):
    """The same equilibrium with the prices as unknowns: flows x, prices u of supply and v of demand.

    Sᵀu + transport − Dᵀv ≥ 0 ⟂ x ≥ 0, supply at u − Sx ≥ 0 ⟂ u ≥ 0, Dx − demand at v ≥ 0 ⟂ v ≥ 0; places that sell or
    buy whatever the price is have no diagonal. Large x and u with v = 0 are feasible, as supply depends on u.
    """
    sold, bought, distance = _routes(max(1, round(0.9 * n)), rng)
    S, D = _incidence(sold), _incidence(bought)
    supply, demand = rng.uniform(0.5, 2.0, S.shape[0]), rng.uniform(0.0, 2.0, D.shape[0])
    demand[rng.random(demand.size) < rng.choice([0.0, 0.5, 1.0])] = 0.0
    A = sp.block_array([[None, S.T, -D.T], [-S, sp.diags_array(supply), None], [D, None, sp.diags_array(demand)]])
    q = [scattered(rng, 0.3, 3.0) * distance, -rng.uniform(0.0, 2.0, supply.size), -rng.uniform(5.0, 20.0, demand.size)]
    return sp.csr_array(A), np.zeros(A.shape[0]), np.concatenate(q)


def cournot(n, rng):
    """Firms that sell in several markets: z is what one sells in one, p its marginal loss, ψ what it has promised.

    A = DᵀbD + diag(b) + SᵀcS: a market's price falls by b per unit, a firm's costs rise by c. Positive definite.
    """
    firm, market, distance = _routes(n, rng)
    S, D = _incidence(firm), _incidence(market)
    b, c = 10.0 ** rng.uniform(-1.0, 1.0, D.shape[0]), scattered(rng, 0.01, 1.0) * rng.random(S.shape[0])
    A = D.T @ sp.diags_array(b) @ D + sp.diags_array(b[market]) + S.T @ sp.diags_array(c) @ S
    q = rng.uniform(1.0, 4.0, S.shape[0])[firm] + distance - rng.uniform(4.0, 12.0, D.shape[0])[market]
    promised = np.where(rng.random(firm.size) < 0.2, 0.1 * rng.random(firm.size), 0.0)
    return sp.csr_array(A), promised, q


def traffic(n, rng):
    """User equilibrium in a city of streets on a grid: flows x on routes, times u between the ends of journeys.

    time of route − u ≥ 0 ⟂ x ≥ 0, flow of journey − demand + elasticity·u ≥ 0 ⟂ u ≥ 0: A = [ΔᵀCΔ, −Γᵀ; Γ, E], Δ streets
    × routes, Γ journeys × routes, C ≥ 0 delay per flow; E ≥ 0, often 0. Large x and u = 0 are feasible.
    Reference: Aashtiani and Magnanti, SIAM J. Algebr. Discrete Methods 2 (1981).
    """
    each = int(rng.integers(2, 6))
    journeys = max(1, round(n / (each + 1)))
    longest, routes = int(rng.integers(2, 7)), journeys * each
    side = max(2, round(np.sqrt(routes * longest / (2.0 * scattered(rng, 2.0, 12.0)))))
    streets = _streets(journeys, each, longest, side, rng)
    used, route = streets >= 0, np.broadcast_to(np.arange(routes)[:, None], streets.shape)
    shape = (2 * (side + 2 * longest) ** 2, routes)
    Delta = sp.csr_array((np.ones(int(used.sum())), (streets[used], route[used])), shape)
    Gamma = sp.kron(sp.eye_array(journeys), np.ones((1, each)), format="csr")
    delay, free = rng.uniform(0.05, 1.0, shape[0]), rng.uniform(0.5, 2.0, shape[0])
    elastic = scattered(rng, 0.01, 1.0) * rng.random(journeys) if rng.random() < 0.5 else np.zeros(journeys)
    times = Delta.T @ sp.diags_array(delay) @ Delta
    A = sp.block_array([[times, -Gamma.T], [Gamma, sp.diags_array(elastic)]], format="csr")
    demand = rng.uniform(0.2, 2.0, journeys)
    return A, np.zeros(A.shape[0]), np.concatenate([Delta.T @ free, -demand])


def _streets(journeys, each, longest, side, rng):
    """The streets of every route, −1 where it is shorter: a random order of the steps east and north of its journey."""
    across = rng.integers(0, longest + 1, (journeys, 2))
    across[across.sum(axis=1) == 0] = 1
    start = rng.integers(0, side, (journeys, 2))
    steps = np.arange(2 * longest)
    kind = np.where(steps < across[:, :1], 0, np.where(steps < across.sum(axis=1)[:, None], 1, 2))
    kind = np.repeat(kind, each, axis=0)
    key = np.where(kind == 2, 2.0, rng.random(kind.shape))
    kind = np.take_along_axis(kind, np.argsort(key, axis=1), axis=1)
    x, y = (np.repeat(start[:, k], each)[:, None] + np.cumsum(kind == k, axis=1) - (kind == k) for k in (0, 1))
    return np.where(kind == 2, -1, 2 * (x * (side + 2 * longest) + y) + kind)


def _routes(n, rng):
    """Of about n pairs of places near each other the first, the second, and the distance, about 1."""
    from scipy.spatial import cKDTree

    ratio = rng.uniform(0.4, 1.2)
    degree = min(scattered(rng, 3.0, 60.0), max(3.0, _ENTRIES / (n * (1.0 + 1.0 / ratio))))
    degree = max(1, round(min(degree, np.sqrt(n * ratio))))
    second = max(1, round(n / degree))
    first = max(degree, round(ratio * second))
    apart, near = cKDTree(rng.random((first, 2))).query(rng.random((second, 2)), k=degree)
    apart, near = apart.reshape(second, degree), near.reshape(second, degree)
    _, near = np.unique(near, return_inverse=True)  # a place without a partner is none
    distance = apart.ravel() * np.sqrt(first / degree)
    return near.ravel(), np.repeat(np.arange(second), degree), distance


def _incidence(place):
    """Places × routes: 1 where the route has the place."""
    n = place.size
    return sp.csr_array((np.ones(n), (place, np.arange(n))), (int(place.max()) + 1, n))
