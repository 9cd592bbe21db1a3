"""Pointers to NamedTuples, so that kernels pass one address instead of hundreds of numbers.

numba passes a tuple of arrays by value, as all their pointers, shapes and strides. With four such tuples that is some
300 words per call, which take time to copy and, as LLVM code, to compile.
"""

from typing import Any

from numba import types
from numba.core import cgutils
from numba.core.datamodel import models, register_default
from numba.core.imputils import impl_ret_borrowed, lower_getattr_generic
from numba.core.typing.templates import AttributeTemplate
from numba.extending import infer_getattr, intrinsic


class PointerType(types.Type):  # type: ignore[misc]  # numba ships no types
    """Numba type of a pointer to a NamedTuple."""

    def __init__(self, target: Any) -> None:
        self.target = target
        super().__init__(name=f"pointer_to({target})")


@register_default(PointerType)
class _PointerModel(models.PrimitiveModel):  # type: ignore[misc]  # numba ships no types
    def __init__(self, manager: Any, kind: Any) -> None:
        super().__init__(manager, kind, manager.lookup(kind.target).get_value_type().as_pointer())


@intrinsic
def pointer_to(typing_context, value):
    """Return a pointer to a NamedTuple, an argument of the calling kernel; fields are read as attributes.

    The pointer must not outlive the call. The owner of the tuple keeps the arrays alive until then.
    """

    def codegen(context, builder, signature, arguments):
        return cgutils.alloca_once_value(builder, arguments[0])

    return PointerType(value)(value), codegen


@infer_getattr
class _Fields(AttributeTemplate):  # type: ignore[misc]  # numba ships no types
    key = PointerType

    def generic_resolve(self, kind: Any, name: str) -> Any:
        target = kind.target
        return target.types[target.fields.index(name)] if name in target.fields else None


@lower_getattr_generic(PointerType)
def _load_field(context: Any, builder: Any, kind: Any, value: Any, name: str) -> Any:
    index = kind.target.fields.index(name)
    field = builder.load(cgutils.gep_inbounds(builder, value, 0, index))
    return impl_ret_borrowed(context, builder, kind.target.types[index], field)
