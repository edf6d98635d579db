"""Who does the jobs of a stage: this process, processes beside it, or machines elsewhere.

A stage is a *task*, a module-level function of a bench and a job. Jobs are cut by the data, and their
results are taken in the order of the jobs: so the cache does not depend on who does them, or on how
many there are.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from types import TracebackType
from typing import Protocol, Self, TypeVar

from nurbs_ooc.build.workshop import Bench, Workshop, leave, opened

J = TypeVar("J")
R = TypeVar("R")


class Crew(Protocol):
    """Workers that share a workshop's files."""

    n_workers: int

    def run(self, task: Callable[[Bench, J], R], shop: Workshop, jobs: Iterable[J]) -> Iterator[R]:
        """Yield the results of ``jobs`` in their order; jobs are taken only as they are needed.

        Args:
            task: a module-level function, so that other processes find it by its name.
            shop: where the jobs' files are.
            jobs: what ``task`` takes, in a form that can be sent to other processes.
        """
        ...

    def __enter__(self) -> Self: ...

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None: ...


class SoloCrew:
    """This process alone: nothing to start, nothing to send."""

    n_workers = 1

    def run(self, task: Callable[[Bench, J], R], shop: Workshop, jobs: Iterable[J]) -> Iterator[R]:
        """See ``Crew``."""
        try:
            for job in jobs:
                yield task(opened(shop), job)
        finally:
            leave()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        leave()
