"""From a tile's key to its mesh, through whatever transport there is; runs on the loader's threads."""

from __future__ import annotations

from dataclasses import dataclass

from nurbs_cache.errors import CacheError
from nurbs_client.loader import Loaded
from nurbs_client.residency import TileKey
from nurbs_client.scene import Scene
from nurbs_client.tile_mesh import read_tile
from nurbs_client.transport import Transport


@dataclass(frozen=True, eq=False)
class TileSource:
    """Fetches and decodes tiles."""

    scene: Scene
    transport: Transport

    def fetch(self, keys: list[TileKey]) -> list[Loaded]:
        """Meshes of ``keys``; a broken tile costs only itself, a server that is gone raises ``ServerError``."""
        names = {key: bytes(self.scene.nodes["tile_hash"][key.node]).decode() for key in keys if key.node >= 0}
        stored = [key for key in keys if names.get(key)]
        found: dict[TileKey, bytes | CacheError] = {}
        if stored:
            answers = self.transport.tiles([names[key] for key in stored])
            found = dict(zip(stored, answers, strict=True))
        return [self._decoded(key, found[key] if key in found else self._built(key)) for key in keys]

    def _built(self, key: TileKey) -> bytes | CacheError:
        """A tile that may have to be made first."""
        try:
            if key.node >= 0:
                return self.transport.node_tile(key.node)
            return self.transport.surface_lod(int(self.scene.surface_ids[key.surface]), key.level)
        except CacheError as error:
            return error

    @staticmethod
    def _decoded(key: TileKey, data: bytes | CacheError) -> Loaded:
        if isinstance(data, CacheError):
            return Loaded(key, None, data)
        try:
            return Loaded(key, read_tile(data), None)
        except CacheError as error:
            return Loaded(key, None, error)
