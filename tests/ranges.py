"""Distributions of domain parameters, as tests write them."""

from __future__ import annotations

from skillcli.config.randomization import Distribution


def uniform(low: float, high: float) -> Distribution:
    """Equally likely between low and high."""
    return Distribution(kind="uniform", values=(low, high))


def log_uniform(low: float, high: float) -> Distribution:
    """Equally likely per octave between low and high, both positive."""
    return Distribution(kind="log_uniform", values=(low, high))


def one_of(*values: float) -> Distribution:
    """One of these values."""
    return Distribution(kind="one_of", values=values)
