"""SIMD vectors of 16 float32 lanes for numba kernels, wide vectors of 32 lanes, and their masks.

LLVM lowers 16 lanes to one AVX-512 register, two AVX registers or four SSE registers. Kernels use LLVM only through
this package; `tests/base/jit/test_simd.py` compares every operation with its NumPy equivalent.

A vector exists only inside a kernel. It is loaded from a C-contiguous float32 array at a flat index, computed with
(``+ - *`` and the functions below), and stored, or reduced to a number or a mask. Operations take vectors of 16 or of
32 lanes; a float32 among their operands is broadcast. A mask is an int64 whose bit i stands for lane i. Nothing here is
contracted or reassociated except `muladd`, which may round once or twice.
"""

import operator
from collections.abc import Callable
from typing import Any

from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.core.datamodel import models, register_default
from numba.core.errors import TypingError
from numba.core.typing.templates import AbstractTemplate, infer_global
from numba.extending import intrinsic, lower_builtin

from zbuf_occlude.base.jit.compiler import always_inline

N_LANES = 16
ALL = (1 << N_LANES) - 1
"""Mask of all lanes."""
N_WIDE = 2 * N_LANES
"""Lanes of a wide vector. Its code is compiled once, where a loop over two vectors would be unrolled."""


class VectorType(types.Type):  # type: ignore[misc]  # numba ships no types
    """Numba type of a vector of n float32."""

    def __init__(self, n: int) -> None:
        self.n = n
        self.floats = ir.VectorType(ir.FloatType(), n)
        super().__init__(name=f"float32x{n}")


VECTOR, WIDE = VectorType(N_LANES), VectorType(N_WIDE)
_WORD = ir.IntType(64)


@register_default(VectorType)
class _VectorModel(models.PrimitiveModel):  # type: ignore[misc]  # numba ships no types
    def __init__(self, manager: Any, kind: Any) -> None:
        super().__init__(manager, kind, kind.floats)


def _vector_of(*kinds: Any) -> Any:
    """Return the type of the vectors among the arguments; None without vectors, or with operands of other types."""
    vectors = {kind for kind in kinds if isinstance(kind, VectorType)}
    others = {kind for kind in kinds if kind not in vectors} - {types.float32}
    return vectors.pop() if len(vectors) == 1 and not others else None


def _vectors(builder: Any, vector: Any, kinds: Any, values: Any) -> list[Any]:
    """Return the values as vectors of one type; float32 numbers are broadcast."""
    pairs = zip(kinds, values, strict=True)
    return [_repeat(builder, value, vector.floats) if kind == types.float32 else value for kind, value in pairs]


def _to_word(builder: Any, bools: Any) -> Any:
    return builder.zext(builder.bitcast(bools, ir.IntType(bools.type.count)), _WORD)


def _to_bools(builder: Any, mask: Any, n: int) -> Any:
    return builder.bitcast(builder.trunc(mask, ir.IntType(n)), ir.VectorType(ir.IntType(1), n))


def _repeat(builder: Any, value: Any, kind: Any) -> Any:
    one = builder.insert_element(ir.Constant(kind, ir.Undefined), value, ir.Constant(ir.IntType(32), 0))
    indices = ir.Constant(ir.VectorType(ir.IntType(32), kind.count), [0] * kind.count)
    return builder.shuffle_vector(one, ir.Constant(kind, ir.Undefined), indices)


def _address(context: Any, builder: Any, kind: Any, array: Any, index: Any, vector: Any) -> Any:
    data = context.make_array(kind)(context, builder, array).data
    return builder.bitcast(builder.gep(data, [index]), vector.as_pointer())


def _must_be_contiguous(array: Any) -> None:
    if array.layout != "C" or array.dtype != types.float32:
        raise TypingError(f"lanes must be taken from a C-contiguous float32 array; got {array}.")


def _operation(emit: Callable[..., Any], result: Any, *kinds: Any) -> Any:
    """Return signature and code generator of an operation on vectors and numbers whose code `emit` emits."""
    vector = _vector_of(*kinds)
    if vector is None:
        return None

    def codegen(context, builder, signature, args):
        return emit(builder, *_vectors(builder, vector, kinds, args))

    return (vector if result is None else result)(*kinds), codegen


def _unary(emit: Callable[[Any, Any], Any], result: Any = None) -> Any:
    """Make a function of one vector whose code `emit` emits."""

    @intrinsic
    def operation(typing_context, a):
        return _operation(emit, result, a)

    return operation


def _binary(emit: Callable[[Any, Any, Any], Any], result: Any = None) -> Any:
    """Make a function of two vectors whose code `emit` emits."""

    @intrinsic
    def operation(typing_context, a, b):
        return _operation(emit, result, a, b)

    return operation


def _call(name: str) -> Callable[..., Any]:
    """Return an emitter of calls to one of LLVM's vector intrinsics."""

    def emit(builder: Any, *args: Any) -> Any:
        kind = args[0].type
        function = ir.FunctionType(kind, [kind] * len(args))
        return builder.call(
            cgutils.get_or_insert_function(builder.module, function, f"llvm.{name}.v{kind.count}f32"), args
        )

    return emit


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
absolute = _unary(_call("fabs"))
"""|a|"""
square_root = _unary(_call("sqrt"))
"""Square root; NaN for negative numbers."""


class _Arithmetic(AbstractTemplate):  # type: ignore[misc]  # numba ships no types
    def generic(self, args: Any, kws: Any) -> Any:
        vector = _vector_of(*args)
        return vector and vector(*args)


def _operator(function: Any, emit: Callable[[Any, Any, Any], Any]) -> None:
    """Define an operator on vectors. An `overload` would be compiled for each pair of types."""
    infer_global(function)(_Arithmetic)

    def lower(context, builder, signature, args):
        return emit(builder, *_vectors(builder, signature.return_type, signature.args, args))

    for kinds in ((VectorType, VectorType), (VectorType, types.float32), (types.float32, VectorType)):
        lower_builtin(function, *kinds)(lower)


_operator(operator.add, lambda builder, a, b: builder.fadd(a, b))
_operator(operator.sub, lambda builder, a, b: builder.fsub(a, b))
_operator(operator.mul, lambda builder, a, b: builder.fmul(a, b))
infer_global(operator.neg)(_Arithmetic)
lower_builtin(operator.neg, VectorType)(lambda context, builder, signature, args: builder.fneg(*args))


@intrinsic
def muladd(typing_context, a, b, c):
    """Compute a * b + c, fused if the machine can."""
    return _operation(_call("fmuladd"), None, a, b, c)


@intrinsic
def fma(typing_context, a, b, c):
    """Compute a * b + c of three float64, rounded once on every machine."""

    def codegen(context, builder, signature, args):
        return builder.fma(*args)

    return types.float64(types.float64, types.float64, types.float64), codegen


@intrinsic
def splat(typing_context, value):
    """Broadcast a number to 16 lanes."""

    def codegen(context, builder, signature, args):
        return _repeat(builder, args[0], VECTOR.floats)

    return VECTOR(types.float32), codegen


@intrinsic
def tag_lanes(typing_context, vector):
    """Write each lane's index to its last four bits, so that no two lanes are equal."""

    def codegen(context, builder, signature, args):
        kind = ir.VectorType(ir.IntType(32), N_LANES)
        bits = builder.and_(builder.bitcast(args[0], kind), ir.Constant(kind, [-N_LANES] * N_LANES))
        return builder.bitcast(builder.or_(bits, ir.Constant(kind, list(range(N_LANES)))), VECTOR.floats)

    return VECTOR(VECTOR), codegen


def _load(result: Any, kind: Any) -> Any:
    @intrinsic
    def operation(typing_context, array, index):
        _must_be_contiguous(array)

        def codegen(context, builder, signature, args):
            return builder.load(_address(context, builder, array, args[0], args[1], kind), align=4)

        return result(array, types.intp), codegen

    return operation


load_scalar = _load(types.float32, ir.FloatType())
"""Load the float32 of an array at a flat index."""
load, load_wide = _load(VECTOR, VECTOR.floats), _load(WIDE, WIDE.floats)
"""Load the 16, or 32, float32 of an array that start at a flat index."""


def _must_be_flat(array: Any) -> None:
    if array.layout != "C":
        raise TypingError(f"numbers must be taken from a C-contiguous array; got {array}.")


@intrinsic
def load_unchecked(typing_context, array, index):
    """Load the number of a C-contiguous array at a flat index, which is not checked and must not be negative."""
    _must_be_flat(array)

    def codegen(context, builder, signature, args):
        return builder.load(builder.gep(context.make_array(array)(context, builder, args[0]).data, [args[1]]))

    return array.dtype(array, types.intp), codegen


@intrinsic
def store_unchecked(typing_context, array, index, value):
    """Store a number in a C-contiguous array at a flat index, which is not checked and must not be negative."""
    _must_be_flat(array)

    def codegen(context, builder, signature, args):
        data = context.make_array(array)(context, builder, args[0]).data
        builder.store(context.cast(builder, args[2], value, array.dtype), builder.gep(data, [args[1]]))
        return context.get_dummy_value()

    return types.void(array, types.intp, value), codegen


@intrinsic
def store(typing_context, array, index, vector):
    """Store a vector in an array at a flat index."""
    _must_be_contiguous(array)
    if _vector_of(vector) is None:
        return None

    def codegen(context, builder, signature, args):
        builder.store(args[2], _address(context, builder, array, args[0], args[1], vector.floats), align=4)
        return context.get_dummy_value()

    return types.void(array, types.intp, vector), codegen


@intrinsic
def prefetch(typing_context, array, index):
    """Fetch the cache line of the number at a flat index, which need not exist, into the first cache."""
    _must_be_flat(array)

    def codegen(context, builder, signature, args):
        address = builder.gep(context.make_array(array)(context, builder, args[0]).data, [args[1]])
        kind = ir.FunctionType(ir.VoidType(), [cgutils.voidptr_t, *[ir.IntType(32)] * 3])
        function = cgutils.get_or_insert_function(builder.module, kind, "llvm.prefetch.p0i8")
        flags = [ir.Constant(ir.IntType(32), flag) for flag in (0, 3, 1)]  # to read, to keep, data
        builder.call(function, [builder.bitcast(address, cgutils.voidptr_t), *flags])
        return context.get_dummy_value()

    return types.void(array, types.intp), codegen


@intrinsic
def equal_wide(typing_context, array, index, value):
    """Return the mask of the 32 int32 of an array, from a flat index on, that equal a value."""

    def codegen(context, builder, signature, args):
        kind = ir.VectorType(ir.IntType(32), N_WIDE)
        values = builder.load(_address(context, builder, array, args[0], args[1], kind), align=4)
        return _to_word(builder, builder.icmp_signed("==", values, _repeat(builder, args[2], kind)))

    return types.int64(array, types.intp, types.int32), codegen


@intrinsic
def store_masked(typing_context, array, index, mask, value):
    """Store a value in the masked lanes of the 16 int32 of an array from a flat index on."""

    def codegen(context, builder, signature, args):
        kind = ir.VectorType(ir.IntType(32), N_LANES)
        address = _address(context, builder, array, args[0], args[1], kind)
        old = builder.load(address, align=4)
        new = builder.select(_to_bools(builder, args[2], N_LANES), _repeat(builder, args[3], kind), old)
        builder.store(new, address, align=4)
        return context.get_dummy_value()

    return types.void(array, types.intp, types.int64, types.int32), codegen


@intrinsic
def blend(typing_context, mask, a, b):
    """Return a in the lanes of a mask, b in the others."""
    vector = _vector_of(a, b)
    if vector is None:
        return None

    def codegen(context, builder, signature, args):
        bools = _to_bools(builder, args[0], vector.n)
        return builder.select(bools, *_vectors(builder, vector, (a, b), args[1:]))

    return vector(types.int64, a, b), codegen


def _folded(emit: Callable[[Any, Any, Any], Any]) -> Callable[[Any, Any], Any]:
    """Return an emitter that reduces a vector by halves, 16 to 8 to 4 to 2 to 1, with the operation `emit` emits."""

    def fold(builder: Any, vector: Any) -> Any:
        n = vector.type.count
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

    return fold


lowest = _unary(_folded(_smaller), types.float32)
"""Smallest lane."""
highest = _unary(_folded(_larger), types.float32)
"""Largest lane."""


def _of_mask(emit: Callable[[Any, Any], Any]) -> Any:
    @intrinsic
    def operation(typing_context, mask):
        def codegen(context, builder, signature, args):
            return emit(builder, args[0])

        return types.int64(types.int64), codegen

    return operation


first_lane = _of_mask(lambda builder, mask: builder.cttz(mask, ir.Constant(ir.IntType(1), 1)))
"""Lowest lane of a mask that is not empty."""
last_lane = _of_mask(
    lambda builder, mask: builder.sub(
        ir.Constant(ir.IntType(64), 63), builder.ctlz(mask, ir.Constant(ir.IntType(1), 1))
    )
)
"""Highest lane of a mask that is not empty."""
count_lanes = _of_mask(lambda builder, mask: builder.ctpop(mask))
"""Number of lanes in a mask."""


# Three vectors at a time: tuples of 3, one per axis.


@always_inline
def load3(array, index, stride):
    """Load three vectors, `stride` numbers apart."""
    return load(array, index), load(array, index + stride), load(array, index + 2 * stride)


@always_inline
def load3_wide(array, index, stride):
    """Load three wide vectors, `stride` numbers apart."""
    return load_wide(array, index), load_wide(array, index + stride), load_wide(array, index + 2 * stride)


@always_inline
def load_scalar3(array, index, stride):
    """Load three numbers, `stride` numbers apart."""
    return load_scalar(array, index), load_scalar(array, index + stride), load_scalar(array, index + 2 * stride)


@always_inline
def store3(array, index, stride, vectors):
    """Store three vectors, `stride` numbers apart."""
    store(array, index, vectors[0])
    store(array, index + stride, vectors[1])
    store(array, index + 2 * stride, vectors[2])


@always_inline
def splat3(values):
    """Broadcast each of three numbers to all lanes."""
    return splat(values[0]), splat(values[1]), splat(values[2])


@always_inline
def dot3(a, b):
    """Compute a . b."""
    return muladd(a[0], b[0], muladd(a[1], b[1], a[2] * b[2]))


@always_inline
def cross3(a, b):
    """Compute a x b. Where products are fused, cross3(b, a) is not its exact negative."""
    return (
        muladd(a[1], b[2], -(a[2] * b[1])),
        muladd(a[2], b[0], -(a[0] * b[2])),
        muladd(a[0], b[1], -(a[1] * b[0])),
    )


@always_inline
def cross3_add(a, b, c):
    """Compute a x b + c."""
    return (
        muladd(a[1], b[2], muladd(-a[2], b[1], c[0])),
        muladd(a[2], b[0], muladd(-a[0], b[2], c[1])),
        muladd(a[0], b[1], muladd(-a[1], b[0], c[2])),
    )


@always_inline
def transform(matrix, x, y, z):
    """Multiply a 3 x 4 matrix, (12,) float32, by (x, y, z, 1)."""
    return (
        muladd(x, matrix[0], muladd(y, matrix[1], muladd(z, matrix[2], matrix[3]))),
        muladd(x, matrix[4], muladd(y, matrix[5], muladd(z, matrix[6], matrix[7]))),
        muladd(x, matrix[8], muladd(y, matrix[9], muladd(z, matrix[10], matrix[11]))),
    )
