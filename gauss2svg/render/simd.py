"""Sixteen lanes of float32 or float64 as one numba value: kernels are vectorised as written.

LLVM's loop vectoriser gives up on the compositing loops, whose many small buffers could alias.
Here a row of a tile is one `<16 x float>` value. LLVM maps it to one 512-bit, two 256-bit or
four 128-bit registers, whatever the machine has, and `<16 x double>` to twice as many. The
arithmetic may be contracted to fused multiply-adds and nothing else, so that NaN and infinity
behave as they do in scalar code.

    load(array, i)      lanes from array.flat[i : i + 16] (C-contiguous, float32 or float64)
    store(array, i, v)  and back
    splat(x, like)      sixteen times x, of the element type of like: lanes or an array
    narrow(v, like)     lanes of float64 rounded to the element type of like
    + - * /             between lanes of one element type
    least, most         lane by lane minimum and maximum
    exponent(v), mantissa(v)  v = mantissa 2^exponent, mantissa in 0.75..1.5, v normal and > 0
    root(v)             square root, v >= 0
    whole(v)            rounded to whole numbers
    power_of_two(v)     2^v for whole v in the range of the type's normal numbers
    total(v)            sum of the lanes, by pairs, in a fixed order

What differs between the precisions is chosen when a kernel is compiled, so that one source
serves both:

    constant(single, double)    makes f(like), the value for the element type of like
    polynomial(single, double)  makes f(u) = 1 + c1 u + c2 u^2 + ..
"""

import operator
from collections.abc import Sequence
from typing import Any

from llvmlite import ir
from numba import types
from numba.extending import intrinsic, lower_builtin, models, register_model, type_callable

LANES = 16
_ELEMENTS = {types.float32: ir.FloatType(), types.float64: ir.DoubleType()}
# Of IEEE 754: bits of an element, bits of its fraction, bias of its exponent.
_LAYOUT = {types.float32: (32, 23, 127), types.float64: (64, 52, 1023)}
_CONTRACT = ("contract",)


class _Lanes(types.Type):
    def __init__(self, dtype: Any) -> None:
        super().__init__(name=f"{dtype}x{LANES}")
        self.dtype = dtype


@register_model(_Lanes)
class _LanesModel(models.PrimitiveModel):
    def __init__(self, dmm: Any, fe_type: Any) -> None:
        super().__init__(dmm, fe_type, ir.VectorType(_ELEMENTS[fe_type.dtype], LANES))


def _lane_pointer(context: Any, builder: Any, array_type: Any, array: Any, index: Any) -> Any:
    data = context.make_array(array_type)(context, builder, array).data
    element = builder.gep(data, [index], inbounds=True)
    return builder.bitcast(element, ir.VectorType(_ELEMENTS[array_type.dtype], LANES).as_pointer())


def _alignment(array_type: Any) -> int:
    return array_type.dtype.bitwidth // 8


def _has_lanes(like: Any) -> bool:
    return isinstance(like, (_Lanes, types.Array)) and like.dtype in _ELEMENTS


def _is_lane_source(array: Any) -> bool:
    return isinstance(array, types.Array) and _has_lanes(array) and array.layout == "C"


@intrinsic
def load(typingctx, array, index):
    """Lanes from the 16 elements of a C-contiguous array that start at flat index."""
    if not _is_lane_source(array):
        return None

    def codegen(context, builder, signature, args):
        at = context.cast(builder, args[1], signature.args[1], types.intp)
        pointer = _lane_pointer(context, builder, signature.args[0], args[0], at)
        return builder.load(pointer, align=_alignment(signature.args[0]))

    return _Lanes(array.dtype)(array, index), codegen


@intrinsic
def store(typingctx, array, index, value):
    """Write lanes to the 16 elements that start at flat index."""
    if not _is_lane_source(array) or value != _Lanes(array.dtype):
        return None

    def codegen(context, builder, signature, args):
        at = context.cast(builder, args[1], signature.args[1], types.intp)
        pointer = _lane_pointer(context, builder, signature.args[0], args[0], at)
        builder.store(args[2], pointer, align=_alignment(signature.args[0]))
        return context.get_dummy_value()

    return types.void(array, index, value), codegen


@intrinsic
def splat(typingctx, value, like):
    """Sixteen lanes of one number, converted to the element type of like."""
    if not isinstance(value, (types.Float, types.Integer)) or not _has_lanes(like):
        return None

    def codegen(context, builder, signature, args):
        scalar = context.cast(builder, args[0], signature.args[0], signature.args[1].dtype)
        undefined = ir.Constant(ir.VectorType(scalar.type, LANES), ir.Undefined)
        single = builder.insert_element(undefined, scalar, ir.Constant(ir.IntType(32), 0))
        mask = ir.Constant(ir.VectorType(ir.IntType(32), LANES), [0] * LANES)
        return builder.shuffle_vector(single, undefined, mask)

    return _Lanes(like.dtype)(value, like), codegen


@intrinsic
def narrow(typingctx, value, like):
    """Lanes of float64, rounded to the element type of like; as they are where that is float64."""
    if value != _Lanes(types.float64) or not _has_lanes(like):
        return None

    def codegen(context, builder, signature, args):
        if signature.args[1].dtype == types.float64:
            return args[0]
        return builder.fptrunc(args[0], ir.VectorType(_ELEMENTS[types.float32], LANES))

    return _Lanes(like.dtype)(value, like), codegen


def constant(single: float, double: float) -> Any:
    """A function of like: single if its elements are float32, double if float64, as float64."""

    @intrinsic
    def operation(typingctx, like):
        if not _has_lanes(like):
            return None
        value = single if like.dtype == types.float32 else double

        def codegen(context, builder, signature, args):
            return ir.Constant(ir.DoubleType(), value)

        return types.float64(like), codegen

    return operation


def polynomial(single: Sequence[float], double: Sequence[float]) -> Any:
    """A function of lanes u: 1 + c1 u + c2 u^2 + .., lowest power first, by Horner's rule."""

    @intrinsic
    def operation(typingctx, u):
        if not isinstance(u, _Lanes):
            return None
        *lower, highest = (1.0, *(single if u.dtype == types.float32 else double))

        def codegen(context, builder, signature, args):
            vector = args[0].type
            value = ir.Constant(vector, [highest] * LANES)
            for coefficient in reversed(lower):
                product = builder.fmul(args[0], value, flags=_CONTRACT)
                added = ir.Constant(vector, [coefficient] * LANES)
                value = builder.fadd(added, product, flags=_CONTRACT)
            return value

        return u(u), codegen

    return operation


def _binary(emit):
    @intrinsic
    def operation(typingctx, left, right):
        if not isinstance(left, _Lanes) or left != right:
            return None

        def codegen(context, builder, signature, args):
            return emit(builder, args[0], args[1])

        return left(left, right), codegen

    return operation


least = _binary(lambda builder, a, b: builder.select(builder.fcmp_ordered("<", a, b), a, b))
most = _binary(lambda builder, a, b: builder.select(builder.fcmp_ordered(">", a, b), a, b))


def _overload_operator(symbol, emit):
    # Lowered directly: numba's `overload` would compile each use of an operator as a function.
    @type_callable(symbol)
    def type_of(context):
        def typer(left, right):
            return left if isinstance(left, _Lanes) and left == right else None

        return typer

    @lower_builtin(symbol, _Lanes, _Lanes)
    def lower(context, builder, signature, args):
        return emit(builder, args[0], args[1])


_overload_operator(operator.add, lambda builder, a, b: builder.fadd(a, b, flags=_CONTRACT))
_overload_operator(operator.sub, lambda builder, a, b: builder.fsub(a, b, flags=_CONTRACT))
_overload_operator(operator.mul, lambda builder, a, b: builder.fmul(a, b, flags=_CONTRACT))
_overload_operator(operator.truediv, lambda builder, a, b: builder.fdiv(a, b))


def _unary(emit):
    @intrinsic
    def operation(typingctx, value):
        if not isinstance(value, _Lanes):
            return None

        def codegen(context, builder, signature, args):
            return emit(builder, args[0], *_LAYOUT[signature.args[0].dtype])

        return value(value), codegen

    return operation


def _split(builder, value, bits, fraction, bias):
    """Whole lanes: the bits, and the exponent that leaves the mantissa in 0.75..1.5."""
    integers = ir.VectorType(ir.IntType(bits), LANES)
    three_quarters = ((bias - 1) << fraction) | (1 << (fraction - 1))
    as_bits = builder.bitcast(value, integers)
    above = builder.sub(as_bits, ir.Constant(integers, [three_quarters] * LANES))
    return as_bits, builder.ashr(above, ir.Constant(integers, [fraction] * LANES))


def _emit_exponent(builder, value, *layout):
    return builder.sitofp(_split(builder, value, *layout)[1], value.type)


def _emit_mantissa(builder, value, *layout):
    as_bits, power = _split(builder, value, *layout)
    shifted = builder.shl(power, ir.Constant(power.type, [layout[1]] * LANES))
    return builder.bitcast(builder.sub(as_bits, shifted), value.type)


def _emit_intrinsic(name):
    def emit(builder, value, *layout):
        signature = ir.FunctionType(value.type, [value.type])
        full = f"llvm.{name}.v{LANES}f{layout[0]}"
        return builder.call(builder.module.declare_intrinsic(full, fnty=signature), [value])

    return emit


def _emit_power_of_two(builder, value, bits, fraction, bias):
    integers = ir.VectorType(ir.IntType(bits), LANES)
    power = builder.fptosi(value, integers)
    biased = builder.add(power, ir.Constant(integers, [bias] * LANES))
    raised = builder.shl(biased, ir.Constant(integers, [fraction] * LANES))
    return builder.bitcast(raised, value.type)


exponent = _unary(_emit_exponent)
mantissa = _unary(_emit_mantissa)
whole = _unary(_emit_intrinsic("rint"))
root = _unary(_emit_intrinsic("sqrt"))
power_of_two = _unary(_emit_power_of_two)


@intrinsic
def total(typingctx, value):
    """Sum of the lanes: halves added to halves, so the order never changes."""
    if not isinstance(value, _Lanes):
        return None

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
