"""Subplots of changes over an episode, and over learning."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numpy as np
from matplotlib.axes import Axes
from matplotlib.ticker import LogFormatter

from skillcli.trajectories import Array
from skillcli.viz import motion
from skillcli.viz.palette import BETWEEN, COLORS, DASHES, TARGET, look
from skillcli.viz.scene import Runs, Scene, label

FLOOR = 1e-4  # m; a logarithmic axis cannot show zero

_CURVES = {
    "final_distance": "final distance",
    "return": "return per episode",
    "inference_log_prob": "inference log-probability",
    "kl": "KL divergence of the update",
    "embedding_std": r"mean $\sigma$ of the embedding",
}


def unit(scene: Scene) -> tuple[float, str]:
    """Return the unit of distances: how many make a metre, and its name."""
    name, per_metre = scene.figure_settings.unit
    return per_metre, name


class _PlainNumbers(LogFormatter):
    """Write 0.5 and 20 where other formatters write powers of ten; between them what a short axis has room for."""

    def __call__(self, x: float, pos: int | None = None) -> str:
        """Label one tick."""
        return f"{x:g}" if super().__call__(x, pos) else ""


def _logarithmic(axes: Axes) -> None:
    """Make the axis logarithmic with plain numbers."""
    axes.set_yscale("log")
    axes.yaxis.set_major_formatter(_PlainNumbers())
    axes.yaxis.set_minor_formatter(_PlainNumbers(minor_thresholds=(1, 0.4)))


def _tolerance_line(axes: Axes, scene: Scene, named: bool = True) -> None:
    height = unit(scene)[0] * scene.tolerance
    axes.axhline(height, color=TARGET, lw=0.8, ls=(0, (4, 3)), zorder=1)
    if named:
        axes.annotate(
            "tolerance",
            (1, height),
            xycoords=("axes fraction", "data"),
            xytext=(-2, 2),
            textcoords="offset points",
            ha="right",
            va="bottom",
            fontsize=7,
            color=TARGET,
        )


def _time(scene: Scene, episode: int) -> Array:
    """Return the time of each state of an episode, (length+1,) s."""
    time: Array = scene.trajectories.time[: int(scene.trajectories.length[episode]) + 1]
    since: Array = time - time[0]
    return since


def distances(axes: Axes, scene: Scene) -> None:
    """Draw the distance to the goal over time: each skill at its mean, and the 10-90 % band over sampled latents."""
    at_means = motion.mean_episodes(scene)
    sampled: dict[int, list[int]] = {}
    others = set(range(scene.trajectories.episodes)) - set(at_means.values()) if scene.runs is Runs.SAMPLED else ()
    for episode in others:  # latents between skills have no goal of their own
        sampled.setdefault(motion.episode_skill(scene, episode), []).append(episode)
    shortest = int(scene.trajectories.length.min()) + 1
    scale, name = unit(scene)
    for skill, episodes in sampled.items():
        gaps = np.array([motion.distance(scene, episode)[:shortest] for episode in episodes])
        low, high = scale * np.maximum(np.quantile(gaps, [0.1, 0.9], axis=0), FLOOR)
        axes.fill_between(_time(scene, episodes[0])[:shortest], low, high, color=look(skill).color, alpha=0.15, lw=0)
    for skill, episode in at_means.items():
        style, gap = look(skill), scale * np.maximum(motion.distance(scene, episode), FLOOR)
        axes.plot(_time(scene, episode), gap, color=style.color, ls=style.dash, lw=1.2)
    _tolerance_line(axes, scene)
    _logarithmic(axes)
    axes.set(xlabel="time [s]", ylabel=f"distance to the goal [{name}]", title="accuracy")
    axes.grid(True)
    each = min((len(episodes) for episodes in sampled.values()), default=0)
    note = f"line: mean latent\nband: 10-90 % of {each} latents" if each else "at the mean latents"
    axes.annotate(note, (0.98, 0.98), xycoords="axes fraction", ha="right", va="top", fontsize=7, color=TARGET)


# --- one composition --------------------------------------------------------------------------------------------------


def _boundaries(axes: Axes, scene: Scene, episode: int) -> None:
    """Mark changes of the plan: thin lines, and bands in the skill's colour with its number on top."""
    time = _time(scene, episode)
    for piece in motion.pieces(scene, episode):
        start, stop = time[piece.start], time[piece.stop]
        axes.axvspan(start, stop, ymin=0.94, color=motion.piece_look(scene, episode, piece).color, lw=0, alpha=0.85)
        axes.axvline(start, color=BETWEEN, lw=0.5, zorder=0)
        if piece.skill >= 0:
            axes.annotate(
                str(piece.skill + 1),
                ((start + stop) / 2, 0.968),
                xycoords=("data", "axes fraction"),
                ha="center",
                va="center",
                fontsize=6.5,
                color="white",
                fontweight="bold",
            )


def latent_components(axes: Axes, scene: Scene, episode: int) -> None:
    """Draw each component of the latent over time."""
    time = _time(scene, episode)
    fed = scene.trajectories.latent[episode, : len(time) - 1]
    for i, values in enumerate(fed.T):
        # dashes and colours both differ, so that components can be distinguished without colour
        axes.stairs(values, time, baseline=None, color=COLORS[i % 8], ls=DASHES[i % 4], lw=1.4, label=f"$z_{{{i + 1}}}$")
    low, high = (float(fed.min()), float(fed.max())) if fed.size else (0.0, 1.0)
    room = max(high - low, 0.1)
    axes.set(ylim=(low - 0.08 * room, high + 0.3 * room), ylabel="latent component", xlim=(0, time[-1]))
    _boundaries(axes, scene, episode)
    axes.grid(True, axis="y")
    axes.legend(loc="upper left", bbox_to_anchor=(0, 0.945), ncols=4, fontsize=7, borderaxespad=0.3)
    axes.set_title("what the plan feeds (top band: skill)")


def waypoint_distance(axes: Axes, scene: Scene, episode: int) -> None:
    """Draw the distance to the next waypoint; its number points to where it was passed."""
    scale, name = unit(scene)
    time, gap = _time(scene, episode), scale * motion.distance(scene, episode)
    axes.plot(time, gap, color=TARGET, lw=1.3)
    axes.set(xlim=(0, time[-1]), ylim=(0, 1.3 * float(gap.max()) or 1.0), xlabel="time [s]")
    _boundaries(axes, scene, episode)
    _tolerance_line(axes, scene, named=False)
    axes.grid(True, axis="y")
    if not len(scene.waypoints):
        axes.set(ylabel=f"distance [{name}]", title="distance to the target (dashed: tolerance)")
        return
    axes.set(ylabel=f"distance [{name}]", title="distance to the due waypoint (dashed: tolerance)")
    share = motion.reached(scene, episode)
    count = len(motion.due_in(scene, episode))
    for order in range(count):
        hits = np.flatnonzero(share >= (order + 1) / count - 1e-9)
        if len(hits):
            axes.annotate(
                f"{order + 1}",
                (time[hits[0]], gap[hits[0]]),
                xytext=(-10, 22),
                textcoords="offset points",
                ha="center",
                fontsize=7,
                bbox={"facecolor": "white", "edgecolor": "none", "pad": 0.8},
                arrowprops={"arrowstyle": "->", "lw": 0.7, "color": TARGET},
            )


def against_plan(axes: Axes, scene: Scene) -> None:
    """Draw how far each executed episode is from its plan over time, in the style of its success."""
    scale, name = unit(scene)
    axes.set(xlabel="time [s]", ylabel=f"distance [{name}]", title="executed against planned, at the same time")
    axes.grid(True, axis="y")
    if scene.source is None:
        return
    for episode in range(scene.trajectories.episodes):
        color = TARGET if scene.trajectories.success[episode] else COLORS[1]
        axes.plot(_time(scene, episode), scale * motion.off_plan(scene, episode), color=color, lw=0.9, alpha=0.7)
    axes.set(xlim=(0, None), ylim=(0, None))


def closest(axes: Axes, scene: Scene) -> None:
    """Draw the smallest distance to each waypoint in its turn, all routes in a row."""
    scale, name = unit(scene)
    gaps = scale * np.concatenate([motion.closest(scene, episode) for episode in range(scene.trajectories.episodes)])
    order = np.arange(1, len(gaps) + 1)
    axes.vlines(order, 0, gaps, color=TARGET, lw=1.2)
    axes.plot(order, gaps, ls="none", marker="o", color=TARGET, ms=4.5)
    beside = {"xytext": (6, 0), "va": "center"} if len(gaps) <= 8 else {"xytext": (0, 5), "ha": "center", "rotation": 90}
    for place, gap in zip(order, gaps, strict=True):
        text, height = ("never due", 0.0) if np.isnan(gap) else (f"{gap:.2g}", float(gap))
        axes.annotate(text, (place, height), textcoords="offset points", fontsize=7, **beside)
    top = 1.25 * max(float(np.nanmax(gaps, initial=0)), scale * scene.tolerance)
    axes.set(
        xticks=order[:: 1 + len(order) // 9],
        xlim=(0.5, len(gaps) + 1),
        ylim=(0, top),
        xlabel="waypoint",
        ylabel=f"distance [{name}]",
    )
    _tolerance_line(axes, scene)
    axes.set_title("nearest pass while due")


# --- learning ---------------------------------------------------------------------------------------------------------


def curve_subplots(scene: Scene) -> list[Callable[[Axes, Scene], None]]:
    """Return the subplots that the recorded curves allow, the most informative first."""
    panels: list[Callable[[Axes, Scene], None]] = []
    if "success_rate" in scene.curves or _per_skill(scene):
        panels.append(success_curves)
    single: dict[str, Callable[[Axes, Scene], None]] = {
        name: partial(_curve, name=name) for name in _CURVES if name in scene.curves
    }
    if "return" in single and reward_terms(scene):
        single["return"] = reward_curves
    return [*panels, *single.values()]


def _per_skill(scene: Scene) -> dict[int, Array]:
    """Return success curves by skill, (iterations,) each."""
    found = {k: scene.curves.get(f"success/{name}") for k, name in enumerate(scene.skills)}
    return {k: curve for k, curve in found.items() if curve is not None}


def _experience(axes: Axes, scene: Scene, count: int) -> Array:
    """Return the x values of learning curves, (count,): control steps if they were counted, else iterations."""
    steps = scene.curves.get("env_steps")
    axes.grid(True)
    if steps is None or len(steps) != count:
        axes.set_xlabel("iteration")
        return np.arange(count)
    axes.set_xlabel("control steps [thousands]")
    thousands: Array = np.asarray(steps) / 1000
    return thousands


def success_curves(axes: Axes, scene: Scene) -> None:
    """Draw success over learning: each skill, and their mean in black."""
    for skill, values in _per_skill(scene).items():
        style = look(skill)
        axes.plot(_experience(axes, scene, len(values)), values, color=style.color, ls=style.dash, lw=0.9)
    if (mean := scene.curves.get("success_rate")) is not None:
        axes.plot(_experience(axes, scene, len(mean)), mean, color="black", lw=1.8)
    axes.set(ylim=(-0.02, 1.04), ylabel="success rate", title="learning: success (black: mean)")


def reward_terms(scene: Scene) -> dict[str, Array]:
    """Return what each term of the reward gave per episode, (iterations,) by its name; empty for files without them."""
    terms = {name.removeprefix("reward/"): values for name, values in scene.curves.items() if name.startswith("reward/")}
    return {label(name): np.asarray(values, dtype=float) for name, values in terms.items()}


def reward_curves(axes: Axes, scene: Scene) -> None:
    """Draw each term of the reward over learning, and the return, their sum, in black."""
    for index, (name, values) in enumerate(reward_terms(scene).items()):
        style = look(index)
        axes.plot(_experience(axes, scene, len(values)), values, color=style.color, ls=style.dash, lw=0.9, label=name)
    if (total := scene.curves.get("return")) is not None:
        axes.plot(_experience(axes, scene, len(total)), total, color="black", lw=1.6, label="return")
    axes.legend(loc="best", fontsize=6, ncols=2, borderaxespad=0.2, handlelength=1.6, handletextpad=0.4, columnspacing=0.8)
    axes.set(ylabel="per episode", title="learning: reward terms")


def _curve(axes: Axes, scene: Scene, name: str) -> None:
    """Draw one learning curve; distances in the unit of the other subplots, on a logarithmic axis."""
    values, named = np.asarray(scene.curves[name], dtype=float), _CURVES[name]
    axes.set_title(f"learning: {named.partition(' of')[0].partition(' per')[0]}")
    if name == "final_distance":
        scale, unit_name = unit(scene)
        values, named = scale * np.maximum(values, FLOOR), f"{named} [{unit_name}]"
        _logarithmic(axes)
    axes.plot(_experience(axes, scene, len(values)), values, color=TARGET, lw=1.4)
    axes.set_ylabel(named)
