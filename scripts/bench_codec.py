#!/usr/bin/env python3
"""Encode and decode tiles of about 3,000 triangles: MB/s of raw data, bytes per triangle; JSON on stdout.

Raw data are float32 positions and normals and uint32 indices. Each figure is the median over the chunks of
the best of several runs, in CPU time of one thread, after a first call that compiles.
"""

from __future__ import annotations

import argparse
import json
import platform
import statistics
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

sys.path.insert(0, str(Path(__file__).resolve().parent.parent / "cache"))

from codec_peers import Peer, peers
from docs_section import replace_section

from nurbs_cache.store import Store
from nurbs_cache.tile import TileContent, decode_tile, encode_tile

TRIANGLES = 3000  # of a chunk, about


def sheet(
    rows: int, columns: int, random: np.random.Generator
) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.float32]]:
    """Positions and normals of a smooth bent sheet of 50 to 500 mm, turned and placed anywhere."""
    u, v = np.meshgrid(np.linspace(0.0, 1.0, rows), np.linspace(0.0, 1.0, columns), indexing="ij")
    a, b, c, d = random.uniform(-1.0, 1.0, 4)
    height = 0.1 * (a * u * u + b * u * v + c * v * v + d * np.sin(3.0 * u + 2.0 * v))
    slope_u = 0.1 * (2 * a * u + b * v + 3 * d * np.cos(3.0 * u + 2.0 * v))
    slope_v = 0.1 * (b * u + 2 * c * v + 2 * d * np.cos(3.0 * u + 2.0 * v))
    turn = np.linalg.qr(random.normal(size=(3, 3)))[0]
    points = np.stack([u, v, height], axis=-1).reshape(-1, 3) @ turn * random.uniform(50.0, 500.0)
    normals = np.stack([-slope_u, -slope_v, np.ones_like(u)], axis=-1).reshape(-1, 3) @ turn
    normals /= np.linalg.norm(normals, axis=1)[:, None]
    return points + random.uniform(0.0, 1000.0, 3), normals.astype(np.float32)


def chunk(random: np.random.Generator) -> TileContent:
    """Faces of 8 to some 400 triangles each, as a node of an assembly has them."""
    positions: list[npt.NDArray[np.float64]] = []
    normals: list[npt.NDArray[np.float32]] = []
    triangles: list[npt.NDArray[np.uint32]] = []
    n_vertices = n_triangles = 0
    while n_triangles < TRIANGLES:
        rows, columns = random.integers(3, 16, 2)
        p, n = sheet(int(rows), int(columns), random)
        corner = np.arange(rows * columns, dtype=np.uint32).reshape(rows, columns) + np.uint32(n_vertices)
        a, b, c, d = corner[:-1, :-1], corner[1:, :-1], corner[1:, 1:], corner[:-1, 1:]
        faces = np.stack([a, b, c, a, c, d], axis=-1).reshape(-1, 3)
        kept = random.random(len(faces)) > 0.05  # holes, as trimming leaves them
        positions.append(p)
        normals.append(n)
        triangles.append(faces[kept])
        n_vertices += len(p)
        n_triangles += int(kept.sum())
    none = np.zeros(0, np.uint32)
    return TileContent(
        np.concatenate(positions), np.concatenate(normals), np.concatenate(triangles), none.reshape(0, 2), none
    )


def stored_chunks(path: Path, limit: int) -> list[TileContent]:
    """The tiles of a cache as contents, the first ``limit`` with enough triangles."""
    contents = []
    with Store.open(path) as store:
        for _, data in store.scan("tiles"):
            tile = decode_tile(data)
            if len(tile.triangles) >= TRIANGLES // 4 and len(contents) < limit:
                places = tile.origin + tile.positions.astype(np.float64)
                contents.append(TileContent(places, tile.normals, tile.triangles, tile.lines, tile.points, tile.ledger))
    return contents


def best_s(run: Callable[[], object], repeats: int) -> float:
    """Shortest CPU time of one thread, s."""
    times = []
    for _ in range(repeats):
        start = time.thread_time_ns()
        run()
        times.append(time.thread_time_ns() - start)
    return min(times) * 1e-9


def measure(contents: list[TileContent], codec: str, repeats: int) -> dict[str, float]:
    """Figures of one codec."""
    encode_mb_s, decode_mb_s, sizes = [], [], []
    for content in contents:
        data = encode_tile(content, codec=codec)
        raw = 24 * len(content.positions) + 4 * (content.triangles.size + content.lines.size + content.points.size)
        sizes.append(len(data) / len(content.triangles))
        encode_mb_s.append(raw / best_s(lambda c=content: encode_tile(c, codec=codec), repeats) / 1e6)  # type: ignore[misc]
        decode_mb_s.append(raw / best_s(lambda d=data: decode_tile(d), repeats) / 1e6)  # type: ignore[misc]
    return {
        "bytes_per_triangle": round(statistics.median(sizes), 3),
        "encode_mb_s": round(statistics.median(encode_mb_s), 1),
        "decode_mb_s": round(statistics.median(decode_mb_s), 1),
    }


def measure_peer(contents: list[TileContent], peer: Peer, repeats: int) -> dict[str, float]:
    """The same figures of another codec, in the same raw bytes."""
    encode_mb_s, decode_mb_s, sizes = [], [], []
    for content in contents:
        given = peer.prepare(content)
        coded = peer.encode(given)
        raw = 24 * len(content.positions) + 4 * content.triangles.size
        sizes.append(peer.size(coded) / len(content.triangles))
        encode_mb_s.append(raw / best_s(lambda g=given: peer.encode(g), repeats) / 1e6)  # type: ignore[misc]
        decode_mb_s.append(raw / best_s(lambda c=coded: peer.decode(c), repeats) / 1e6)  # type: ignore[misc]
    return {
        "bytes_per_triangle": round(statistics.median(sizes), 3),
        "encode_mb_s": round(statistics.median(encode_mb_s), 1),
        "decode_mb_s": round(statistics.median(decode_mb_s), 1),
    }


def markdown(report: dict[str, Any]) -> str:
    """The figures as a table."""
    lines = [
        f"{report['machine']}, {report['chunks']} tiles ({report['source']}),",
        f"each with some {report['triangles']} triangles and {report['vertices']} vertices.",
        "",
        "| codec | bytes a triangle | encode MB/s | decode MB/s |",
        "|---|--:|--:|--:|",
    ]
    ours = {f"ours, {name}": figures for name, figures in report["codecs"].items()}
    for name, figures in {**ours, **report.get("peers", {})}.items():
        values = figures["bytes_per_triangle"], figures["encode_mb_s"], figures["decode_mb_s"]
        lines.append(f"| {name} | {values[0]:.2f} | {values[1]:.0f} | {values[2]:.0f} |")
    return "\n".join(lines)


def main() -> None:
    """Print the report."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--cache", type=Path, help="measure on the tiles of this cache instead of made-up chunks")
    parser.add_argument("--chunks", type=int, default=12, help="number of chunks (default 12)")
    parser.add_argument("--repeats", type=int, default=30, help="runs of each, the best counts (default 30)")
    parser.add_argument("--peers", action="store_true", help="meshoptimizer and Draco too, where installed")
    parser.add_argument("--docs", type=Path, help="page whose section `codec` is replaced by the table")
    options = parser.parse_args()
    random = np.random.default_rng(1)
    if options.cache:
        contents = stored_chunks(options.cache, options.chunks)
    else:
        contents = [chunk(random) for _ in range(options.chunks)]
    if not contents:
        sys.exit(f"{options.cache}: no tile of {TRIANGLES // 4} triangles or more")
    report: dict[str, Any] = {
        "source": str(options.cache or "made up"),
        "machine": platform.processor() or platform.machine(),
        "chunks": len(contents),
        "triangles": int(statistics.median(len(c.triangles) for c in contents)),
        "vertices": int(statistics.median(len(c.positions) for c in contents)),
        "codecs": {codec: measure(contents, codec, options.repeats) for codec in ("zstd", "huffman", "plain")},
    }
    if options.peers:
        report["peers"] = {name: measure_peer(contents, peer, options.repeats) for name, peer in peers().items()}
    if options.docs:
        replace_section(options.docs, "codec", markdown(report))
    print(json.dumps(report, indent=2))


if __name__ == "__main__":
    main()
