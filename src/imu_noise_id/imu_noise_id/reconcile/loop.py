"""Reconciliation from recording and model to verdicts and a mended model."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import numpy as np

from imu_noise_id.effects.base import Effect
from imu_noise_id.effects.cross_axis import CrossAxis
from imu_noise_id.effects.periodic import Periodic
from imu_noise_id.effects.variance_change import VarianceChange
from imu_noise_id.effects.white_noise import WhiteNoise
from imu_noise_id.model import ChannelModel, NoiseModel
from imu_noise_id.reconcile.axes import Tie, ties
from imu_noise_id.reconcile.candidate import PRICE_PER_PARAMETER, Candidate, given_count
from imu_noise_id.reconcile.clean import answer_hits, open_topic
from imu_noise_id.reconcile.common import COMMON_NOISE, of_one_noise, only_slow
from imu_noise_id.reconcile.compare import Finding, Findings
from imu_noise_id.reconcile.explain import MOST_PER_CHANNEL, candidates
from imu_noise_id.reconcile.lines import harmonics, line_columns
from imu_noise_id.reconcile.mended import channel_result, mended_model, uncompared
from imu_noise_id.reconcile.null import z_of
from imu_noise_id.reconcile.prior import widened
from imu_noise_id.reconcile.result import (
    ADD,
    REFIT,
    REMOVE,
    ChannelReconciliation,
    Reconciliation,
    Where,
)
from imu_noise_id.reconcile.work import Work, drafted
from imu_noise_id.recording import Channel, Recording

FALSE_ALARM_RATE = 0.01
TOLD_APART = 5.0
LEAST_GAIN = 6.0
MOST_STEPS = 6
OTHER_POSE_M_S2 = 1.0
TIES_SHARE = 0.15
TIMING_SHARE = 0.05
GONE = 4.0
MOST_LEFT = 1.0
"""Of the gap beyond 1: 1 of 5729 channels that the study calls explained has more than 0.5."""


def reconcile_recording(
    recording: Recording,
    model: NoiseModel,
    seed: int = 0,
    workers: int = 2,
    false_alarm_rate: float = FALSE_ALARM_RATE,
    progress: Callable[[str], None] | None = None,
    simulation: Recording | None = None,
) -> Reconciliation:
    """Compare a recording with a model, name what is missing, and mend the model.

    Parameters
    ----------
    recording : Recording
    model : NoiseModel
        Its parameters float within their intervals; a value without one (typed by hand) is taken as
        known to 0.2 %.
    seed : int
        Of the draws that stand in for missing or clipped samples.
    workers : int
        Threads; the result does not depend on their number.
    false_alarm_rate : float
        Chance that a recording of the model itself is changed in any channel.
    progress : callable, optional
        Told each channel's name when it is done.
    simulation : Recording, optional
        From which the model was identified: slow noise that both may have is no difference.

    Returns
    -------
    Reconciliation
    """
    works, levels = _opened(recording, model, seed, false_alarm_rate)

    def explained(name: str) -> Work:
        done = explain(works[name], levels.channel)
        answered = any(d.effect.name == "outliers" for d in done.drafts)
        if done.drafts and not answered:
            again = answer_hits(done, np.random.default_rng([seed, 99]))
            if len(again.drafts) > len(done.drafts):
                done = explain(again, levels.channel)  # hits that a burst had covered
        if progress is not None:
            progress(name)
        return done

    with ThreadPoolExecutor(max(workers, 1)) as pool:
        results = dict(zip(works, pool.map(explained, works), strict=True))
    slow = [name for name, work in results.items() if only_slow(work)]
    if simulation is not None and slow:
        played, _ = _opened(simulation, model, seed, false_alarm_rate)
        for name in slow:
            if of_one_noise(results[name], works[name], played[name], levels.channel):
                notes = (*works[name].notes, COMMON_NOISE)
                results[name] = replace(results[name], drafts=(), notes=notes)
    return _assemble(recording, model, results, levels)


def compare_recording(
    recording: Recording,
    model: NoiseModel,
    seed: int = 0,
    false_alarm_rate: float = FALSE_ALARM_RATE,
) -> tuple[ChannelReconciliation, ...]:
    """Only whether recording and model agree, and where not: cheap enough for a live node.

    Returns
    -------
    tuple of ChannelReconciliation
        ``agrees`` or ``unexplained``; a hold, rounding or hits that the model lacks come as steps.
    """
    works, levels = _opened(recording, model, seed, false_alarm_rate)
    return tuple(channel_result(work, levels.channel) for work in works.values())


def _opened(
    recording: Recording, model: NoiseModel, seed: int, rate: float
) -> tuple[dict[str, Work], _Levels]:
    """Every channel with its contamination answered."""
    models = {c.name: c for c in model.channels}
    known = [c for c in recording.channels if c.name in models and c.still.any()]
    levels = _Levels(rate, known)
    works: dict[str, Work] = {}
    for number, topic in enumerate(dict.fromkeys(c.topic for c in known)):
        channels = [c for c in known if c.topic == topic]
        rng = np.random.default_rng([seed, number])
        opened = open_topic(channels, models, recording, levels.timing, rng)
        works.update({w.name: w for w in opened})
    return _tie(works, models, levels.tie), levels


class _Levels:
    """How the false-alarm rate of the recording is shared out, logarithms."""

    def __init__(self, rate: float, channels: list[Channel]) -> None:
        pairs = max(len(channels) * (len(channels) - 1) // 2, 1)
        topics = max(len({c.topic for c in channels}), 1)
        self.rate = rate
        self.tie = float(np.log(TIES_SHARE * rate / pairs))
        self.timing = float(np.log(TIMING_SHARE * rate / topics))
        left = 1.0 - TIES_SHARE - TIMING_SHARE
        self.channel = float(np.log(left * rate / max(len(channels), 1)))


def _tie(
    works: dict[str, Work], models: dict[str, ChannelModel], log_level: float
) -> dict[str, Work]:
    """Answer correlations between channels, strongest first; both channels get the step."""
    found = ties({n: w.found.white for n, w in works.items()}, models)
    out = dict(works)
    for tie in sorted((t for t in found if t.log_p < log_level), key=lambda t: t.log_p):
        for name, other in ((tie.first, tie.second), (tie.second, tie.first)):
            out[name] = _tied(out[name], other, tie)
    return out


def _tied(work: Work, other: str, tie: Tie) -> Work:
    z = z_of(tie.log_p)
    finding = Finding("cross_axis", tie.log_p, z, Where("axes", tie.value, tie.value, "1", z))
    gone = tie.given != 0.0 and abs(tie.value) < GONE * tie.std_error
    action = REMOVE if gone else REFIT if tie.given else ADD
    before = replace(work, unmet=(*work.unmet, finding))
    effect = CrossAxis(other, tie.given if gone else tie.value)
    after = work if action == REMOVE else _louder(work, abs(tie.value - tie.given))
    return drafted(before, after, action, effect, finding)


def _louder(work: Work, shared: float) -> Work:
    """A channel whose white level may be higher by what it shares: that is no finding of its own.

    Two channels that leak alike to a correlation r have densities higher by r/2.
    """
    state = work.state
    row = 0
    for effect in state.effects[: given_count(state)]:
        if isinstance(effect, WhiteNoise):
            return work.analysed(replace(state, prior=widened(state.prior, row, shared)))
        row += len(effect.free())
    return work


def explain(work: Work, log_level: float) -> Work:
    """Change one channel's model until nothing significant is left or nothing helps.

    Where something significant remains, only the first changes are kept that halved the worst
    statistic and the gap on unseen data each: what is in no catalogue collects names that close
    no gap.
    """
    trail: list[tuple[Work, Findings]] = [(work, work.findings)]
    while len(trail) <= MOST_STEPS:
        current, findings = trail[-1]
        if findings.log_p > log_level:
            break
        pick = _choose(candidates(current.state, current.found, current.skip))
        if pick is None:
            break
        best, rival = pick
        best, after = _made(current, best)
        if best.effect.name == "random_telegraph":
            after = replace(after, skip=after.skip | {"levels"})
        after = replace(after, drafts=current.drafts)
        noted = _with_harmonics(_noted(current, after, best, findings.worst, rival), best.effect)
        trail.append((noted, noted.findings))
    return _pruned(_halved(trail, log_level), log_level)


def _made(work: Work, best: Candidate) -> tuple[Candidate, Work]:
    """The work with a change made; where it was rounded coarsely, on draws under that change."""
    if isinstance(best.effect, VarianceChange) and best.action == ADD and work.drawable:
        quiet, burst = work.drawn_with(best.effect)
        return replace(best, effect=burst), quiet
    return best, replace(work, state=best.state, found=best.found).drawn_anew()


def _with_harmonics(work: Work, line: Effect) -> Work:
    """Beside a line that was added its harmonics, a step each: what makes one makes all."""
    if not isinstance(line, Periodic):
        return work
    lines = sum(isinstance(c.effect, Periodic) for c in work.state.columns) // 2
    room = max(MOST_PER_CHANNEL["periodic"] - lines, 0)
    for frequency_hz, log_p in harmonics(work.state, work.found, line.frequency_hz)[:room]:
        pair = line_columns(frequency_hz, work.state, work.state.columns[-1].span_s)
        after = work.analysed(replace(work.state, columns=(*work.state.columns, *pair)))
        amplitude = float(np.hypot(*after.found.sizes[-2:]))
        place = Where("spectrum", frequency_hz, frequency_hz, "Hz", z_of(log_p))
        finding = Finding("line", log_p, place.z, place)
        work = drafted(work, after, ADD, Periodic(frequency_hz, amplitude), finding)
    return work


def _pruned(work: Work, log_level: float) -> Work:
    """Without an added noise that later steps made needless: two steps pass for a walk first."""
    for number, draft in enumerate(work.drafts[:-1]):
        names = [e.name for e in work.state.effects]
        if draft.action != ADD or draft.effect.name not in names[given_count(work.state) :]:
            continue
        index = names.index(draft.effect.name, given_count(work.state))
        effects = (*work.state.effects[:index], *work.state.effects[index + 1 :])
        fewer = work.analysed(replace(work.state, effects=effects))
        loss = work.found.objective - fewer.found.objective
        as_good = fewer.findings.log_p > log_level or work.findings.log_p <= log_level
        if as_good and loss < PRICE_PER_PARAMETER * len(draft.effect.free()):
            heir = work.drafts[number + 1]
            unseen = replace(heir.held_out, gap_before=draft.held_out.gap_before)
            heir = replace(heir, whole=(draft.whole[0], heir.whole[1]), held_out=unseen)
            drafts = (*work.drafts[:number], heir, *work.drafts[number + 2 :])
            return _pruned(replace(fewer, drafts=drafts), log_level)
    return work


def _noted(before: Work, after: Work, best: Candidate, finding: Finding, rival: str) -> Work:
    return drafted(before, after, best.action, best.effect, finding, rival)


def _choose(found: list[Candidate]) -> tuple[Candidate, str] | None:
    """Best candidate with the name of an equal one, or None where none is worth its price."""
    if not found or found[0].net <= 0.0 or found[0].gain < LEAST_GAIN:
        return None
    best = found[0]
    rival = next((c for c in found[1:] if c.label != best.label), None)
    if rival is None or best.net - rival.net >= TOLD_APART:
        return best, ""
    return best, rival.label


def _halved(trail: list[tuple[Work, Findings]], log_level: float) -> Work:
    """The last work of the trail whose steps are worth keeping."""
    if len(trail) == 1 or (trail[-1][1].log_p > log_level and _closed(trail)):
        return trail[-1][0]
    kept = 0
    for step in range(1, len(trail)):
        before, after = trail[kept][1].worst.z, trail[step][1].worst.z
        new = trail[step][0].drafts[len(trail[step - 1][0].drafts) :]
        gap_before, gap_after = new[0].held_out.gap_before, new[-1].held_out.gap_after
        closed = gap_after - 1.0 <= 0.5 * (gap_before - 1.0)
        if abs(after) > 0.5 * abs(before) or not closed:
            break
        kept = step
    return trail[kept][0]


def _closed(trail: list[tuple[Work, Findings]]) -> bool:
    """Whether the steps closed the gap on unseen data too: half of it, and a scatter of 0.25.

    Of a large gap half is a gap: no more than ``MOST_LEFT`` may stay.
    """
    before = trail[1][0].drafts[len(trail[0][0].drafts)].held_out.gap_before
    after = trail[-1][0].drafts[-1].held_out.gap_after
    return after - 1.0 <= min(0.5 * max(before - 1.0, 0.0) + 0.25, MOST_LEFT)


def _assemble(
    recording: Recording,
    model: NoiseModel,
    works: dict[str, Work],
    levels: _Levels,
) -> Reconciliation:
    results: list[ChannelReconciliation] = []
    models = {c.name: c for c in model.channels}
    for channel in recording.channels:
        if channel.name in works:
            results.append(channel_result(works[channel.name], levels.channel))
        else:
            results.append(uncompared(channel, models.get(channel.name)))
    absent = models.keys() - {c.name for c in recording.channels}
    notes = [f"{name}: in the model, not in the recording" for name in sorted(absent)]
    notes += lying_otherwise(recording, models)
    notes += of_the_stamps(recording)
    mended = mended_model(model, works, recording)
    return Reconciliation(tuple(results), mended, levels.rate, tuple(notes))


def of_the_stamps(recording: Recording) -> list[str]:
    """What the reader says of a topic's samples, and what it left out: the clock was set, say."""
    notes = []
    for topic in dict.fromkeys(c.topic for c in recording.channels):
        qualities = [c.quality for c in recording.channels if c.topic == topic]
        common = (n for n in qualities[0].notes if all(n in q.notes for q in qualities))
        notes += [f"{topic}: {note}" for note in common if note not in recording.notes]
        twice = max(quality.duplicates for quality in qualities)
        back = max(quality.out_of_order for quality in qualities)
        if twice or back:
            notes.append(
                f"{topic}: left out are {twice} samples with the stamp of another and {back} with "
                "one that runs back: a clock set back, or messages sent twice?"
            )
    return notes


def lying_otherwise(recording: Recording, models: dict[str, ChannelModel]) -> list[str]:
    """Say where gravity is not as in the model: a constant is no noise, but may be a sign error.

    By more than ``OTHER_POSE_M_S2``, which no bias is; a typed model, mean 0, says nothing of it.
    """
    notes = []
    for channel in recording.channels:
        model = models.get(channel.name)
        held = channel.name.startswith("linear_acceleration.") and channel.values.size
        if model is None or not model.mean or not held:
            continue
        mean = float(channel.values.mean())
        if abs(mean - model.mean) > OTHER_POSE_M_S2:
            notes.append(
                f"{channel.name}: a mean of {mean:+.2f} m/s^2 and {model.mean:+.2f} in the model: "
                "the sensor lies otherwise, or an axis has the other sign"
            )
    return notes
