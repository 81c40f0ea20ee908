"""Work is counted, the same for the same steps, however they are made."""

from functools import partial

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

import icpmodel as icp
from icpmodel.algebra.factor_costs import factor_costs
from icpmodel.errors import OutOfMemory, OutOfTime
from icpmodel.numerics import work
from icpmodel.numerics.factorisation import factorise


def counted(make):
    before = work.done()
    made = make()
    return work.done() - before, made


def test_products_factorisations_and_cycles_are_counted():
    problem = icp.scenes.membrane(n=900).problem
    matrix, f = problem.matrix, np.ones(900)
    product, _ = counted(lambda: matrix.product(f))
    assert product == pytest.approx(work.product(problem.n, problem.nnz))
    for triangles, least in ((False, factor_costs(matrix).fill), (True, work.Fill(900, problem.nnz, 0.0, True))):
        first, lu = counted(partial(factorise, problem.A, triangles=triangles))
        again, _ = counted(partial(factorise, problem.A, triangles=triangles))
        assert first == again >= int(work.factor_cost(least))
        one, two = (counted(partial(lu.solve, f))[0] for f in (f, np.ones((900, 2))))
        assert 0 < one == two // 2 < first


def test_a_thread_counts_its_own_work():
    from concurrent.futures import ThreadPoolExecutor

    before = work.done()
    with ThreadPoolExecutor(1) as pool:
        assert pool.submit(lambda: (work.add(5.0), work.done())[1]).result() == 5.0
    assert work.done() == before


@given(seconds=st.floats(10.0, 1e6), share=st.floats(0.0, 2.0))
def test_a_step_is_refused_exactly_where_it_is_foreseen_to_take_more_than_what_is_left(seconds, share):
    assume(abs(share - 1.0) > 0.1)
    with work.within(seconds):
        if share > 1.0:
            with pytest.raises(OutOfTime):
                work.afford(1e9 * share * seconds)
        else:
            work.afford(1e9 * share * seconds)
    work.afford(1e9 * share * seconds)  # nothing limits it any more


def test_once_the_time_is_over_nothing_is_begun_and_an_inner_limit_ends_with_its_block():
    with work.within(0.0):
        with pytest.raises(OutOfTime):
            work.afford()
        with work.within(1e6):
            work.afford(1e9)
        with pytest.raises(OutOfTime):
            work.afford()
    with work.within():
        work.afford(1e30)


def test_the_clock_stands_still_while_code_is_loaded_even_where_one_piece_asks_for_another():
    with work.COMPILER.busy():
        before = work.clock()
        with work.COMPILER.busy():
            assert work.clock() == before
        assert work.clock() == before
    assert work.clock() >= before


def test_a_factorisation_is_foreseen_by_its_fill_and_not_begun():
    A = icp.scenes.membrane(n=2500).problem.A
    with work.within(1e-4), pytest.raises(OutOfTime):
        factorise(A)
    with work.within(memory=12 * A.nnz), pytest.raises(OutOfMemory):
        factorise(A)


def test_a_limit_of_the_count_is_the_same_on_every_machine_and_leaves_other_limits():
    with work.of_count(1e6):
        work.add(9e5)
        work.afford(1e5)
        with pytest.raises(OutOfTime):
            work.afford(1.1e5)
    with work.within(0.0), work.of_count(1e6), pytest.raises(OutOfTime):
        work.afford()
