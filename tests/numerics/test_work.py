"""Work is counted, the same for the same steps, however they are made."""

import numpy as np
import pytest

import icpmodel as icp
from icpmodel.algebra.steps import compiled_step, in_a_row
from icpmodel.numerics import work
from icpmodel.numerics.factorisation import factorise


def counted(make):
    before = work.done()
    made = make()
    return work.done() - before, made


@pytest.mark.parametrize("few", [0, 10**6])
@pytest.mark.parametrize("threads", [1, 2])
def test_so_many_sweeps_count_so_many_times_one(few, threads):
    """Whether they are made one by one, in one call, in one pass, or by two threads; and again on the same object."""
    problem = icp.scenes.membrane(n=900).problem
    A, rows, z = problem.A, problem.matrix.rows, np.zeros(900)
    matrix = (A.indptr, A.indices, A.data, rows.diag, problem.q)
    how = {"few": few, "threads": threads, "chunk": 100}
    step = compiled_step(problem, "in_order", matrix, ((1.0,), True), rows.above, **how)
    one, _ = counted(lambda: step(z))
    assert one == work.sweep(problem.n, problem.nnz)
    for count in (1, 2, 3, 4, 4):
        total, steps = counted(lambda count=count: in_a_row(step, z, count))
        assert total == pytest.approx(len(steps) * one)


def test_products_factorisations_and_cycles_are_counted():
    problem = icp.scenes.membrane(n=900).problem
    matrix, f = problem.matrix, np.ones(900)
    product, _ = counted(lambda: matrix.product(f))
    assert product == pytest.approx(work.product(problem.n, problem.nnz))
    first, lu = counted(lambda: factorise(problem.A))
    again, _ = counted(lambda: factorise(problem.A))
    assert first == again > work.factor_cost(work.Fill(900, problem.nnz, 0.0, True))
    assert 0 < counted(lambda: lu.solve(f))[0] == 0.5 * counted(lambda: lu.solve(np.ones((900, 2))))[0] < first


def test_a_thread_counts_its_own_work():
    from concurrent.futures import ThreadPoolExecutor

    before = work.done()
    with ThreadPoolExecutor(1) as pool:
        assert pool.submit(lambda: (work.add(5.0), work.done())[1]).result() == 5.0
    assert work.done() == before
