"""Identification in a process of its own: reception never waits for it."""

from __future__ import annotations

import contextlib
import multiprocessing
import os
import pickle
import signal
import threading
from dataclasses import dataclass
from multiprocessing.connection import Connection

from imu_noise_id.checkpoint import Checkpoint, save_checkpoint
from imu_noise_id.columns import TopicColumns
from imu_noise_id.errors import InputError
from imu_noise_id.live import Findings, identify_columns
from imu_noise_id.longrun import LongRun
from imu_noise_id.model import NoiseModel

_NICE = 5


@dataclass(frozen=True)
class Job:
    """What to identify.

    Attributes
    ----------
    columns : tuple of TopicColumns
    last_s : float or None
    checkpoint : str
        File to keep the columns in first; empty: none.
    identify : bool
        False: only the checkpoint.
    before : tuple of LongRun
        What the buffers have forgotten.
    reference : NoiseModel or None
        A model that the buffer is compared with.
    """

    columns: tuple[TopicColumns, ...]
    last_s: float | None = None
    checkpoint: str = ""
    identify: bool = True
    before: tuple[LongRun, ...] = ()
    reference: NoiseModel | None = None


@dataclass(frozen=True)
class Answer:
    """What came of a job: findings, or why there are none; and why there is no checkpoint."""

    findings: Findings | None
    problem: str = ""
    checkpoint_problem: str = ""


class Worker:
    """One process that works one job at a time; it ends with its parent."""

    def __init__(self) -> None:
        self._process: multiprocessing.process.BaseProcess | None = None
        self._connection: Connection | None = None
        self._sender: threading.Thread | None = None
        self.busy = False

    def submit(self, job: Job) -> None:
        """Start on a job; only when not `busy`."""
        if self._process is None or not self._process.is_alive():
            self._start()
        self.busy = True
        # a pipe takes 64 kB at a time: what is sent meanwhile must not hold up reception
        self._sender = threading.Thread(target=self._send, args=(job,))
        self._sender.start()

    def poll(self) -> Answer | None:
        """The answer, once there is one; a worker that died is an answer too."""
        if not self.busy or self._connection is None or not self._connection.poll():
            return None
        try:
            answer: Answer = self._connection.recv()
        except (EOFError, OSError):
            answer = Answer(None, "the identifying process died; it is started again")
            self.close()
        self.busy = False
        return answer

    def close(self) -> None:
        """End the process and wait for it."""
        if self._process is not None:
            self._process.terminate()
            self._process.join()
        if self._sender is not None:
            self._sender.join()
        if self._connection is not None:
            self._connection.close()
        self._process = self._connection = self._sender = None

    def _start(self) -> None:
        self.close()
        context = multiprocessing.get_context("spawn")
        self._connection, theirs = context.Pipe()
        self._process = context.Process(target=serve, args=(theirs,), daemon=True)
        self._process.start()
        theirs.close()

    def _send(self, job: Job) -> None:
        with contextlib.suppress(BrokenPipeError, ConnectionResetError):
            if self._connection is not None:
                send_job(self._connection, job)


def send_job(connection: Connection, job: Job) -> None:
    """Send a job, its arrays from where they lie: a copy would hold the interpreter's lock."""
    arrays: list[pickle.PickleBuffer] = []
    head = pickle.dumps(job, protocol=5, buffer_callback=arrays.append)
    connection.send((head, len(arrays)))
    for array in arrays:
        connection.send_bytes(array.raw())


def receive_job(connection: Connection) -> Job:
    """Receive what `send_job` sent; its arrays are read-only."""
    head, count = connection.recv()
    arrays = [connection.recv_bytes() for _ in range(count)]
    job: Job = pickle.loads(head, buffers=arrays)  # noqa: S301 - from our own parent, by its pipe
    return job


def serve(connection: Connection) -> None:
    """Work jobs until the parent is gone."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, signal.SIG_DFL)
    os.nice(_NICE)
    with contextlib.suppress(EOFError, BrokenPipeError, ConnectionResetError):
        while True:
            connection.send(work(receive_job(connection)))


def work(job: Job) -> Answer:
    """One job."""
    problem = checkpoint_problem = ""
    found = None
    if job.checkpoint:
        try:
            save_checkpoint(Checkpoint(job.columns, job.before), job.checkpoint)
        except InputError as error:
            checkpoint_problem = str(error)
    if job.identify:
        try:
            found = identify_columns(job.columns, job.last_s, job.before, job.reference)
        except InputError as error:
            problem = str(error)
    return Answer(found, problem, checkpoint_problem)
