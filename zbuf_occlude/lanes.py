"""Vectors of 16 float32 lanes for numba kernels, and masks of 16 bits.

LLVM lowers them to whatever the machine has: one AVX-512 register, two of AVX, four of SSE. Kernels touch LLVM only
here, in `threads` and in `image_space.reference`; `tests/test_lanes.py` compares every operation with its plain twin in
NumPy.

A vector lives inside a kernel only: it is loaded from a C-contiguous float32 array at a flat index, computed with
(``+ - *``, the functions below), and stored, or reduced to a number or to a mask. A mask is an int64 whose bit i
stands for lane i. Nothing here is contracted or reassociated beyond `muladd`, which may round once or twice.
"""

import operator
from collections.abc import Callable
from typing import Any

from llvmlite import ir
from numba import njit, types
from numba.core import cgutils
from numba.core.datamodel import models, register_default
from numba.core.errors import TypingError
from numba.extending import intrinsic, overload

inner = njit(_nrt=False, no_cpython_wrapper=True, no_cfunc_wrapper=True)
"""Decorator of a function that only kernels call: Python, to which it would be no function at all, must not.

Without the code by which Python calls a function compiling takes a tenth less. It allocates nothing (``_nrt=False``),
and references to its arrays are not counted, which would cost more than the geometry.
"""
inlined = njit(_nrt=False, forceinline=True, no_cpython_wrapper=True, no_cfunc_wrapper=True)
"""The same for what is best copied into its callers."""
merged = njit(_nrt=False, inline="always", no_cpython_wrapper=True, no_cfunc_wrapper=True)
"""The same for what has one caller, itself without counted references, which takes it in before it is compiled.

A caller's options become its own, so one that counts references would here, too; `tests/test_kernels.py` looks.
Of nested functions numba optimises the inner ones anew with each outer one.
"""

N_LANES = 16
ALL = (1 << N_LANES) - 1
"""The mask of all lanes."""


class VectorType(types.Type):  # type: ignore[misc]  # numba ships no types
    """Numba's type of a vector of 16 float32."""

    def __init__(self) -> None:
        super().__init__(name="float32x16")


VECTOR = VectorType()
_FLOATS = ir.VectorType(ir.FloatType(), N_LANES)
_INTS = ir.VectorType(ir.IntType(32), N_LANES)
_BOOLS = ir.VectorType(ir.IntType(1), N_LANES)
_BITS = ir.IntType(N_LANES)
_WORD = ir.IntType(64)


@register_default(VectorType)
class _VectorModel(models.PrimitiveModel):  # type: ignore[misc]  # numba ships no types
    def __init__(self, manager: Any, kind: Any) -> None:
        super().__init__(manager, kind, _FLOATS)


def _to_word(builder: Any, bools: Any) -> Any:
    return builder.zext(builder.bitcast(bools, _BITS), _WORD)


def _repeat(builder: Any, value: Any, kind: Any) -> Any:
    one = builder.insert_element(ir.Constant(kind, ir.Undefined), value, ir.Constant(ir.IntType(32), 0))
    return builder.shuffle_vector(one, ir.Constant(kind, ir.Undefined), ir.Constant(_INTS, [0] * N_LANES))


def _address(context: Any, builder: Any, kind: Any, array: Any, index: Any, vector: Any) -> Any:
    data = context.make_array(kind)(context, builder, array).data
    return builder.bitcast(builder.gep(data, [index]), vector.as_pointer())


def _llvm_function(builder: Any, name: str, n_arguments: int) -> Any:
    return cgutils.get_or_insert_function(builder.module, ir.FunctionType(_FLOATS, [_FLOATS] * n_arguments), name)


def _must_be_contiguous(array: Any) -> None:
    if array.layout != "C" or array.dtype != types.float32:
        raise TypingError(f"lanes must be taken from a C-contiguous float32 array; got {array}.")


def _binary(emit: Callable[[Any, Any, Any], Any], result: Any = VECTOR) -> Any:
    """Make a function of two vectors from what it emits."""

    @intrinsic
    def operation(typing_context, a, b):
        def codegen(context, builder, signature, args):
            return emit(builder, *args)

        return result(VECTOR, VECTOR), codegen

    return operation


def _smaller(builder: Any, a: Any, b: Any) -> Any:
    return builder.select(builder.fcmp_ordered("<", a, b), a, b)


def _larger(builder: Any, a: Any, b: Any) -> Any:
    return builder.select(builder.fcmp_ordered(">", a, b), a, b)


minimum = _binary(_smaller)
"""Smaller of a and b in each lane; b where either is NaN."""
maximum = _binary(_larger)
"""Larger of a and b in each lane; b where either is NaN."""
divide = _binary(lambda builder, a, b: builder.fdiv(a, b))
"""a / b"""
greater = _binary(lambda builder, a, b: _to_word(builder, builder.fcmp_ordered(">", a, b)), types.int64)
"""Mask of a > b; False where either is NaN."""
not_less = _binary(lambda builder, a, b: _to_word(builder, builder.fcmp_unordered(">=", a, b)), types.int64)
"""Mask of not (a < b); True where either is NaN."""

_add = _binary(lambda builder, a, b: builder.fadd(a, b))
_subtract = _binary(lambda builder, a, b: builder.fsub(a, b))
_multiply = _binary(lambda builder, a, b: builder.fmul(a, b))


@overload(operator.add)
def _overload_add(a, b):
    if isinstance(a, VectorType) and isinstance(b, VectorType):
        return lambda a, b: _add(a, b)
    return None


@overload(operator.sub)
def _overload_subtract(a, b):
    if isinstance(a, VectorType) and isinstance(b, VectorType):
        return lambda a, b: _subtract(a, b)
    return None


@overload(operator.mul)
def _overload_multiply(a, b):
    if isinstance(a, VectorType) and isinstance(b, VectorType):
        return lambda a, b: _multiply(a, b)
    return None


@intrinsic
def muladd(typing_context, a, b, c):
    """a * b + c, fused where the machine can."""

    def codegen(context, builder, signature, args):
        return builder.call(_llvm_function(builder, "llvm.fmuladd.v16f32", 3), args)

    return VECTOR(VECTOR, VECTOR, VECTOR), codegen


@intrinsic
def absolute(typing_context, a):
    """|a|"""

    def codegen(context, builder, signature, args):
        return builder.call(_llvm_function(builder, "llvm.fabs.v16f32", 1), args)

    return VECTOR(VECTOR), codegen


@intrinsic
def square_root(typing_context, a):
    """The square root, NaN of negative numbers."""

    def codegen(context, builder, signature, args):
        return builder.call(_llvm_function(builder, "llvm.sqrt.v16f32", 1), args)

    return VECTOR(VECTOR), codegen


@intrinsic
def splat(typing_context, value):
    """One number in all lanes."""

    def codegen(context, builder, signature, args):
        return _repeat(builder, args[0], _FLOATS)

    return VECTOR(types.float32), codegen


@intrinsic
def load(typing_context, array, index):
    """The 16 float32 of an array that begin at a flat index."""
    _must_be_contiguous(array)

    def codegen(context, builder, signature, args):
        return builder.load(_address(context, builder, signature.args[0], args[0], args[1], _FLOATS), align=4)

    return VECTOR(array, types.intp), codegen


@intrinsic
def spread(typing_context, array, index):
    """The float32 of an array at a flat index, in all lanes."""
    _must_be_contiguous(array)

    def codegen(context, builder, signature, args):
        address = _address(context, builder, signature.args[0], args[0], args[1], ir.FloatType())
        return _repeat(builder, builder.load(address, align=4), _FLOATS)

    return VECTOR(array, types.intp), codegen


@intrinsic
def store(typing_context, array, index, vector):
    """Write 16 float32 to an array from a flat index on."""
    _must_be_contiguous(array)

    def codegen(context, builder, signature, args):
        builder.store(args[2], _address(context, builder, signature.args[0], args[0], args[1], _FLOATS), align=4)
        return context.get_dummy_value()

    return types.void(array, types.intp, VECTOR), codegen


@intrinsic
def equal(typing_context, array, index, value):
    """Mask of the 16 int32 of an array from a flat index on that equal a value."""

    def codegen(context, builder, signature, args):
        values = builder.load(_address(context, builder, signature.args[0], args[0], args[1], _INTS), align=4)
        return _to_word(builder, builder.icmp_signed("==", values, _repeat(builder, args[2], _INTS)))

    return types.int64(array, types.intp, types.int32), codegen


@intrinsic
def fill(typing_context, array, index, mask, value):
    """Write a value to the lanes of a mask of the 16 int32 of an array from a flat index on."""

    def codegen(context, builder, signature, args):
        address = _address(context, builder, signature.args[0], args[0], args[1], _INTS)
        bools = builder.bitcast(builder.trunc(args[2], _BITS), _BOOLS)
        old = builder.load(address, align=4)
        builder.store(builder.select(bools, _repeat(builder, args[3], _INTS), old), address, align=4)
        return context.get_dummy_value()

    return types.void(array, types.intp, types.int64, types.int32), codegen


@intrinsic
def select(typing_context, mask, a, b):
    """a in the lanes of a mask, b in the others."""

    def codegen(context, builder, signature, args):
        bools = builder.bitcast(builder.trunc(args[0], _BITS), _BOOLS)
        return builder.select(bools, args[1], args[2])

    return VECTOR(types.int64, VECTOR, VECTOR), codegen


def _reduction(emit: Callable[[Any, Any, Any], Any]) -> Any:
    """Make a function of one vector that folds it in halves, 16 to 8 to 4 to 2 to 1."""

    @intrinsic
    def operation(typing_context, a):
        def codegen(context, builder, signature, args):
            vector, n = args[0], N_LANES
            while n > 1:
                n //= 2
                halves = [
                    builder.shuffle_vector(
                        vector,
                        ir.Constant(vector.type, ir.Undefined),
                        ir.Constant(ir.VectorType(ir.IntType(32), n), list(range(first, first + n))),
                    )
                    for first in (0, n)
                ]
                vector = emit(builder, *halves)
            return builder.extract_element(vector, ir.Constant(ir.IntType(32), 0))

        return types.float32(VECTOR), codegen

    return operation


lowest = _reduction(_smaller)
"""The smallest lane."""
highest = _reduction(_larger)
"""The largest lane."""


@intrinsic
def first_lane(typing_context, mask):
    """The lowest lane of a mask that is not empty."""

    def codegen(context, builder, signature, args):
        return builder.cttz(args[0], ir.Constant(ir.IntType(1), 1))

    return types.int64(types.int64), codegen


@intrinsic
def count_lanes(typing_context, mask):
    """The number of lanes in a mask."""

    def codegen(context, builder, signature, args):
        return builder.ctpop(args[0])

    return types.int64(types.int64), codegen


# three vectors at a time: tuples of 3, one for each axis


@inlined
def load3(array, index, stride):
    """Load three vectors, each `stride` numbers after the one before."""
    return load(array, index), load(array, index + stride), load(array, index + 2 * stride)


@inlined
def spread3(array, index, stride):
    """Three numbers, each `stride` after the one before, each in all lanes of a vector."""
    return spread(array, index), spread(array, index + stride), spread(array, index + 2 * stride)


@inlined
def store3(array, index, stride, vectors):
    """Write three vectors likewise."""
    store(array, index, vectors[0])
    store(array, index + stride, vectors[1])
    store(array, index + 2 * stride, vectors[2])


@inlined
def splat3(values):
    """Each of three numbers in all lanes."""
    return splat(values[0]), splat(values[1]), splat(values[2])


@inlined
def dot3(a, b, c):
    """a . b + c"""
    return muladd(a[0], b[0], muladd(a[1], b[1], muladd(a[2], b[2], c)))


@inlined
def cross3(a, b):
    """a x b"""
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


@inlined
def transform(matrix, x, y, z):
    """Rows 0 to 2 of a 3 x 4 matrix, (12,) float32, times (x, y, z, 1)."""
    return (
        muladd(x, splat(matrix[0]), muladd(y, splat(matrix[1]), muladd(z, splat(matrix[2]), splat(matrix[3])))),
        muladd(x, splat(matrix[4]), muladd(y, splat(matrix[5]), muladd(z, splat(matrix[6]), splat(matrix[7])))),
        muladd(x, splat(matrix[8]), muladd(y, splat(matrix[9]), muladd(z, splat(matrix[10]), splat(matrix[11])))),
    )
