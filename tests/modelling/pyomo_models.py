"""Pyomo models for the tests, and whether their conditions hold, read from Pyomo's own arguments."""

import numpy as np
import pyomo.environ as pyo
import scipy.sparse as sp
from pyomo.core.expr import relational_expr as relational
from pyomo.mpec import Complementarity, complements

import icpmodel as icp


def ends(argument):
    """(lower, value, upper) of one argument of a condition at the values of the variables."""
    if isinstance(argument, relational.RangedExpression):
        return tuple(pyo.value(part) for part in argument.args)
    if isinstance(argument, relational.InequalityExpression):
        low, high = argument.args
        return 0.0, pyo.value(high) - pyo.value(low), np.inf
    if isinstance(argument, relational.EqualityExpression):
        value = pyo.value(argument.args[0]) - pyo.value(argument.args[1])
        return 0.0, value, 0.0
    return -np.inf, pyo.value(argument), np.inf


def violation(model):
    """By how much the worst condition or equality of a model fails to hold."""
    worst = [0.0]
    for condition in model.component_data_objects(Complementarity, active=True, descend_into=True):
        first, second = (ends(argument) for argument in condition._args)
        if np.isfinite(second[:3:2]).sum() > np.isfinite(first[:3:2]).sum():
            first, second = second, first
        low, f, high = first
        if np.isfinite(second[:3:2]).any():
            worst.append(abs(min(f - low, second[1] - second[0])))
        else:  # a <= f <= b with g without bound: f is the projection of f - g onto [a, b]
            worst.append(abs(f - min(max(f - second[1], low), high)))
    equations = model.component_data_objects(pyo.Constraint, active=True, descend_into=True)
    return max(worst + [abs(pyo.value(one.body) - pyo.value(one.upper)) for one in equations])


def random_problem(random, n, kind="constant"):
    """(ICP, the affine part G of its psi): a strictly diagonally dominant A with at least three entries a row; psi
    constant, affine or nonlinear, of which every row moves with itself and one other variable at most."""
    A = sp.random_array((n, n), density=0.3, rng=random, data_sampler=lambda size: random.uniform(-1, 1, size))
    A = A.tolil()
    for i in range(n):
        for step in (1, 2):
            A[i, (i + step) % n] = random.choice([-0.7, 0.9])
        A[i, i] = 0.0
    A = sp.csr_array(A + sp.diags_array(abs(A.tocsr()).sum(axis=1) + 0.5))
    q, c = random.uniform(-2, 2, n), random.uniform(-1, 1, n)
    G = sp.csr_array((random.uniform(-0.4, 0.4, n), (np.arange(n), random.permutation(n))), shape=(n, n))
    G = sp.csr_array(G - sp.diags_array(G.diagonal()))
    G.eliminate_zeros()
    if kind == "constant":
        return icp.ICP(A, q, c), 0 * G
    if kind == "affine":
        return icp.ICP(A, q, icp.Affine(G, c)), G
    sine = lambda z: G @ z + c + 0.3 * np.sin(z)  # noqa: E731
    return icp.ICP(A, q, icp.Function(sine, lambda z: G + sp.diags_array(0.3 * np.cos(z)))), G


def linear(matrix, x, i):
    entries = slice(matrix.indptr[i], matrix.indptr[i + 1])
    return sum(a * x[j] for a, j in zip(matrix.data[entries].tolist(), matrix.indices[entries].tolist(), strict=True))


def written(problem, G, random, kind, *, plainly=False):
    """`problem` as a Pyomo model; sides in either order, either sign, the constant on either end, in nested blocks."""
    n = problem.n
    model = pyo.ConcreteModel()
    model.part = pyo.Block([0, 1])
    model.part[0].inner = pyo.Block()
    model.part[0].inner.x = pyo.Var(range(n))
    x = model.part[0].inner.x
    model.one = pyo.Param(initialize=1.0, mutable=True)
    model.two = pyo.Var()
    model.two.fix(2.0)
    c = problem.psi.value(np.zeros(n))

    def side(body, constant, free):
        """body + constant >= 0, or the same words turned around."""
        if not plainly and random.random() < 0.5:
            body = model.two * body / 2 * model.one
        choice = 0 if plainly else random.integers(6)
        return (
            lambda: body + constant >= 0,
            lambda: body >= -constant,
            lambda: -body <= constant,
            lambda: constant + body >= 0,
            lambda: body + free >= free - constant,
            lambda: pyo.inequality(body=-body - constant, upper=0.0),
        )[choice]()

    def rule(block, i):
        moving = x[i]
        if kind != "constant":
            moving = moving - linear(G, x, i)
        if kind == "nonlinear":
            moving = moving - 0.3 * pyo.sin(x[i])
        p = side(linear(problem.A, x, i), float(problem.q[i]), x[(i + 1) % n])
        factor = 1.0 if plainly else float(random.uniform(0.5, 2))
        r = side(factor * moving, -factor * float(c[i]), x[(i + 3) % n])
        return complements(p, r) if plainly or random.random() < 0.5 else complements(r, p)

    model.part[1].rows = Complementarity(range(n), rule=rule)
    model.part[1].unused = Complementarity(expr=complements(x[0] >= 0, x[1] ** 2 >= x[0] ** 3))
    model.part[1].unused.deactivate()
    return model
