"""Long work of a node in a process of its own: reception never waits for it."""

from __future__ import annotations

import contextlib
import multiprocessing
import os
import pickle
import signal
import threading
from collections.abc import Callable
from multiprocessing.connection import Connection
from typing import Any, Generic, TypeVar

_NICE = 5
Job = TypeVar("Job")
Answer = TypeVar("Answer")


class Worker(Generic[Job, Answer]):
    """One process that works one job at a time; it ends with its parent.

    Parameters
    ----------
    work : callable
        A function of a module, by whose name the process finds it.
    died : Answer
        What is answered where the process died.
    """

    def __init__(self, work: Callable[[Job], Answer], died: Answer) -> None:
        self._work = work
        self._died = died
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
            answer = self._died
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
        self._process = context.Process(target=serve, args=(theirs, self._work), daemon=True)
        self._process.start()
        theirs.close()

    def _send(self, job: Job) -> None:
        with contextlib.suppress(BrokenPipeError, ConnectionResetError):
            if self._connection is not None:
                send_job(self._connection, job)


def send_job(connection: Connection, job: object) -> None:
    """Send a job, its arrays from where they lie: a copy would hold the interpreter's lock."""
    arrays: list[pickle.PickleBuffer] = []
    head = pickle.dumps(job, protocol=5, buffer_callback=arrays.append)
    connection.send((head, len(arrays)))
    for array in arrays:
        connection.send_bytes(array.raw())


def receive_job(connection: Connection) -> Any:
    """Receive what `send_job` sent; its arrays are read-only."""
    head, count = connection.recv()
    arrays = [connection.recv_bytes() for _ in range(count)]
    return pickle.loads(head, buffers=arrays)  # noqa: S301 - from our own parent, by its pipe


def serve(connection: Connection, work: Callable[[Any], object]) -> None:
    """Work jobs until the parent is gone."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, signal.SIG_DFL)
    os.nice(_NICE)
    with contextlib.suppress(EOFError, BrokenPipeError, ConnectionResetError):
        while True:
            connection.send(work(receive_job(connection)))
