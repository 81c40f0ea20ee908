"""CVXPY's standard quadratic programs, of any size: portfolio, support vectors, transport."""

import cvxpy as cp
import numpy as np


def portfolio(n=30, factors=5):
    random = np.random.default_rng(1)
    returns, loading = np.abs(random.normal(size=n)), random.normal(size=(n, factors))
    S = random.normal(size=(factors, factors))
    w, f = cp.Variable(n), cp.Variable(factors)
    risk = cp.quad_form(f, cp.psd_wrap(S.T @ S)) + cp.sum_squares(cp.multiply(random.uniform(0, 1.4, n), w))
    return cp.Problem(cp.Maximize(returns @ w - 0.1 * risk), [cp.sum(w) == 1, w >= 0, f == loading.T @ w])


def support_vectors(rows=40, n=5):
    random = np.random.default_rng(4)
    X, b, v = random.normal(0, 5, size=(rows, n)), cp.Variable(n), cp.Variable()
    labels = np.sign(X @ random.normal(size=n) + random.normal(size=rows))
    hinge = cp.sum(cp.pos(1 - cp.multiply(labels, X @ b - v))) / rows
    return cp.Problem(cp.Minimize(hinge + 0.1 * cp.sum_squares(b)))


def transport(sources=4, sinks=5):
    random = np.random.default_rng(9)
    X, supply = cp.Variable((sources, sinks)), random.uniform(1, 2, sources)
    rows = [cp.sum(X, axis=1) == supply, cp.sum(X, axis=0) == np.full(sinks, supply.sum() / sinks), X >= 0]
    return cp.Problem(cp.Minimize(cp.sum(cp.multiply(random.uniform(0, 1, (sources, sinks)), X))), rows)


PROGRAMS = (portfolio, support_vectors, transport)
