"""One thread of BLAS: the libraries that are limited, and that they get their threads back."""

import threadpoolctl

from icpmodel.numerics.threads import one_blas_thread


def threads_of_blas():
    return {one["filepath"]: one["num_threads"] for one in threadpoolctl.threadpool_info() if one["user_api"] == "blas"}


def test_every_blas_has_one_thread_and_gets_its_own_back():
    """SciPy's, which is another one than NumPy's, too."""
    with one_blas_thread():
        assert set(threads_of_blas().values()) == {1}


def test_who_ends_last_gives_them_back():
    """Two threads that overlap: the first one to begin is the first one to end."""
    with one_blas_thread():
        pass
    before = threads_of_blas()
    first, second = one_blas_thread(), one_blas_thread()
    first.__enter__()
    second.__enter__()
    first.__exit__(None, None, None)
    assert set(threads_of_blas().values()) == {1}
    second.__exit__(None, None, None)
    assert threads_of_blas() == before
