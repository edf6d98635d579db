"""The scene of a store: products, materials, occurrences, units."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from nurbs_cache import record
from nurbs_cache.errors import CorruptRecordError, MissingRecordError
from nurbs_cache.raw_store import RawStore, Writing
from nurbs_cache.row_pages import clean_rows, parse_rows
from nurbs_cache.scene_codec import decode_materials, decode_products, encode_materials, encode_products
from nurbs_cache.scene_record import OCCURRENCE_DTYPE, Material, Product


class SceneTables(RawStore):
    """Table ``scene`` and the units in ``meta``."""

    def put_scene(
        self,
        products: Sequence[Product],
        materials: Sequence[Material],
        occurrences: npt.NDArray[np.void],
        units: Mapping[str, Any] | None = None,
    ) -> None:
        """Store the scene in one transaction; ``units`` says what the source was in, as JSON."""
        values = {
            b"products": encode_products(products),
            b"materials": encode_materials(materials),
            b"occurrences": clean_rows(occurrences, OCCURRENCE_DTYPE).tobytes(),
        }

        def change(writing: Writing) -> None:
            for key, value in values.items():
                writing.put("scene", key, record.pack(value))
            writing.put("meta", b"units", pack_json(units or {}))

        self.transact(change)

    def get_products(self) -> list[Product]:
        """The product tree, parents before children; empty before ``put_scene``."""
        data = self._scene_value(b"products")
        return decode_products(data) if data else []

    def get_materials(self) -> list[Material]:
        """All materials; empty before ``put_scene``."""
        data = self._scene_value(b"materials")
        return decode_materials(data) if data else []

    def get_occurrences(self) -> npt.NDArray[np.void]:
        """(n,) ``OCCURRENCE_DTYPE``; empty before ``put_scene``."""
        return parse_rows(self._scene_value(b"occurrences"), OCCURRENCE_DTYPE, f"{self.name}: occurrences").copy()

    def get_units(self) -> dict[str, Any]:
        """What ``put_scene`` was given."""
        return self.read_json("meta", b"units")

    def get_provenance(self) -> dict[str, Any]:
        """What ``create`` was given."""
        return self.read_json("meta", b"provenance")

    def read_json(self, table: str, key: bytes) -> dict[str, Any]:
        """A JSON object; empty if nothing is stored."""
        data = self.find(table, key)
        if data is None:
            return {}
        what = f"{self.name}: {key.decode()}"
        try:
            value = json.loads(record.unpack(data, what))
        except ValueError as error:
            raise CorruptRecordError(f"{what}: {error}") from error
        if not isinstance(value, dict):
            raise CorruptRecordError(f"{what}: not a JSON object")
        return value

    def _scene_value(self, key: bytes) -> bytes:
        try:
            return record.unpack(self.get("scene", key), f"{self.name}: {key.decode()}")
        except MissingRecordError:
            return b""


def pack_json(value: Mapping[str, Any]) -> bytes:
    """Canonical JSON in a record: keys sorted, no spaces, UTF-8."""
    return record.pack(json.dumps(value, sort_keys=True, separators=(",", ":"), ensure_ascii=False).encode())
