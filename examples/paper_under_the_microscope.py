r"""What of the paper holds, what had to be mended, and what fails? Every statement, tested by the smallest numbers.

Kumar, Deepmala and Das, *More on modulus based iterative method for solving implicit complementarity problem*, is where
this package began. Each of its statements is here with numbers that show a verdict, computed live. A line that does not
show it would be marked NO, and the count at the end is made of what was shown.

Run: python examples/paper_under_the_microscope.py      writes paper_under_the_microscope.png and .svg into the current
folder, and paper_counterexamples.png
"""

# %%
# ## Contents
#
# 1. [The model](#the-model), and what the verdicts mean
# 2. [Words and lemmas](#words-and-lemmas): M-matrices, the modulus identity, an inequality
# 3. [The equation and the methods](#the-equation-and-the-methods): theorem 3.1, method 3.1, its members, where to start
#    and when to stop
# 4. [When it converges](#when-it-converges): theorems 4.1 to 4.4
# 5. [What is seen](#what-is-seen): four promises and what became of them
# 6. [What no theorem here can give](#what-no-theorem-here-can-give): the wheel
# 7. [The count](#the-count), and [what it means for you](#what-this-means-for-you)
# 8. [One thing to vary](#vary-one-thing), and [exercises](#exercises)
#
# ## The model
#
# Find $z$ with $p = Az + q \ge 0$, $r = z - \psi(z) \ge 0$ and $p^\top r = 0$, where
# $|\psi(x) - \psi(y)| \le G|x - y|$. In what follows $D = \mathrm{diag}(A)$, $B = D - A$, $e = (1, \ldots, 1)$.
# $\varphi$ is a diagonal matrix, $\varphi_1$ and $\varphi_2$ are positive ones, and $\Omega = \varphi_1^{-1}\varphi_2$.
# With a splitting $A = M_1 - N_1$ the matrix of a step is $X = M_1 + \varphi + \Omega$.
#
# - **holds**: true as it is printed, perhaps with hypotheses that are not needed;
# - **mended**: misprinted, and it can be seen what was meant;
# - **fails**: it promises something that an example refutes, and needs another condition or formula.

from itertools import islice, product

import matplotlib.pyplot as plt
import numpy as np

import icpmodel as icp
from icpmodel.theory import check, classify, predicted_rate

HOLDS, MENDED, FAILS, NOT_SHOWN = "holds", "mended", "fails", "NOT SHOWN"
FOUND = {}  # statement: (verdict, what is right)


def judge(name, verdict, right, *seen):
    """Print and keep the verdict; `seen` are pairs (line, whether it agrees)."""
    FOUND[name] = (verdict if all(shows for _, shows in seen) else NOT_SHOWN, right)
    print(f"{name}: {FOUND[name][0]}")
    for line, shows in seen:
        print(f"{'  ' if shows else 'NO'} {line}")


def after(k, problem, method, z):
    """zᵏ by the package's method, from z."""
    return next(islice(method.iterates(problem, np.array(z, dtype=float)), k, None))[0]


def printed_step(A, q, psi, M1, N1, phi, phi1, phi2, z):
    """Method 3.1, the formula of the paper written out."""
    F, P1, P2 = (np.diag(np.broadcast_to(d, len(z))) for d in (phi, phi1, phi2))
    modulus = np.abs((P1 @ A - P2) @ z + P1 @ q + P2 @ psi(z))
    return np.linalg.solve(
        P1 @ M1 + P1 @ F + P2, (P1 @ N1 + P1 @ F) @ z + modulus - P1 @ q + P2 @ psi(z)
    )


def refuted(theorem, problem, method):
    """The theorem as printed promises convergence, the corrected one does not."""
    printed, corrected = (
        check(theorem, problem, method, as_printed=flag) for flag in (True, False)
    )
    return [
        (f"as printed, convergence?  {printed}", printed.holds is True),
        (f"corrected, convergence?   {corrected}", corrected.holds is False),
    ]


def grows(problem, method, solution, h):
    """By what one step multiplies a small error h of the solution, in one unknown."""
    factor = (after(1, problem, method, [solution + h])[0] - solution) / h
    known = problem.residual([solution]) < 1e-12
    return (
        f"z* = {solution:g}, and a step multiplies the error by {factor:.6g}",
        known and abs(factor) > 1,
    )


# a problem of four unknowns, drawn at random, for identities
rng = np.random.default_rng(2022)
A4, G4, z4, phi4 = (
    rng.normal(size=(4, 4)) + 5 * np.eye(4),
    rng.normal(size=(4, 4)) / 9,
    *rng.normal(size=(2, 4)),
)
four = icp.ICP(A4, rng.normal(size=4), icp.Affine(G4, rng.normal(size=4)))
one, two = rng.uniform(0.5, 3, size=(2, 4))  # any φ₁ and φ₂
D4, L4, U4 = np.diag(np.diag(A4)), -np.tril(A4, -1), -np.triu(A4, 1)

# %%
# ## Words and lemmas
#
# ### M-matrices: holds
#
# An *M-matrix* is a Z-matrix with $A^{-1} \ge 0$, and then some positive diagonal $U$ makes $AU$ strictly dominant
# (lemma 2.3). Both are true. An M-matrix is here never singular, though other books call singular matrices so, and
# "P-matrix" and "H-splitting" are used without a definition.

matrices = [
    np.array([[a, b], [c, 2.0]])
    for a, b, c in product((-1, 1, 3), (-3, -1, 0), (-2, -1, 0))
]
agree = [
    classify(A).m.holds is bool((np.linalg.inv(A) >= 0).all())
    for A in matrices
    if np.linalg.det(A)
]
singular = classify([[1, -1], [-1, 1]]).m
A = np.array([[1, -2], [-0.25, 1]])
U = classify(A).generalised_dominant.witness
judge(
    "M-matrix",
    HOLDS,
    "never singular; 'P-matrix' and 'H-splitting' are not defined",
    (
        f"{len(agree)} Z-matrices: classify(A).m and the inverse agree {sum(agree)} "
        "times",
        all(agree),
    ),
    (f"(1, -1; -1, 1), singular, is an M-matrix? {singular}", singular.holds is False),
    (
        f"A = (1, -2; -0.25, 1), U = diag({U[0]:g}, {U[1]:.4f}): AUe = {A @ U}",
        (U > 0).all() and (A @ U > 0).all(),
    ),
)

# %%
# ### Lemma 2.1: holds
#
# $x \ge 0$, $y \ge 0$ and $x^\top y = 0$ if and only if $x + y = |x - y|$. All of the method is in it, and it is
# best used as an identity: $|x - y| = x + y - 2\min(x, y)$.

pairs = np.array(list(product(range(-2, 3), repeat=4))).reshape(-1, 2, 2)
left = [bool((x >= 0).all() and (y >= 0).all() and x @ y == 0) for x, y in pairs]
right = [bool((x + y == np.abs(x - y)).all()) for x, y in pairs]
judge(
    "Lemma 2.1",
    HOLDS,
    "in numbers: |x − y| = x + y − 2 min(x, y)",
    (
        f"{len(pairs)} pairs of vectors: left side true for {sum(left)}, right side "
        f"for {sum(right)}",
        left == right,
    ),
)

# %%
# ### Lemma 2.2: holds
#
# For strictly diagonally dominant $A$,
# $\|A^{-1}E\|_\infty \le \max_i\, (|E|e)_i / (\langle A\rangle e)_i$. It is attained.


def ratio(A, E):
    """The left side over the right one."""
    low = 2 * np.abs(np.diag(A)) - np.abs(A).sum(axis=1)
    return (
        np.abs(np.linalg.solve(A, E)).sum(axis=1).max()
        / (np.abs(E).sum(axis=1) / low).max()
    )


cases = np.random.default_rng(1).normal(size=(200, 2, 3, 3))
worst = max(
    ratio(B + np.diag(np.sign(np.diag(B)) * np.abs(B).sum(axis=1)), E) for B, E in cases
)
equal = ratio(np.array([[2, -1], [-1, 3]]), np.diag([1, 2]))
judge(
    "Lemma 2.2",
    HOLDS,
    "the bound is attained",
    (f"left over right in {len(cases)} random cases: at most {worst:.3f}", worst <= 1),
    (
        f"A = (2, -1; -1, 3), E = diag(1, 2): left over right = {equal:.3f}",
        abs(equal - 1) < 1e-12,
    ),
)

# %%
# ## The equation and the methods
#
# ### Theorem 3.1: holds
#
# $z$ is a solution if and only if
#
# $$(\varphi_1 A + \varphi_2)z
# = |(\varphi_1 A - \varphi_2)z + \varphi_1 q + \varphi_2\psi(z)| - \varphi_1 q + \varphi_2\psi(z).$$
#
# The difference of the two sides is $2\varphi_1 \min(p, \Omega r)$, so that they are equal exactly where that is zero.
# (The paper wants $z - \psi(z)$ to be invertible, and never uses it.)

psi_z = four.psi.value(z4)
right = (
    np.abs(one * (A4 @ z4) - two * z4 + one * four.q + two * psi_z)
    - one * four.q
    + two * psi_z
)
defect, twice = (
    one * (A4 @ z4) + two * z4 - right,
    2 * one * four.natural_map(z4, two / one),
)
judge(
    "Theorem 3.1",
    HOLDS,
    "that z − ψ(z) be invertible is not needed",
    (f"left - right           = {defect.round(5)} at a random z", True),
    (
        f"2 phi1 min(p, Omega r) = {twice.round(5)}",
        np.allclose(defect, twice, rtol=0, atol=1e-12),
    ),
)

# %%
# ### Method 3.1: holds
#
# $$(\varphi_1 M_1 + \varphi_1\varphi + \varphi_2)z^+
# = (\varphi_1 N_1 + \varphi_1\varphi)z + |(\varphi_1 A - \varphi_2)z + \varphi_1 q + \varphi_2\psi(z)| - \varphi_1 q
# {} + \varphi_2\psi(z).$$
#
# It is the same as $z^+ = z - 2X^{-1}\min(p, \Omega r)$: of five parameters two are left, $X$ and $\Omega$. $\varphi_1$
# only rescales, and $\varphi$ only shifts $M_1$.

M1 = D4 - L4
paper = printed_step(A4, four.q, four.psi.value, M1, M1 - A4, phi4, one, two, z4)
X = M1 + np.diag(phi4 + two / one)
short = z4 - 2 * np.linalg.solve(X, np.minimum(four.p(z4), two / one * four.r(z4)))
package = after(1, four, icp.MNMGS(phi=phi4, phi1=one, phi2=two), z4)
scaled = after(1, four, icp.MNMGS(phi=phi4, phi1=7 * one, phi2=7 * two), z4)
judge(
    "Method 3.1",
    HOLDS,
    "it is z⁺ = z − 2X⁻¹ min(p, Ωr): φ₁ only rescales, φ only shifts M₁",
    (
        f"the formula of the paper:   {paper.round(7)}",
        np.allclose(paper, package, rtol=0, atol=1e-12),
    ),
    (
        f"z - 2 X^-1 min(p, Omega r): {short.round(7)}",
        np.allclose(paper, short, rtol=0, atol=1e-12),
    ),
    (
        "phi1 and phi2 times 7 change nothing",
        np.allclose(package, scaled, rtol=0, atol=1e-12),
    ),
)

# %%
# ### The residual: fails
#
# $\mathrm{Res}(z) = \|\min(z - \psi(z), Az + q)\|_2$ "is the Euclidean norm of the error vector", and
# $\mathrm{Res} < \varepsilon$ ends the iteration. It is no norm of the error. What bounds the error is
# `icp.error_bound`, and [a lesson](what_a_bound_is_worth.md) is about it.

soft, z = icp.ICP([[1e-6]], [-1e-6]), np.array([2.0])
res, bound, error = (
    soft.paper_residual(z),
    icp.error_bound(soft, z).value,
    abs(z[0] - 1),
)
judge(
    "Residual",
    FAILS,
    "it is no error; icp.error_bound(problem, z) bounds the error",
    (
        f"A = 1e-6, q = -1e-6, psi = 0, z* = 1: Res({z[0]:g}) = {res:.3g}, and the "
        f"error is {error:g}",
        res < error,
    ),
    (f"icp.error_bound: at most {bound:.6g}", error <= bound < 1.001 * error),
)

# %%
# ### The start: holds
#
# "Consider a nonnegative initial vector $z^{(0)}$." Any start serves. And $z$ itself may be negative: only $p$ and $r$
# have a sign.

below = icp.ICP([[2, -1], [-1, 2]], [4, 5], -10.0)
z = after(80, below, icp.MNMGS(), [-1e6, -1e6])
judge(
    "Start",
    HOLDS,
    "any start serves; z* itself may be negative",
    (
        f"A = (2, -1; -1, 2), q = (4, 5), psi = -10, from (-1e6, -1e6): z = {z}",
        below.residual(z) < 1e-9,
    ),
    ("every entry of this solution is negative", (z < 0).all()),
)

# %%
# ### The remark: mended
#
# "$\varphi_1 = I$ and $\varphi = 0$ in Equation (2)" give the older method NMMS. Equation (2) has no $\varphi$; method
# 3.1 was meant. The converse is true as well: all of the new family is NMMS, with the splitting $M_1 + \varphi$ and
# with $\Omega$.

new = after(3, four, icp.Modulus(splitting=D4 - L4, phi=phi4, phi1=one, phi2=two), z4)
old = after(3, four, icp.NMMS(splitting=D4 - L4 + np.diag(phi4), omega=two / one), z4)
judge(
    "Remark",
    MENDED,
    "in method 3.1; conversely the family is NMMS with M₁ + φ and Ω",
    (f"three steps of method 3.1: {new.round(7)}", True),
    (
        f"three steps of NMMS:       {old.round(7)}",
        np.allclose(new, old, rtol=0, atol=1e-12),
    ),
)

# %%
# ### MNMMOD: mended
#
# $(A + \varphi + \theta_1 I)z^+ = \varphi z + |(A - \theta_1 I)z + q\psi(z)| - q + \psi(z)$. A plus sign is lost
# between $q$ and $\psi$, and both $\psi$ lost their factor $\theta_1$: $|(A - \theta_1 I)z + q + \theta_1\psi(z)| - q +
# \theta_1\psi(z)$.

q, psi, theta, literal, plus = 1.0, 1.0, 2.0, 0.0, 0.0
for _ in range(80):
    literal = (abs((1 - theta) * literal + q * psi) - q + psi) / (1 + theta)
    plus = (abs((1 - theta) * plus + q + psi) - q + psi) / (1 + theta)
right = after(80, icp.ICP([[1.0]], [q], psi), icp.MNMMOD(theta1=theta), [0.0])[0]
judge(
    "MNMMOD",
    MENDED,
    "|(A − θ₁I)z + q + θ₁ψ(z)| − q + θ₁ψ(z): a + and two factors θ₁ are lost",
    (
        f"A = q = psi = 1, theta1 = 2, z* = 1: as printed the limit is {literal:.6f}",
        abs(literal - 1) > 0.1,
    ),
    (f"with only the + restored {plus:.6f}", abs(plus - 1) > 0.1),
    (f"icp.MNMMOD {right:.6f}", abs(right - 1) < 1e-12),
)

# %%
# ### The triangles: mended
#
# "$L_1$, $U_1$ are the strictly lower, upper triangular matrices of $A$", and Gauss–Seidel has $M_1 = D_1 - L_1$,
# $N_1 = U_1$. Then $M_1 - N_1$ is not $A$: it is $-L$ and $-U$ that are the triangles, $A = D - L - U$.

A, q, z = np.array([[4.0, -1], [-2, 4]]), np.array([-3.0, -2]), np.zeros(2)
M1, N1 = np.diag([4.0, 4]) - np.tril(A, -1), np.triu(A, 1)
for _ in range(200):
    z = printed_step(A, q, np.zeros_like, M1, N1, 0, 1, 4, z)
right = after(200, icp.ICP(A, q), icp.MNMGS(), [0, 0])
judge(
    "L and U",
    MENDED,
    "A = D − L − U: −L and −U are the strict triangles of A",
    (
        f"A = (4, -1; -2, 4), q = (-3, -2), z* = (1, 1): as printed the limit is {z}",
        np.abs(z - 1).max() > 0.1,
    ),
    (f"A - (M1 - N1) = {(A - M1 + N1).tolist()} is not zero", (A != M1 - N1).any()),
    (f"icp.MNMGS {right}", np.abs(right - 1).max() < 1e-12),
)

# %%
# ### The members: holds
#
# MNMOD has $M_1 = A$ and $\Omega = I$. MNMAOR has $M_1 = (D - \theta_2 L)/\theta_1$ and $N_1 = ((1 - \theta_1)D +
# (\theta_1 - \theta_2)L + \theta_1 U)/\theta_1$, with MNMSOR, MNMGS and MNMJ in it. True, once $A = D - L - U$.

thetas, free = (
    ((1.2, 0.7), (0.8, 0.8), (1, 1), (1, 0)),
    {"phi": phi4, "phi1": one, "phi2": two},
)
methods = (
    icp.MNMAOR(theta1=1.2, theta2=0.7, **free),
    icp.MNMSOR(theta1=0.8, **free),
    icp.MNMGS(**free),
    icp.MNMJ(**free),
)
M = [(D4 - b * L4) / a for a, b in thetas]
N = [((1 - a) * D4 + (a - b) * L4 + a * U4) / a for a, b in thetas]
cases = [
    (icp.MNMOD(phi=phi4), A4, 0 * A4, 1, 1),
    *zip(methods, M, N, [one] * 4, [two] * 4, strict=True),
]
seen = []
for method, M1, N1, phi1, phi2 in cases:
    paper = printed_step(A4, four.q, four.psi.value, M1, N1, phi4, phi1, phi2, z4)
    gap = np.abs(paper - after(1, four, method, z4)).max()
    seen += [
        (
            f"the step of icp.{type(method).__name__} differs by {gap:.0e} at a "
            "random z",
            gap < 1e-12,
        )
    ]
judge("Members", HOLDS, "nothing, once A = D − L − U", *seen)

# %%
# ## When it converges
#
# ### Theorem 4.1: holds
#
# Let $A$ be a P-matrix and $\rho(\mathcal L) < 1$ with
# $\mathcal L = |X^{-1}|(|N_1 + \varphi| + |A - \Omega| + 2\Omega G)$. Then the method converges from every $z^0 \ge 0$.
#
# True, and more is: for any square matrix and any start. $\rho(\mathcal L) < 1$ brings the solution with it, and $A$
# then *is* a P-matrix. That $A$ be one is not enough for itself.

matrices = np.random.default_rng(4).normal(size=(300, 3, 3)) + np.eye(3)
held = [A for A in matrices if check("4.1", icp.ICP(A, [0, 0, 0]), icp.MNMOD()).holds]
p = sum(classify(A).p.holds for A in held)
wheel = icp.ICP([[1, 0, 2], [2, 1, 0], [0, 2, 1]], [-1, -1, -1])
found, res = (
    check("4.1", wheel, icp.MNMGS()),
    wheel.residual(after(2000, wheel, icp.MNMGS(), [1, 0, 0])),
)
judge(
    "Theorem 4.1",
    HOLDS,
    "for any square A and any start: ρ(L) < 1 brings a solution, and A is then a "
    "P-matrix",
    (
        f"{len(matrices)} random A, MNMOD: rho(L) < 1 for {len(held)}, of which "
        f"P-matrices {p}",
        len(held) == p > 9,
    ),
    (
        f"the P-matrix (1, 0, 2; 2, 1, 0; 0, 2, 1): {found}",
        classify(wheel.A).p.holds and not found.holds,
    ),
    (f"there Gauss-Seidel has the residual {res:.3g} after 2000 steps", res > 0.1),
)

# %%
# ### Its proof: fails
#
# "Since $\rho(\mathcal L) < 1$, $|z^{k+1} - z^*| < |z^k - z^*|$", entry by entry. An entry that is right can be spoilt
# by the others. What is true is $|z^{k+1} - z^*| \le \mathcal L|z^k - z^*|$, and what falls is $\max_i |z^k_i -
# z^*_i|/v_i$ for some $v > 0$.

A = np.array([[2, -1], [-0.5, 2]])
problem, method, z0 = icp.ICP(A, -A @ [1, 1]), icp.MNMGS(), np.array([1.0, 3.0])
e0, e1 = np.abs(z0 - 1), np.abs(after(1, problem, method, z0) - 1)
found, rate = check("4.1", problem, method), predicted_rate(problem, method)
shrunk = (e1 / rate.v).max() / (e0 / rate.v).max()
judge(
    "Proof of 4.1",
    FAILS,
    "|zᵏ⁺¹ − z*| ≤ L|zᵏ − z*|; what falls is max |zᵏ − z*|ᵢ/vᵢ with some v > 0",
    (f"A = (2, -1; -0.5, 2), Gauss-Seidel, Omega = D: {found}", found.holds is True),
    (f"z0 = {z0}: |e0| = {e0}, |e1| = {e1}: the first entry grows", e1[0] > e0[0]),
    (f"max |e|/v with v = {rate.v.round(3)} is multiplied by {shrunk:.4f}", shrunk < 1),
    (f"predicted_rate: at most {rate.factor:.4f}", shrunk <= rate.factor < 1),
)

# %%
# ### Theorem 4.2: mended
#
# With $\varphi_1 = (w_{ij})$, $\varphi_2 = (\xi_{ij}) \ge \varphi_1 D$: if $2\xi_{ii}g_{ij} \le |w_{ij}m_{ij}| +
# |w_{ij}n_{ij}| - |w_{ij}a_{ij}|$ and $g_{ii}$ has a bound alike, the method converges.
#
# $\varphi_1$ is diagonal, so that $w_{ij} = 0$ for $i \ne j$, and $G$ must be diagonal; $w_{ii}$ was meant. That is
# true, and useless where $\psi$ couples unknowns: for the sweeps it still forces $g_{ij} = 0$ unless $\theta_2 >
# \theta_1$ or $\theta_2 < 0$. The corrected theorem takes any small $G$.

A = np.array([[1, -0.2, 0.1], [0.1, 1, 0.3], [-0.2, 0.1, 1]])  # φ = 0, φ₁ = φ₂ = D = I
problem = icp.ICP(A, [0, 0, 0], icp.Affine(1e-6 * np.tril(np.ones((3, 3)), -1)))


def largest(w, M):
    """The largest off-diagonal entry that the condition leaves to G."""
    return (
        (np.abs(w * M) + np.abs(w * (M - A)) - np.abs(w * A)) * (1 - np.eye(3))
    ).max() / 2


seen = []
for a, b in ((1, 0), (1, 1), (0.8, 0.8), (1.2, 1.2), (1, 1.4)):
    method = icp.MNMAOR(theta1=a, theta2=b)
    M = method.splitting_of().matrix(problem.A).toarray()
    literal, meant = largest(np.eye(3), M), largest(1, M)
    printed, useful = (
        check("4.2", problem, method, as_printed=flag).holds for flag in (True, False)
    )
    text = f"theta = ({a}, {b}): g_ij <= {literal:g} as printed, {meant:.2f} as meant"
    shows = literal == 0 and useful and printed == (meant > 1e-9) == (b > a)
    seen += [(f"{text}; G = 1e-6: meant {printed}, corrected {useful}", shows)]
judge("Theorem 4.2", MENDED, "wᵢᵢ for wᵢⱼ; the corrected one takes any small G", *seen)

# %%
# ### Theorem 4.3, the parentheses: fails
#
# Let $\varphi_2 \ge \varphi_1 D$ and
# $\max(\theta_1, \theta_2)\ \rho(D^{-1}|B| + \varphi_2 G) < \min(1, \theta_1)$. (The paper writes $\varphi_1 D$ and
# $\varphi_1 B$, from which $\varphi_1$ cancels.) Then MNMAOR converges.
#
# The number must be $\rho(D^{-1}(|B| + \Omega G))$: $D^{-1}$ stands before both terms, as it does at the end of the
# proof. $\varphi_1$ cancels from the second one as well.

circle, gauss_seidel = (
    icp.ICP([[0.1]], [1.0], icp.Affine([[-5.0]], 6.0)),
    icp.MNMGS(phi1=1.0, phi2=0.1),
)
same = check("4.3", circle, icp.MNMGS(phi1=100.0, phi2=10.0), as_printed=True)
orbit, exact = (
    [after(k, circle, gauss_seidel, [2.0])[0] for k in (400, 401, 402)],
    circle.residual([1.0]) < 1e-12,
)
judge(
    "4.3 parentheses",
    FAILS,
    "ρ(D⁻¹(|B| + ΩG)): D⁻¹ stands before both terms, and φ₁ cancels",
    ("A = 0.1, q = 1, psi(z) = 6 - 5z, Gauss-Seidel with phi1 = 1, phi2 = 0.1", True),
    *refuted("4.3", circle, gauss_seidel),
    (
        f"phi1 = 100, phi2 = 10, the same method, as printed: {same}",
        same.holds is False,
    ),
    (
        f"z* = 1; z400, z401, z402 from z0 = 2: {np.round(orbit, 6)}",
        exact and np.ptp(orbit) > 1,
    ),
)

# %%
# ### Theorem 4.3, the shift: fails
#
# The same, with "$\varphi$ a diagonal matrix", of any sign. $\varphi \ge 0$ must be asked for, also for
# $|X^{-1}| \le (\langle M_1\rangle + |\varphi| + \Omega)^{-1}$ in the proof.

negative, shifted = icp.ICP([[1.0]], [-1.0]), icp.MNMGS(phi=-1.5)
X, proof = (1 + phi + 1 for phi in (shifted.phi, abs(shifted.phi)))
judge(
    "4.3 shift",
    FAILS,
    "φ ≥ 0 must be asked for",
    ("A = 1, q = -1, psi = 0, Gauss-Seidel with phi = -1.5", True),
    *refuted("4.3", negative, shifted),
    (
        f"|X^-1| = {1 / abs(X):.3g}, the proof's bound {1 / proof:.3g}",
        1 / abs(X) > 1 / proof,
    ),
    grows(negative, shifted, 1.0, 0.1),
)

# %%
# ### Theorem 4.3, the sign of θ₂: fails
#
# The same: $0 \le \max(\theta_1, \theta_2)\ \rho < \min(1, \theta_1)$ allows $\theta_2 < 0$, where
# $|\theta_2||L|$ may be anything. $\theta_2 \ge 0$ must be asked for.

A = np.array([[1, -0.5], [-0.5, 1]])
pair, backward = icp.ICP(A, -A @ [1, 1]), icp.MNMAOR(theta1=1.0, theta2=-4.0)
h = 2.0**-20  # near z* the step is linear
T = np.array([(after(1, pair, backward, 1 + h * e) - 1) / h for e in np.eye(2)]).T
radius = np.abs(np.linalg.eigvals(T)).max()
judge(
    "4.3 sign",
    FAILS,
    "θ₂ ≥ 0 must be asked for",
    ("A = (1, -0.5; -0.5, 1), psi = 0, z* = (1, 1), theta = (1, -4)", True),
    *refuted("4.3", pair, backward),
    (
        f"the matrix that multiplies the error has the spectral radius {radius:.4f}",
        radius > 1,
    ),
)

# %%
# ### Theorem 4.4, case 1: fails
#
# For $\varphi_2 \ge \varphi_1 D$ and a positive diagonal $U$: if
# $(\langle\varphi_1 M_1 + \varphi\rangle - |\varphi_1 N_1 + \varphi| - \varphi_2 G)Ue > 0$, the method converges.
#
# $\varphi$ must have the factor $\varphi_1$, like all the rest:
# $(\varphi_1(\langle M_1 + \varphi\rangle - |N_1 + \varphi|) - \varphi_2 G)v > 0$ for some $v > 0$, and $D > 0$.


def condition_44(A, M1, phi, phi1, phi2, G, corrected):
    """The left side of both cases for n = 1; corrected: φ times φ₁."""
    shift = phi1 * phi if corrected else phi
    return (
        abs(phi1 * M1 + shift)
        - abs(phi1 * (M1 - A) + shift)
        + min(phi2, phi1 * A)
        - phi1 * A
        - phi2 * G
    )


def theorem_44(q, slope, c, phi2):
    """A = 1, M₁ = .1, φ = .5, φ₁ = .1, ψ(z) = slope·z + c, z* = 1."""
    problem = icp.ICP([[1.0]], [q], icp.Affine([[slope]], c))
    method = icp.Modulus(splitting=[[0.1]], phi=0.5, phi1=0.1, phi2=phi2)
    printed, corrected = (
        condition_44(1, 0.1, 0.5, 0.1, phi2, abs(slope), flag) for flag in (False, True)
    )
    return [
        (
            f"A = 1, q = {q:g}, psi = {c:g} + {slope:g} z, M1 = 0.1, phi = 0.5, "
            f"phi1 = 0.1, phi2 = {phi2:g}",
            True,
        ),
        (
            f"the condition as printed: {printed:.3g} > 0; corrected: "
            f"{corrected:.3g} < 0",
            corrected < 0 < printed,
        ),
        *refuted("4.4", problem, method),
        grows(problem, method, 1.0, 1e-3),
    ], (problem, method)


first, case_1 = theorem_44(q=5.0, slope=-0.9, c=1.9, phi2=0.1)
judge(
    "4.4 case 1",
    FAILS,
    "φ₁φ for φ: (φ₁(⟨M₁ + φ⟩ − |N₁ + φ|) − φ₂G)v > 0 for some v > 0, and D > 0",
    *first,
)

# %%
# ### Theorem 4.4, case 2: fails
#
# For $0 < \varphi_2 < \varphi_1 D$: the same with $\varphi_2 - \varphi_1 D$ added on the left, and the same mistake.
# One formula serves for both cases: add $\min(\varphi_2, \varphi_1 D) - \varphi_1 D$.

second, case_2 = theorem_44(q=-1.0, slope=0.0, c=0.0, phi2=0.01)
judge(
    "4.4 case 2",
    FAILS,
    "the same; one formula for both: add min(φ₂, φ₁D) − φ₁D",
    *second,
)

# %%
# ### Theorem 4.4, its other clauses: mended
#
# "$A$ is an H₊-matrix, and $(\langle M_1 + \varphi\rangle - (N_1 + \varphi))U$ is strictly diagonally dominant."
# The modulus $|N_1 + \varphi|$ was meant. Beside the condition only $D > 0$ is needed; without it there may be no step
# at all, or two solutions and iterates that run away from both.

M, A = 0.4, 1.0
printed, meant = abs(M) - (M - A), abs(M) - abs(M - A)
value = condition_44(-1, -1, 0, 1, 1, 0, corrected=True)
found = check("4.4", icp.ICP([[-1.0]], [0.0]), icp.Modulus(splitting="whole", phi2=1.0))
twofold, whole = icp.ICP([[-1.0]], [1.0]), icp.Modulus(splitting="whole", phi2=2.0)
ends, far = (
    [z for z in (0.0, 1.0) if twofold.residual([z]) == 0],
    after(40, twofold, whole, [3.0])[0],
)
judge(
    "4.4 clauses",
    MENDED,
    "|N₁ + φ| for (N₁ + φ); beside the condition only D > 0 is needed",
    (
        f"A = 1, M1 + phi = 0.4: {printed:.3g} as printed, {meant:.3g} as meant",
        meant < 0 < printed,
    ),
    (
        f"A = M1 = -1, Omega = 1: the condition reads {value:g} > 0, but X = M1 + "
        "Omega = 0",
        value > 0,
    ),
    (f"corrected, convergence?   {found}", found.holds is False),
    (
        f"A = M1 = -1, q = 1: solutions {ends}; from 3, Omega = 2, z40 = {far:.1g}",
        len(ends) == 2 and far > 1e9,
    ),
)

# %%
# ## What is seen
#
# Four examples for which the printed theorems promise convergence, from a start a thousandth away from the solution. To
# the right the first of them: the printed number is 0.5, the right one 5, and the walk on the V of
# [one unknown](modulus_in_one_unknown.md) ends in a square.

PROMISED = {
    "4.3, parentheses": (circle, gauss_seidel, "#0072B2", "o"),
    "4.3, shift": (negative, shifted, "#D55E00", "s"),
    "4.3, sign": (pair, backward, "#009E73", "D"),
    "4.4, case 1": (*case_1, "#CC79A7", "^"),
}
figure, (fate, web) = plt.subplots(
    1, 2, figsize=(10, 4.2), width_ratios=[1.5, 1], layout="constrained"
)
for name, (problem, method, colour, marker) in PROMISED.items():
    start = np.full(problem.n, 1.0) + 1e-3 * np.arange(
        1, problem.n + 1
    )  # all four have z* = 1
    error = [
        np.abs(z - 1).max() for z, _ in islice(method.iterates(problem, start), 41)
    ]
    fate.semilogy(error, marker=marker, color=colour, markersize=4, linewidth=1)
    last = max(k for k, one in enumerate(error) if one < 1e4)
    fate.annotate(
        name,
        (last, error[last]),
        (6, 0),
        textcoords="offset points",
        va="center",
        fontsize=9,
    )
fate.axhline(1e-3, color="0.6", linewidth=1)
fate.annotate(
    "all of them were promised to fall below this line",
    (2, 3e-4),
    color="0.4",
    fontsize=9,
)
fate.set(
    xlim=(0, 54),
    ylim=(1e-4, 1e4),
    xlabel="steps",
    ylabel="largest error",
    title="Promised to converge",
)
grid = np.linspace(-20, 70, 300)
web.plot(grid, grid, color="0.6", linewidth=1)
web.plot(
    grid,
    [after(1, circle, gauss_seidel, [z])[0] for z in grid],
    color="#0072B2",
    linewidth=2,
)
z = np.repeat([after(k, circle, gauss_seidel, [2.0])[0] for k in range(10)], 2)
web.plot(z[:-1], np.append(2.0, z[2:]), color="black", linewidth=0.9)
web.plot(1, 1, "*", color="black", markersize=9)
web.set(
    xlabel="z",
    ylabel="$z^+$, after one step",
    title="4.3: a square instead of the star",
)
for axes in (fate, web):
    axes.spines[["top", "right"]].set_visible(False)
figure.savefig("paper_counterexamples.png", dpi=150)

# %%
# ## What no theorem here can give
#
# The abstract promises conditions "when the system matrix is a P-matrix". Being one is not enough for the members that
# the paper names. On the wheel of theorem 4.1 the step with $M_1 = A$ and $\Omega = \omega I$ turns the error in the
# plane across $(1, 1, 1)$. It never shrinks it, whatever $\omega$ is. Gauss–Seidel is in a circle of two. [Why
# relaxation helps](why_relaxation_helps.md) has the picture, and a step that does converge.

for omega in (0.5, 1.0, 2.0, 8.0):
    error = [
        z - 1 / 3
        for z, _ in islice(
            icp.MNMMOD(theta1=omega).iterates(wheel, np.array([0.4, 0.3, 0.3])), 201
        )
    ]
    sizes = [np.linalg.norm(error[k] - error[k].mean()) for k in (0, 1, 200)]
    print(
        f"omega = {omega:3.1f}: in that plane "
        f"{', '.join(f'{one:.6f}' for one in sizes)} after 0, 1, 200 steps"
    )
    assert np.ptp(sizes) < 1e-9, "the error keeps its size"

# %%
# ## The count
#
# In the order of the paper:

width = max(map(len, FOUND))
for name, (verdict, correction) in FOUND.items():
    print(f"{name:{width}}  {verdict:9}  {correction}")
count = {
    verdict: sum(found == verdict for found, _ in FOUND.values())
    for verdict in (HOLDS, MENDED, FAILS, NOT_SHOWN)
}
print(
    f"\nOf {len(FOUND)} statements {count[HOLDS]} hold, {count[MENDED]} were mended "
    f"and {count[FAILS]} fail.",
    end="",
)
print(f" {count[NOT_SHOWN]} are not shown by their numbers.")

# %%
# The first half of the paper, the equation and the methods, is sound but for misprints and one word on the residual.
# What fails is in the conditions for convergence.

SHADES = {HOLDS: "#009E73", MENDED: "#E69F00", FAILS: "#D55E00", NOT_SHOWN: "0.6"}
SIGNS = {HOLDS: "✓", MENDED: "~", FAILS: "×", NOT_SHOWN: "?"}
figure, tiles = plt.subplots(figsize=(10, 2.9), layout="constrained")
for k, (name, (verdict, _)) in enumerate(FOUND.items()):
    column, row = k % 7, k // 7
    tiles.add_patch(
        plt.Rectangle(
            (column, -row),
            0.94,
            -0.9,
            facecolor=SHADES[verdict],
            alpha=0.3,
            linewidth=0,
        )
    )
    tiles.text(column + 0.47, -row - 0.3, name, ha="center", va="center", fontsize=8.5)
    tiles.text(
        column + 0.47,
        -row - 0.62,
        f"{SIGNS[verdict]} {verdict}",
        ha="center",
        va="center",
        fontsize=9,
    )
tiles.set(xlim=(0, 7), ylim=(-3, 0.1))
tiles.axis("off")
tiles.set_title(
    f"{count[HOLDS]} hold, {count[MENDED]} mended, {count[FAILS]} fail", fontsize=11
)
for suffix in ("png", "svg"):
    figure.savefig(f"paper_under_the_microscope.{suffix}", dpi=150)

# %%
# ## What this means for you
#
# - **The methods are right**, and you may use them: take the formulas from here or from `icp.MNMGS` and its sisters,
#   not from the display of MNMMOD.
# - **Do not tune five parameters.** Only $X$ and $\Omega$ matter. $\Omega = D$ is a good one; $\varphi_1$ does nothing.
# - **Do not trust a printed condition.** Ask `icp.theory.check` or `icp.theory.predicted_rate`, which hold, and say how
#   many steps it takes.
# - **Start anywhere**, at the answer of yesterday for instance.
# - **Do not stop at a residual** if it is the error that you care for: `solve(..., accuracy=1e-6)`.
# - **Of speed it says nothing**: the paper has no experiments. [Those of this package](../research.md#the-experiments)
#   are in the form of its literature.
# - **Where no theorem applies**, try and see: what comes out is judged by a certificate that does not depend on how it
#   was found.

problem, method = (
    icp.ICP([[4, -1], [-2, 4]], [-3, -2], icp.Affine([[0, 0.2], [0.2, 0]])),
    icp.MNMGS(),
)
rate = predicted_rate(problem, method)
answer = problem.solve(method, accuracy=1e-6, z0=[-100, 100])
print(
    f"promised: a step leaves {rate.factor:.3f}; "
    f"{rate.steps(problem, [-100, 100], 1e-6)} steps from (-100, 100)"
)
print(
    f"needed:   {answer.iterations} steps; certified error "
    f"{answer.certificate.error_bound:.1e}"
)
assert answer.iterations <= rate.steps(problem, [-100, 100], 1e-6), (
    "it takes no more steps than predicted"
)

# %%
# ## Vary one thing
#
# The slope of the obstacle in the first counterexample to theorem 4.3, $\psi(z) = 1 + (1 - z)s$, with $z^* = 1$ for
# every $s$. The printed number is $\varphi_2 s = 0.1 s$ and promises convergence for all $s < 10$. The right number is
# $s$, and at $s = 1$ the promise and the walk part.

for s in (0.5, 0.9, 1.1, 5.0, 9.0):
    steep = icp.ICP([[0.1]], [1.0], icp.Affine([[-s]], 1 + s))
    printed, right = (
        check("4.3", steep, gauss_seidel, as_printed=flag).holds
        for flag in (True, False)
    )
    left = abs(after(400, steep, gauss_seidel, [2.0])[0] - 1)
    print(
        f"s = {s}: printed {printed!s:5} corrected {right!s:5} error after 400 "
        f"steps {left:.1e}"
    )
    assert right == (left < 1e-3), "the right number decides"

# %%
# ## Exercises
#
# **1.** In the counterexample with the shift $\varphi = -1.5$ the error is multiplied by $-3$. Up to which negative
# $\varphi$ does that method still converge?
#
# Answer: $A = M_1 = \Omega = 1$, hence $X = 2 + \varphi$. A step multiplies by $1 - 2/(2 + \varphi)$, which is above
# −1 for $\varphi > -1$. A negative shift is not always wrong, only never promised.

for phi in (-0.9, -1.1):
    error = abs(after(200, negative, icp.MNMGS(phi=phi), [1.5])[0] - 1)
    print(
        f"phi = {phi}: factor {1 - 2 / (2 + phi):.3f}, error after 200 steps "
        f"{error:.1e}"
    )
    assert (error < 1e-6) == (phi > -1), "it converges where the shift is above -1"

# %%
# **2.** MNMMOD as printed has $q\psi(z)$ inside the modulus. For which $q$ and $\psi$ (constant, in one unknown) is the
# misprint not seen?
#
# Answer: With $\theta_1 = 1$, where $q\psi = q + \psi$, for example $q = \psi = 2$ (or both 0). The method then walks
# where it should, and a test with such numbers would not find the misprint.

z, q, psi = 0.0, 2.0, 2.0
for _ in range(80):
    z = (abs((1 - 1) * z + q * psi) - q + psi) / (1 + 1)
print(
    f"A = 1, q = psi = 2, theta1 = 1, as printed: {z:g}; solved: "
    f"{icp.ICP([[1.0]], [q], psi).solve().z[0]:g}"
)
assert z == 2.0, "the misprint is not seen"

# %%
# **3.** Of the 300 random matrices in theorem 4.1 how many are P-matrices, and for how many of these does its condition
# hold with MNMOD?
#
# Answer: For few: it is sufficient, by no means necessary. That is why the package tries methods that nothing promises
# as well, and lets a certificate judge.

p_matrices = [A for A in matrices if classify(A).p.holds]
promised = sum(
    check("4.1", icp.ICP(A, [0, 0, 0]), icp.MNMOD()).holds is True for A in p_matrices
)
solved = sum(
    icp.ICP(A, -np.ones(3)).solve(raise_on_failure=False).solved for A in p_matrices
)
print(
    f"{len(p_matrices)} P-matrices; promised for {promised}; solve() finds the "
    f"solution for q = -(1, 1, 1) in {solved}"
)

# a statement whose numbers do not show its verdict ends the lesson
unshown = [name for name, (verdict, _) in FOUND.items() if verdict == NOT_SHOWN]
assert not unshown, f"not shown: {', '.join(unshown)}"
