"""Where methods fail, and what they say then. Nothing here is ever called solved that is not.

Run: python examples/when_methods_fail.py
"""

import textwrap

import icpmodel as icp


def report(title, problem, method=None, **options):
    solution = problem.solve(method, raise_on_failure=False, **options)
    print(title)
    if solution.solved:
        print(f"    {solution.method!r}: solved, residual {solution.residual:.2g}")
    else:  # the message says which method ended how, whose iterate is the best, and what to try
        print(textwrap.fill(solution.message, 116, initial_indent="    ", subsequent_indent="    "))


print("1. A condition that the literature prints, and that is false: its number is .5 < 1, and the method cycles.")
problem = icp.ICP([[0.1]], [1.0], icp.Affine([[-5.0]], 6.0))
report(
    "   A = .1, q = 1, psi(z) = 6 - 5z, phi2 = .1; z = 1 is the only solution", problem, "mnmgs", phi2=0.1, z0=[56.0]
)

print("\n2. A P-matrix that is not H+: a solution exists and is unique, but sweeps turn in a circle.")
problem = icp.scenes.hand_cyclic().problem
report("   Gauss-Seidel", problem, "mnmgs")
report("   M1 = A and Omega = 2I", problem, "mnmmod", theta1=2.0)

print("\n3. The choice of splitting decides: Jacobi takes the maximum of two couplings, Gauss-Seidel adds them.")
problem = icp.scenes.hand_splittings().problem
report("   Gauss-Seidel", problem, "mnmgs")
report("   Jacobi", problem, "mnmj")
report("   no method named: what is tried, and why", problem)
print(textwrap.fill(problem.solve().why, 116, initial_indent="    ", subsequent_indent="    "))

print("\n4. A problem that has no solution at all: -z - 1 >= 0 and z >= 0. Pivoting proves it.")
report("   A = -1, q = -1", icp.ICP([[-1.0]], [-1.0]))

print("\n5. A tolerance below rounding is answered with the floor, not with success.")
problem = icp.scenes.manufactured_affine(n=400).problem
report("   rtol = 0", problem, "mnmgs", rtol=0.0)
