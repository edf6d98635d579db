"""The entropy coder of a cache's tiles: chosen when the build starts, kept in its provenance."""

from __future__ import annotations

from typing import Any

from nurbs_cache.typed_store import TypedStore

DEFAULT_CODEC = "zstd"
"""Fewer bytes than Huffman coding and faster both ways; docs/benchmarks.md has the figures."""


def codec_plan(codec: str) -> dict[str, Any]:
    """What a build's provenance says of its codec: nothing if it is the default."""
    return {} if codec == DEFAULT_CODEC else {"codec": codec}


def codec_of(store: TypedStore) -> str:
    """The codec that a store's tiles are made with, now and on demand."""
    return str(store.get_provenance().get("codec", DEFAULT_CODEC))
