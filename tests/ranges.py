"""Ranges of domain parameters, as tests write them."""

from __future__ import annotations

from skillcli.config.randomization import Range


def uniform(low: float, high: float) -> Range:
    """Equally likely between low and high."""
    return Range(kind="uniform", values=(low, high))


def log_uniform(low: float, high: float) -> Range:
    """Equally likely per octave between low and high, both positive."""
    return Range(kind="log_uniform", values=(low, high))


def one_of(*values: float) -> Range:
    """One of these values."""
    return Range(kind="one_of", values=values)
