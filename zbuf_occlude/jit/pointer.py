"""References: kernels pass the address of a NamedTuple on, instead of its hundreds of numbers by value.

numba passes a tuple of arrays to a function as all their pointers, shapes and strides, one by one: with four such
tuples that is some 300 words per call, which take time both to copy and, as text of LLVM, to compile.
"""

from typing import Any

from numba import types
from numba.core import cgutils
from numba.core.datamodel import models, register_default
from numba.core.imputils import impl_ret_borrowed, lower_getattr_generic
from numba.core.typing.templates import AttributeTemplate
from numba.extending import infer_getattr, intrinsic


class ReferenceType(types.Type):  # type: ignore[misc]  # numba ships no types
    """Numba's type of a reference to a NamedTuple."""

    def __init__(self, target: Any) -> None:
        self.target = target
        super().__init__(name=f"reference({target})")


@register_default(ReferenceType)
class _ReferenceModel(models.PrimitiveModel):  # type: ignore[misc]  # numba ships no types
    def __init__(self, manager: Any, kind: Any) -> None:
        super().__init__(manager, kind, manager.lookup(kind.target).get_value_type().as_pointer())


@intrinsic
def reference(typing_context, value):
    """Refer to a NamedTuple that is an argument of the calling kernel; its fields are read as the tuple's own.

    It must not outlive the call, and the tuple's owner keeps its arrays alive as long.
    """

    def codegen(context, builder, signature, arguments):
        return cgutils.alloca_once_value(builder, arguments[0])

    return ReferenceType(value)(value), codegen


@infer_getattr
class _Fields(AttributeTemplate):  # type: ignore[misc]  # numba ships no types
    key = ReferenceType

    def generic_resolve(self, kind: Any, name: str) -> Any:
        target = kind.target
        return target.types[target.fields.index(name)] if name in target.fields else None


@lower_getattr_generic(ReferenceType)
def _load_field(context: Any, builder: Any, kind: Any, value: Any, name: str) -> Any:
    index = kind.target.fields.index(name)
    field = builder.load(cgutils.gep_inbounds(builder, value, 0, index))
    return impl_ret_borrowed(context, builder, kind.target.types[index], field)
