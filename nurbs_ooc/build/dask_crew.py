"""Workers as a Dask cluster, for what one machine is too small for; needs the extra ``dask``.

Jobs travel to the workers, their files do not: every worker sees the folders of the build under the
same paths, on a file system that they share. The builder alone writes to the store.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable, Iterator
from types import TracebackType
from typing import Any, Self, TypeVar

from nurbs_cache.errors import UsageError
from nurbs_ooc.build.workshop import Bench, Workshop, opened

J = TypeVar("J")
R = TypeVar("R")

AHEAD = 3  # jobs a worker has, running or waiting: the network is slower than a socket
CONNECT_LIMIT_S = 10.0


class DaskCrew:
    """The workers of a running cluster; see ``Crew``.

    Args:
        address: of its scheduler, as in tcp://host:8786.

    Raises:
        UsageError: Dask is not installed, nobody answers, or the workers cannot do these jobs.
    """

    def __init__(self, address: str) -> None:
        try:
            from distributed import Client
        except ImportError as error:
            raise UsageError("--dask needs Dask: pip install 'nurbs-ooc[dask]'") from error
        try:
            self._client: Any = Client(address, timeout=CONNECT_LIMIT_S, set_as_default=False)
        except (OSError, ValueError) as error:
            raise UsageError(f"--dask {address}: no scheduler answers: {error}") from error
        threads = [worker["nthreads"] for worker in self._client.scheduler_info(n_workers=-1)["workers"].values()]
        self.n_workers = len(threads)
        if not threads or max(threads) > 1:
            self._client.close()
            raise UsageError(
                f"--dask {address}: {len(threads)} workers, {max(threads, default=0)} threads; "
                "want at least one worker with one thread each (dask worker --nthreads 1)"
            )

    def run(self, task: Callable[[Bench, J], R], shop: Workshop, jobs: Iterable[J]) -> Iterator[R]:
        """See ``Crew``."""
        waiting: deque[Any] = deque()
        try:
            for job in jobs:
                waiting.append(self._client.submit(_do, task, shop, job, pure=False))
                if len(waiting) >= AHEAD * self.n_workers:
                    yield waiting.popleft().result()
            while waiting:
                yield waiting.popleft().result()
        finally:
            self._client.cancel(list(waiting))

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._client.close()


def _do(task: Callable[[Bench, J], R], shop: Workshop, job: J) -> R:
    """Do one job on a worker."""
    return task(opened(shop), job)
