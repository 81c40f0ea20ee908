"""LDLᵀ of symmetric matrices with one pattern, by supernodes: columns of L next to one another that fill the same rows.

The w columns of supernode s are kept as one full array with a row for each of `rows[start[s] : start[s + 1]]`, their
own w rows first, from `offset[s]` on: what one contributes to another is a product of two such arrays, which is made at
the speed of full matrices. Some entries that are 0 are kept as well, so that there are fewer and larger ones.
Reference: Ng and Peyton, SIAM J. Sci. Comput. 14 (1993).
"""

from __future__ import annotations

import numpy as np

from . import called, compiled, inlined, one, sums, uint

#: of the entries of a supernode this share may be zeros, it has at most so many columns, and products of fewer
#: multiplications are not worth a call of BLAS; half or twice as much made no difference
_ZEROS = 0.3
_WIDEST = 64
_LITTLE = 500


@called
def _tree(indptr, indices, order, place):
    # the elimination tree: the parent of column j is the first row below j that it fills; and how many rows it fills
    n = order.size
    parent = np.full(n, -1, np.int32)
    count = np.zeros(n, np.int32)
    seen = np.full(n, -1, np.int32)
    for i in range(n):
        seen[i] = i
        for e in range(indptr[order[i]], indptr[order[i] + 1]):
            j = place[indices[e]]
            while j < i and seen[j] != i:
                if parent[j] < 0:
                    parent[j] = i
                seen[j] = i
                count[j] += 1
                j = parent[j]
    return parent, count


@called
def _postorder(parent):
    # children right before their parents, which fill what they do: L is as full as before
    n = parent.size
    child = np.full(n + 1, -1, np.int32)
    sibling = np.empty(n, np.int32)
    for j in range(n - 1, -1, -1):
        # the roots are children of the last one, n
        sibling[j] = child[parent[j]]
        child[parent[j]] = j
    turn = np.empty(n, np.int32)
    path = np.empty(n + 1, np.int32)
    depth = 0
    at = 0
    path[0] = n
    while depth >= 0:
        i = path[depth]
        if child[i] >= 0:
            depth += 1
            path[depth] = child[i]
            child[i] = sibling[child[i]]
        else:
            if i < n:
                turn[at] = i
                at += 1
            depth -= 1
    return turn


@called
def _joined(parent, count):
    # where the supernodes begin, and n
    n = parent.size
    first = [0]
    zeros = 0.0
    for j in range(1, n):
        width = j - first[-1]
        more = zeros + (count[j] + 1 - count[j - 1]) * width
        entries = (width + 1) * (count[j] + 0.5 * width + 1.0)
        if parent[j - 1] == j and width < _WIDEST and more <= _ZEROS * entries:
            zeros = more
        else:
            first.append(j)
            zeros = 0.0
    return np.array([*first, n])


@compiled
def analysed(indptr, indices, order):
    # the pattern, symmetric, of a matrix in this order of its rows, and what else is known before its entries: its rows
    # in the order that is taken, where supernodes begin, which one a column is in, where its rows and entries begin,
    # the rows, and where the entries of the matrix go, -1 above the diagonal
    n = order.size
    place = np.empty(order.size, np.int32)
    place[order] = np.arange(n)
    parent, count = _tree(indptr, indices, order, place)
    turn = _postorder(parent)
    order = order[turn]
    count = count[turn]
    place = np.empty(n + 1, np.int32)
    place[turn], place[n] = np.arange(n), -1
    parent = place[parent[turn]]  # of a root, -1, it is the last one
    place[order] = np.arange(n)
    first = _joined(parent, count)
    m = first.size - 1
    of = np.empty(n, np.int32)
    start = np.zeros(m + 1, np.int64)
    offset = np.zeros(m + 1, np.int64)
    for s in range(m):
        width = first[s + 1] - first[s]
        last = first[s + 1] - 1
        of[first[s] : last + 1] = s
        start[s + 1] = start[s] + width + count[last]
        offset[s + 1] = offset[s] + (width + count[last]) * width
    rows = np.empty(start[m], np.int32)
    end = start[:m].copy()
    seen = np.full(m, -1, np.int32)
    for i in range(n):
        rows[end[of[i]]] = i
        end[of[i]] += 1
        seen[of[i]] = i
        for e in range(indptr[order[i]], indptr[order[i] + 1]):
            j = place[indices[e]]
            while j < i and seen[of[j]] != i:
                s = of[j]
                if end[s] == start[s + 1]:
                    raise ValueError("the pattern is not symmetric")
                rows[end[s]] = i
                seen[s] = i
                end[s] += 1
                j = parent[first[s + 1] - 1]
    if (end < start[1:]).any():
        raise ValueError("the pattern is not symmetric")
    to = np.full(indices.size, -1, np.int64)
    at = np.empty(n, np.int32)
    seen = np.full(n, -1, np.int32)
    for s in range(m):
        own = rows[start[s] : start[s + 1]]
        at[own] = np.arange(own.size)
        seen[own] = s
        for j in range(first[s], first[s + 1]):
            for e in range(indptr[order[j]], indptr[order[j] + 1]):
                i = place[indices[e]]
                if i >= j:
                    if seen[i] != s:
                        raise ValueError("the pattern is not symmetric")
                    to[e] = offset[s] + at[i] * (first[s + 1] - first[s]) + j - first[s]
    return order, (first, of, start, offset, rows), to


@compiled
def enter(indptr, indices, data, signs, free, to, values):
    # the entries of the matrix, row i times signs_i, where they go, what is not `free` being 0 but for the diagonal; of
    # two that are opposite to one another the one below the diagonal counts. Returns whether they are finite
    values[:] = 0.0
    for i in range(signs.size):
        for e in range(uint(indptr[i]), uint(indptr[i + 1])):
            j = indices[e]
            if to[e] >= 0 and (j == i or (free[i] and free[j])):
                values[to[e]] += signs[i] * data[e]
                if not abs(data[e]) < np.inf:
                    return False
    return True


@sums
def _subtract(values, base, depth, D, f, rows, low, high, end, at):
    # L_a D L_b' of the rows low <= a < end and b, which are before `high`, one by one; L_low begins at `base`, its D at
    # f, and the row that it belongs to at `at`
    for b in range(uint(high - low)):
        j = rows[uint(low) + b]
        q = uint(base) + b * uint(depth)
        for a in range(b, uint(end - low)):
            p = uint(base) + a * uint(depth)
            k = uint(0)
            total = 0.0
            while k < uint(depth):
                total += values[p + k] * values[q + k] * D[uint(f) + k]
                k += one()
            values[uint(at[uint(rows[uint(low) + a])] + j)] -= total


@called
def _subtract_product(values, base, depth, D, f, rows, low, high, end, at, scaled, product):
    # the same as a product of two arrays, which goes into the third
    height = end - low
    width = high - low
    L = values[base : base + height * depth].reshape(height, depth)
    LD = scaled[: width * depth].reshape(width, depth)
    for b in range(width):
        for k in range(depth):
            LD[b, k] = L[b, k] * D[f + k]
    P = product[: height * width].reshape(height, width)
    np.dot(L, LD.T, P)
    for a in range(uint(height)):
        to = at[rows[uint(low) + a]]
        for b in range(uint(width)):
            values[uint(to + rows[uint(low) + b])] -= P[a, b]


@called
def _gather(values, base, depth, D, f, rows, low, end, at, first_at, width, wide, height, of_wide, full):
    # the columns of L as rows of `wide`, from `full` on, where their rows are in the supernode, and their D
    for k in range(full * height, (full + depth) * height):
        wide[k] = 0.0
    for a in range(uint(end - low)):
        to = full * height + (at[rows[uint(low) + a]] - first_at) // width
        p = uint(base) + a * uint(depth)
        for k in range(uint(depth)):
            wide[uint(to) + k * uint(height)] = values[p + k]
    for k in range(depth):
        of_wide[full + k] = D[f + k]


@called
def _subtract_gathered(values, target, width, wide, height, of_wide, full, scaled, product):
    # what has been gathered, at once
    L = wide[: full * height].reshape(full, height)
    LD = scaled[: full * width].reshape(full, width)
    for k in range(full):
        for b in range(width):
            LD[k, b] = L[k, b] * of_wide[k]
    P = product[: height * width].reshape(height, width)
    np.dot(L.T, LD, P)
    own = values[target : target + height * width].reshape(height, width)
    for a in range(height):
        for b in range(width):
            own[a, b] -= P[a, b]


@sums
def _eliminate(values, base, width, height, D, f):
    # the columns of one supernode among themselves, its array beginning at `base` and its D at f
    for i in range(height):
        p = uint(base + i * width)
        before = uint(min(i, width))
        square = 0.0
        for k in range(uint(1), before):
            q = uint(base) + k * uint(width)
            total = 0.0
            for j in range(k):
                total += values[p + j] * values[q + j]
            values[p + k] -= total
        for k in range(before):
            x = values[p + k]
            values[p + k] = x / D[uint(f) + k]
            square += x * values[p + k]
        if i < width:
            D[uint(f) + before] = values[p + before] - square


@inlined
def _hand_on(s, to, head, after):
    after[s] = head[to]
    head[to] = s


@compiled
def factor(form, values, D, links, begin, stop):
    # L in the place of the entries, and D, of the supernodes begin <= s < stop. `links`, -1 at first, are a list for
    # each of those whose turn it is to contribute to it, and their first row that has not been
    first, of, start, offset, rows = form
    head = links[0]
    after = links[1]
    reached = links[2]
    tallest = 0
    for s in range(start.size - 1):
        tallest = max(tallest, start[s + 1] - start[s])
    at = np.empty(of.size, np.int64)
    scaled = np.empty(_WIDEST * _WIDEST)
    product = np.empty(tallest * _WIDEST)
    wide = np.empty(tallest * _WIDEST)
    of_wide = np.empty(_WIDEST)
    for s in range(begin, stop):
        width = first[s + 1] - first[s]
        height = start[s + 1] - start[s]
        full = 0
        first_at = offset[s] - first[s]
        for k in range(height):
            at[rows[start[s] + k]] = first_at + k * width
        t = head[s]
        reached[s] = start[s] + width
        while t >= 0:
            low = reached[t]
            end = start[t + 1]
            depth = first[t + 1] - first[t]
            f = first[t]
            base = offset[t] + (low - start[t]) * depth
            high = low
            while high < end and rows[high] < first[s + 1]:
                high += 1
            entries = (end - low) * (high - low)
            if entries * depth <= _LITTLE:
                _subtract(values, base, depth, D, f, rows, low, high, end, at)
            elif 4 * depth <= _WIDEST and 2 * entries >= height * width:
                if full + depth > _WIDEST:
                    _subtract_gathered(values, offset[s], width, wide, height, of_wide, full, scaled, product)
                    full = 0
                _gather(values, base, depth, D, f, rows, low, end, at, first_at, width, wide, height, of_wide, full)
                full += depth
            else:
                _subtract_product(values, base, depth, D, f, rows, low, high, end, at, scaled, product)
            reached[t] = high
            following = after[t]
            if high < end:
                _hand_on(t, of[rows[high]], head, after)
            t = following
        if full:
            _subtract_gathered(values, offset[s], width, wide, height, of_wide, full, scaled, product)
        _eliminate(values, offset[s], width, height, D, first[s])
        if width < height:
            _hand_on(s, of[rows[start[s] + width]], head, after)


@sums
def _forward(values, base, width, rows, low, end, f, x):
    for i in range(1, end - low):
        p = uint(base + i * width)
        total = 0.0
        for k in range(uint(min(i, width))):
            total += values[p + k] * x[uint(f) + k]
        x[uint(rows[uint(low + i)])] -= total


@called
def _backward(values, base, width, rows, low, end, f, x):
    for i in range(end - low - 1, 0, -1):
        p = uint(base + i * width)
        of_row = x[uint(rows[uint(low + i)])]
        for k in range(uint(min(i, width))):
            x[uint(f) + k] -= values[p + k] * of_row


@compiled
def solve(form, values, D, x):
    # x = (LDL')^-1 x, in place
    first, _, start, offset, rows = form
    for s in range(first.size - 1):
        _forward(values, offset[s], first[s + 1] - first[s], rows, start[s], start[s + 1], first[s], x)
    x /= D
    for s in range(first.size - 2, -1, -1):
        _backward(values, offset[s], first[s + 1] - first[s], rows, start[s], start[s + 1], first[s], x)
