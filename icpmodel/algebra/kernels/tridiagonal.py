"""Tridiagonal linear complementarity problems in O(n), for the method `Tridiagonal` in `methods.shortcuts`.

Row i of A is (lower_i, diagonal_i, upper_i), entries outside the matrix being 0.
"""

from __future__ import annotations

import numpy as np

from ...numerics.kernels import compiled

#: how Newton's steps end: the signs no longer change, too many steps are needed, or a pivot is not positive
SETTLED, UNSETTLED, NO_PIVOT = range(3)


@compiled
def bands(indptr, indices, data):
    # the three diagonals of a CSR matrix
    n = indptr.size - 1
    lower = np.zeros(n)
    diagonal = np.zeros(n)
    upper = np.zeros(n)
    for i in range(n):
        for k in range(indptr[i], indptr[i + 1]):
            if indices[k] < i:
                lower[i] = data[k]
            elif indices[k] > i:
                upper[i] = data[k]
            else:
                diagonal[i] = data[k]
    return lower, diagonal, upper


@compiled
def solve(lower, diagonal, upper, free, f, fixed, x):
    # (Ax)_i = f_i in the free rows, x_i = fixed_i in the others: elimination from the top, substitution from below.
    # Returns whether all pivots are positive, as they are where A is a P-matrix
    n = free.size
    above = np.empty(n)
    carried = 0.0
    value = 0.0
    sound = True
    for i in range(n):
        if free[i]:
            pivot = diagonal[i] - lower[i] * carried
            sound &= pivot > 0.0
            value = (f[i] - lower[i] * value) / pivot
            carried = upper[i] / pivot
        else:
            value = fixed[i]
            carried = 0.0
        x[i] = value
        above[i] = carried
    for i in range(n - 2, -1, -1):
        x[i] -= above[i] * x[i + 1]
    return sound


@compiled
def product(lower, diagonal, upper, q, z, p):
    # p = Az + q
    n = z.size
    for i in range(n):
        p[i] = q[i] + diagonal[i] * z[i]
        if i > 0:
            p[i] += lower[i] * z[i - 1]
        if i < n - 1:
            p[i] += upper[i] * z[i + 1]


@compiled
def newton(lower, diagonal, upper, q, c, top, obstacle, free, limit):
    # Newton steps: p = 0 in the free rows, z = c in the others; then the rows with p < diagonal * (z - c) are free.
    # With an upper obstacle `top`, else None, z = top in rows with p < diagonal * (z - top). `obstacle` is z in the
    # rows that are not free; with one obstacle it is c itself. It and `free` are changed. Returns the last z and how
    # the steps ended
    z = np.empty(q.size)
    p = np.empty(q.size)
    f = -q
    for _ in range(limit):
        if not solve(lower, diagonal, upper, free, f, obstacle, z):
            return z, NO_PIVOT
        product(lower, diagonal, upper, q, z, p)
        changed = False
        for i in range(q.size):
            is_free = p[i] < diagonal[i] * (z[i] - c[i])
            if top is not None:
                at = c[i]
                if is_free and p[i] < diagonal[i] * (z[i] - top[i]):
                    is_free = False
                    at = top[i]
                changed |= not is_free and at != obstacle[i]
                obstacle[i] = at
            changed |= is_free != free[i]
            free[i] = is_free
        if not changed:
            return z, SETTLED
    return z, UNSETTLED


@compiled
def refine(lower, diagonal, upper, q, free, z):
    # z after a step of iterative refinement in the free rows
    p = np.empty_like(z)
    step = np.empty_like(z)
    product(lower, diagonal, upper, q, z, p)
    for i in range(z.size):
        p[i] = -p[i]
    solve(lower, diagonal, upper, free, p, np.zeros_like(z), step)
    for i in range(z.size):
        step[i] += z[i]
    return step


@compiled
def join_runs(one, two, to, back):
    # joins two adjacent runs of free rows: `to` couples the last row of `one` to the first of `two`, `back` the latter
    # to the former. Returns whether the determinant is positive, else A is no M-matrix; and the run, as
    # `rows_off_obstacle` stores it
    first, top, bottom, up, down, y_top, y_bottom = one
    _, top2, bottom2, up2, down2, y_top2, y_bottom2 = two
    determinant = 1.0 - (to * back) * (bottom * top2)
    new_y_bottom = (y_bottom - bottom * to * y_top2) / determinant
    new_y_top = (y_top2 - top2 * back * y_bottom) / determinant
    return determinant > 0.0, (
        first,
        top + (up * to) * (back * down) * (top2 / determinant),
        bottom2 + (down2 * back) * (to * up2) * (bottom / determinant),
        -(up * to) * up2 / determinant,
        -(down2 * back) * down / determinant,
        y_top - up * to * new_y_top,
        y_bottom2 - down2 * back * new_y_bottom,
    )


@compiled
def rows_off_obstacle(lower, diagonal, upper, f):
    # which rows leave the obstacle in the LCP with the M-matrix A, rows divided by the diagonal, and f; and False where
    # A proves to be no M-matrix. From the top, one row after the other is added to a problem that is already solved; a
    # row that has left the obstacle stays off it. Stored for each run of free rows: its first row; of its inverse the
    # corners top (first, first), bottom (last, last), up (first, last) and down (last, first); y at both ends, as long
    # as the rows around it are at 0
    n = f.size
    free = np.zeros(n, np.bool_)
    runs = np.empty((n // 2 + 2, 7))
    count = 0
    for i in range(n):
        run = (float(i), 1.0, 1.0, 1.0, 1.0, -f[i], -f[i])
        joins_run = i > 0 and free[i - 1]
        back = lower[i] / diagonal[i]
        if f[i] + (back * runs[count - 1, 6] if joins_run else 0.0) >= 0.0:
            continue
        free[i] = True
        k = i - 1
        # the row above the run becomes free too where the run pulls it below 0
        while True:
            if joins_run:
                count -= 1
                first, top, bottom, up, down, y_top, y_bottom = runs[count]
                above = (first, top, bottom, up, down, y_top, y_bottom)
                sound, run = join_runs(above, run, upper[k] / diagonal[k], back)
                if not sound:
                    return free, False
            k = int(run[0]) - 1
            if k < 0:
                break
            to = upper[k] / diagonal[k]
            back = lower[k + 1] / diagonal[k + 1]
            joins_run = k > 0 and free[k - 1]
            coupling = lower[k] / diagonal[k] * runs[count - 1, 6] if joins_run else 0.0
            if f[k] + coupling + to * run[5] >= 0.0:
                break
            free[k] = True
            sound, run = join_runs((float(k), 1.0, 1.0, 1.0, 1.0, -f[k], -f[k]), run, to, back)
            if not sound:
                return free, False
            back = lower[k] / diagonal[k]
            k = k - 1
        runs[count] = run
        count += 1
    return free, True


@compiled
def free_rows(lower, diagonal, upper, q, c):
    # the free rows with which Newton's steps begin. Rows without an obstacle get a lower bound of z as one: the
    # solution without any obstacles. Where a determinant shows that A is no M-matrix, all rows begin on their obstacles
    n = q.size
    below = np.empty(n)
    load = np.empty(n)
    every = np.empty(n, np.bool_)
    bounded = True
    for i in range(n):
        load[i] = -q[i]
        every[i] = True
        bounded = bounded and c[i] != -np.inf
    if not bounded:
        solve(lower, diagonal, upper, every, load, c, below)
    for i in range(n):
        if c[i] != -np.inf:
            below[i] = c[i]
    f = np.empty(n)
    product(lower, diagonal, upper, q, below, f)
    for i in range(n):
        f[i] /= diagonal[i]
    free, sound = rows_off_obstacle(lower, diagonal, upper, f)
    for i in range(n):
        free[i] = (free[i] and sound) or c[i] == -np.inf
    return free


@compiled
def _one_side(lower, diagonal, upper, q, c, held, values, limit):
    # z of the LCP with the obstacle c, where z is fixed at `values` in the rows that are `held`
    n = q.size
    lower = lower.copy()
    diagonal = diagonal.copy()
    upper = upper.copy()
    q = q.copy()
    c = c.copy()
    for i in range(n):
        if held[i]:
            lower[i] = 0.0
            diagonal[i] = 1.0
            upper[i] = 0.0
            q[i] = -values[i]
            c[i] = values[i]
            continue
        if i > 0 and held[i - 1]:
            q[i] += lower[i] * values[i - 1]
            lower[i] = 0.0
        if i < n - 1 and held[i + 1]:
            q[i] += upper[i] * values[i + 1]
            upper[i] = 0.0
    free = free_rows(lower, diagonal, upper, q, c)
    return newton(lower, diagonal, upper, q, c, None, c, free, limit)[0]


@compiled
def alternate(lower, diagonal, upper, q, c, top, rounds, limit, obstacle, free):
    # sets `obstacle` and `free` for Newton's steps between two obstacles. Alternates for at most `rounds`, until
    # nothing changes: finds the rows at c with those at `top` held, then the rows at `top` with those at c held
    n = q.size
    above = np.zeros(n, np.bool_)
    below = np.zeros(n, np.bool_)
    mirrored = -q, -top, -c
    for _ in range(rounds):
        z = _one_side(lower, diagonal, upper, q, c, above, top, limit)
        for i in range(n):
            below[i] = z[i] <= c[i] and not above[i]
        z = _one_side(lower, diagonal, upper, mirrored[0], mirrored[1], below, mirrored[2], limit)
        changed = False
        for i in range(n):
            at_top = -z[i] >= top[i] and not below[i]
            changed |= at_top != above[i]
            above[i] = at_top
        if not changed:
            break
    for i in range(n):
        obstacle[i] = top[i] if above[i] else c[i]
        free[i] = not (above[i] or below[i])


@compiled
def solve_rows(lower, diagonal, upper, Q, C, D, rounds, limit, Z):
    # solves one LCP for each row of Q, its obstacles in the rows of C, and above in those of D, or None; writes z to
    # the rows of Z, unchecked
    for k in range(Q.shape[0]):
        free = free_rows(lower, diagonal, upper, Q[k], C[k])
        if D is None:
            z = newton(lower, diagonal, upper, Q[k], C[k], None, C[k], free, rounds * limit)[0]
        else:
            obstacle = C[k].copy()
            z, ended = newton(lower, diagonal, upper, Q[k], C[k], D[k], obstacle, free, limit)
            if ended == UNSETTLED:
                alternate(lower, diagonal, upper, Q[k], C[k], D[k], rounds, limit, obstacle, free)
                z = newton(lower, diagonal, upper, Q[k], C[k], D[k], obstacle, free, limit)[0]
        for i in range(z.size):
            Z[k, i] = z[i]
