"""One channel on its way through reconciliation."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from imu_noise_id.effects.base import CourseEffect, Effect
from imu_noise_id.effects.output_rounding import OutputRounding
from imu_noise_id.effects.periodic import Periodic
from imu_noise_id.effects.variance_change import VarianceChange
from imu_noise_id.effects.white_noise import WhiteNoise
from imu_noise_id.model import ChannelModel
from imu_noise_id.reconcile.compare import Finding, Findings, examine
from imu_noise_id.reconcile.gap import LOCAL, held_out_score, whole_score
from imu_noise_id.reconcile.lines import line_columns
from imu_noise_id.reconcile.null import Null
from imu_noise_id.reconcile.prior import Prior, prior_of, spectral, unseen_drift
from imu_noise_id.reconcile.result import HeldOut, Where
from imu_noise_id.reconcile.state import (
    Analysis,
    Column,
    State,
    analyse,
    course_column,
    inverse_psd,
)
from imu_noise_id.reconcile.unrounded import Steps, draw, information_left
from imu_noise_id.recording import Channel, Floats, Mask
from imu_noise_id.whittle import parameter_vector

SIZE_NAMES = {"rate_ramp": "slope", "bias_step": "height", "temperature": "coefficient"}
"""Parameter to which a course is proportional."""

TYPED_SIZE_ERROR = 0.01
GIVEN_LOG_P = float(np.log(1e-4))
"""Chance beneath which a size that the model has is another in the record."""
STANDS_OUT = 20.0
DRAWS = 6
"""Of what was rounded, the courses (or all of the model) fitted between."""
SETTLING, MOST_DRAWS = 2.5, 24
"""Each draw under a fit leaves the share of a parameter's error that the rounding took of its
information (Dempster, Laird and Rubin 1977): exp(-2.5) after 2.5 over the share that is left."""


@dataclass(frozen=True)
class Draft:
    """A step before its estimates and its sentence are written.

    Attributes
    ----------
    action : str
    effect : Effect
    log_p : float
    where : Where
        What the step answers.
    rival : str
        Another name that fits as well, or empty.
    whole : tuple of (float, float)
        Score of the whole record before and after.
    held_out : HeldOut
    log_errors : dict of str to float
        Standard errors of logarithms of parameters that no later fit tells better.
    """

    action: str
    effect: Effect
    log_p: float
    where: Where
    rival: str
    whole: tuple[float, float]
    held_out: HeldOut
    log_errors: dict[str, float] = field(default_factory=dict)


@dataclass(frozen=True)
class Work:
    """Record, model and findings of one channel.

    Attributes
    ----------
    channel : Channel
    model : ChannelModel
        As given.
    null : Null
    state, found : State, Analysis
        Now.
    hold : float
        Messages per sample of ``state``.
    skip : frozenset of str
        Statistics that whitening does not make fit for this channel.
    unmet : tuple of Finding
        What is wrong outside the whitened record, until a step answers it.
    lasting : tuple of Finding
        Findings of the hits' distribution, kept to the end.
    drafts : tuple of Draft
    notes : tuple of str
        What a reader should know of the samples, a sentence each.
    steps : Steps or None
        What the state's values were drawn for, where they were rounded coarsely.
    """

    channel: Channel
    model: ChannelModel
    null: Null
    state: State
    found: Analysis
    hold: float = 1.0
    skip: frozenset[str] = frozenset()
    unmet: tuple[Finding, ...] = ()
    lasting: tuple[Finding, ...] = ()
    drafts: tuple[Draft, ...] = ()
    notes: tuple[str, ...] = ()
    steps: Steps | None = None

    @property
    def name(self) -> str:
        """Name of the channel."""
        return self.channel.name

    @property
    def drawable(self) -> bool:
        """Whether the values are draws of what was rounded, unchanged since."""
        return self.steps is not None and self.state.values is self.steps.drawn

    @property
    def local(self) -> bool:
        """Whether the model or a step is local in time, so that the odd samples are held out."""
        if any(c.span_s is not None for c in self.state.columns):
            return True
        given = (c.effect.name for c in self.state.columns if c.given)
        return bool(LOCAL & {*given, *(d.effect.name for d in self.drafts)})

    @cached_property
    def findings(self) -> Findings:
        """The battery as things stand, run once."""
        examined = examine(self.state, self.found, self.null, self.skip)
        both = (*examined.all, *self.unmet, *self.lasting)
        return Findings(tuple(sorted(both, key=lambda f: f.log_p)))

    def whole(self) -> float:
        """Score of the whole record."""
        return whole_score(self.found, self.null, self.skip, self._extras())

    def unseen(self, local: bool = False) -> float:
        """Score of the part that no fit has seen."""
        return held_out_score(self.state, self.found, self.null, self.skip, self._extras(), local)

    def _extras(self) -> tuple[float, ...]:
        return tuple(f.z for f in (*self.unmet, *self.lasting))

    def analysed(self, state: State) -> Work:
        """The same with another state."""
        found = analyse(state)
        return replace(self, state=replace(state, effects=found.fit.effects), found=found)

    def _drawn_once(
        self, effects: tuple[Effect, ...], number: int, loudness: Floats | None = None
    ) -> Work:
        state, steps = self.state, self.steps
        if steps is None or not self.drawable:
            return self
        if loudness is not None:
            steps = replace(steps, loudness=loudness)
        course = self._course()
        inverse = inverse_psd(effects, course.size, state.sample_time_s, state.floor)
        steps = draw(steps, course, inverse, state.sample_time_s, number)
        return replace(self, steps=steps).analysed(state.with_values(steps.drawn))

    def _course(self) -> Floats:
        total = np.zeros(self.state.values.size)
        for size, column in zip(self.found.sizes, self.state.columns, strict=True):
            total += size * column.shape
        return total

    @cached_property
    def information_left(self) -> tuple[float, float]:
        """Shares of what was said of the level and of the variance that coarse rounding left."""
        if self.steps is None:
            return 1.0, 1.0
        inverse, dt = self.found.inverse_psd, self.state.sample_time_s
        return information_left(self.steps, self._course(), inverse, dt)

    def drawn_under(self, effects: tuple[Effect, ...]) -> Work:
        """The same on draws of what was rounded under these effects and the courses found.

        Values that were changed since they were drawn stay.
        """
        work = self
        for number in range(DRAWS):
            work = work._drawn_once(effects, number)
        return work

    def drawn_anew(self) -> Work:
        """The same on draws under the fit itself, which moves towards what the steps say of it."""
        work = self
        for number in self._settling():
            work = work._drawn_once(work.found.fit.effects, number)
        return work

    def drawn_with(self, burst: VarianceChange) -> tuple[Work, VarianceChange]:
        """The same on draws without a burst, and that burst as loud as the steps say it is."""
        time_s = self.state.time_s
        inside = (time_s >= burst.from_s) & (time_s < burst.to_s)
        work, ratio = self, burst.ratio
        usual = np.ones(time_s.size) if self.steps is None else self.steps.loudness
        for number in self._settling():
            loudness = np.where(inside, np.sqrt(ratio), 1.0) * usual
            work = work._drawn_once(work.found.fit.effects, number, loudness)
            ratio *= variance_within(work.found.white.samples, inside)
        return work, replace(burst, ratio=ratio)

    def _settling(self) -> range:
        """Numbers of the draws that a fit needs to settle on what the steps say."""
        if not self.drawable:
            return range(0)
        level, variance = self.information_left
        passes = int(min(SETTLING / min(level**2, variance), MOST_DRAWS))
        return range(DRAWS, DRAWS + max(passes, DRAWS))


def variance_within(white: Floats, inside: Mask) -> float:
    """Variance of white samples inside, over that outside."""
    return float(np.mean(white[inside] ** 2) / np.mean(white[~inside] ** 2))


def drafted(
    before: Work, after: Work, action: str, effect: Effect, finding: Finding, rival: str = ""
) -> Work:
    """``after`` with the step that led to it, scored."""
    local = effect.name in LOCAL or before.local or after.local
    draft = Draft(
        action,
        effect,
        finding.log_p,
        finding.where,
        rival,
        (before.whole(), after.whole()),
        HeldOut(before.unseen(local), after.unseen(local)),
    )
    return replace(after, drafts=(*before.drafts, draft))


def initial_state(
    model: ChannelModel,
    values: Floats,
    sample_time_s: float,
    start_s: float,
    temperature: Floats | None,
    hold: float = 1.0,
) -> State:
    """State of a channel under the model as given.

    ``hold`` messages carry one of the ``values``: white noise keeps its deviation per sample, so
    that its density grows by sqrt(hold).
    """
    effects = held(spectral(tuple(f.effect for f in model.effects)), hold)
    prior = prior_of(model)
    if effects:
        prior = Prior(parameter_vector(effects), prior.axes, prior.std_error)
    rounding = next((f.effect for f in model.effects if isinstance(f.effect, OutputRounding)), None)
    floor = rounding.added_psd(sample_time_s) if rounding else 0.0
    drift = unseen_drift(model, effects, sample_time_s, floor, values.size * sample_time_s)
    if drift is not None:
        effects, prior = (*effects, drift[0]), replace(prior, drift=drift[1])
    state = State(values, sample_time_s, start_s, temperature, effects, prior, (), floor)
    return replace(state, columns=_given_columns(model, state))


def held(effects: tuple[Effect, ...], hold: float) -> tuple[Effect, ...]:
    """Effects of every ``hold``-th sample."""
    return tuple(
        e.replace(density=e.density * float(np.sqrt(hold))) if isinstance(e, WhiteNoise) else e
        for e in effects
    )


def _given_columns(model: ChannelModel, state: State) -> tuple[Column, ...]:
    columns: list[Column] = []
    for fitted in model.effects:
        effect = fitted.effect
        if effect.name in SIZE_NAMES and isinstance(effect, CourseEffect):
            if effect.name == "temperature" and state.temperature is None:
                continue
            size_name = SIZE_NAMES[effect.name]
            index = [p.name for p in effect.parameters].index(size_name)
            size = float(getattr(effect, size_name))
            error = fitted.estimates[index].std_error or TYPED_SIZE_ERROR * abs(size)
            if effect.name == "rate_ramp" and state.prior.drift is not None:
                error = max(error, abs(size))  # one recording's ramp may be the next one's walk
            columns.append(course_column(effect, state, size_name, error, given=True))
        elif isinstance(effect, Periodic):
            error_hz = fitted.estimates[0].std_error or TYPED_SIZE_ERROR * effect.frequency_hz
            columns += line_columns(_frequency_near(effect, error_hz, state), state)
    return tuple(columns)


def _frequency_near(line: Periodic, std_error_hz: float, state: State) -> float:
    """Frequency of a given line as the record has it.

    Within two spacings; where nothing stands out there, within twice its standard error.
    """
    n, dt = state.values.size, state.sample_time_s
    if not 2.0 / (n * dt) < line.frequency_hz < 0.5 / dt:
        return line.frequency_hz
    t = np.arange(n)
    base = (state.values - state.values.mean()) * np.exp(-2j * np.pi * line.frequency_hz * dt * t)
    size = max(n // 4096, 1)
    slow = base[: n // size * size].reshape(-1, size).mean(axis=1)
    offset_hz = np.fft.fftfreq(16 * slow.size, size * dt)
    power = np.abs(np.fft.fft(slow, offset_hz.size)) ** 2
    near = np.abs(offset_hz) <= 2.0 / (n * dt)
    wide = np.abs(offset_hz) <= max(2.0 * std_error_hz, 2.0 / (n * dt))
    chance = float(np.median(power)) / np.log(2.0)
    stands_out = power[near].max() > STANDS_OUT * chance or power[wide].max() < STANDS_OUT * chance
    window = near if stands_out else wide
    return line.frequency_hz + float(offset_hz[window][np.argmax(power[window])])
