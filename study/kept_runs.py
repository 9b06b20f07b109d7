"""Runs of a study kept line by line in a file, so that an interruption loses none of them."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from pathlib import Path
from typing import Any


class KeptRuns:
    """Runs jobs on processes; what a file holds already is not run again.

    Parameters
    ----------
    path : Path
        One JSON object a line, ``{"job": [...], "result": ...}``; written as results come.
    workers : int
    """

    def __init__(self, path: Path, workers: int) -> None:
        self._path = path
        self._workers = workers
        lines = path.read_text().splitlines() if path.exists() else []
        rows = [json.loads(line) for line in lines if line.endswith("}")]
        self._known = {json.dumps(row["job"]): row["result"] for row in rows}

    def map(self, work: Callable[..., Any], jobs: Sequence[tuple[Any, ...]]) -> list[Any]:
        """Return ``work(*job)`` for each job, as JSON gives it back; NaN is one of its numbers."""
        keys = [json.dumps([work.__name__, *job]) for job in jobs]
        left = [i for i, key in enumerate(keys) if key not in self._known]
        if left:
            self._path.parent.mkdir(parents=True, exist_ok=True)
        with ProcessPoolExecutor(self._workers) as pool:
            waiting = {pool.submit(work, *jobs[i]): i for i in left}
            for done in as_completed(waiting):
                key = keys[waiting[done]]
                row = {"job": json.loads(key), "result": done.result()}
                with self._path.open("a") as file:
                    file.write(json.dumps(row) + "\n")
                self._known[key] = row["result"]
        return [self._known[key] for key in keys]
