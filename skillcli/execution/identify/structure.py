"""Find what no slope leads to: unit and meaning of the commands, and how late they take effect. Every possibility is tried."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from skillcli.config.randomization import MAX_LATENCY
from skillcli.execution.identify.fit import Fit, fit, prediction_errors
from skillcli.execution.identify.knobs import Knobs
from skillcli.execution.identify.model import Meaning, Model
from skillcli.execution.identify.windows import Windows
from skillcli.execution.log import Log
from skillcli.simulation.replay import Replay
from skillcli.trajectories import Array

TRIED_STEPS = 300  # control steps on which possibilities are compared
CLIPPED = 1.001  # action limits: larger increments cannot have been sent as they are
COARSE = 3  # evaluations of each
# A latency that is no whole number of control steps must predict better by this much, twice the logarithm of the likelihood:
# most arms are late by whole steps, and a servo that is a little weaker looks like one that is a little later.
BETTER = 16.0
AS_GOOD = 3.84  # twice the logarithm of the likelihood within which 95 % of true values lie


@dataclass(frozen=True)
class Structure:
    """One possibility, with how badly it predicts.

    Attributes:
        model: the log in its unit, on simulated arms.
        unit: of increments, in words.
        meaning: of the commands.
        latency: s.
        misfit: smaller is better.
    """

    model: Model
    unit: str
    meaning: Meaning
    latency: float
    misfit: float


def readings(log: Log, replay: Replay) -> dict[str, Model]:
    """Return the log in every unit that its increments may have, by the unit in words.

    Increments beyond the action limit were clipped before they were sent. They are in rad, or they are actions as a policy
    gives them, in units of the action limit and clipped to ±1.
    """
    limit = replay.action_limit
    models = {"rad": Model(log, replay)}
    if log.increments and np.abs(log.sent).max() > CLIPPED * limit:
        models[f"action limits of {limit:g} rad"] = Model(replace(log, sent=limit * log.sent), replay)
    return models


def whole_steps(period: float) -> list[float]:
    """Return the latencies that are whole control steps, s."""
    return [k * period for k in range(int(MAX_LATENCY / period + 1e-9) + 1)]


def compare(models: Mapping[str, Model], windows: Windows, meanings: Sequence[Meaning], knobs: Knobs) -> list[Structure]:
    """Try every unit and meaning with every latency of whole control steps; the best first."""
    few = windows.thinned(TRIED_STEPS)
    tried = [
        Structure(model, unit, meaning, latency, fit(model, meaning, few, knobs, latency, evaluations=COARSE).misfit)
        for unit, model in models.items()
        for meaning in meanings
        for latency in whole_steps(model.log.period)
    ]
    return sorted(tried, key=lambda structure: structure.misfit)


@dataclass(frozen=True)
class Lateness:
    """A latency and how well it is known."""

    value: float  # s
    low: float  # s
    high: float  # s


def refine(model: Model, meaning: Meaning, windows: Windows, found: Fit) -> Lateness:
    """Compare latencies around that of a fit, to the physics step; the knobs follow to first order."""
    step, reach = model.physics_step, model.log.period
    count = round(reach / step)
    tried = found.latency + step * np.arange(-count + 1, count)
    tried = tried[(tried > -1e-9) & (tried <= MAX_LATENCY + 1e-9)]
    costs = _costs(model, meaning, windows, found, tried)
    usual = float(costs[np.abs(tried - found.latency).argmin()])
    best = int(costs.argmin())
    value = float(tried[best]) if costs[best] + BETTER < usual else found.latency
    reference = min(usual, float(costs[best])) if value == found.latency else float(costs[best])
    likely = np.append(tried[costs <= reference + AS_GOOD], value)
    return Lateness(round(value, 6), round(float(likely.min()), 6), round(float(likely.max()), 6))


def _costs(model: Model, meaning: Meaning, windows: Windows, found: Fit, latencies: Array) -> Array:
    """Return the least cost at each latency, (L,), where the errors move with the knobs as around the fit."""
    at_best = [{**found.parameters, "latency": np.array(latency)} for latency in latencies]
    errors = prediction_errors(model, meaning, windows, at_best)
    weighed = (errors / found.weight)[:, windows.counted].reshape(len(latencies), -1)
    full = np.concatenate([weighed, np.tile(found.x, (len(latencies), 1))], axis=1)  # (L, R)
    moves = -full @ found.jacobian @ found.covariance
    left = full + moves @ found.jacobian.T
    costs: Array = np.square(left).sum(axis=1)
    return costs
