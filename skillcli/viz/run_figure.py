"""The figure of a comparison of runs: intervals, performance profiles, sample efficiency, probability of improvement."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from skillcli.evaluation.run_comparison import Efficiency, MetricResult
from skillcli.files import replacing
from skillcli.viz.figure_style import WIDTH, blank, encoded, styled
from skillcli.viz.figures import format_of
from skillcli.viz.palette import look
from skillcli.viz.scene import label

MOST_PAIRS = 12  # rows of the last part


def write_figure(result: MetricResult, curves: Sequence[Efficiency], path: Path) -> None:
    """Draw the comparison and write it as PNG, PDF or SVG, by the suffix.

    Raises:
        UsageError: the suffix is none of the three.
        SkillError: the file cannot be written.
    """
    suffix = format_of(path)
    with replacing(path) as (temporary,), styled():
        temporary.write_bytes(encoded(draw_comparison(result, curves), suffix))


def draw_comparison(result: MetricResult, curves: Sequence[Efficiency]) -> Figure:
    """Draw one metric of all groups; every part says how many runs it stands on."""
    pairs = min(MOST_PAIRS, len(result.pairs))
    figure = blank(WIDTH, 2.2 + 0.18 * len(result.groups) + 1.6 + 0.16 * pairs)
    parts = figure.subplots(2, 2, gridspec_kw={"height_ratios": [3 + len(result.groups) * 0.3, 3 + pairs * 0.3]})
    _intervals(parts[0, 0], result)
    _profiles(parts[0, 1], result)
    _efficiency(parts[1, 0], curves)
    _improvement(parts[1, 1], result)
    return figure


def _intervals(axes: Axes, result: MetricResult) -> None:
    for row, group in enumerate(result.groups):
        color = look(row).color
        axes.plot([group.iqm.low, group.iqm.high], [row, row], color=color, lw=4, alpha=0.4, solid_capstyle="butt")
        axes.plot(group.iqm.value, row, marker=look(row).marker, color=color, ms=4)
    names = [f"{_short(group.label)}, n = {group.n}" for group in result.groups]
    axes.set_yticks(range(len(names)), names)
    axes.set_ylim(len(names) - 0.5, -0.5)
    axes.grid(axis="x")
    axes.set_xlabel(f"{label(result.name)}, interquartile mean, 95 %")


def _profiles(axes: Axes, result: MetricResult) -> None:
    for row, group in enumerate(result.groups):
        share, low, high = group.profile
        axes.step(result.thresholds, share, where="post", color=look(row).color, ls=look(row).dash, lw=1.2)
        axes.fill_between(result.thresholds, low, high, step="post", color=look(row).color, alpha=0.12, lw=0)
    axes.set_ylim(-0.02, 1.02)
    axes.grid()
    axes.set_xlabel(f"threshold of {label(result.name)}")
    axes.set_ylabel("share of runs above")


def _efficiency(axes: Axes, curves: Sequence[Efficiency]) -> None:
    if not curves:
        axes.set_axis_off()
        axes.text(0.5, 0.5, "no learning curves", ha="center", va="center")
        return
    for row, each in enumerate(curves):
        axes.plot(each.steps / 1e3, each.iqm, color=look(row).color, ls=look(row).dash, lw=1.2)
        axes.fill_between(each.steps / 1e3, each.low, each.high, color=look(row).color, alpha=0.12, lw=0)
        if each.n[-1] < each.n[0]:  # some runs were shorter
            shorter = int(np.argmax(each.n < each.n[0]))
            axes.plot(each.steps[shorter] / 1e3, each.iqm[shorter], marker="|", color=look(row).color, ms=9)
    axes.grid()
    axes.set_xlabel("thousand control steps (|: fewer runs from here)")
    axes.set_ylabel("success while training, IQM")


def _improvement(axes: Axes, result: MetricResult) -> None:
    pairs = result.pairs[:MOST_PAIRS]
    if not pairs:
        axes.set_axis_off()
        axes.text(0.5, 0.5, "one group: nothing to compare", ha="center", va="center")
        return
    for row, pair in enumerate(pairs):
        axes.plot(pair.ci95, [row, row], color="#2B2B2B", lw=4, alpha=0.3, solid_capstyle="butt")
        axes.plot(pair.probability, row, marker="o", color="#2B2B2B", ms=4)
    axes.set_yticks(
        range(len(pairs)),
        [f"{_short(pair.first, 16)} / {_short(pair.second, 16)}\n{pair.verdict}" for pair in pairs],
        fontsize=6,
    )
    axes.set_ylim(len(pairs) - 0.5, -0.5)
    axes.set_xlim(0, 1)
    axes.axvline(0.5, color="#7F7F7F", lw=0.7, ls=":")
    more = f" (first {MOST_PAIRS} of {len(result.pairs)})" if len(result.pairs) > MOST_PAIRS else ""
    axes.set_xlabel(f"P(first is better){more}")


def _short(text: str, most: int = 26) -> str:
    shown = label(text)
    return shown if len(shown) <= most else f"…{shown[1 - most :]}"
