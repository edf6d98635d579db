"""The tables of an open store in memory, read once, and the lock under which they and the store change together."""

from __future__ import annotations

import threading
import weakref
from collections.abc import Iterator
from contextlib import contextmanager

from nurbs_cache.typed_store import TypedStore
from nurbs_ooc.build.forest import Forest

_forests: weakref.WeakKeyDictionary[TypedStore, tuple[int, Forest]] = weakref.WeakKeyDictionary()
_loading = threading.Lock()
_changing = threading.RLock()


def open_forest(store: TypedStore) -> Forest:
    """The tables of a store, read when it is first asked for and again when surfaces were replaced by others.

    Their node records are as they were then but for what ``replace_surface`` has changed: who needs to know
    whether a tile is there asks the store.
    """
    with _loading:
        edits = store.edit_count()
        known = _forests.get(store)
        if known is None or known[0] != edits:
            known = _forests[store] = edits, Forest.load(store)
        return known[1]


def note_edit(store: TypedStore, forest: Forest) -> None:
    """``forest`` already shows the store's last edit."""
    with _loading:
        _forests[store] = store.edit_count(), forest


@contextmanager
def changing(store: TypedStore, edits: int | None = None) -> Iterator[bool]:
    """Hold back other changes of stores; whether nothing was replaced since there were ``edits`` edits."""
    with _changing:
        yield edits is None or store.edit_count() == edits
