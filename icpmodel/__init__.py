"""icpmodel: state an implicit complementarity problem, solve it, and have independent solvers check the answer.

Find z with p = Az + q ≥ 0, r = z − ψ(z) ≥ 0 and pᵀr = 0.

>>> import icpmodel as icp
>>> problem = icp.ICP([[2, -1], [-1, 2]], [-1, 3])
>>> problem.solve().z.round(6) + 0.0
array([0.5, 0. ])
"""

import lazy_loader as _lazy

from .crosscheck import crosscheck as crosscheck
from .explain import explain as explain
from .icp import ICP as ICP
from .solve import solve as solve

__version__ = "0.1.0"

# The public names are listed once, in __init__.pyi, and loaded at first use. The functions above are bound at once:
# subpackages have the same names, and the import of a subpackage later would replace the function of its name.
__getattr__, __dir__, __all__ = _lazy.attach_stub(__name__, __file__)
