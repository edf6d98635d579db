"""What a build was made from, so that it is known again when it is resumed."""

from __future__ import annotations

import hashlib
from pathlib import Path
from typing import Any

from nurbs_cache.errors import InputFileError
from nurbs_cache.store import Store
from nurbs_ooc.readers.surface_store import is_surface_store

HASH_BLOCK = 1 << 20  # bytes


def fingerprint(path: Path) -> dict[str, Any]:
    """Name and digest of an input: enough to know it again.

    Raises:
        InputFileError: it cannot be read.
    """
    if is_surface_store(path):
        with Store.open(path) as store:
            return {"name": path.name, "digest": store.content_hash()}
    digest = hashlib.blake2b(digest_size=16)
    try:
        with path.open("rb") as file:
            while block := file.read(HASH_BLOCK):
                digest.update(block)
    except OSError as error:
        raise InputFileError(f"{path}: {error.strerror}") from error
    return {"name": path.name, "digest": digest.hexdigest()}
