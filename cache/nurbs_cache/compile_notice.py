"""Says once that kernels are being compiled: a wait of a minute that no progress bar shows."""

from __future__ import annotations

from collections.abc import Callable

_say: Callable[[], None] | None = None


def on_first_compile(say: Callable[[], None]) -> None:
    """Call ``say`` once, when a kernel is first compiled rather than loaded by this process or one of its workers."""
    global _say
    _say = say


def compiling() -> None:
    """A kernel is about to be compiled."""
    global _say
    if _say is not None:
        say, _say = _say, None
        say()
