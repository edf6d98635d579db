"""The benchmarks of the cache run and say what they measured; how fast is for people to read."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

from nurbs_cache.store import Store
from nurbs_cache.tile import encode_tile, tile_hash
from tests.cache.makers import content


def report(repository: Path, script: str, *options: object) -> dict[str, Any]:
    """What a script prints."""
    command = [sys.executable, str(repository / "scripts" / script), *map(str, options)]
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)}
    run = subprocess.run(command, env=environment, capture_output=True, text=True, check=True)
    printed: dict[str, Any] = json.loads(run.stdout)
    return printed


def test_bench_codec(repository: Path, cache_path: Path) -> None:
    made_up = report(repository, "bench_codec.py", "--chunks", 1, "--repeats", 2)
    assert set(made_up["codecs"]) == {"zstd", "huffman", "plain"}
    assert 2.0 < made_up["codecs"]["zstd"]["bytes_per_triangle"] < 5.0
    assert made_up["codecs"]["zstd"]["bytes_per_triangle"] < made_up["codecs"]["plain"]["bytes_per_triangle"]
    data = encode_tile(content(30, 30))
    with Store.create(cache_path) as store:
        store.put_tiles([(tile_hash(data), data)])
    stored = report(repository, "bench_codec.py", "--cache", cache_path, "--repeats", 1)
    assert (stored["chunks"], stored["triangles"]) == (1, 1682)


def test_bench_store(repository: Path, tmp_path: Path) -> None:
    small = report(repository, "bench_store.py", "--folder", tmp_path, "--tiles", 20, "--nodes", 1000, "--surfaces", 20)
    assert small["tiles"]["put_mb_s"] > 0 and small["part"]["get_mb_s"] > 0
    assert list(tmp_path.iterdir()) == []
