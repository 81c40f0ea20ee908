"""The paper line by line: what it says, whether it is true, and the smallest numbers that show it, computed live.

Kumar, Deepmala and Das, "More on modulus based iterative method for solving implicit complementarity problem".
p = Az + q, r = z − ψ(z), |ψ(x) − ψ(y)| ≤ G|x − y|, D = diag(A), B = D − A, Ω = φ₂/φ₁, X = M₁ + φ + Ω, N₁ = M₁ − A.

Run: python examples/paper_under_the_microscope.py            everything
     python examples/paper_under_the_microscope.py 4.3 R      what begins with 4.3 or R
Change a number and see: a line that no longer shows its verdict is marked NO, and the exit status is 1.
"""

import itertools
import sys

import numpy as np

import icpmodel as icp
from icpmodel.theory import check, classify, predicted_rate

ITEMS = {}


def item(name, verdict, correction):
    """Enter a function: its docstring is the statement, it yields (a line to print, whether it shows the verdict)."""

    def enter(function):
        ITEMS[name] = (function, verdict, correction)
        return function

    return enter


def after(k, problem, method, z):
    """zᵏ by the package's method, from z."""
    return next(itertools.islice(method.iterates(problem, np.array(z, dtype=float)), k, None))[0]


def printed_step(A, q, psi, M1, N1, phi, phi1, phi2, z):
    """Method 3.1, the formula of the paper written out."""
    F, P1, P2 = (np.diag(np.broadcast_to(d, len(z))) for d in (phi, phi1, phi2))
    modulus = np.abs((P1 @ A - P2) @ z + P1 @ q + P2 @ psi(z))
    return np.linalg.solve(P1 @ M1 + P1 @ F + P2, (P1 @ N1 + P1 @ F) @ z + modulus - P1 @ q + P2 @ psi(z))


def given(problem, method):
    """The numbers of a counterexample in one line."""
    at_0, G = problem.psi.value(np.zeros(problem.n)), problem.psi.lipschitz.toarray()
    psi = f"psi(0) = {at_0.tolist()}, G = {G.tolist()}" if G.any() or at_0.any() else "psi = 0"
    M1 = method.splitting_of().matrix(problem.A).toarray().tolist()
    return f"A = {problem.A.toarray().tolist()}, q = {problem.q.tolist()}, {psi}, {method!r}, M1 = {M1}"


def refuted(theorem, problem, method):
    """The theorem as printed promises convergence, the corrected one does not."""
    yield given(problem, method), True
    printed, corrected = (check(theorem, problem, method, as_printed=flag) for flag in (True, False))
    yield f"as printed, convergence?  {printed}", printed.holds is True
    yield f"corrected, convergence?   {corrected}", corrected.holds is False


rng = np.random.default_rng(2022)
A4, G4, z4, phi4 = rng.normal(size=(4, 4)) + 5 * np.eye(4), rng.normal(size=(4, 4)) / 9, *rng.normal(size=(2, 4))
four = icp.ICP(A4, rng.normal(size=4), icp.Affine(G4, rng.normal(size=4)))  # any problem with n = 4
one, two = rng.uniform(0.5, 3, size=(2, 4))  # any φ₁ and φ₂
D4, L4, U4 = np.diag(np.diag(A4)), -np.tril(A4, -1), -np.triu(A4, 1)
cycle = icp.ICP([[1, 0, 2], [2, 1, 0], [0, 2, 1]], [-1, -1, -1])  # A is a P-matrix, but no H-matrix


@item("2 M", "true, but", "it is never singular; 'P-matrix' and 'H-splitting' are used without a definition")
def m_matrix():
    """An M-matrix is a Z-matrix with A⁻¹ ≥ 0; lemma: then some diagonal U > 0 makes AU strictly dominant."""
    matrices = [np.array([[a, b], [c, 2.0]]) for a, b, c in itertools.product((-1, 1, 3), (-3, -1, 0), (-2, -1, 0))]
    agree = [classify(A).m.holds is bool((np.linalg.inv(A) >= 0).all()) for A in matrices if np.linalg.det(A)]
    yield f"{len(agree)} nonsingular Z-matrices: classify(A).m and the inverse agree {sum(agree)} times", all(agree)
    singular = classify([[1, -1], [-1, 1]]).m
    yield f"[1, -1; -1, 1], elsewhere called a singular M-matrix: {singular}", singular.holds is False
    A = np.array([[1, -2], [-0.25, 1]])
    v = classify(A).generalised_dominant.witness
    yield f"A = {A.tolist()}, U = diag({v.round(4)}): AUe = {(A @ v).round(4)}", (v > 0).all() and (A @ v > 0).all()


@item("2.1", "true", "in numbers: |x − y| = x + y − 2 min(x, y)")
def lemma_modulus():
    """x ≥ 0, y ≥ 0 and xᵀy = 0 if and only if x + y = |x − y|."""
    pairs = np.array(list(itertools.product(range(-2, 3), repeat=4))).reshape(-1, 2, 2)
    left = [bool((x >= 0).all() and (y >= 0).all() and x @ y == 0) for x, y in pairs]
    right = [bool((x + y == np.abs(x - y)).all()) for x, y in pairs]
    yield f"{len(pairs)} pairs of vectors: left side true for {sum(left)}, right side for {sum(right)}", left == right


@item("2.2", "true", "none needed; the bound is attained")
def lemma_inverse():
    """For strictly diagonally dominant A: ‖A⁻¹E‖∞ ≤ max (|E|e)ᵢ/(⟨A⟩e)ᵢ."""

    def ratio(A, E):
        low = 2 * np.abs(np.diag(A)) - np.abs(A).sum(axis=1)
        return np.abs(np.linalg.solve(A, E)).sum(axis=1).max() / (np.abs(E).sum(axis=1) / low).max()

    cases = np.random.default_rng(1).normal(size=(200, 2, 3, 3))
    worst = max(ratio(B + np.diag(np.sign(np.diag(B)) * np.abs(B).sum(axis=1)), E) for B, E in cases)
    yield f"left/right over {len(cases)} random cases: at most {worst:.3f}", worst <= 1
    equal = ratio(np.array([[2, -1], [-1, 3]]), np.diag([1, 2]))
    yield f"A = [2, -1; -1, 3], E = diag(1, 2): left/right = {equal:.3f}", abs(equal - 1) < 1e-12


@item("3.1", "true", "none needed; that z − ψ(z) be invertible is nowhere used")
def theorem_31():
    """z solves the ICP iff (φ₁A + φ₂)z = |(φ₁A − φ₂)z + φ₁q + φ₂ψ(z)| − φ₁q + φ₂ψ(z), φ₁ and φ₂ positive diagonal."""
    psi_z = four.psi.value(z4)
    right = np.abs(one * (A4 @ z4) - two * z4 + one * four.q + two * psi_z) - one * four.q + two * psi_z
    defect, twice = one * (A4 @ z4) + two * z4 - right, 2 * one * four.natural_map(z4, two / one)
    yield f"left - right = {defect.round(6)} at a random z", True
    yield f"2 phi1 min(p, Omega r) = {twice.round(6)}: zero together", np.allclose(defect, twice, rtol=0, atol=1e-12)


@item("3 method", "true, but", "it is z⁺ = z − 2X⁻¹ min(p, Ωr): φ₁ only rescales, and φ only shifts M₁")
def method_31():
    """Method 3.1: (φ₁M₁ + φ₁φ + φ₂)z⁺ = (φ₁N₁ + φ₁φ)z + |(φ₁A − φ₂)z + φ₁q + φ₂ψ(z)| − φ₁q + φ₂ψ(z)."""
    M1 = D4 - L4
    paper = printed_step(A4, four.q, four.psi.value, M1, M1 - A4, phi4, one, two, z4)
    X = M1 + np.diag(phi4 + two / one)
    short = z4 - 2 * np.linalg.solve(X, np.minimum(four.p(z4), two / one * four.r(z4)))
    package = after(1, four, icp.MNMGS(phi=phi4, phi1=one, phi2=two), z4)
    yield f"the formula of the paper: {paper.round(9)}", np.allclose(paper, package, rtol=0, atol=1e-12)
    yield f"z - 2 X^-1 min(p, Omega r): {short.round(9)}", np.allclose(paper, short, rtol=0, atol=1e-12)
    scaled = after(1, four, icp.MNMGS(phi=phi4, phi1=7 * one, phi2=7 * two), z4)
    yield "phi1 and phi2 times 7 change nothing", np.allclose(package, scaled, rtol=0, atol=1e-12)


@item("3 Res", "FALSE AS PRINTED", "it is a residual; icp.error_bound(problem, z) bounds the error")
def residual():
    """Res(z) = ‖min(z − ψ(z), Az + q)‖₂ is 'the Euclidean norm of the error vector'; stop when Res(z) < ε."""
    problem, z = icp.ICP([[1e-6]], [-1e-6]), np.array([2.0])
    res, bound, error = problem.residual(z), icp.error_bound(problem, z).value, abs(z[0] - 1)
    yield f"A = 1e-6, q = -1e-6, psi = 0, z* = 1: Res({z[0]:g}) = {res:.3g}, and the error is {error:g}", res < error
    yield f"icp.error_bound: at most {bound:.6g}", error <= bound < 1.001 * error


@item("3 start", "true, but", "any start serves, and z* itself may be negative: only p and r are signed")
def start():
    """'Consider a nonnegative initial vector z⁰' (Method 3.1, theorems 4.1 to 4.3)."""
    problem = icp.ICP([[2, -1], [-1, 2]], [4, 5], -10.0)
    z = after(80, problem, icp.MNMGS(), [-1e6, -1e6])
    yield f"A = [2, -1; -1, 2], q = (4, 5), psi = -10, from (-1e6, -1e6): z = {z}", problem.residual(z) < 1e-9
    yield "every entry of this solution is negative", (z < 0).all()


@item("3 Remark", "mistyped", "in Method 3.1; (2) has no φ. Conversely the family is NMMS with M₁ + φ and Ω")
def remark():
    """Remark: φ₁ = I and φ = 0 in equation (2) give the NMMS method; so the new family covers it."""
    new = after(3, four, icp.Modulus(splitting=D4 - L4, phi=phi4, phi1=one, phi2=two), z4)
    old = after(3, four, icp.NMMS(splitting=D4 - L4 + np.diag(phi4), omega=two / one), z4)
    yield f"three steps of Method 3.1: {new.round(9)}", True
    yield f"three steps of NMMS:       {old.round(9)}", np.allclose(new, old, rtol=0, atol=1e-12)


@item("3 MNMMOD", "mistyped", "a '+' and two factors θ₁ are lost: |(A − θ₁I)z + q + θ₁ψ(z)| − q + θ₁ψ(z)")
def mnmmod():
    """(A + φ + θ₁I)z⁺ = φz + |(A − θ₁I)z + qψ(z)| − q + ψ(z)."""
    q, psi, theta, literal, plus = 1.0, 1.0, 2.0, 0.0, 0.0
    for _ in range(80):
        literal = (abs((1 - theta) * literal + q * psi) - q + psi) / (1 + theta)
        plus = (abs((1 - theta) * plus + q + psi) - q + psi) / (1 + theta)
    right = after(80, icp.ICP([[1.0]], [q], psi), icp.MNMMOD(theta1=theta), [0.0])[0]
    yield f"A = q = psi = 1, theta1 = 2, z* = 1: as printed the limit is {literal:.6f}", abs(literal - 1) > 0.1
    yield f"with only the + restored {plus:.6f}", abs(plus - 1) > 0.1
    yield f"icp.MNMMOD {right:.6f}", abs(right - 1) < 1e-12


@item("3 L, U", "mistyped", "A = D − L − U: −L and −U are the strict triangles of A")
def triangles():
    """L₁ and U₁ are the strictly lower and upper triangular matrices of A; Gauss–Seidel: M₁ = D₁ − L₁, N₁ = U₁."""
    A, q, z = np.array([[4.0, -1], [-2, 4]]), np.array([-3.0, -2]), np.zeros(2)
    M1, N1 = np.diag([4.0, 4]) - np.tril(A, -1), np.triu(A, 1)
    for _ in range(200):
        z = printed_step(A, q, np.zeros_like, M1, N1, 0, 1, 4, z)
    right = after(200, icp.ICP(A, q), icp.MNMGS(), [0, 0])
    yield f"A = [4, -1; -2, 4], q = (-3, -2), z* = (1, 1): as printed the limit is {z}", np.abs(z - 1).max() > 0.1
    yield f"A - (M1 - N1) = {(A - M1 + N1).tolist()} is not zero", (A != M1 - N1).any()
    yield f"icp.MNMGS {right}", np.abs(right - 1).max() < 1e-12


@item("3 members", "true", "none needed once A = D − L − U")
def members():
    """MNMOD: M₁ = A, Ω = I. MNMAOR: M₁ = (D − θ₂L)/θ₁, N₁ = ((1 − θ₁)D + (θ₁ − θ₂)L + θ₁U)/θ₁; SOR, GS, J in it."""
    thetas, free = ((1.2, 0.7), (0.8, 0.8), (1, 1), (1, 0)), {"phi": phi4, "phi1": one, "phi2": two}
    aor = icp.MNMAOR(theta1=1.2, theta2=0.7, **free), icp.MNMSOR(theta1=0.8, **free), icp.MNMGS(**free)
    M = [(D4 - b * L4) / a for a, b in thetas]
    N = [((1 - a) * D4 + (a - b) * L4 + a * U4) / a for a, b in thetas]
    cases = zip([*aor, icp.MNMJ(**free)], M, N, [one] * 4, [two] * 4, strict=True)
    for method, M1, N1, phi1, phi2 in [(icp.MNMOD(phi=phi4), A4, 0 * A4, 1, 1), *cases]:
        paper = printed_step(A4, four.q, four.psi.value, M1, N1, phi4, phi1, phi2, z4)
        gap = np.abs(paper - after(1, four, method, z4)).max()
        yield f"the step of icp.{type(method).__name__} differs by {gap:.0e} at a random z", gap < 1e-12


@item("4.1", "true, but", "for any square A and any start: ρ(L) < 1 brings a solution, and A is then a P-matrix")
def theorem_41():
    """If A is a P-matrix and ρ(L) < 1, L = |X⁻¹|(|N₁ + φ| + |A − Ω| + 2ΩG), it converges from every z⁰ ≥ 0."""
    matrices = np.random.default_rng(4).normal(size=(300, 3, 3)) + np.eye(3)
    held = [A for A in matrices if check("4.1", icp.ICP(A, [0, 0, 0]), icp.MNMOD()).holds]
    p = sum(classify(A).p.holds for A in held)
    yield f"{len(matrices)} random A, MNMOD: rho(L) < 1 for {len(held)}, of which P-matrices {p}", len(held) == p > 9
    found = check("4.1", cycle, icp.MNMGS())
    yield f"a P-matrix is not enough: A = {cycle.A.toarray().tolist()}, {found}", classify(cycle.A).p.holds is True
    res = cycle.residual(after(2000, cycle, icp.MNMGS(), [1, 0, 0]))
    yield f"there Gauss-Seidel has the residual {res:.3g} after 2000 steps", res > 0.1


@item("4.1 proof", "FALSE AS PRINTED", "|zᵏ⁺¹ − z*| ≤ L|zᵏ − z*|; what falls is max |zᵏ − z*|ᵢ/vᵢ with some v > 0")
def decrease():
    """Since ρ(L) < 1, |zᵏ⁺¹ − z*| < |zᵏ − z*|, entry by entry."""
    A = np.array([[2, -1], [-0.5, 2]])
    problem, method, z0 = icp.ICP(A, -A @ [1, 1]), icp.MNMGS(), np.array([1.0, 3.0])
    e0, e1 = np.abs(z0 - 1), np.abs(after(1, problem, method, z0) - 1)
    found, rate = check("4.1", problem, method), predicted_rate(problem, method)
    yield f"{given(problem, method)}: {found}", found.holds is True
    yield f"z0 = {z0}: |e0| = {e0}, |e1| = {e1}: the first entry grows", e1[0] > e0[0]
    ratio = (e1 / rate.v).max() / (e0 / rate.v).max()
    text = f"max |e|/v, v = {rate.v.round(3)}, is multiplied by {ratio:.4f}"
    yield f"{text}; predicted_rate: at most {rate.factor:.4f}", ratio <= rate.factor < 1


@item("4.2", "true, but", "wᵢᵢ for wᵢⱼ; even so AOR has G = 0 unless θ₁ > 1, θ₂ > θ₁ or < 0; corrected: any small G")
def theorem_42():
    """If φ₂ = (ξᵢⱼ) ≥ φ₁D, φ₁ = (wᵢⱼ), 2ξᵢᵢgᵢⱼ ≤ |wᵢⱼmᵢⱼ| + |wᵢⱼnᵢⱼ| − |wᵢⱼaᵢⱼ| and gᵢᵢ likewise, it converges."""
    A = np.array([[1, -0.2, 0.1], [0.1, 1, 0.3], [-0.2, 0.1, 1]])  # φ = 0, φ₁ = φ₂ = D = I
    problem = icp.ICP(A, [0, 0, 0], icp.Affine(1e-6 * np.tril(np.ones((3, 3)), -1)))

    def largest(w, M):
        return ((np.abs(w * M) + np.abs(w * (M - A)) - np.abs(w * A)) * (1 - np.eye(3))).max() / 2

    for a, b in ((1, 0), (1, 1), (0.8, 0.8), (1.2, 1.2), (1, 1.4)):
        method = icp.MNMAOR(theta1=a, theta2=b)
        M = method.splitting_of().matrix(problem.A).toarray()
        n, literal, meant = np.diag(M - A), largest(np.eye(3), M), largest(1, M)
        ii = (np.abs(n) - n).max() / 2
        printed, useful = (check("4.2", problem, method, as_printed=flag).holds for flag in (True, False))
        right = literal == 0 and useful and printed == (meant > 1e-9) == (b > a) and (ii > 1e-9) == (a > 1)
        text = f"theta = ({a}, {b}): gᵢᵢ <= {ii:.2f}, gᵢⱼ <= {literal:g} as printed, {meant:.2f} as meant"
        yield f"{text}; G = 1e-6 below the diagonal: meant {printed}, corrected {useful}", right


@item("4.3 ()", "FALSE AS PRINTED", "ρ(D⁻¹(|B| + ΩG)): D⁻¹ stands before both terms, and φ₁ cancels")
def parenthesis():
    """φ₂ ≥ φ₁D, max(θ₁, θ₂)·ρ(D⁻¹|B| + φ₂G) < min(1, θ₁): MNMAOR converges."""
    problem, method = icp.ICP([[0.1]], [1.0], icp.Affine([[-5.0]], 6.0)), icp.MNMGS(phi1=1.0, phi2=0.1)
    yield from refuted("4.3", problem, method)
    same = check("4.3", problem, icp.MNMGS(phi1=100.0, phi2=10.0), as_printed=True)
    yield f"phi1 = 100, phi2 = 10 is the same method; as printed: {same}", same.holds is False
    orbit, exact = [after(k, problem, method, [2.0])[0] for k in (400, 401, 402)], problem.residual([1.0]) < 1e-12
    yield f"z* = 1; z400, z401, z402 from z0 = 2: {np.round(orbit, 6)}", exact and np.ptp(orbit) > 1


@item("4.3 phi", "FALSE AS PRINTED", "φ ≥ 0 must be asked, also for the proof's |X⁻¹| ≤ (⟨M₁⟩ + |φ| + Ω)⁻¹")
def negative_phi():
    """The same, φ any diagonal matrix."""
    problem, method = icp.ICP([[1.0]], [-1.0]), icp.MNMGS(phi=-1.5)
    yield from refuted("4.3", problem, method)
    X, proof = (1 + phi + 1 for phi in (method.phi, abs(method.phi)))
    yield f"|X^-1| = {1 / abs(X):.3g}, the proof's bound {1 / proof:.3g}", 1 / abs(X) > 1 / proof
    factor = (after(1, problem, method, [1.1])[0] - 1) / (1.1 - 1)
    yield f"one step from 1.1 multiplies the error by {factor:.6g}", factor < -1


@item("4.3 theta2", "FALSE AS PRINTED", "θ₂ ≥ 0 must be asked: θ₂|L| ≤ max(θ₁, θ₂)|L| says nothing of |θ₂|")
def negative_theta2():
    """The same, 0 ≤ max(θ₁, θ₂)·ρ < min(1, θ₁), θ₂ of any sign."""
    A = np.array([[1, -0.5], [-0.5, 1]])
    problem, method = icp.ICP(A, -A @ [1, 1]), icp.MNMAOR(theta1=1.0, theta2=-4.0)
    yield from refuted("4.3", problem, method)
    h = 2.0**-20  # near z* the step is linear
    T = np.array([(after(1, problem, method, 1 + h * e) - 1) / h for e in np.eye(2)]).T
    radius = np.abs(np.linalg.eigvals(T)).max()
    yield f"the matrix that multiplies the error has the spectral radius {radius:.4f}", radius > 1


def condition_44(A, M1, phi, phi1, phi2, G, corrected):
    """The left side of both cases of theorem 4.4 for n = 1; corrected: φ times φ₁, like all the rest."""
    shift = phi1 * phi if corrected else phi
    return abs(phi1 * M1 + shift) - abs(phi1 * (M1 - A) + shift) + min(phi2, phi1 * A) - phi1 * A - phi2 * G


def theorem_44(q, slope, c, phi2):
    """A = 1, M₁ = .1, φ = .5, φ₁ = .1, ψ(z) = slope·z + c, z* = 1."""
    problem = icp.ICP([[1.0]], [q], icp.Affine([[slope]], c))
    method = icp.Modulus(splitting=[[0.1]], phi=0.5, phi1=0.1, phi2=phi2)
    printed, corrected = (condition_44(1, 0.1, 0.5, 0.1, phi2, abs(slope), flag) for flag in (False, True))
    yield f"the condition as printed: {printed:.3g} > 0; corrected: {corrected:.3g} < 0", corrected < 0 < printed
    yield from refuted("4.4", problem, method)
    factor = (after(1, problem, method, [1.001])[0] - 1) / (1.001 - 1)
    yield f"one step from 1.001 multiplies the error by {factor:.6g}", problem.residual([1.0]) < 1e-12 and factor < -1


@item("4.4 (1)", "FALSE AS PRINTED", "φ₁φ for φ: some v > 0 has (φ₁(⟨M₁ + φ⟩ − |N₁ + φ|) − φ₂G)v > 0, and D > 0")
def case_one():
    """φ₂ ≥ φ₁D and (⟨φ₁M₁ + φ⟩ − |φ₁N₁ + φ| − φ₂G)Ue > 0: it converges."""
    yield from theorem_44(q=5.0, slope=-0.9, c=1.9, phi2=0.1)


@item("4.4 (2)", "FALSE AS PRINTED", "the same, with φ₂ − φ₁D added; one formula for both: min(φ₂, φ₁D) − φ₁D")
def case_two():
    """0 < φ₂ < φ₁D and (φ₂ − φ₁D + ⟨φ₁M₁ + φ⟩ − |φ₁N₁ + φ| − φ₂G)Ue > 0: it converges."""
    yield from theorem_44(q=-1.0, slope=0.0, c=0.0, phi2=0.01)


@item("4.4 clauses", "mistyped", "|N₁ + φ| for (N₁ + φ); beside the condition only D > 0 is needed")
def clauses():
    """A is an H₊-matrix and (⟨M₁ + φ⟩ − (N₁ + φ))U is strictly diagonally dominant."""
    M, A = 0.4, 1.0
    printed, meant = abs(M) - (M - A), abs(M) - abs(M - A)
    yield f"A = {A:g}, M1 + phi = {M:g}: {printed:.3g} as printed, {meant:.3g} as meant", meant < 0 < printed
    value = condition_44(-1, -1, 0, 1, 1, 0, corrected=True)
    yield f"A = M1 = -1, Omega = 1, no H+-matrix: the condition reads {value:g} > 0, but X = {-1 + 1:g}", value > 0
    found = check("4.4", icp.ICP([[-1.0]], [0.0]), icp.Modulus(splitting="whole", phi2=1.0))
    yield f"corrected, convergence?   {found}", found.holds is False


def main(wanted):
    names = [name for name in ITEMS if not wanted or name.startswith(tuple(wanted))]
    if not names:
        sys.exit(f"nothing begins with {' or '.join(wanted)}; there are: {', '.join(ITEMS)}")
    not_shown, width = [], max(map(len, ITEMS))
    for name in names:
        function, verdict, correction = ITEMS[name]
        seen = list(function())
        if not all(ok for _, ok in seen):
            not_shown.append(name)
            verdict = "NOT SHOWN by these numbers: " + verdict
        print(f"[{name}] {function.__doc__}\n    verdict:    {verdict}")
        for line, ok in seen:
            print(f"    {'  ' if ok else 'NO'}          {line}")
        print(f"    correction: {correction}\n")
    print(f"{'statement':{width}}  {'as printed':16}  corrected")
    for name in names:
        print(f"{name:{width}}  {'NOT SHOWN' if name in not_shown else ITEMS[name][1]:16}  {ITEMS[name][2]}")
    return len(not_shown) > 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
