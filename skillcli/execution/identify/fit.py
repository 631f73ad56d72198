"""Fit parameters to windows of a log by least squares on what is predicted, weighed against what was believed before."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares

from skillcli.execution.identify.knobs import Knobs
from skillcli.execution.identify.model import Meaning, Model, Parameters
from skillcli.execution.identify.windows import Windows
from skillcli.trajectories import Array

FIRST_NOISE = 0.005  # rad, before anything is known of it
LEAST_NOISE = 2e-4  # rad: no model and no encoder is better
DIFFERENCE = 0.05  # standard deviations of the prior, over which derivatives are taken
FARTHEST = 5.0  # standard deviations of the prior, at most


@dataclass(frozen=True)
class Fit:
    """What a fit found.

    Attributes:
        knobs: what was turned.
        x: (K,) where to, in standard deviations of the prior.
        covariance: (K, K) of `x`.
        latency: s.
        weight: (J,) rad, the noise that residuals were divided by.
        noise: (J,) rad, what they turned out to count for: their size, larger if neighbours in time are alike.
        residual: (W, L, J) rad, predicted less measured; NaN where nothing counts.
        jacobian: (R, K) of the weighed residuals that count and of the prior.
        cost: sum of their squares.
    """

    knobs: Knobs
    x: Array
    covariance: Array
    latency: float
    weight: Array
    noise: Array
    residual: Array
    jacobian: Array
    cost: float

    @property
    def misfit(self) -> float:
        """Return a measure of the whole error, smaller is better: each joint has a noise of its own."""
        variance = np.nanmean(np.square(self.residual), axis=(0, 1)) + LEAST_NOISE**2
        return float(np.sum(np.isfinite(self.residual).all(axis=2)) * np.log(variance).sum())

    @property
    def log_evidence(self) -> float:
        """Return how likely the log is whatever the numbers are, logarithm up to a constant, by Laplace's approximation.

        It compares fits that turn different knobs with the same noise: a knob that explains little counts against a fit.
        """
        return float(np.linalg.slogdet(self.covariance)[1] - self.cost) / 2

    @property
    def parameters(self) -> dict[str, Array]:
        """Return all parameters by name."""
        return {**self.knobs.parameters(self.x), "latency": np.array(self.latency)}


def prediction_errors(model: Model, meaning: Meaning, windows: Windows, parameters: Sequence[Parameters]) -> Array:
    """Return what is predicted less what was measured, on each of P parameters, (P, W, L, J) rad; NaN where nothing counts.

    Increments that add up leave the command of a whole window off by a constant, the noise of the angle that they began at; so
    does an arm that rests beside its command. There only what is left of it counts.
    """
    errors = model.predict(windows, meaning, parameters) - model.measured(windows)
    errors[:, ~windows.counted] = np.nan
    if meaning is Meaning.ADDED:
        errors -= np.nanmean(errors, axis=2, keepdims=True)
    return errors


class Residuals:
    """The errors of a model on windows, as `least_squares` wants them.

    Args:
        model: predicts.
        meaning: of the commands.
        windows: to predict.
        knobs: to turn.
        latency: s.
        noise: (J,) rad, one weight for each joint.
    """

    def __init__(self, model: Model, meaning: Meaning, windows: Windows, knobs: Knobs, latency: float, noise: Array) -> None:
        self._model, self._meaning, self._windows, self._knobs = model, meaning, windows, knobs
        self._latency, self._noise = latency, noise

    def errors(self, points: Array) -> Array:
        """Return the errors at each of P points (P, K), (P, W, L, J) rad; NaN where nothing counts."""
        parameters = [{**self._knobs.parameters(x), "latency": np.array(self._latency)} for x in points]
        return prediction_errors(self._model, self._meaning, self._windows, parameters)

    def weighed(self, errors: Array) -> Array:
        """Return the errors that count in units of their noise, (P, R), from errors (P, W, L, J)."""
        counted: Array = (errors / self._noise)[:, self._windows.counted]
        return counted.reshape(len(errors), -1)

    def __call__(self, x: Array) -> Array:
        """Return the weighed errors, and how far each number is from what was believed."""
        return np.concatenate([self.weighed(self.errors(x[None]))[0], x])

    def jacobian(self, x: Array) -> Array:
        """Return the derivatives, (R, K): all points beside `x` are simulated side by side."""
        steps = np.where(x > 0, -DIFFERENCE, DIFFERENCE)  # towards what was believed, so never out of bounds
        points = np.concatenate([x[None], x + np.diag(steps)])
        weighed = self.weighed(self.errors(points))
        slopes = (weighed[1:] - weighed[0]) / steps[:, None]
        return np.concatenate([slopes.T, np.eye(len(x))])


def fit(
    model: Model,
    meaning: Meaning,
    windows: Windows,
    knobs: Knobs,
    latency: float,
    start: Array | None = None,
    noise: Array | None = None,
    evaluations: int = 8,
) -> Fit:
    """Turn the knobs so that the windows are predicted best.

    Args:
        model: predicts.
        meaning: of the commands.
        windows: to predict.
        knobs: to turn.
        latency: s, held.
        start: (K,) where to begin; the prior by default.
        noise: (J,) rad.
        evaluations: of the model, at most.
    """
    noise = np.full(model.log.joints, FIRST_NOISE) if noise is None else noise
    residuals = Residuals(model, meaning, windows, knobs, latency, noise)
    start = np.zeros(knobs.count) if start is None else start
    if evaluations > 0:
        found = least_squares(
            residuals, start, residuals.jacobian, bounds=(-FARTHEST, FARTHEST), max_nfev=evaluations, xtol=1e-3, ftol=1e-4
        )
        x, jacobian = found.x, found.jac
    else:
        x, jacobian = start, residuals.jacobian(start)
    errors = residuals.errors(x[None])
    weighed = residuals.weighed(errors)
    return Fit(
        knobs=knobs,
        x=x,
        covariance=np.linalg.inv(jacobian.T @ jacobian),
        latency=latency,
        weight=noise,
        noise=effective_noise(errors[0]),
        residual=errors[0],
        jacobian=jacobian,
        cost=float(np.square(weighed).sum() + x @ x),
    )


def effective_noise(residual: Array) -> Array:
    """Return the noise that independent errors of as little weight would have, (J,) rad, from residuals (W, L, J).

    Neighbours that err alike say less than independent ones: a first-order process counts as n (1 - r) / (1 + r) of n values.
    """
    variance = np.nanmean(np.square(residual), axis=(0, 1))
    alike = np.nanmean(residual[:, 1:] * residual[:, :-1], axis=(0, 1)) if residual.shape[1] > 1 else 0.0 * variance
    r = np.clip(alike / np.maximum(variance, 1e-300), 0.0, 0.95)
    noise: Array = np.sqrt(variance * (1 + r) / (1 - r))
    return np.maximum(noise, LEAST_NOISE)
