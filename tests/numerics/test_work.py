"""Work is counted, the same for the same steps, however they are made."""

import subprocess
import sys
import time
from functools import partial
from textwrap import dedent
from threading import Event, Thread

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

import icpmodel as icp
from icpmodel.algebra.factor_costs import factor_costs
from icpmodel.errors import OutOfTime
from icpmodel.numerics import work
from icpmodel.numerics.factorisation import factorise
from icpmodel.numerics.fill import Fill, factor_cost


def counted(make):
    before = work.counter()
    made = make()
    return work.counter() - before, made


def test_where_no_time_is_left_no_step_is_blamed():
    with work.work_limit(0.0), pytest.raises(OutOfTime, match=r"^no time is left$"):
        work.check_budget()


def test_time_before_the_block_does_not_make_its_steps_slower():
    with work.work_limit(10_000.0, start_time=work.clock() - 5_000.0):
        assert work.nanoseconds_left() > 1e12


def test_products_factorisations_and_cycles_are_counted():
    problem = icp.scenes.membrane(n=900).problem
    matrix, f = problem.matrix, np.ones(900)
    product, _ = counted(lambda: matrix.product(f))
    assert product == pytest.approx(work.product_cost(problem.n, problem.nnz))
    for triangles, least in ((False, factor_costs(matrix).fill), (True, Fill(900, problem.nnz, 0.0, True))):
        first, lu = counted(partial(factorise, problem.A, triangles=triangles))
        again, _ = counted(partial(factorise, problem.A, triangles=triangles))
        assert first == again >= int(factor_cost(least))
        one, two = (counted(partial(lu.solve, f))[0] for f in (f, np.ones((900, 2))))
        assert 0 < one == two // 2 < first


def test_the_clock_goes_on_while_another_thread_compiles():
    begun, over = Event(), Event()

    def compile_something():
        with work.COMPILER.busy():
            begun.set()
            over.wait()

    thread = Thread(target=compile_something)
    thread.start()
    begun.wait()
    before = work.clock()
    time.sleep(0.01)
    after = work.clock()
    over.set()
    thread.join()
    assert after > before


def test_functions_of_no_module_compile_beside_the_loops():
    script = """
        import numba, icpmodel as icp
        icp.ICP([[2.0, -1.0], [-1.0, 2.0]], [-1.0, 3.0]).solve()
        names = {"__name__": None}
        exec("def f(x): return 0.3 * x", names)
        assert numba.njit(names["f"])(1.0) == 0.3
    """
    run = subprocess.run([sys.executable, "-c", dedent(script)], capture_output=True, text=True, check=False)
    assert run.returncode == 0, run.stderr


def test_a_thread_counts_its_own_work():
    from concurrent.futures import ThreadPoolExecutor

    before = work.counter()
    with ThreadPoolExecutor(1) as pool:
        assert pool.submit(lambda: (work.count(5.0), work.counter())[1]).result() == 5.0
    assert work.counter() == before


@given(seconds=st.floats(10.0, 1e6), share=st.floats(0.0, 2.0))
def test_a_step_is_refused_exactly_where_it_is_foreseen_to_take_more_than_what_is_left(seconds, share):
    assume(abs(share - 1.0) > 0.1)
    with work.work_limit(seconds):
        if share > 1.0:
            with pytest.raises(OutOfTime):
                work.check_budget(1e9 * share * seconds)
        else:
            work.check_budget(1e9 * share * seconds)
    work.check_budget(1e9 * share * seconds)  # nothing limits it any more


def test_once_the_time_is_over_nothing_is_begun_in_an_inner_block_either_and_limits_end_with_theirs():
    with work.work_limit(0.0), pytest.raises(OutOfTime), work.work_limit(1e6):
        work.check_budget()
    with work.work_limit(1e6):
        with pytest.raises(OutOfTime), work.work_limit(0.0):
            work.check_budget()
        work.check_budget(1e9)
    with work.work_limit():
        work.check_budget(1e30)


def test_the_clock_stands_still_while_code_is_loaded_even_where_one_piece_asks_for_another():
    with work.COMPILER.busy():
        before = work.clock()
        with work.COMPILER.busy():
            assert work.clock() == before
        assert work.clock() == before
    assert work.clock() >= before


def test_a_factorisation_is_foreseen_by_its_fill_and_not_begun():
    A = icp.scenes.membrane(n=2500).problem.A
    with work.work_limit(1e-4), pytest.raises(OutOfTime):
        factorise(A)


def test_a_limit_of_the_count_is_the_same_on_every_machine_and_leaves_other_limits():
    with work.work_limit(nanoseconds=1e6):
        work.count(9e5)
        work.check_budget(1e5)
        with pytest.raises(OutOfTime):
            work.check_budget(1.1e5)
    with work.work_limit(0.0), work.work_limit(nanoseconds=1e6), pytest.raises(OutOfTime):
        work.check_budget()
