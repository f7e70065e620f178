"""Natural logarithm and power of two of lanes, by polynomials.

    log(v)    for normal v > 0: within 3e-7 in float32 and 2e-15 in float64, plus a rounding of
              the result
    exp2(v)   relative 3e-6 in float32 and 1e-15 in float64, plus roundings; v is clipped to
              the exponents of the type's normal numbers

Together s^(beta - 1) = exp2(log(s) (beta - 1) LOG2_E). These errors are checked
by tests/render/test_powers.py.
"""

# pyright: reportCallIssue=false
# The intrinsics of simd.py take a typing context that numba passes by itself.

import math

from numba import njit

from gauss2svg.render.simd import (
    constant,
    exponent,
    least,
    mantissa,
    most,
    polynomial,
    power_of_two,
    splat,
    whole,
)

LOG2_E = 1 / math.log(2)
# Least r^2 / 2 whose power is computed: nearer to the mean the power of this is used.
LOGARITHM_FROM = 1e-12

# ln(1 + u) / u on -0.25..0.5 and 2^u on -0.5..0.5, minimax for float32 and least squares on
# Chebyshev nodes for float64.
_log_ratio = polynomial(
    (-0.4999786647381979, 0.3331604554922196, -0.25090916436329785, 0.20691373305725377,
     -0.16575104713970026, 0.07944019106468078),
    (-0.5000000000000548, 0.3333333333331913, -0.24999999998209857, 0.20000000000595142,
     -0.16666666866293955, 0.14285714556075513, -0.12499989577936857, 0.11111081830769431,
     -0.10000268978114876, 0.09092107600498316, -0.0833055290284183, 0.07669299666707963,
     -0.07130476727220882, 0.0685273527995908, -0.06711635413331628, 0.05802458618907468,
     -0.03466566693531796, 0.009872262001040057),
)  # fmt: skip
_exp2_part = polynomial(
    (0.6931241927588543, 0.24024098682901, 0.055906428246032355, 0.009582850681341234),
    (0.6931471805599501, 0.2402265069590916, 0.05550410866445849, 0.00961812910795129,
     0.0013333558228595145, 0.00015403530034444139, 1.5252658065656096e-05,
     1.321563522364695e-06, 1.0208556826465857e-07, 7.041314080487328e-09),
)  # fmt: skip
_least_exponent = constant(-126.0, -1022.0)
_most_exponent = constant(127.0, 1023.0)


@njit(inline="always")
def log(v):
    """Natural logarithm of lanes."""
    u = mantissa(v) - splat(1.0, v)
    return exponent(v) * splat(1 / LOG2_E, v) + u * _log_ratio(u)


@njit(inline="always")
def exp2(v):
    """Two to the power of lanes."""
    v = least(most(v, splat(_least_exponent(v), v)), splat(_most_exponent(v), v))
    n = whole(v)
    return power_of_two(n) * _exp2_part(v - n)
