"""The contract of a method: what a subclass needs, and how it is found."""

import subprocess
import sys
from textwrap import dedent

import icpmodel as icp
from icpmodel import methods
from icpmodel.methods.contract import Method

PLAIN = """
    import numpy as np
    import icpmodel as icp
    from icpmodel.methods.contract import Method

    class Richardson(Method):
        name = "richardson"

        def iterates(self, problem, z):
            while True:
                yield z, None
                z = np.maximum(problem.psi.value(z), z - 0.2 * problem.p(z))

    problem = icp.ICP([[4.0, -1.0], [-2.0, 4.0]], [-3.0, -2.0])
    solution = problem.solve("richardson")
    print("richardson" in icp.methods.names(), repr(solution.method), solution.z.round(6).tolist())
    try:
        problem.solve("richardson", omega=1.0)
    except icp.InputError as error:
        print(error)
"""


def test_a_subclass_with_a_name_is_found_by_it_and_needs_no_options():
    """In a process of its own, as it stays registered."""
    run = subprocess.run([sys.executable, "-c", dedent(PLAIN)], capture_output=True, text=True, check=True)
    found, refused = run.stdout.splitlines()
    assert found == "True Richardson() [1.0, 1.0]"
    assert refused.startswith("richardson has no option omega; it takes none; solve itself takes z0")


def test_a_subclass_without_a_name_of_its_own_takes_nobody_s_place():
    class Mine(icp.MNMGS):
        pass

    assert type(methods.named("mnmgs")) is icp.MNMGS
    assert repr(Mine(phi=2.0)) == "Mine(phi=2)"
    assert icp.ICP([[2.0]], [-2.0]).solve(Mine()).z.tolist() == [1.0]


class Short(Method):
    """Ends after some iterates; listens to nobody."""

    def iterates(self, problem, z):
        for k in range(3):
            yield z + k, None


def test_a_path_that_ends_is_a_run_that_stands_still_or_is_as_good_as_rounding_allows():
    problem = icp.ICP([[1.0]], [-9.0])
    solution = problem.solve(Short(), raise_on_failure=False)
    assert solution.status is icp.Status.STAGNATED
    assert "it has no further step, but z is not a solution" in solution.message
    assert solution.z.tolist() == [2.0]
    third = icp.ICP([[3.0]], [-1.0])
    near = third.solve(Short(), z0=[1 / 3 + 3e-16], rtol=0.0, raise_on_failure=False)
    assert near.status is icp.Status.PRECISION_LIMIT


def test_a_path_need_not_be_a_generator_and_may_say_what_it_settled_on():
    class Path:
        adapted_method = icp.PSOR(omega=1.25)

        def __init__(self, z):
            self.z = z

        def __iter__(self):
            return self

        def __next__(self):
            self.z = self.z + 1.0
            return self.z - 1.0, None

    class Counting(Method):
        def iterates(self, problem, z):
            return Path(z)

    solution = icp.ICP([[1.0]], [-9.0]).solve(Counting())
    assert solution.iterations == 9
    assert repr(solution.method) == "Counting()"
    assert repr(solution.adapted_method) == "PSOR(omega=1.25)"
