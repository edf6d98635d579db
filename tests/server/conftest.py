"""The small cache on disk, served in this process."""

from __future__ import annotations

import asyncio
import os
from pathlib import Path

import pytest

from nurbs_cache.store import Store
from nurbs_server.app import create_app
from tests.server.small_cache import CountingBuilders, Serve, Test, client_of, fill

REPOSITORY = Path(__file__).resolve().parents[2]


@pytest.fixture
def small_cache(cache_path: Path) -> Path:
    """The cache on disk, closed."""
    with Store.create(cache_path, provenance={"made by": "a test"}) as store:
        fill(store)
    return cache_path


@pytest.fixture
def python_path() -> dict[str, str]:
    """An environment in which another Python finds the packages of this checkout."""
    path = os.pathsep.join(str(REPOSITORY / folder) for folder in (".", "cache", "server", "client"))
    return {**os.environ, "PYTHONPATH": path}


@pytest.fixture
def builders() -> CountingBuilders:
    """Builders to inject and to ask."""
    return CountingBuilders()


@pytest.fixture
def serve(small_cache: Path, builders: CountingBuilders) -> Serve:
    """Run an async test with a client of the small cache, served with the counting builders."""

    def run(test: Test) -> None:
        async def main(store: Store) -> None:
            async with client_of(create_app(store, builders.injected)) as client:
                await test(client)

        with Store.open(small_cache, read_only=False) as store:
            asyncio.run(main(store))

    return run


@pytest.fixture
def serve_read_only(small_cache: Path) -> Serve:
    """The same of the cache opened for reading."""

    def run(test: Test) -> None:
        async def main(store: Store) -> None:
            async with client_of(create_app(store, refusal="process 7 is writing to it")) as client:
                await test(client)

        with Store.open(small_cache) as store:
            asyncio.run(main(store))

    return run
