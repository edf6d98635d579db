"""The one decorator for compiled kernels, with an on-disk cache that cannot go stale.

numba's own cache is keyed by the file that defines a kernel, so machine code survives an edit to a
helper in another file. Here the cache folder is named by a digest of *all* files that import this
module and of the record layouts, of the numba and numpy versions and of the processor. Kernels may
therefore use constants of such files only.
"""

from __future__ import annotations

import hashlib
import importlib.util
import os
import shutil
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import ParamSpec, TypeVar, cast

import llvmlite.binding
import numba
import numpy as np

P = ParamSpec("P")
R = TypeVar("R")

KERNEL_PACKAGES = ("nurbs_cache", "nurbs_ooc")
KEPT_CACHES = 4  # older digests are removed: a developer's edits would otherwise fill the disk


@cache
def kernel_cache_dir() -> Path:
    """Folder for compiled kernels, ``$NURBS_OOC_KERNEL_CACHE`` or below the user's cache folder."""
    digest = hashlib.sha256(f"{numba.__version__} {np.__version__} {llvmlite.binding.get_host_cpu_name()}".encode())
    for package in KERNEL_PACKAGES:
        spec = importlib.util.find_spec(package)
        for place in (spec.submodule_search_locations or []) if spec else []:
            for path in sorted(Path(place).rglob("*.py")):
                text = path.read_bytes()
                if b"nurbs_cache.jit" in text or path.name.endswith("_record.py"):
                    digest.update(path.name.encode() + text)
    user_cache = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
    base = Path(os.environ.get("NURBS_OOC_KERNEL_CACHE") or user_cache / "nurbs-ooc" / "kernels")
    folder = base / digest.hexdigest()[:16]
    if not folder.exists():
        _drop_old(base)
    return folder


def _drop_old(base: Path) -> None:
    """Remove all but the newest few caches; a cache in use by another process is only recompiled."""
    if not base.is_dir():
        return
    folders = sorted((f for f in base.iterdir() if f.is_dir()), key=lambda f: f.stat().st_mtime, reverse=True)
    for folder in folders[KEPT_CACHES - 1 :]:
        shutil.rmtree(folder, ignore_errors=True)


def kernel(function: Callable[P, R]) -> Callable[P, R]:
    """Compile ``function`` without the interpreter: no GIL, IEEE division, machine code kept on disk."""
    before = numba.config.CACHE_DIR
    numba.config.CACHE_DIR = str(kernel_cache_dir())
    try:
        return cast("Callable[P, R]", numba.njit(function, cache=True, nogil=True, error_model="numpy"))
    finally:
        numba.config.CACHE_DIR = before


def helper(function: Callable[P, R]) -> Callable[P, R]:
    """Like ``kernel`` for what only kernels call: compiled into them, nothing of its own on disk."""
    return cast("Callable[P, R]", numba.njit(function, nogil=True, error_model="numpy"))
