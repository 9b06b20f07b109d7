"""What the live ``identify`` has a process of its own do: reception never waits for it."""

from __future__ import annotations

from dataclasses import dataclass

from imu_noise_id.checkpoint import Checkpoint, save_checkpoint
from imu_noise_id.columns import TopicColumns
from imu_noise_id.errors import InputError
from imu_noise_id.live import Findings, identify_columns
from imu_noise_id.longrun import LongRun
from imu_noise_id.model import NoiseModel


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


DIED = Answer(None, "the identifying process died; it is started again")


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
