"""Work on threads, for what leaves the interpreter lock alone: compression, and large arrays."""

from __future__ import annotations

import os
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from typing import TypeVar

T = TypeVar("T")
R = TypeVar("R")


def cores() -> int:
    """Return how many threads are worth having here: at most four."""
    return max(1, min(4, len(os.sched_getaffinity(0))))


def ordered_map(work: Callable[[T], R], items: Sequence[T], threads: int) -> Iterator[R]:
    """``map`` on threads, results in order, never more than two items a thread in memory."""
    if threads == 1 or len(items) < 2:
        yield from map(work, items)
        return
    with ThreadPoolExecutor(threads) as pool:
        pending: deque[Future[R]] = deque()
        for item in items:
            pending.append(pool.submit(work, item))
            if len(pending) > 2 * threads:
                yield pending.popleft().result()
        while pending:
            yield pending.popleft().result()
