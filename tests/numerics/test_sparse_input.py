"""What comes in as a sparse matrix is checked before compiled code reads it: SciPy would write to memory of others."""

import numpy as np
import pytest
import scipy.sparse as sp

import icpmodel as icp

FAULTS = {
    "csr": {"indices": [0, 3], "indptr": [0, 5, 0, 0]},
    "csc": {"indices": [-1, 0], "indptr": [0, 0, 9, 9]},
    "bsr": {"indices": [7, 0], "indptr": [1, 1, 2, 3]},
    "coo": {"coords": ([0, 10**7], [0, 0]), "row": [1, 3], "col": [-1, 0], "data": [1.0] * 7},
    "dia": {"offsets": [7], "data": np.ones((5, 3))},
    "dok": {"_dict": {(10**7, 0): 1.0}},
    "lil": {"rows": [[0], [10**7], [1]], "data": [[1.0, 1.0], [], [1.0]]},
}


def broken(form, part):
    """A matrix of SciPy's, valid when it was made, whose `part` was then set to what does not fit."""
    A = sp.coo_array(np.diag([2.0, 2.0, 2.0])).asformat(form)
    value = FAULTS[form][part]
    if form == "lil":
        value = np.array([*map(list, value), None], dtype=object)[:3]
    elif form == "coo" and part == "coords":
        value = tuple(np.array(one, dtype=np.int32) for one in value)
    elif part != "_dict":
        value = np.array(value, dtype=float if part == "data" else np.int32)
    setattr(A, part, value)
    return A


def at_one(psi):
    return icp.ICP(np.eye(3), -1.0, psi).psi.bind(3).jacobian(np.ones(3))


def one_side(z):
    return 0.5 * z


def moved(**change):
    jumps = sp.csr_array(-1.0 * (1 - np.eye(3)))
    return icp.Derivative(icp.ICP(3.0 * np.eye(3), -1.0, icp.Intervention(jumps)).solve()).forward(**change)


DOORS = {
    "A": lambda M: icp.ICP(M, -1.0),
    "B": lambda M: icp.ICP.vertical(np.eye(3), np.ones(3), M, np.ones(3)),
    "Affine.G": icp.Affine,
    "Function.lipschitz": lambda M: at_one(icp.Function(one_side, lipschitz=M)),
    "Function.jacobian": lambda M: at_one(icp.Function(one_side, lambda z: M)),
    "Function.parameter_derivative": lambda M: icp.Function(one_side, parameter_derivative=lambda z: M).data_gradient(
        np.ones(3), np.ones(3)
    ),
    "jumps": icp.Intervention,
    "change of gains": lambda M: moved(dpsi=M),
    "dA": lambda M: moved(dA=M),
    "M1": icp.algebra.splittings.UserSplitting,
    "rows": lambda M: icp.ByRows((3,), lambda lo, hi: (M, 1.0, 0.0)).local_rows(0, 3),
    "classes": icp.theory.classify,
    "P": lambda M: icp.solve_qp(M, np.ones(3)),
    "G": lambda M: icp.solve_qp(np.eye(3), np.ones(3), G=M, h=np.ones(3)),
    "A of a program": lambda M: icp.solve_avi(np.eye(3), np.ones(3), A=M, b=np.ones(3)),
    "least squares": lambda M: icp.solve_lsq(M, np.ones(3)),
}


@pytest.mark.parametrize("door", DOORS)
def test_positions_outside_the_shape_are_refused_at_every_door(door):
    for form, parts in FAULTS.items():
        for part in parts:
            with pytest.raises((icp.InputError, icp.MapError)):
                DOORS[door](broken(form, part))


def test_positions_outside_a_vector_are_refused():
    q = sp.coo_array(np.ones((3, 1)))
    q.coords[0][:] += 1
    with pytest.raises(icp.InputError):
        icp.ICP(np.eye(3), q)


def test_positions_that_are_no_whole_numbers_are_refused():
    for form, part in (("csr", "indices"), ("csc", "indptr"), ("coo", "coords")):
        A = sp.coo_array(np.eye(3)).asformat(form)
        positions = getattr(A, part)
        setattr(A, part, tuple(one + 0.5 for one in positions) if form == "coo" else positions + 0.5)
        with pytest.raises(icp.InputError, match="whole numbers were expected"):
            icp.ICP(A, 1.0)


@pytest.mark.parametrize("form", FAULTS)
def test_every_format_is_read_as_the_matrix_it_is_and_left_alone(form):
    dense = np.array([[4.0, -1.0, 0.0, 0.0], [0.0, 4.0, 0.0, -2.0], [0.0, 0.0, 4.0, 0.0], [-1.0, 0.0, 0.0, 4.0]])
    A = sp.coo_array(dense).asformat(form)
    before = A.copy()
    assert np.array_equal(icp.ICP(A, 1.0).A.toarray(), dense)
    assert (before != A).nnz == 0
    assert A.nnz == before.nnz


WIDE = {
    "int64": np.array([2**53 + 1]),
    "uint64": np.array([2**64 - 1], dtype=np.uint64),
    "longdouble": np.array([1.0], dtype=np.longdouble) / 3,
    "too large": np.array(["1e4000"], dtype=np.longdouble),
}


@pytest.mark.parametrize("name", WIDE)
@pytest.mark.parametrize("made", [np.diag, lambda x: sp.coo_array(np.diag(x)), lambda x: x])
def test_numbers_that_no_float64_equals_are_not_rounded_in_silence(name, made):
    if not np.finfo(np.longdouble).eps < np.finfo(float).eps and WIDE[name].dtype.kind == "f":
        pytest.skip("longdouble is float64 here")
    value = made(WIDE[name])
    A, q = (value, [1.0]) if value.ndim == 2 else ([[1.0]], value)
    with pytest.raises(icp.InputError):
        icp.ICP(A, q)
    assert icp.ICP(np.array([[2**60]]), np.array([3], dtype=np.longdouble)).q == 3.0
