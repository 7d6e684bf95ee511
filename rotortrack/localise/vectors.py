"""Sixteen numbers at once: a type of float32 vectors for kernels, one spot in each lane.

numba alone vectorises loops only when it feels like it, and a harmless change of code may cost a
factor of five. A value of this type is one LLVM vector from the start, which becomes one register
on AVX-512 and two or four elsewhere; arithmetic with it reads like that of numbers. Lanes never
mix, so no result depends on what stands in the other lanes.
"""

from __future__ import annotations

import operator
from collections.abc import Callable
from typing import Any, Final

import numpy as np
from llvmlite import ir
from numba import extending
from numba.core import cgutils, types
from numba.core.typing.templates import AbstractTemplate, infer_global, signature
from numba.extending import lower_builtin, models, register_model

# numba types it as what it is in Python, not as what kernels call.
intrinsic: Any = extending.intrinsic

LANES: Final = 16

Vector = Any
Mask = Any


class _Vector(types.Type):
    def __init__(self) -> None:
        super().__init__(name="lanes")


class _Mask(types.Type):
    def __init__(self) -> None:
        super().__init__(name="lane_mask")


_FLOAT = ir.FloatType()
FLOATS = ir.VectorType(_FLOAT, LANES)
_INTS = ir.VectorType(ir.IntType(32), LANES)
_BITS = ir.VectorType(ir.IntType(1), LANES)
VECTOR = _Vector()
_MASK = _Mask()
_FLAGS = ("contract",)


@register_model(_Vector)
class _VectorModel(models.PrimitiveModel):
    def __init__(self, manager: Any, kind: Any) -> None:
        super().__init__(manager, kind, FLOATS)


@register_model(_Mask)
class _MaskModel(models.PrimitiveModel):
    def __init__(self, manager: Any, kind: Any) -> None:
        super().__init__(manager, kind, _BITS)


def _splat(builder: Any, value: Any) -> Any:
    vector = builder.insert_element(
        ir.Constant(FLOATS, ir.Undefined), value, ir.Constant(ir.IntType(32), 0)
    )
    return builder.shuffle_vector(
        vector, ir.Constant(FLOATS, ir.Undefined), ir.Constant(_INTS, [0] * LANES)
    )


def _constant(value: float) -> Any:
    return ir.Constant(FLOATS, [float(np.float32(value))] * LANES)


def widen(context: Any, builder: Any, kind: Any, value: Any) -> Any:
    """Give a number to every lane; vectors pass."""
    if kind is VECTOR or isinstance(kind, _Vector):
        return value
    return _splat(builder, context.cast(builder, value, kind, types.float32))


def _is_operand(kind: Any) -> bool:
    return isinstance(kind, (_Vector, types.Number))


def _binary(function: Any, result: Any, code: Callable[[Any, Any, Any], Any]) -> None:
    @infer_global(function)
    class _Rule(AbstractTemplate):
        def generic(self, args: Any, kws: Any) -> Any:
            if (
                len(args) == 2
                and all(map(_is_operand, args))
                and any(isinstance(a, _Vector) for a in args)
            ):
                return signature(result, *args)
            return None

    def lower(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        left, right = (widen(context, builder, k, v) for k, v in zip(sig.args, args, strict=True))
        return code(builder, left, right)

    for left in (_Vector, types.Number):
        for right in (_Vector, types.Number):
            if left is _Vector or right is _Vector:
                lower_builtin(function, left, right)(lower)


_binary(operator.add, VECTOR, lambda b, x, y: b.fadd(x, y, flags=_FLAGS))
_binary(operator.sub, VECTOR, lambda b, x, y: b.fsub(x, y, flags=_FLAGS))
_binary(operator.mul, VECTOR, lambda b, x, y: b.fmul(x, y, flags=_FLAGS))
_binary(operator.truediv, VECTOR, lambda b, x, y: b.fdiv(x, y, flags=_FLAGS))
_binary(operator.iadd, VECTOR, lambda b, x, y: b.fadd(x, y, flags=_FLAGS))
_binary(operator.isub, VECTOR, lambda b, x, y: b.fsub(x, y, flags=_FLAGS))
_binary(operator.imul, VECTOR, lambda b, x, y: b.fmul(x, y, flags=_FLAGS))


def _comparison(function: Any, sign: str) -> None:
    _binary(function, _MASK, lambda builder, x, y: builder.fcmp_ordered(sign, x, y))


_comparison(operator.lt, "<")
_comparison(operator.le, "<=")
_comparison(operator.gt, ">")
_comparison(operator.ge, ">=")
_comparison(operator.eq, "==")


def _mask_binary(function: Any, name: str) -> None:
    @infer_global(function)
    class _Rule(AbstractTemplate):
        def generic(self, args: Any, kws: Any) -> Any:
            if len(args) == 2 and all(isinstance(a, _Mask) for a in args):
                return signature(_MASK, *args)
            return None

    @lower_builtin(function, _Mask, _Mask)
    def _lower(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        return getattr(builder, name)(*args)


_mask_binary(operator.and_, "and_")
_mask_binary(operator.or_, "or_")
_mask_binary(operator.iand, "and_")
_mask_binary(operator.ior, "or_")


def _unary(function: Any, kind: Any, code: Callable[[Any, Any], Any]) -> None:
    @infer_global(function)
    class _Rule(AbstractTemplate):
        def generic(self, args: Any, kws: Any) -> Any:
            return (
                signature(args[0], *args)
                if len(args) == 1 and isinstance(args[0], type(kind))
                else None
            )

    @lower_builtin(function, type(kind))
    def _lower(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        return code(builder, args[0])


_unary(operator.neg, VECTOR, lambda b, x: b.fneg(x))
_unary(operator.invert, _MASK, lambda b, x: b.not_(x))


def _math(name: str) -> Callable[[Any, Any], Any]:
    def code(builder: Any, x: Any) -> Any:
        function = cgutils.get_or_insert_function(
            builder.module, ir.FunctionType(FLOATS, [FLOATS]), f"llvm.{name}.v16f32"
        )
        return builder.call(function, [x])

    return code


_unary(abs, VECTOR, _math("fabs"))


@intrinsic
def sqrt(typing: Any, x: Any) -> Any:
    """Take the square root of each lane."""

    def code(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        return _math("sqrt")(builder, args[0])

    return VECTOR(x), code


@intrinsic
def all_lanes(typing: Any, value: Any) -> Any:
    """Give a number to every lane."""

    def code(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        return widen(context, builder, value, args[0])

    return VECTOR(value), code


@intrinsic
def select(typing: Any, mask: Any, yes: Any, no: Any) -> Any:
    """Take `yes` in the lanes of the mask and `no` in the others."""

    def code(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        return builder.select(
            args[0], widen(context, builder, yes, args[1]), widen(context, builder, no, args[2])
        )

    return VECTOR(mask, yes, no), code


def _extremum(sign: str) -> Any:
    def code(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        x, y = (widen(context, builder, k, v) for k, v in zip(sig.args, args, strict=True))
        return builder.select(builder.fcmp_ordered(sign, x, y), x, y)

    return code


@intrinsic
def smaller(typing: Any, x: Any, y: Any) -> Any:
    """Take the smaller of each lane; where `x` is NaN, `y`."""
    return VECTOR(x, y), _extremum("<")


@intrinsic
def larger(typing: Any, x: Any, y: Any) -> Any:
    """Take the larger of each lane; where `x` is NaN, `y`."""
    return VECTOR(x, y), _extremum(">")


@intrinsic
def bits(typing: Any, mask: Any) -> Any:
    """Pack a mask into an integer: bit l for lane l."""

    def code(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        return builder.zext(builder.bitcast(args[0], ir.IntType(LANES)), ir.IntType(64))

    return types.int64(mask), code


def _pointer(context: Any, builder: Any, kind: Any, value: Any, index: Any, wide: Any) -> Any:
    array = context.make_array(kind)(context, builder, value=value)
    offset = builder.mul(index, ir.Constant(index.type, LANES))
    return builder.bitcast(builder.gep(array.data, [offset]), wide.as_pointer())


@intrinsic
def load(typing: Any, array: Any, index: Any) -> Any:
    """Read lane vector number `index` of a contiguous float32 array."""

    def code(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        k = context.cast(builder, args[1], index, types.intp)
        return builder.load(_pointer(context, builder, array, args[0], k, FLOATS), align=4)

    return VECTOR(array, index), code


@intrinsic
def store(typing: Any, array: Any, index: Any, value: Any) -> Any:
    """Write lane vector number `index` of a contiguous float32 or float64 array."""

    def code(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        k = context.cast(builder, args[1], index, types.intp)
        x = widen(context, builder, value, args[2])
        wide = FLOATS
        if array.dtype == types.float64:
            wide = ir.VectorType(ir.DoubleType(), LANES)
            x = builder.fpext(x, wide)
        builder.store(x, _pointer(context, builder, array, args[0], k, wide), align=4)
        return context.get_dummy_value()

    return types.none(array, index, value), code


def _ints(value: int) -> Any:
    return ir.Constant(_INTS, [value] * LANES)


@intrinsic
def exp2_parts(typing: Any, x: Any) -> Any:
    """Split x into its nearest whole number k, as the float 2^k, and x - k; |x| below 126."""

    def code(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        whole = _math("rint")(builder, args[0])
        exponent = builder.fptosi(whole, _INTS)
        power = builder.bitcast(builder.shl(builder.add(exponent, _ints(127)), _ints(23)), FLOATS)
        rest = builder.fsub(args[0], whole)
        return context.make_tuple(builder, sig.return_type, (power, rest))

    return types.UniTuple(VECTOR, 2)(x), code


@intrinsic
def log2_parts(typing: Any, x: Any) -> Any:
    """Split a normal x > 0 into k and m with x = 2^k m and m within sqrt(1/2) .. sqrt(2)."""

    def code(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        # Bits of sqrt(1/2): subtracting them makes the exponent field count from there.
        half = _ints(0x3F3504F3)
        number = builder.bitcast(args[0], _INTS)
        shifted = builder.sub(number, half)
        exponent = builder.ashr(shifted, _ints(23))
        mantissa = builder.bitcast(builder.sub(number, builder.shl(exponent, _ints(23))), FLOATS)
        return context.make_tuple(
            builder, sig.return_type, (builder.sitofp(exponent, FLOATS), mantissa)
        )

    return types.UniTuple(VECTOR, 2)(x), code
