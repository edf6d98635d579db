"""The one decorator for compiled kernels, with an on-disk cache that cannot go stale.

By itself numba keys its cache by the file that defines a kernel, so machine code survives an edit to a
helper in another file. Here the key is a digest of that file and of all it imports from this
project, directly or not, of the numba and numpy versions and of the processor. It does not depend on
where the project is installed or when its files were written.
"""

from __future__ import annotations

import contextlib
import hashlib
import importlib.util
import os
import re
import shutil
import time
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any, ParamSpec, Self, TypeVar, cast

import llvmlite.binding
import numba
import numpy as np
from llvmlite import ir
from numba.core import event, types
from numba.core.caching import _CacheLocator
from numba.core.codegen import CPUCodeLibrary, JITCPUCodegen
from numba.core.types.misc import unliteral
from numba.np import arrayobj

from nurbs_cache.compile_notice import compiling

P = ParamSpec("P")
R = TypeVar("R")

_kernels: set[str] = set()  # their names
_helpers: set[str] = set()  # likewise, leaves among them
_NARROW = {types.int8, types.int16, types.int32, types.uint8, types.uint16, types.uint32}
UNUSED_DAYS = 30  # kernels that no run has looked at for so long are removed
# What a ``leaf`` may return: nothing that could be an array or hold one.
_SCALARS = re.compile(r"(None|int|float|bool|tuple\[(int|float|bool)(, (int|float|bool))*\])")
_IMPORT = re.compile(rb"^\s*(?:from|import)\s+(nurbs_\w+(?:\.\w+)*)(?:\s+import\s+([^\n(#]+))?", re.MULTILINE)


class _Notice(event.Listener):  # type: ignore[misc]
    """Hears of every kernel that is compiled; loading one from disk makes no such event."""

    def on_start(self, _event: Any) -> None:
        """Before."""
        compiling()

    def on_end(self, _event: Any) -> None:
        """After."""


event.register("numba:compile", _Notice())


def kernel_cache_base() -> Path:
    """Folder of all compiled kernels: ``$NURBS_OOC_KERNEL_CACHE``, or one below the user's cache folder."""
    base = os.environ.get("NURBS_OOC_KERNEL_CACHE")
    if base:
        return Path(base)
    return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "nurbs-ooc" / "kernels"


@cache
def _imports(path: str) -> frozenset[str]:
    """Source files of this project that the file imports itself."""
    found = set()
    for module, names in _IMPORT.findall(Path(path).read_bytes()):
        candidates = [module.decode()] + [f"{module.decode()}.{n.strip()}" for n in names.decode().split(",") if n]
        for name in candidates:
            try:
                spec = importlib.util.find_spec(name)
            except (ImportError, ValueError):
                continue
            if spec is not None and spec.origin is not None and spec.origin.endswith(".py"):
                found.add(spec.origin)
    return frozenset(found)


@cache
def source_digest(path: str) -> str:
    """Digest of a source file, of all project files it depends on, and of what compiles them."""
    seen: set[str] = set()
    waiting = [path]
    while waiting:
        current = waiting.pop()
        if current not in seen:
            seen.add(current)
            waiting.extend(_imports(current))
    digest = hashlib.sha256(f"{numba.__version__} {np.__version__} {llvmlite.binding.get_host_cpu_name()}".encode())
    for text in sorted(Path(p).read_bytes() for p in seen):
        digest.update(hashlib.sha256(text).digest())
    return digest.hexdigest()[:24]


class DigestLocator(_CacheLocator):  # type: ignore[misc]
    """Tells numba where a kernel's machine code lies and which sources it belongs to."""

    def __init__(self, module: str, path: str) -> None:
        self._module = module
        self._py_file = path  # named by numba in its warnings
        self._digest = source_digest(path)
        self._folder = kernel_cache_base() / self._digest

    @classmethod
    def from_function(cls, py_func: Any, py_file: str) -> Self | None:
        """The locator of a function; None where its file or the cache folder cannot be used."""
        try:
            locator = cls(py_func.__module__, py_file)
            locator.ensure_cache_path()
            os.utime(locator._folder)
        except OSError:
            return None
        return locator

    def get_cache_path(self) -> str:
        """The folder named by the digest."""
        return str(self._folder)

    def get_source_stamp(self) -> str:
        """What the machine code was compiled from."""
        return self._digest

    def get_disambiguator(self) -> str:
        """Tells functions of the same name apart."""
        return self._module


def ran_before(module_path: str) -> bool:
    """Whether a source file's code has run to its end here before, so that its kernels need not be compiled."""
    return _mark(module_path).exists()


def note_run(module_path: str) -> None:
    """Remember that for ``ran_before``; where the cache folder cannot be written nothing happens."""
    with contextlib.suppress(OSError):
        _mark(module_path).parent.mkdir(parents=True, exist_ok=True)
        _mark(module_path).touch()


def _mark(module_path: str) -> Path:
    return kernel_cache_base() / source_digest(module_path) / "ran"


def drop_unused_kernels() -> None:
    """Remove kernels of sources that no run has used for ``UNUSED_DAYS`` days."""
    limit = time.time() - UNUSED_DAYS * 86400.0
    base = kernel_cache_base()
    for folder in base.iterdir() if base.is_dir() else []:
        if folder.is_dir() and folder.stat().st_mtime < limit:
            shutil.rmtree(folder, ignore_errors=True)


_optimize = CPUCodeLibrary._optimize_final_module
_finalize = CPUCodeLibrary.finalize
_set_env = JITCPUCodegen.set_env
_fix_integer_index = arrayobj.fix_integer_index


def _optimize_kernel(library: Any) -> None:
    """Before a kernel is optimised, let the compiler know that nobody else calls what has been linked into it.

    An array is passed as seven numbers, the tables of a part as a hundred, and all of them are copied at every
    call that is not inlined, used or not. Of functions of its own LLVM drops the arguments that are not used.
    """
    if library.name in _kernels:
        for linked in library._final_module.functions:
            if not linked.is_declaration and linked.linkage == llvmlite.binding.Linkage.linkonce_odr:
                linked.linkage = llvmlite.binding.Linkage.internal
    _optimize(library)


def _with_all_they_call(libraries: list[Any]) -> list[Any]:
    """Each library once, with those that helpers among them call, directly or not.

    Callers come before what they call: the linker takes only functions that it has seen a call of.
    """
    done: dict[Any, None] = {}
    waiting = [(library, False) for library in libraries]
    while waiting:
        library, called_are_done = waiting.pop()
        if called_are_done:
            done.setdefault(library)
        elif library not in done:
            waiting.append((library, True))
            if _is_helper(library):
                waiting.extend((called, False) for called in library._linking_libraries)
    return list(reversed(done))


def _finalize_kernel(library: Any) -> None:
    """Leave helpers as they are, and optimise a kernel together with all that it calls.

    numba would link into each function all that it calls, optimise that and make machine code of it, again for
    every function further up: most of the time of compiling, for code that nobody ever runs.
    """
    if _is_helper(library):
        library._finalized = True
        return
    library._linking_libraries = _with_all_they_call(library._linking_libraries)
    _finalize(library)


def _set_kernel_env(codegen: Any, name: str, env: Any) -> None:
    """Tell machine code where its Python globals are; a helper has neither."""
    if codegen._engine.get_global_value_address(name):
        _set_env(codegen, name, env)


def _is_helper(library: Any) -> bool:
    # A name may belong to a helper in one file and a kernel in another: then both are taken for kernels.
    return library.name in _helpers and library.name not in _kernels


def _fix_index(context: Any, builder: Any, index_type: Any, index: Any, size: Any) -> Any:
    """Take an index of our functions as it is: none counts from the end, unless it is a constant.

    numba asks of every index whether it is negative; where most of the time goes into triangles that know one another
    by number, the questions are a tenth of it. With bounds checked a negative index is an error.
    """
    if isinstance(index, ir.Constant) or "nurbs_" not in builder.function.name:
        return _fix_integer_index(context, builder, index_type, index, size)
    return context.cast(builder, index, index_type, types.intp)


CPUCodeLibrary._optimize_final_module = _optimize_kernel
CPUCodeLibrary.finalize = _finalize_kernel
JITCPUCodegen.set_env = _set_kernel_env
arrayobj.fix_integer_index = _fix_index


def kernel(function: Callable[P, R]) -> Callable[P, R]:
    """Compile ``function`` without the interpreter: no GIL, IEEE division, machine code kept on disk."""
    _kernels.add(function.__qualname__)
    before = numba.config.CACHE_LOCATOR_CLASSES
    numba.config.CACHE_LOCATOR_CLASSES = f"{__name__}.{DigestLocator.__name__}"
    try:
        return cast("Callable[P, R]", numba.njit(function, cache=True, nogil=True, error_model="numpy"))
    except RuntimeError:
        # No folder to write to: compile in memory only.
        return cast("Callable[P, R]", numba.njit(function, nogil=True, error_model="numpy"))
    finally:
        numba.config.CACHE_LOCATOR_CLASSES = before


def _widened(argument: Any) -> Any:
    """The type that a helper sees of an argument: one for all integers that fit into 64 bits, constant or not."""
    argument = unliteral(argument)
    return types.int64 if argument in _NARROW else argument


def _compile_once(function: Any) -> Any:
    """Let a helper be compiled once for all widths of integers and all constants; it was a third of all compiling."""
    if numba.config.DISABLE_JIT:
        return function
    template_for = function.get_call_template

    def template_for_widened(arguments: tuple[Any, ...], keywords: dict[str, Any]) -> Any:
        return template_for(tuple(_widened(a) for a in arguments), {name: _widened(a) for name, a in keywords.items()})

    function.get_call_template = template_for_widened
    return function


def helper(function: Callable[P, R]) -> Callable[P, R]:
    """Like ``kernel`` for what only kernels call: compiled into them, nothing of its own on disk or for Python."""
    _helpers.add(function.__qualname__)
    return cast(
        "Callable[P, R]",
        _compile_once(
            numba.njit(function, nogil=True, error_model="numpy", no_cpython_wrapper=True, no_cfunc_wrapper=True)
        ),
    )


def leaf(function: Callable[P, R]) -> Callable[P, R]:
    """A ``helper`` that neither creates arrays nor returns any, compiled without reference counts.

    Counting is an atomic operation on a place that all threads share, for every array of every call: it
    took a third of the time of a tessellation. Views of arguments are fine, for the caller keeps them alive.
    """
    returns = function.__annotations__.get("return")
    if not isinstance(returns, str) or not _SCALARS.fullmatch(returns):
        raise TypeError(f"{function.__qualname__} returns {returns}: a leaf returns numbers or nothing")
    _helpers.add(function.__qualname__)
    return cast(
        "Callable[P, R]",
        _compile_once(
            numba.njit(
                function, nogil=True, error_model="numpy", no_cpython_wrapper=True, no_cfunc_wrapper=True, _nrt=False
            )
        ),
    )
