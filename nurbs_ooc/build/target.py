"""Where a build writes: beside its cache until it is done, so that an existing cache stays whole.

::

    CACHE.partial/    the store while it is built; kept when a build is killed, taken up by --resume
    CACHE/            appears by one rename when everything is stored
    CACHE.replaced/   the former cache, for the moment between two renames (--force)

The store is its own journal: a stage is finished when its table is there, a node when its row names a
tile. What the build was started with is kept in the store's provenance, so that it is not resumed with
other inputs.
"""

from __future__ import annotations

import shutil
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from nurbs_cache.errors import CacheError, UsageError
from nurbs_cache.store import Store


def partial_path(cache: Path) -> Path:
    """The folder in which the cache ``cache`` is built."""
    return cache.with_name(cache.name + ".partial")


def _is_there(path: Path) -> bool:
    return path.exists() and not (path.is_dir() and not any(path.iterdir()))


@contextmanager
def open_target(cache: Path, plan: Mapping[str, Any], *, resume: bool, force: bool) -> Iterator[Store]:
    """The store to build into; when the block ends well, it is the cache.

    Args:
        cache: the folder that the user named.
        plan: JSON of what is built: inputs and tunables. ``resume`` needs the same one.
        resume: go on with a killed build, or add tiles to a finished one.
        force: replace what is there.

    Raises:
        UsageError: something is there and neither ``resume`` nor ``force`` says what to do with it.
        CacheError: another build writes there, or it was made from other inputs.
    """
    partial = partial_path(cache)
    if resume and not partial.exists() and _is_there(cache):
        with _taken_up(cache, plan) as store:
            yield store
        return
    _refuse_leftovers(cache, partial, resume=resume, force=force)
    if resume and _is_there(partial):
        opened = _taken_up(partial, plan)
    else:
        cache.parent.mkdir(parents=True, exist_ok=True)
        _discard(partial)
        opened = Store.create(partial, provenance=plan)
    with opened as store:
        yield store
    _publish(partial, cache)


def _refuse_leftovers(cache: Path, partial: Path, *, resume: bool, force: bool) -> None:
    """Nothing is overwritten unless it was asked for."""
    if _is_there(partial) and not (resume or force):
        raise UsageError(f"{partial}: an unfinished build; --resume goes on with it, --force starts anew")
    if _is_there(cache) and not (resume or force):
        raise UsageError(f"{cache}: is there already; --force replaces it, --resume adds what it lacks")
    if _is_there(cache) and not _is_store(cache):
        raise CacheError(f"{cache}: is not a cache of this program and is left alone")


def _is_store(path: Path) -> bool:
    return (path / "data.mdb").is_file()


def _taken_up(path: Path, plan: Mapping[str, Any]) -> Store:
    """Open an existing store for writing if it was started with the same plan."""
    store = Store.open(path, read_only=False)
    stored = store.get_provenance()
    differing = sorted(key for key in plan.keys() | stored.keys() if plan.get(key) != stored.get(key))
    if differing:
        store.close()
        raise CacheError(f"{path}: was started with other {', '.join(differing)}; --force starts anew")
    return store


def _discard(partial: Path) -> None:
    """Remove a former partial build that no other process is writing to."""
    if not partial.exists():
        return
    if _is_store(partial):
        Store.create(partial, overwrite=True).close()  # refuses while another build has it
    shutil.rmtree(partial)


def _publish(partial: Path, cache: Path) -> None:
    """Let the finished store take the cache's name."""
    replaced = cache.with_name(cache.name + ".replaced")
    if cache.exists():
        if replaced.exists():
            shutil.rmtree(replaced)
        cache.rename(replaced)
    partial.rename(cache)
    if replaced.exists():
        shutil.rmtree(replaced)
