"""What ``identify`` leaves behind for one recording, and for many."""

from __future__ import annotations

import contextlib
import os
import signal
from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass
from multiprocessing import get_context
from pathlib import Path
from typing import TYPE_CHECKING, Any

from imu_noise_id.errors import InputError
from imu_noise_id.results_file import Unit

if TYPE_CHECKING:
    from imu_noise_id.identify import Identification
    from imu_noise_id.recording import Recording
    from imu_noise_id.topics import TopicNames


@dataclass(frozen=True)
class Job:
    """One recording to identify."""

    name: str
    bag: str
    output: str
    topics: TopicNames
    last_s: float | None


def read_job(job: Job) -> Recording:
    """Read the recording of a job.

    Raises
    ------
    InputError
        When nothing in it can be used.
    """
    from imu_noise_id.bags import read_recording

    return read_recording(job.bag, job.topics, job.last_s)


def write_identification(identification: Identification, folder: Path | str) -> None:
    """Write ``identify.json``, ``model.yaml`` and ``report.html``, each whole.

    Raises
    ------
    OutputError
        When one cannot be written; says where they are kept.
    """
    from imu_noise_id.files import write_or_keep, write_text
    from imu_noise_id.model_file import save_model
    from imu_noise_id.report.identification import identification_page
    from imu_noise_id.results_file import identification_tree, write_json

    page = identification_page(identification)

    def write(folder: Path) -> None:
        write_json(identification_tree(identification), folder / "identify.json")
        save_model(identification.model, folder / "model.yaml")
        write_text(folder / "report.html", page)

    write_or_keep(write, Path(folder))


def identify_unit(job: Job) -> Unit:
    """Identify one recording of a fleet and write its folder; what is wrong is in the result."""
    from imu_noise_id.identify import identify_recording

    try:
        identification = identify_recording(read_job(job), workers=1)
        write_identification(identification, job.output)
    except InputError as error:
        return Unit(job.name, job.bag, None, str(error))
    return Unit(job.name, job.bag, identification.model)


def identify_fleet(
    jobs: list[Job], scheduler: str | None, done: Callable[[str], None]
) -> list[Unit]:
    """Identify many recordings over the cores of this machine, or over a Dask cluster.

    Parameters
    ----------
    jobs : list of Job
    scheduler : str, optional
        Address of a Dask scheduler whose workers see the same files.
    done : callable
        Told the name of each recording that is through.

    Returns
    -------
    list of Unit
        In the order of the jobs.
    """
    finished: dict[str, Unit] = {}
    for unit in _on_cluster(jobs, scheduler) if scheduler else _on_cores(jobs):
        finished[unit.name] = unit
        done(unit.name)
    return [finished[job.name] for job in jobs]


def _on_cores(jobs: list[Job]) -> Iterator[Unit]:
    """Yield units as they come; what a dying process took with it is done again in this one."""
    cores = min(len(os.sched_getaffinity(0)), len(jobs))
    if cores == 1:
        yield from map(identify_unit, jobs)
        return
    left = {job.name: job for job in jobs}
    with ProcessPoolExecutor(
        cores, mp_context=get_context("spawn"), initializer=_end_silently
    ) as pool:
        with _interrupts_wait():
            futures = [pool.submit(identify_unit, job) for job in jobs]
        for future in as_completed(futures):
            if isinstance(future.exception(), BrokenProcessPool):
                break
            unit = future.result()
            del left[unit.name]
            yield unit
    yield from map(identify_unit, left.values())


@contextlib.contextmanager
def _interrupts_wait() -> Iterator[None]:
    """Let Ctrl-C wait; a process that is started meanwhile inherits this."""
    signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGINT})


def _end_silently() -> None:
    """Let Ctrl-C end a worker at once, without the traceback of wherever it is."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGINT})


def _on_cluster(jobs: list[Job], scheduler: str) -> Iterator[Unit]:
    """Yield units as they come; Dask itself repeats what a dying worker took with it."""
    try:
        from distributed import Client, as_completed
    except ImportError:
        raise InputError(
            "--scheduler needs Dask: python -m pip install 'distributed>=2024.1'"
        ) from None
    try:
        client: Any = Client(scheduler, timeout="10s", set_as_default=False)
    except (OSError, ValueError, TimeoutError) as error:
        raise InputError(
            f"--scheduler {scheduler}: no scheduler answers ({type(error).__name__}): "
            "start one with 'dask scheduler'"
        ) from error
    with client:
        futures = client.map(identify_unit, jobs, pure=False, retries=3)
        for future in as_completed(futures, loop=client.loop):
            yield future.result()
