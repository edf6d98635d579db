"""A counter from which threads that are inside compiled code take numbers: each number goes to one of them."""

from __future__ import annotations

import threading
from typing import TYPE_CHECKING, Any

import numba
import numpy as np
import numpy.typing as npt
from numba.core import types
from numba.core.errors import TypingError
from numba.extending import intrinsic
from numba.np import arrayobj

Ints = npt.NDArray[np.int64]

_lock = threading.Lock()


def new_turns() -> Ints:
    """A counter (1,) that begins with 0."""
    return np.zeros(1, np.int64)


@intrinsic  # type: ignore[untyped-decorator]
def _next_turn(_typing_context: Any, turns: Any) -> Any:
    if not (isinstance(turns, types.Array) and turns.ndim == 1 and turns.dtype == types.int64):
        raise TypingError(f"turns are an array of int64, not {turns}")

    def generate(context: Any, builder: Any, _signature: Any, arguments: Any) -> Any:
        place = arrayobj.make_array(turns)(context, builder, arguments[0]).data
        one = context.get_constant(types.int64, 1)
        # Nothing else is handed over from thread to thread by it, so no order of other memory is asked for.
        return builder.atomic_rmw("add", place, one, "monotonic")

    return types.int64(turns), generate


if TYPE_CHECKING or numba.config.DISABLE_JIT:

    def next_turn(turns: Ints) -> int:
        """The number of calls with the same ``turns`` (1,) before this one, by whatever thread."""
        with _lock:
            turn = int(turns[0])
            turns[0] = turn + 1
        return turn

else:
    next_turn = _next_turn
