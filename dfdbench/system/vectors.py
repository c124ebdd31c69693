"""Process eight float64 at once in compiled code, for loops too short for auto-vectorisation.

When LLVM vectorises a loop itself, the loop first checks whether arrays overlap, and does its last
few steps one by one. Slices, which tell LLVM that an index is not negative, count references. If
rows are twenty numbers long, this takes longer than the sums. Each of the eight numbers is rounded
like a single float64, and no product is fused with a sum: results do not depend on the processor.
"""

from typing import Any

from llvmlite import ir
from numba import types
from numba.extending import intrinsic as _intrinsic
from numba.extending import models, register_model

#: How many numbers a vector has.
LANES = 8

_VECTOR = ir.VectorType(ir.DoubleType(), LANES)
_ZEROS = ir.Constant(ir.VectorType(ir.IntType(32), LANES), [0] * LANES)

# Its decorated functions are called without their first argument, which no type expresses.
intrinsic: Any = _intrinsic


class _Vector(types.Type):
    def __init__(self) -> None:
        super().__init__(name=f"float64 x {LANES}")


_vector = _Vector()


@register_model(_Vector)
class _VectorModel(models.PrimitiveModel):
    def __init__(self, manager: Any, kind: Any) -> None:
        super().__init__(manager, kind, _VECTOR)


@intrinsic
def load(typing: Any, array: Any, at: Any) -> Any:
    """Return ``array[at : at + LANES]`` of a contiguous float64 array, without bounds checks.

    Examples
    --------
    >>> import numpy as np
    >>> from dfdbench.system.compiled import compiled
    >>> @compiled()
    ... def add_twice(sums, numbers):
    ...     store(sums, 0, plus(load(sums, 0), times(load(numbers, 0), all_of(2.0))))
    >>> sums = np.ones(8)
    >>> add_twice(sums, np.arange(8.0))
    >>> sums.tolist()
    [1.0, 3.0, 5.0, 7.0, 9.0, 11.0, 13.0, 15.0]
    """

    def code(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        return builder.load(_place(context, builder, signature, args, _VECTOR), align=8)

    return _vector(array, types.intp), code


@intrinsic
def store(typing: Any, array: Any, at: Any, numbers: Any) -> Any:
    """Write ``array[at : at + LANES]`` of a contiguous float64 array, without bounds checks."""

    def code(context: Any, builder: Any, signature: Any, args: Any) -> None:
        place = _place(context, builder, signature, args, _VECTOR)
        builder.store(args[2], place, align=8)

    return types.void(array, types.intp, _vector), code


@intrinsic
def all_of(typing: Any, number: Any) -> Any:
    """Return a vector that repeats one number."""

    def code(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        return _spread(builder, args[0], _VECTOR)

    return _vector(types.float64), code


@intrinsic
def plus(typing: Any, first: Any, second: Any) -> Any:
    """Return the sums of two vectors."""
    return _vector(_vector, _vector), lambda context, builder, signature, args: builder.fadd(*args)


@intrinsic
def times(typing: Any, first: Any, second: Any) -> Any:
    """Return the products of two vectors."""
    return _vector(_vector, _vector), lambda context, builder, signature, args: builder.fmul(*args)


@intrinsic
def where_below(typing: Any, array: Any, at: Any, limit: Any, numbers: Any) -> Any:
    """Return numbers where ``array[at : at + LANES]``, of a signed integer type, is below a limit.

    Return 0 elsewhere; the limit has the array's type.
    """

    def code(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        kind = context.get_value_type(signature.args[0].dtype)
        vector = ir.VectorType(kind, LANES)
        found = builder.load(_place(context, builder, signature, args, vector), align=1)
        limits = _spread(builder, builder.trunc(args[2], kind), vector)
        below = builder.icmp_signed("<", found, limits)
        return builder.select(below, args[3], ir.Constant(_VECTOR, [0.0] * LANES))

    return _vector(array, types.intp, types.int64, _vector), code


def _place(context: Any, builder: Any, signature: Any, args: Any, vector: Any) -> Any:
    data = context.make_array(signature.args[0])(context, builder, args[0]).data
    return builder.bitcast(builder.gep(data, [args[1]]), vector.as_pointer())


def _spread(builder: Any, number: Any, vector: Any) -> Any:
    nothing = ir.Constant(vector, ir.Undefined)
    first = builder.insert_element(nothing, number, ir.Constant(ir.IntType(32), 0))
    return builder.shuffle_vector(first, nothing, _ZEROS)
