"""All typed tables of a store together: its schema, its content hash and the check of every value."""

from __future__ import annotations

import hashlib
import struct
from collections.abc import Mapping
from typing import Any

from nurbs_cache import record
from nurbs_cache.edit_tables import EditTables
from nurbs_cache.errors import CacheError, CorruptRecordError
from nurbs_cache.node_record import NODE_DTYPE
from nurbs_cache.raw_store import TABLES, Writing
from nurbs_cache.row_pages import parse_rows
from nurbs_cache.scene_tables import pack_json
from nurbs_cache.tile import check_tile, tile_hash
from nurbs_cache.tree_tables import EDITS_KEY

SCHEMA_VERSION = 1
MAGIC = b"nurbs-ooc cache"
READ_AT_ONCE = 64 << 20  # bytes; loops over a whole table give the memory of what they have read back so often
HASHED_TABLES = ("part_infos", "parts", "scene", "tree", "nodes", "items", "faces")


class TypedStore(EditTables):
    """The typed methods over the tables; see ``Store`` and ``MemoryStore``."""

    def content_hash(self) -> str:
        """32 hex characters: equal for equal content, however, wherever and in whatever order it was stored.

        Hashed are the schema, the units, and every key with the identity of its value in the tables of
        parts, scene, tree, nodes, items and face report. A node names its tile by the hash of the tile's
        bytes, which covers them. Provenance and the note of edits stay out, and so do surfaces' levels of
        detail: they follow from the surfaces and are kept only for speed.

        Raises:
            CorruptRecordError: a value is damaged, or a tile that a node names is not stored.
        """
        digest = hashlib.blake2b(MAGIC + struct.pack("<I", SCHEMA_VERSION), digest_size=16)
        digest.update(record.identity(self.get("meta", b"units"), f"{self.name}: units"))
        for table in HASHED_TABLES:
            digest.update(table.encode() + b"\0")
            n_bytes = 0
            for key, value in self.scan(table):
                digest.update(struct.pack("<I", len(key)) + key)
                digest.update(record.identity(value, f"{self.name}: {table} {key.hex()}"))
                n_bytes += len(value)
                if n_bytes > READ_AT_ONCE:
                    self.release_pages()
                    n_bytes = 0
            digest.update(b"\xff\xff\xff\xff")
        self._check_node_tiles()
        return digest.hexdigest()

    def check(self) -> dict[str, int]:
        """Read and verify every stored value; returns the number of values per table.

        Raises:
            CorruptRecordError: a value is damaged or stored under a name that is not its own.
        """
        counts = dict.fromkeys(TABLES, 0)
        for table in TABLES:
            for key, value in self.scan(table):
                what = f"{self.name}: {table} {key.hex()}"
                if table == "tiles":
                    check_tile(value, what)
                    if bytes.fromhex(tile_hash(value)) != key:
                        raise CorruptRecordError(f"{what}: the tile is not the one its name says")
                elif table != "meta" or key in (b"units", b"provenance", EDITS_KEY):
                    record.verify(value, what)
                counts[table] += 1
        self._check_node_tiles()
        return counts

    def _check_node_tiles(self) -> None:
        """Every tile that a node names is there."""
        stored = set(self.scan_keys("tiles"))
        for key, value in self.scan("nodes"):
            what = f"{self.name}: page {int.from_bytes(key, 'big')} of nodes"
            for name in parse_rows(record.unpack(value, what), NODE_DTYPE, what)["tile_hash"].tolist():
                if name and bytes.fromhex(name.decode()) not in stored:
                    raise CorruptRecordError(f"{what}: tile {name.decode()} is not stored")

    def _initialise(self, provenance: Mapping[str, Any], *, overwrite: bool) -> None:
        """Make this an empty store."""

        def change(writing: Writing) -> None:
            used = writing.find("meta", b"magic")
            if used is not None and used != MAGIC:
                raise CacheError(f"{self.name}: not a nurbs-ooc cache")
            if used is not None and not overwrite:
                raise CacheError(f"{self.name}: there is a cache already; overwrite it or choose another name")
            for table in TABLES:
                writing.clear(table)
            writing.put("meta", b"magic", MAGIC)
            writing.put("meta", b"schema", str(SCHEMA_VERSION).encode())
            writing.put("meta", b"provenance", pack_json(provenance))
            writing.put("meta", b"units", pack_json({}))

        self.transact(change)

    def _check_schema(self) -> None:
        """Refuse what is not a store of this version."""
        magic, schema = self.find("meta", b"magic"), self.find("meta", b"schema")
        if magic != MAGIC or schema is None:
            raise CacheError(f"{self.name}: not a nurbs-ooc cache")
        text = schema.decode("ascii", "replace")
        if text != str(SCHEMA_VERSION):
            raise CacheError(f"{self.name}: cache schema {text}, this program reads {SCHEMA_VERSION}; build it again")
