"""Sixteen neighbouring pixels at once: how filters read, shift and add up rows of an image."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, cast

from llvmlite import ir
from numba.core import types
from numba.extending import intrinsic

from rotortrack.localise.vectors import (
    FLOATS,
    LANES,
    VECTOR,
    Vector,
    gives_nothing,
    gives_vector,
    widen,
)

_INDEX = ir.IntType(32)
_INDICES = ir.VectorType(_INDEX, LANES)


def _place(context: Any, builder: Any, kind: Any, array: Any, element: Any) -> Any:
    data = context.make_array(kind)(context, builder, value=array).data
    return builder.gep(data, [element])


@gives_vector
def load_pixels(typing: Any, array: Any, element: Any) -> Any:
    """Read 16 values of a contiguous float32 or uint16 array from an element on, as floats."""

    def code(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        kind = sig.args[0]
        place = _place(
            context, builder, kind, args[0], context.cast(builder, args[1], element, types.intp)
        )
        if kind.dtype == types.float32:
            return builder.load(builder.bitcast(place, FLOATS.as_pointer()), align=4)
        whole = ir.VectorType(ir.IntType(16), LANES)
        counts = builder.load(builder.bitcast(place, whole.as_pointer()), align=2)
        return builder.uitofp(counts, FLOATS)

    if array.dtype not in (types.float32, types.uint16):
        return None
    return VECTOR(array, element), code


@gives_nothing
def store_pixels(typing: Any, array: Any, element: Any, value: Any) -> Any:
    """Write 16 values into a contiguous float32 array from an element on."""

    def code(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        place = _place(
            context,
            builder,
            sig.args[0],
            args[0],
            context.cast(builder, args[1], element, types.intp),
        )
        pixels = widen(context, builder, value, args[2])
        builder.store(pixels, builder.bitcast(place, FLOATS.as_pointer()), align=4)
        return context.get_dummy_value()

    return types.none(array, element, value), code


def _shifted(typing: Any, left: Any, right: Any, by: Any) -> Any:
    """Take 16 of the 32 values of two neighbouring vectors, from value number `by` (literal) on."""
    if not isinstance(by, types.IntegerLiteral):
        return None
    first = by.literal_value

    def code(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        chosen = ir.Constant(_INDICES, list(range(first, first + LANES)))
        return builder.shuffle_vector(args[0], args[1], chosen)

    return VECTOR(left, right, by), code


shifted = cast(Callable[[Vector, Vector, int], Vector], intrinsic(prefer_literal=True)(_shifted))


def _total(typing: Any, values: Any) -> Any:
    """Add up the 16 values, pairwise, in the same order on every machine."""

    def code(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        summed = args[0]
        width = LANES // 2
        while width:
            upper = [lane + width if lane < width else 0 for lane in range(LANES)]
            moved = builder.shuffle_vector(
                summed, ir.Constant(FLOATS, ir.Undefined), ir.Constant(_INDICES, upper)
            )
            summed = builder.fadd(summed, moved)
            width //= 2
        return builder.extract_element(summed, ir.Constant(_INDEX, 0))

    return types.float32(values), code


total = cast(Callable[[Vector], float], intrinsic(_total))
