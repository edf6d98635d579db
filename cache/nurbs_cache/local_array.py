"""Small arrays on the stack of a compiled function: what a ``leaf`` uses where others would allocate."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import numba
import numpy as np
import numpy.typing as npt
from llvmlite import ir
from numba.core import types
from numba.core.errors import TypingError
from numba.extending import intrinsic


def _array_on_stack(shape: tuple[int, ...]) -> tuple[types.Array, Callable[..., Any]]:
    """Type and code generator of an array of float64 that lives as long as the call of its function."""
    array_type = types.Array(types.float64, len(shape), "C")
    count = int(np.prod(shape))

    def generate(context: Any, builder: Any, _signature: Any, _arguments: Any) -> Any:
        # Not ``cgutils.alloca_once``: that writes zeros at every call.
        with builder.goto_entry_block():
            place = builder.alloca(ir.ArrayType(ir.DoubleType(), count))
        array = context.make_array(array_type)(context, builder)
        strides = [8 * int(np.prod(shape[k + 1 :])) for k in range(len(shape))]
        context.populate_array(
            array,
            data=builder.bitcast(place, ir.DoubleType().as_pointer()),
            shape=[context.get_constant(types.intp, n) for n in shape],
            strides=[context.get_constant(types.intp, n) for n in strides],
            itemsize=context.get_constant(types.intp, 8),
            meminfo=None,
        )
        return array._getvalue()

    return array_type, generate


def _constant(size: Any) -> int:
    if not isinstance(size, types.IntegerLiteral):
        raise TypingError("the size of a local array must be a constant")
    return int(size.literal_value)


@intrinsic(prefer_literal=True)  # type: ignore[untyped-decorator]
def _line(_typing_context: Any, n: Any) -> Any:
    array_type, generate = _array_on_stack((_constant(n),))
    return array_type(n), generate


@intrinsic(prefer_literal=True)  # type: ignore[untyped-decorator]
def _table(_typing_context: Any, n: Any, m: Any) -> Any:
    array_type, generate = _array_on_stack((_constant(n), _constant(m)))
    return array_type(n, m), generate


if TYPE_CHECKING or numba.config.DISABLE_JIT:

    def local_line(n: int) -> npt.NDArray[np.float64]:
        """(n,) numbers of any value, n a constant; they end with the function that asks for them."""
        return np.full(n, np.nan)

    def local_table(n: int, m: int) -> npt.NDArray[np.float64]:
        """(n, m) numbers of any value, n and m constants; they end with the function that asks for them."""
        return np.full((n, m), np.nan)

else:
    local_line = _line
    local_table = _table
