"""Sixteen numbers at once: a float32 vector type for kernels, with one spot in each lane.

Whether a compiler turns a loop over sixteen lanes into vector instructions hangs on details, and a
harmless change of code can cost a factor of five. A value of this type is a vector from the start:
one register with AVX-512, two or four elsewhere. Arithmetic with it, and with numbers, which count
for every lane, reads as usual. Lanes never mix, so no result depends on what the others hold.

Vectors live in kernels alone; :func:`load` and :func:`store` connect them with arrays, in which
vector k fills the elements 16 k to 16 k + 15.
"""

from __future__ import annotations

import operator
from collections.abc import Callable
from typing import Any, Final, Protocol, cast

import numpy as np
from llvmlite import ir
from numba.core import cgutils, types
from numba.core.typing.templates import AbstractTemplate, infer_global, signature
from numba.extending import intrinsic, lower_builtin, models, register_model

LANES: Final = 16


class Vector(Protocol):
    """Sixteen float32, as the type checker sees them."""

    def __add__(self, other: Vector | float, /) -> Vector: ...
    def __radd__(self, other: float, /) -> Vector: ...
    def __sub__(self, other: Vector | float, /) -> Vector: ...
    def __rsub__(self, other: float, /) -> Vector: ...
    def __mul__(self, other: Vector | float, /) -> Vector: ...
    def __rmul__(self, other: float, /) -> Vector: ...
    def __truediv__(self, other: Vector | float, /) -> Vector: ...
    def __rtruediv__(self, other: float, /) -> Vector: ...
    def __neg__(self) -> Vector: ...
    def __abs__(self) -> Vector: ...
    def __lt__(self, other: Vector | float, /) -> Mask: ...
    def __le__(self, other: Vector | float, /) -> Mask: ...
    def __gt__(self, other: Vector | float, /) -> Mask: ...
    def __ge__(self, other: Vector | float, /) -> Mask: ...
    def __eq__(self, other: object, /) -> Mask: ...  # type: ignore[override]


class Mask(Protocol):
    """Sixteen truths, as the type checker sees them."""

    def __and__(self, other: Mask, /) -> Mask: ...
    def __or__(self, other: Mask, /) -> Mask: ...
    def __invert__(self) -> Mask: ...


class _VectorType(types.Type):
    def __init__(self) -> None:
        super().__init__(name="float32 x 16")


class _MaskType(types.Type):
    def __init__(self) -> None:
        super().__init__(name="bool x 16")


VECTOR = _VectorType()
_MASK = _MaskType()
_INT = ir.IntType(32)
FLOATS = ir.VectorType(ir.FloatType(), LANES)
_DOUBLES = ir.VectorType(ir.DoubleType(), LANES)
_INTS = ir.VectorType(_INT, LANES)
_BITS = ir.VectorType(ir.IntType(1), LANES)

# Multiplication and addition may fuse, as in all kernels.
_FAST = ("contract",)


@register_model(_VectorType)
class _VectorModel(models.PrimitiveModel):
    def __init__(self, manager: Any, kind: Any) -> None:
        super().__init__(manager, kind, FLOATS)  # type: ignore[no-untyped-call]


@register_model(_MaskType)
class _MaskModel(models.PrimitiveModel):
    def __init__(self, manager: Any, kind: Any) -> None:
        super().__init__(manager, kind, _BITS)  # type: ignore[no-untyped-call]


def widen(context: Any, builder: Any, kind: Any, value: Any) -> Any:
    """Give a number to every lane; vectors pass."""
    if isinstance(kind, _VectorType):
        return value
    number = context.cast(builder, value, kind, types.float32)
    first = builder.insert_element(ir.Constant(FLOATS, ir.Undefined), number, ir.Constant(_INT, 0))
    return builder.shuffle_vector(
        first, ir.Constant(FLOATS, ir.Undefined), ir.Constant(_INTS, [0] * LANES)
    )


def _call(builder: Any, name: str, x: Any) -> Any:
    """Call a function of LLVM that takes and returns a vector."""
    function = cgutils.get_or_insert_function(
        builder.module, ir.FunctionType(FLOATS, [FLOATS]), f"llvm.{name}.v{LANES}f32"
    )
    return builder.call(function, [x])


def _define(
    function: Any, operands: tuple[tuple[Any, ...], ...], result: Any, code: Callable[..., Any]
) -> None:
    """Teach numba an operator: for each tuple of operand types, `code` makes the instruction."""

    @infer_global(function)
    class _Rule(AbstractTemplate):
        def generic(self, args: Any, _keywords: Any) -> Any:
            for kinds in operands:
                if len(kinds) == len(args) and all(map(isinstance, args, kinds)):
                    return signature(result, *args)
            return None

    def lower(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        if not isinstance(sig.args[0], _MaskType):
            args = [
                widen(context, builder, kind, value)
                for kind, value in zip(sig.args, args, strict=True)
            ]
        return code(builder, *args)

    for kinds in operands:
        lower_builtin(function, *kinds)(lower)


_PAIRS = (
    (_VectorType, _VectorType),
    (_VectorType, types.Number),
    (types.Number, _VectorType),
)
for _functions, _name in (
    ((operator.add, operator.iadd), "fadd"),
    ((operator.sub, operator.isub), "fsub"),
    ((operator.mul, operator.imul), "fmul"),
    ((operator.truediv, operator.itruediv), "fdiv"),
):
    for _function in _functions:
        _define(
            _function,
            _PAIRS,
            VECTOR,
            lambda builder, x, y, name=_name: getattr(builder, name)(x, y, flags=_FAST),
        )
for _function, _sign in (
    (operator.lt, "<"),
    (operator.le, "<="),
    (operator.gt, ">"),
    (operator.ge, ">="),
    (operator.eq, "=="),
):
    _define(
        _function,
        _PAIRS,
        _MASK,
        lambda builder, x, y, sign=_sign: builder.fcmp_ordered(sign, x, y),
    )
_define(operator.neg, ((_VectorType,),), VECTOR, lambda builder, x: builder.fneg(x))
_define(abs, ((_VectorType,),), VECTOR, lambda builder, x: _call(builder, "fabs", x))
_MASKS = ((_MaskType, _MaskType),)
_define(operator.and_, _MASKS, _MASK, lambda builder, x, y: builder.and_(x, y))
_define(operator.or_, _MASKS, _MASK, lambda builder, x, y: builder.or_(x, y))
_define(operator.invert, ((_MaskType,),), _MASK, lambda builder, x: builder.not_(x))


def gives_vector(function: Callable[..., Any]) -> Callable[..., Vector]:
    """Make a function of kernels from one that gives its type and the code of its calls."""
    return cast(Callable[..., Vector], intrinsic(function))


def gives_pair(function: Callable[..., Any]) -> Callable[..., tuple[Vector, Vector]]:
    """Do the same for two vectors."""
    return cast(Callable[..., tuple[Vector, Vector]], intrinsic(function))


def gives_number(function: Callable[..., Any]) -> Callable[..., int]:
    """Do the same for a whole number."""
    return cast(Callable[..., int], intrinsic(function))


def gives_nothing(function: Callable[..., Any]) -> Callable[..., None]:
    """Do the same for what is done to arrays."""
    return cast(Callable[..., None], intrinsic(function))


@gives_vector
def all_lanes(_context: Any, number: Any) -> Any:
    """Give a number to every lane."""

    def code(context: Any, builder: Any, _sig: Any, args: Any) -> Any:
        return widen(context, builder, number, args[0])

    return VECTOR(number), code


@gives_vector
def sqrt(_context: Any, x: Any) -> Any:
    """Take the square root of every lane."""

    def code(_context: Any, builder: Any, _sig: Any, args: Any) -> Any:
        return _call(builder, "sqrt", args[0])

    return VECTOR(x), code


@gives_vector
def select(_context: Any, mask: Any, yes: Any, no: Any) -> Any:
    """Take `yes` in the lanes of the mask and `no` in the others."""

    def code(context: Any, builder: Any, _sig: Any, args: Any) -> Any:
        return builder.select(
            args[0],
            widen(context, builder, yes, args[1]),
            widen(context, builder, no, args[2]),
        )

    return VECTOR(mask, yes, no), code


def _extremum(sign: str) -> Callable[..., Any]:
    def code(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        x = widen(context, builder, sig.args[0], args[0])
        y = widen(context, builder, sig.args[1], args[1])
        return builder.select(builder.fcmp_ordered(sign, x, y), x, y)

    return code


@gives_vector
def smaller(_context: Any, x: Any, y: Any) -> Any:
    """Take the smaller of both; where one is NaN, `y`."""
    return VECTOR(x, y), _extremum("<")


@gives_vector
def larger(_context: Any, x: Any, y: Any) -> Any:
    """Take the larger of both; where one is NaN, `y`."""
    return VECTOR(x, y), _extremum(">")


@gives_number
def bits(_context: Any, mask: Any) -> Any:
    """Pack a mask into an integer, lane l into bit l."""

    def code(_context: Any, builder: Any, _sig: Any, args: Any) -> Any:
        return builder.zext(builder.bitcast(args[0], ir.IntType(LANES)), ir.IntType(64))

    return types.int64(mask), code


def _pointer(context: Any, builder: Any, kinds: Any, args: Any, wide: Any) -> Any:
    """Point at the vector that the second argument numbers in the array of the first."""
    array = context.make_array(kinds[0])(context, builder, value=args[0])
    index = context.cast(builder, args[1], kinds[1], types.intp)
    offset = builder.mul(index, ir.Constant(index.type, LANES))
    return builder.bitcast(builder.gep(array.data, [offset]), wide.as_pointer())


@gives_vector
def load(_context: Any, array: Any, index: Any) -> Any:
    """Read vector `index` of a contiguous float32 array; nothing checks its length."""

    def code(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        return builder.load(_pointer(context, builder, sig.args, args, FLOATS), align=4)

    return VECTOR(array, index), code


@gives_nothing
def store(_context: Any, array: Any, index: Any, value: Any) -> Any:
    """Write vector `index` of a contiguous float32 or float64 array; see :func:`load`."""

    def code(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        x = widen(context, builder, value, args[2])
        wide = FLOATS
        if array.dtype == types.float64:
            wide = _DOUBLES
            x = builder.fpext(x, wide)
        builder.store(x, _pointer(context, builder, sig.args, args, wide), align=4)
        return context.get_dummy_value()

    return types.none(array, index, value), code


def _all_ints(value: int) -> Any:
    return ir.Constant(_INTS, [value] * LANES)


@gives_pair
def exp2_parts(_context: Any, x: Any) -> Any:
    """Give 2^k and x - k for the whole number k nearest to x, which lies within -126 and 127."""

    def code(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        whole = _call(builder, "rint", args[0])
        exponent = builder.add(builder.fptosi(whole, _INTS), _all_ints(127))
        power = builder.bitcast(builder.shl(exponent, _all_ints(23)), FLOATS)
        return context.make_tuple(builder, sig.return_type, (power, builder.fsub(args[0], whole)))

    return types.UniTuple(VECTOR, 2)(x), code


@gives_pair
def log2_parts(_context: Any, x: Any) -> Any:
    """Give k and m with x = 2^k m and m from sqrt(1/2) to sqrt(2), for normal x > 0."""

    def code(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        number = builder.bitcast(args[0], _INTS)
        # Counted from the bits of sqrt(1/2), the field of the exponent changes there.
        root = int(np.float32(np.sqrt(0.5)).view(np.int32))
        exponent = builder.ashr(builder.sub(number, _all_ints(root)), _all_ints(23))
        mantissa = builder.sub(number, builder.shl(exponent, _all_ints(23)))
        return context.make_tuple(
            builder,
            sig.return_type,
            (builder.sitofp(exponent, FLOATS), builder.bitcast(mantissa, FLOATS)),
        )

    return types.UniTuple(VECTOR, 2)(x), code
