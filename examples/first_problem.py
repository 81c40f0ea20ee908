"""First steps: state a problem, solve it, ask how wrong the answer can be, and get a second opinion.

Run: python examples/first_problem.py
"""

import numpy as np

import icpmodel as icp

# Two unknowns that may not fall below a bound that moves with the other one:
#     z1 >= z2/2 + 1,   z2 >= z1/2 - 3,
# and a force p = Az + q >= 0 that acts only where a bound is touched.
A = np.array([[2.0, -1.0], [-1.0, 2.0]])
q = np.array([1.0, -2.0])
psi = icp.Affine(G=[[0.0, 0.5], [0.5, 0.0]], c=[1.0, -3.0])

problem = icp.ICP(A, q, psi)
solution = problem.solve(rtol=1e-12)
print(solution)
print()
print("z =", solution.z.round(9))
print("p =", solution.p.round(9), " (force: only where the bound is touched)")
print("r =", solution.r.round(9), " (distance to the bound)")
print()

# Any callable will do for psi. Without a Lipschitz constant there is no certificate, and the card says so.
problem = icp.ICP(A, q, psi=lambda z: 0.3 * np.sin(z))
print(problem.solve())
print()

# With it, the same answer comes with a proof that it is the only one.
problem = icp.ICP(A, q, psi=icp.Elementwise(lambda z: 0.3 * np.sin(z), lambda z: 0.3 * np.cos(z), lipschitz=0.3))
print(problem.solve())
print()
print(problem.crosscheck())
