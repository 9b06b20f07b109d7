"""One way to change a channel's model, with what it gains and what it costs."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from imu_noise_id.effects.base import Effect
from imu_noise_id.reconcile.result import ADD
from imu_noise_id.reconcile.state import Analysis, State, analyse

PRICE_PER_PARAMETER = 3.0


@dataclass(frozen=True)
class Candidate:
    """One way to change a channel's model.

    Attributes
    ----------
    action : str
        ``add``, ``refit`` or ``remove``.
    effect : Effect
        With fitted values.
    gain : float
        Nats, before its price.
    price : float
        Nats, for its parameters and for searching them.
    state, found : State, Analysis
        The channel with the change.
    """

    action: str
    effect: Effect
    gain: float
    price: float
    state: State
    found: Analysis

    @property
    def net(self) -> float:
        """Nats after the price."""
        return self.gain - self.price

    @property
    def label(self) -> str:
        """What it is called when it is weighed against others."""
        return self.effect.name if self.action == ADD else f"{self.action} of {self.effect.name}"


def candidate_of(
    action: str, effect: Effect, price: float, before: Analysis, state: State
) -> Candidate:
    """A change with the gain of its best fit, the effect as fitted where it is a spectral one."""
    found = analyse(state)
    fitted = effect
    if state.effects and effect in state.effects:
        fitted = found.fit.effects[state.effects.index(effect)]
    gain = found.objective - before.objective
    return Candidate(action, fitted, gain, price, replace(state, effects=found.fit.effects), found)


def count_of(state: State, name: str) -> int:
    """How many effects of a name there are."""
    columns = sum(c.effect.name == name for c in state.columns)
    return sum(e.name == name for e in state.effects) + columns


def given_count(state: State) -> int:
    """Number of spectral effects that the given model has; they come first."""
    ends = np.cumsum([len(e.free()) for e in state.effects])
    return int(np.searchsorted(ends, state.prior.centre.size, side="right"))


def rows_of(state: State, index: int) -> list[int]:
    """Rows of one spectral effect's parameters."""
    before = sum(len(e.free()) for e in state.effects[:index])
    return list(range(before, before + len(state.effects[index].free())))
