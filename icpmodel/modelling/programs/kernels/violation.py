"""The sums and maxima over rows of which the judge of a program makes its shares."""

from __future__ import annotations

import numpy as np

from ....numerics.kernels import compiled, inlined, uint
from ....numerics.rounding import UNIT_ROUNDOFF


@inlined
def _row_sums(start, stop, indices, data, is_x, z, largest):
    # (|A||z|)_i, (|A| largest)_i, (|A||x|)_i and (Ax)_i
    terms = 0.0
    largest_terms = 0.0
    terms_of_x = 0.0
    slope = 0.0
    for k in range(uint(start), uint(stop)):
        j = uint(indices[k])
        size = abs(data[k])
        terms += size * abs(z[j])
        largest_terms += size * largest[j]
        if is_x[j]:
            terms_of_x += size * abs(z[j])
            slope += data[k] * z[j]
    return terms, largest_terms, terms_of_x, slope


@compiled
def violation_of_rows(
    indptr, indices, data, diagonal, is_x, q, z, p, room, largest, largest_q, loss, gradient_noise, shares
):
    # `shares`: the largest shares of terms that are wrong in the rows off their obstacles, up to rounding, strictly,
    # and strictly where the terms are not rounding. Returns Σ|p|d; x'Ax; Σ|x|(|q| + rounding); and what the sides add
    shares[:] = 0.0
    gap = 0.0
    curvature = 0.0
    linear = 0.0
    side_terms = 0.0
    for i in range(uint(q.size)):
        sums = _row_sums(indptr[i], indptr[i + uint(1)], indices, data, is_x, z, largest)
        terms, largest_terms, terms_of_x, slope = sums
        terms += abs(q[i])
        wrong = abs(p[i])
        if np.isnan(wrong) or (room[i] > 0.0 and wrong > 0.0 and not wrong + terms < np.inf):
            shares[:] = np.inf
        own = loss * terms
        most = np.inf
        if is_x[i] and largest_q[i] > 0.0:
            most = gradient_noise * min(largest_q[i], terms)
        noise = max(own, min(loss * largest_terms, most))
        strict = wrong - min(own, most)
        reach = terms_of_x / diagonal[i] if diagonal[i] > 0.0 else abs(z[i])
        if strict > 0.0:
            gap += strict * min(room[i], reach)
        if is_x[i]:
            curvature += z[i] * slope
            linear += abs(z[i]) * (abs(q[i]) + noise)
            if room[i] == 0.0:
                side_terms -= z[i] * p[i]
        else:
            side_terms += z[i] * q[i]
        if room[i] > 0.0:
            if wrong > noise:
                shares[0] = max(shares[0], (wrong - noise) / terms)
            if wrong > own:
                share = (wrong - own) / terms
                shares[1] = max(shares[1], share)
                if terms > UNIT_ROUNDOFF * largest_terms:
                    shares[2] = max(shares[2], share)
    return gap, curvature, linear, side_terms
