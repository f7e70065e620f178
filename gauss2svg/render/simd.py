"""Sixteen float32 lanes as one numba value, so that kernels vectorise by construction.

LLVM's loop vectoriser gives up on the compositing loops (many small buffers
that could alias). Here a row of a tile is one `<16 x float>` value: LLVM maps it
to one 512-bit, two 256-bit or four 128-bit registers, whatever the machine has.
The arithmetic may be contracted to fused multiply-adds and nothing else, so
that NaN and infinity behave as they do in plain code.

    load(array, i)      lanes from array.flat[i : i + 16] (C-contiguous float32)
    store(array, i, v)  and back
    splat(x)            sixteen times x
    + - *               between lanes
    least, most         lane by lane minimum and maximum
    total(v)            sum of the lanes, by pairs, in a fixed order
"""

import operator
from typing import Any

from llvmlite import ir
from numba import types
from numba.extending import intrinsic, models, overload, register_model

LANES = 16
_VECTOR = ir.VectorType(ir.FloatType(), LANES)
_CONTRACT = ("contract",)


class _Lanes(types.Type):
    def __init__(self) -> None:
        super().__init__(name="float32x16")


lanes_type = _Lanes()


@register_model(_Lanes)
class _LanesModel(models.PrimitiveModel):
    def __init__(self, dmm: Any, fe_type: Any) -> None:
        super().__init__(dmm, fe_type, _VECTOR)


def _lane_pointer(context: Any, builder: Any, array_type: Any, array: Any, index: Any) -> Any:
    data = context.make_array(array_type)(context, builder, array).data
    element = builder.gep(data, [index], inbounds=True)
    return builder.bitcast(element, _VECTOR.as_pointer())


def _is_lane_source(array: Any) -> bool:
    return isinstance(array, types.Array) and array.dtype == types.float32 and array.layout == "C"


@intrinsic
def load(typingctx, array, index):
    """Lanes from the 16 elements of a C-contiguous float32 array that start at flat index."""
    if not _is_lane_source(array):
        return None

    def codegen(context, builder, signature, args):
        at = context.cast(builder, args[1], signature.args[1], types.intp)
        pointer = _lane_pointer(context, builder, signature.args[0], args[0], at)
        return builder.load(pointer, align=4)

    return lanes_type(array, index), codegen


@intrinsic
def store(typingctx, array, index, value):
    """Write lanes to the 16 elements that start at flat index."""
    if not _is_lane_source(array) or value != lanes_type:
        return None

    def codegen(context, builder, signature, args):
        at = context.cast(builder, args[1], signature.args[1], types.intp)
        pointer = _lane_pointer(context, builder, signature.args[0], args[0], at)
        builder.store(args[2], pointer, align=4)
        return context.get_dummy_value()

    return types.void(array, index, value), codegen


@intrinsic
def splat(typingctx, value):
    """Sixteen lanes of one number, converted to float32."""
    if not isinstance(value, (types.Float, types.Integer)):
        return None

    def codegen(context, builder, signature, args):
        scalar = context.cast(builder, args[0], signature.args[0], types.float32)
        single = builder.insert_element(
            ir.Constant(_VECTOR, ir.Undefined), scalar, ir.Constant(ir.IntType(32), 0)
        )
        mask = ir.Constant(ir.VectorType(ir.IntType(32), LANES), [0] * LANES)
        return builder.shuffle_vector(single, ir.Constant(_VECTOR, ir.Undefined), mask)

    return lanes_type(value), codegen


def _binary(emit):
    @intrinsic
    def operation(typingctx, left, right):
        if left != lanes_type or right != lanes_type:
            return None

        def codegen(context, builder, signature, args):
            return emit(builder, args[0], args[1])

        return lanes_type(left, right), codegen

    return operation


least = _binary(lambda builder, a, b: builder.select(builder.fcmp_ordered("<", a, b), a, b))
most = _binary(lambda builder, a, b: builder.select(builder.fcmp_ordered(">", a, b), a, b))
_add = _binary(lambda builder, a, b: builder.fadd(a, b, flags=_CONTRACT))
_sub = _binary(lambda builder, a, b: builder.fsub(a, b, flags=_CONTRACT))
_mul = _binary(lambda builder, a, b: builder.fmul(a, b, flags=_CONTRACT))


def _overload_operator(symbol, operation):
    @overload(symbol, inline="always")
    def implementation(left, right):
        if left == lanes_type and right == lanes_type:
            return lambda left, right: operation(left, right)
        return None


_overload_operator(operator.add, _add)
_overload_operator(operator.sub, _sub)
_overload_operator(operator.mul, _mul)


@intrinsic
def total(typingctx, value):
    """Sum of the lanes: halves added to halves, so the order never changes."""
    if value != lanes_type:
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

    return types.float32(value), codegen
