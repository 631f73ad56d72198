"""Figures of the transfer to other robots."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from skillcli.viz import motion, subplots_transfer
from skillcli.viz.figure_style import WIDTH, blank
from skillcli.viz.scene import Scene

COLUMNS = 3
MAX_TRANSFERS = 6


def success(scenes: Sequence[Scene], titles: Sequence[str]) -> Figure:
    """Draw success per domain with Wilson's 95 % interval; scenes of transfer-eval artifacts, at most `MAX_TRANSFERS`."""
    return _side_by_side(scenes, titles, subplots_transfer.success)


def distances(scenes: Sequence[Scene], titles: Sequence[str]) -> Figure:
    """Draw every final distance per domain with quartiles; scenes of transfer-eval artifacts, at most `MAX_TRANSFERS`."""
    return _side_by_side(scenes, titles, subplots_transfer.final_distances)


def _side_by_side(scenes: Sequence[Scene], titles: Sequence[str], panel: Callable[[Axes, Scene], None]) -> Figure:
    columns = min(len(scenes), COLUMNS)
    rows = -(-len(scenes) // columns)
    most = max(len(motion.domains(scene)) for scene in scenes)
    figure = blank(WIDTH, rows * (0.8 + 0.52 * most))
    for place, (scene, title) in enumerate(zip(scenes, titles, strict=True)):
        axes = figure.add_subplot(rows, columns, place + 1)
        panel(axes, scene)
        axes.set_title(title)
        axes.set_xlabel(axes.get_xlabel().replace(" to the target", ""))
    return figure
