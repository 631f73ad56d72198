"""The white noise of measured joint angles, from what a fit leaves unexplained."""

from __future__ import annotations

import numpy as np

from skillcli.execution.identify.knobs import CERTAIN
from skillcli.trajectories import Array


def white_noise(residual: Array) -> tuple[float, float, float]:
    """Return the standard deviation of white noise and its 95 % interval, rad, from residuals in time (W, L, J); NaN is none.

    White noise is what neighbours do not share: their covariance, which errors of the model cause, is subtracted.
    """
    apart = residual - np.nanmean(residual, axis=(0, 1))
    products = np.square(apart[:, 1:]) - apart[:, 1:] * apart[:, :-1]
    each = products[np.isfinite(products)]
    if not len(each):
        return 0.0, 0.0, 0.0
    mean, error = float(each.mean()), float(each.std() / np.sqrt(len(each)))
    value, low, high = (float(np.sqrt(max(0.0, part))) for part in (mean, mean - CERTAIN * error, mean + CERTAIN * error))
    return value, low, high
