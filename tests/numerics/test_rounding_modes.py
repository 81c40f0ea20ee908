"""Modes of the processor that proofs do not count on are told."""

import ctypes
import platform
import struct
import warnings
from contextlib import contextmanager

import pytest

import icpmodel as icp

#: where glibc keeps the control word of SSE in its fenv_t, and the bits for results and for operands
_AT, _FLUSH = 28, 0x8040


@contextmanager
def flushing_to_zero():
    if platform.machine() != "x86_64" or platform.libc_ver()[0] != "glibc":
        pytest.skip("the mode is set by hand for x86-64 with glibc only")
    libm, before = ctypes.CDLL("libm.so.6"), ctypes.create_string_buffer(64)
    libm.fegetenv(before)
    after = ctypes.create_string_buffer(before.raw, 64)
    struct.pack_into("I", after, _AT, struct.unpack_from("I", before, _AT)[0] | _FLUSH)
    libm.fesetenv(after)
    try:
        yield
    finally:
        libm.fesetenv(before)


def test_flushing_to_zero_is_reported():
    problem = icp.ICP([[2.0]], [-1.0])
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert problem.solve().solved
    with flushing_to_zero(), pytest.warns(RuntimeWarning, match="flushes subnormal numbers to zero"):
        problem.solve()
