"""Arrays that a compiled function lends to those it calls, without reference counts.

A count is an atomic operation on a place that all threads share, for every array of every call of a ``helper``.
An array that somebody else keeps alive needs none.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, TypeVar

import numba
from numba.core import types
from numba.core.errors import TypingError
from numba.core.types.containers import BaseTuple
from numba.core.types.misc import MemInfoPointer, NoneType
from numba.extending import intrinsic

T = TypeVar("T")


def _lend(context: Any, builder: Any, kind: Any, value: Any) -> Any:
    """The value of a type with the owners of its arrays taken off."""
    if isinstance(kind, types.Array):
        array = context.make_array(kind)(context, builder, value)
        array.meminfo = context.get_constant_null(MemInfoPointer(types.voidptr))
        array.parent = context.get_constant_null(types.pyobject)
        return array._getvalue()
    if isinstance(kind, BaseTuple):
        for k, part in enumerate(kind):
            lent = _lend(context, builder, part, builder.extract_value(value, k))
            value = builder.insert_value(value, lent, k)
    return value


def _holds_nothing_else(kind: Any) -> bool:
    """Whether a type is an array, a number or None, or a tuple of such."""
    if isinstance(kind, BaseTuple):
        return all(_holds_nothing_else(part) for part in kind)
    return isinstance(kind, types.Array | types.Number | types.Boolean | NoneType)


@intrinsic  # type: ignore[untyped-decorator]
def _borrowed(_typing_context: Any, lender: Any) -> Any:
    if not _holds_nothing_else(lender):
        raise TypingError(f"only arrays and tuples of arrays can be borrowed, not {lender}")

    def generate(context: Any, builder: Any, _signature: Any, arguments: Any) -> Any:
        return _lend(context, builder, lender, arguments[0])

    return lender(lender), generate


if TYPE_CHECKING or numba.config.DISABLE_JIT:

    def borrowed(lender: T) -> T:
        """The same array or (nested) tuple of arrays, not kept alive by whoever has it.

        The caller must use ``lender`` once more after all uses of what was borrowed, or have it from its own
        caller, and must not return or keep what was borrowed: numba lets go of a variable after its last use.
        """
        return lender

else:
    borrowed = _borrowed
