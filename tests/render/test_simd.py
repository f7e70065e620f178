"""Logarithms and powers of the kernels against the mathematics library."""

import numpy as np
import pytest
from numba import njit

from gauss2svg.render.kernels import LOGARITHM_FROM
from gauss2svg.render.simd import LANES, exp2, load, log, store


@njit
def logs(source, out):
    for i in range(0, source.size, LANES):
        store(out, i, log(load(source, i)))


@njit
def powers(source, out):
    for i in range(0, source.size, LANES):
        store(out, i, exp2(load(source, i)))


@pytest.mark.parametrize(("dtype", "off"), [(np.float32, 3e-7), (np.float64, 4e-15)])
def test_logarithm_is_within_the_stated_error_from_the_centre_to_far_out(dtype, off):
    v = np.geomspace(LOGARITHM_FROM, 1e6, 160000).astype(dtype)
    near = (1 + np.linspace(-0.3, 0.6, 160000)).astype(dtype)
    for source in (v, near):
        out = np.empty_like(source)
        logs(source, out)
        exact = np.log(source.astype(np.longdouble))
        rounding = np.finfo(dtype).eps * np.maximum(np.abs(exact), 1)
        assert (np.abs(out - exact) <= off + rounding).all()


@pytest.mark.parametrize(("dtype", "off"), [(np.float32, 3e-6), (np.float64, 3e-15)])
def test_power_of_two_is_within_the_stated_error_and_clipped(dtype, off):
    most = 120 if dtype == np.float32 else 1000
    source = np.linspace(-most, most, 160000).astype(dtype)
    out = np.empty_like(source)
    powers(source, out)
    exact = np.exp2(source.astype(np.longdouble))
    assert (np.abs(out / exact - 1) <= off).all()
    extremes = np.resize(np.array([-1e6, 1e6], dtype), LANES)
    out = np.empty_like(extremes)
    powers(extremes, out)
    assert (out[::2] <= np.finfo(dtype).tiny).all()
    assert np.isfinite(out).all()
