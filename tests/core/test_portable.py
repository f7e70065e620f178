"""Functions and linear algebra against NumPy's, in long double where the last digits matter."""

import numpy as np
import pytest

from gauss2svg import portable

FAR = np.random.default_rng(0).uniform(-1, 1, 20000)
POINTS = np.random.default_rng(1).normal(size=(2, 20000)) * [[1], [1e-3]]
# The function, its arguments, and its largest error in units in the last place.
CASES = {
    "exp": ((700 * FAR,), 1.5),
    "log": ((np.exp(700 * FAR),), 1.5),
    "log near 1": ((1 + FAR / 2,), 1.5),
    "cos": ((1.5 * FAR,), 2),
    "sin": ((1.5 * FAR,), 2),
    "arctan2": (tuple(POINTS), 5),
    "arctan2 of steep points": (tuple(POINTS[::-1]), 5),
    "power": ((1 + FAR / 2, 3 * FAR), 4),
    "hypot": (tuple(POINTS), 1.5),
    "cbrt": ((1 + FAR,), 4),
    "log2": ((np.exp(700 * FAR),), 4),
    "arccos": ((0.999 * FAR,), 60),
}


@pytest.mark.skipif(np.finfo(np.longdouble).eps > 1e-18, reason="long double is not longer here")
@pytest.mark.parametrize("case", CASES)
def test_functions_are_as_exact_as_they_say(case):
    name, (arguments, most) = case.split()[0], CASES[case]
    exact = getattr(np, name)(*(np.asarray(a, np.longdouble) for a in arguments))
    error = np.abs(getattr(portable, name)(*arguments) - exact)
    assert (error <= most * np.spacing(np.abs(exact.astype(float)))).all()


def test_angles_of_many_turns_are_reduced():
    angle_rad = 1e6 * FAR
    assert np.abs(portable.cos(angle_rad) - np.cos(angle_rad)).max() < 5e-16
    assert np.abs(portable.sin(angle_rad) - np.sin(angle_rad)).max() < 5e-16


SPECIAL = np.array([0.0, -0.0, 1.0, np.inf, np.nan, 5e-324, 1e-300, 1e300])


@pytest.mark.parametrize("name", ["exp", "log", "arctan2", "power", "log2", "hypot"])
def test_special_values_are_those_of_numpy(name):
    first = np.abs(SPECIAL) if name == "power" else np.append(SPECIAL, [-1, -750, 750, -np.inf])
    with np.errstate(all="ignore"):
        second = np.array([0.0, 1.0, -1.0, 2.5, -2.5]) if name == "power" else SPECIAL
        values = (first[:, None], second) if name in ("arctan2", "power", "hypot") else (first,)
        found, expected = (getattr(one, name)(*values) for one in (portable, np))
    special = ~(np.isfinite(expected) & (expected != 0)) | (expected == 1)
    if name == "hypot":
        special &= (np.abs(values[0]) < 1e150) & (np.abs(values[1]) < 1e150)
    assert np.array_equal(found[special], expected[special], equal_nan=True)


@pytest.mark.parametrize("count", [1, 2, 40])
def test_products_and_equations_are_those_of_numpy(count):
    rng = np.random.default_rng(count)
    a, b = rng.normal(size=(count, count)), rng.normal(size=(count, 3))
    for right in (b, b[:, 0], b[:, ::2]):
        assert np.allclose(portable.product(a, right), a @ right)
        assert np.allclose(portable.solve(a, right), np.linalg.solve(a, right))
    image = rng.normal(size=(5, 4, count))
    assert np.allclose(portable.product(image, b), image @ b)
    with pytest.raises(np.linalg.LinAlgError):
        portable.solve(np.zeros_like(a), b)


def test_least_squares_and_main_axes_are_those_of_numpy():
    rng = np.random.default_rng(0)
    basis, values = rng.normal(size=(50, 4)), rng.normal(size=(50, 3))
    basis[:, 3] = basis[:, 2]
    expected = np.linalg.lstsq(basis, values, rcond=None)[0]
    assert np.allclose(portable.least_squares(basis, values), expected, atol=1e-3)
    for columns in (2, 5):
        rows = rng.normal(size=(30, columns)) * np.arange(1, columns + 1)
        axis = np.linalg.svd(rows)[2][0]
        assert abs(portable.main_axis(rows) @ axis) == pytest.approx(1)
    assert np.linalg.norm(portable.main_axis(np.zeros((3, 2)))) == 1
