"""Sixteen lanes of float32 or float64 as one numba value, so that kernels are vectorised.

LLVM's loop vectoriser cannot vectorise the compositing loops, because they have many small buffers
that might overlap in memory. So here a row of a tile is one value of the type `<16 x float>`. LLVM
keeps it in one register of 512 bits, two of 256 or four of 128, whichever the machine has, and a
`<16 x double>` in twice as many. LLVM may contract the arithmetic to fused multiply-adds, but may
not change it in any other way, so NaN and infinity behave as in scalar code.

    load(array, i)      lanes from array.flat[i : i + 16]; the array is C-contiguous
    store(array, i, v)  writes lanes v to array.flat[i : i + 16]
    splat(x, like)      sixteen times the number x, in the element type of `like`, which is lanes or
                        an array
    narrow(v, like)     lanes of float64, rounded to the element type of `like`
    + - * /             arithmetic between lanes of the same element type
    least, most         minimum and maximum, lane by lane
    exponent(v), mantissa(v)  v = mantissa 2^exponent with a mantissa in 0.75..1.5. v must be a
                        normal number > 0
    root(v)             square root of v >= 0
    whole(v)            v rounded to whole numbers
    power_of_two(v)     2^v for whole v, if 2^v is a normal number
    total(v)            sum of the lanes, which are added in a fixed order
    log(v)              natural logarithm of a normal v > 0. The error is at most 3e-7 in float32
                        and 2e-15 in float64, plus one rounding of the result
    exp2(v)             two to the power of v. The relative error is at most 3e-6 in float32 and
                        1e-15 in float64, plus roundings. v is clipped so that the result is a
                        normal number

The same source code serves float32 and float64. Constants that differ between the two are chosen
when a kernel is compiled:

    constant(single, double)    makes a function f(like): the value for the element type of `like`
    polynomial(single, double)  makes a function f(u) = 1 + c1 u + c2 u^2 + ..
"""

# pyright: reportCallIssue=false
# pyright would report calls of intrinsics as errors, because they lack their first argument,
# typingctx, which numba adds.

import math
import operator
from collections.abc import Sequence
from typing import Any

from llvmlite import ir
from numba import njit, types
from numba.extending import intrinsic, lower_builtin, models, register_model, type_callable

LANES = 16
LOG2_E = 1 / math.log(2)
_ELEMENTS = {types.float32: ir.FloatType(), types.float64: ir.DoubleType()}
# The IEEE 754 layout of an element: its number of bits, the bits of its fraction, and the bias of
# its exponent.
_LAYOUT = {types.float32: (32, 23, 127), types.float64: (64, 52, 1023)}
_CONTRACT = ("contract",)


class _Lanes(types.Type):
    def __init__(self, dtype: Any) -> None:
        super().__init__(name=f"{dtype}x{LANES}")
        self.dtype = dtype


@register_model(_Lanes)
class _LanesModel(models.PrimitiveModel):
    def __init__(self, dmm: Any, fe_type: Any) -> None:
        super().__init__(dmm, fe_type, _vector(fe_type))


def _vector(lanes_type: Any) -> Any:
    """Return LLVM's type of sixteen lanes, for a _Lanes type or the element type of an array."""
    return ir.VectorType(_ELEMENTS[lanes_type.dtype], LANES)


def _pointer(context: Any, builder: Any, array_type: Any, array: Any, index: Any) -> Any:
    data = context.make_array(array_type)(context, builder, array).data
    element = builder.gep(data, [index], inbounds=True)
    return builder.bitcast(element, _vector(array_type).as_pointer())


@intrinsic
def load(typingctx, array, index):
    """Return lanes of 16 elements of a C-contiguous array, from the flat index `index` on."""
    assert array.layout == "C"

    def codegen(context, builder, signature, args):
        pointer = _pointer(context, builder, array, *args)
        return builder.load(pointer, align=array.dtype.bitwidth // 8)

    return _Lanes(array.dtype)(array, types.intp), codegen


@intrinsic
def store(typingctx, array, index, value):
    """Write lanes to 16 elements of a C-contiguous array, from the flat index `index` on."""
    assert (array.layout, array.dtype) == ("C", value.dtype)

    def codegen(context, builder, signature, args):
        pointer = _pointer(context, builder, array, *args[:2])
        builder.store(args[2], pointer, align=array.dtype.bitwidth // 8)
        return context.get_dummy_value()

    return types.void(array, types.intp, value), codegen


@intrinsic
def splat(typingctx, value, like):
    """Return sixteen lanes of one number, which is converted to the element type of `like`."""

    def codegen(context, builder, signature, args):
        undefined = ir.Constant(_vector(like), ir.Undefined)
        single = builder.insert_element(undefined, args[0], ir.Constant(ir.IntType(32), 0))
        mask = ir.Constant(ir.VectorType(ir.IntType(32), LANES), [0] * LANES)
        return builder.shuffle_vector(single, undefined, mask)

    return _Lanes(like.dtype)(like.dtype, like), codegen


@intrinsic
def narrow(typingctx, value, like):
    """Return float64 lanes, rounded to the element type of `like`, which is float32 or float64."""

    def codegen(context, builder, signature, args):
        return args[0] if like.dtype == value.dtype else builder.fptrunc(args[0], _vector(like))

    return _Lanes(like.dtype)(value, like), codegen


def constant(single: float, double: float) -> Any:
    """Return a function f(like), which returns `single` or `double`.

    f returns `single` if the elements of `like` are float32, and `double` if they are float64.
    """

    @intrinsic
    def operation(typingctx, like):
        value = single if like.dtype == types.float32 else double

        def codegen(context, builder, signature, args):
            return ir.Constant(ir.DoubleType(), value)

        return types.float64(like), codegen

    return operation


def _unary(emit):
    @intrinsic
    def operation(typingctx, value):
        def codegen(context, builder, signature, args):
            return emit(builder, args[0], *_LAYOUT[value.dtype])

        return value(value), codegen

    return operation


def _binary(emit):
    @intrinsic
    def operation(typingctx, left, right):
        assert left == right

        def codegen(context, builder, signature, args):
            return emit(builder, *args)

        return left(left, right), codegen

    return operation


least = _binary(lambda builder, a, b: builder.select(builder.fcmp_ordered("<", a, b), a, b))
most = _binary(lambda builder, a, b: builder.select(builder.fcmp_ordered(">", a, b), a, b))


def _overload_operator(symbol, emit):
    # The operator is translated to LLVM here. With numba's `overload`, each use of the operator
    # would be compiled as a function, which takes time.
    @type_callable(symbol)
    def type_of(context):
        return lambda left, right: left if isinstance(left, _Lanes) and left == right else None

    @lower_builtin(symbol, _Lanes, _Lanes)
    def lower(context, builder, signature, args):
        return emit(builder, *args)


_overload_operator(operator.add, lambda builder, a, b: builder.fadd(a, b, flags=_CONTRACT))
_overload_operator(operator.sub, lambda builder, a, b: builder.fsub(a, b, flags=_CONTRACT))
_overload_operator(operator.mul, lambda builder, a, b: builder.fmul(a, b, flags=_CONTRACT))
_overload_operator(operator.truediv, lambda builder, a, b: builder.fdiv(a, b))


def polynomial(single: Sequence[float], double: Sequence[float]) -> Any:
    """Return a function f(u) = 1 + c1 u + c2 u^2 + .. of lanes u, computed by Horner's rule.

    The coefficients c1, c2, .. are `single` for lanes of float32, and `double` for float64.
    """

    def emit(builder, u, bits, *_):
        *lower, highest = (1.0, *(single if bits == 32 else double))
        value = ir.Constant(u.type, [highest] * LANES)
        for coefficient in reversed(lower):
            product = builder.fmul(u, value, flags=_CONTRACT)
            added = ir.Constant(u.type, [coefficient] * LANES)
            value = builder.fadd(added, product, flags=_CONTRACT)
        return value

    return _unary(emit)


def _split(builder, value, bits, fraction, bias):
    """Return two vectors of integers: the bits of each lane, and the exponent of each lane.

    The exponent e of a lane v is chosen so that the mantissa v / 2^e is at least 0.75 and below
    1.5.
    """
    integers = ir.VectorType(ir.IntType(bits), LANES)
    three_quarters = ((bias - 1) << fraction) | (1 << (fraction - 1))
    as_bits = builder.bitcast(value, integers)
    above = builder.sub(as_bits, ir.Constant(integers, [three_quarters] * LANES))
    return as_bits, builder.ashr(above, ir.Constant(integers, [fraction] * LANES))


@_unary
def exponent(builder, value, *layout):
    """Return the exponent of each lane, as lanes of the same element type."""
    return builder.sitofp(_split(builder, value, *layout)[1], value.type)


@_unary
def mantissa(builder, value, *layout):
    """Return the mantissa of each lane, a number in 0.75..1.5."""
    as_bits, power = _split(builder, value, *layout)
    shifted = builder.shl(power, ir.Constant(power.type, [layout[1]] * LANES))
    return builder.bitcast(builder.sub(as_bits, shifted), value.type)


@_unary
def power_of_two(builder, value, bits, fraction, bias):
    """Return 2 to the power of each lane. The lanes must be whole numbers."""
    integers = ir.VectorType(ir.IntType(bits), LANES)
    power = builder.fptosi(value, integers)
    biased = builder.add(power, ir.Constant(integers, [bias] * LANES))
    raised = builder.shl(biased, ir.Constant(integers, [fraction] * LANES))
    return builder.bitcast(raised, value.type)


def _intrinsic_of_llvm(name):
    def emit(builder, value, bits, *_):
        signature = ir.FunctionType(value.type, [value.type])
        full = f"llvm.{name}.v{LANES}f{bits}"
        return builder.call(builder.module.declare_intrinsic(full, fnty=signature), [value])

    return _unary(emit)


whole, root = _intrinsic_of_llvm("rint"), _intrinsic_of_llvm("sqrt")


@intrinsic
def total(typingctx, value):
    """Return the sum of the lanes.

    One half of the lanes is added to the other half, and so on, until one number is left.
    """

    def codegen(context, builder, signature, args):
        vector, width = args[0], LANES
        while width > 1:
            width //= 2
            i32 = ir.IntType(32)
            undefined = ir.Constant(vector.type, ir.Undefined)
            low = ir.Constant(ir.VectorType(i32, width), list(range(width)))
            high = ir.Constant(ir.VectorType(i32, width), list(range(width, 2 * width)))
            vector = builder.fadd(
                builder.shuffle_vector(vector, undefined, low),
                builder.shuffle_vector(vector, undefined, high),
            )
        return builder.extract_element(vector, ir.Constant(ir.IntType(32), 0))

    return value.dtype(value), codegen


# Coefficients of polynomials that approximate ln(1 + u) / u on -0.25..0.5 and 2^u on -0.5..0.5.
# They come from a minimax approximation for float32, and from least squares on Chebyshev nodes for
# float64.
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
    """Return the natural logarithm of lanes."""
    u = mantissa(v) - splat(1.0, v)
    return exponent(v) * splat(1 / LOG2_E, v) + u * _log_ratio(u)


@njit(inline="always")
def exp2(v):
    """Return 2 to the power of each lane of v."""
    v = least(most(v, splat(_least_exponent(v), v)), splat(_most_exponent(v), v))
    n = whole(v)
    return power_of_two(n) * _exp2_part(v - n)
