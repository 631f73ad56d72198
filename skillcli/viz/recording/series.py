"""Time series over control steps, and learning curves over iterations."""

from __future__ import annotations

import numpy as np
import rerun as rr

from skillcli.trajectories import SAFETY_LIMITS, Array
from skillcli.viz import motion
from skillcli.viz.palette import BETWEEN, look, rgba
from skillcli.viz.recording.clock import Clock
from skillcli.viz.recording.entities import curve_path, episode_color, key
from skillcli.viz.recording.notes import label
from skillcli.viz.scene import Runs, Scene


def log_series(stream: rr.RecordingStream, scene: Scene, clock: Clock) -> None:
    """Log the series of one played episode."""
    for name, (rows, values) in _single(scene, clock.episode).items():
        entity = f"series/{name}/{key(scene, clock.episode)}"
        said = label(scene, clock.episode) if scene.runs is Runs.DOMAINS else scene.episode_labels[clock.episode]
        names, colors = [said], [rgba(episode_color(scene, clock.episode))]
        stream.log(entity, rr.SeriesLines(colors=colors, names=names), static=True)
        stream.send_columns(entity, clock.columns(rows), rr.Scalars.columns(scalars=values))
    _log_source(stream, scene, clock)
    for name, (rows, values, names) in _several(scene, clock.episode).items():
        colors = [rgba(look(i).color) for i in range(len(names))]
        stream.log(f"series/{name}", rr.SeriesLines(colors=colors, names=names), static=True)
        columns = rr.Scalars.columns(scalars=values)
        stream.send_columns(f"series/{name}", clock.columns(rows), columns)


def _log_source(stream: rr.RecordingStream, scene: Scene, clock: Clock) -> None:
    """Log the source's distance at the same time, in a transfer."""
    sent = motion.sent(scene)
    if sent is None:
        return
    values = motion.distance(sent, int(scene.episode_source[clock.episode]))
    rows = slice(0, min(len(values), int(scene.trajectories.length[clock.episode]) + 1))
    entity = f"series/distance/{key(scene, clock.episode)}-source"
    stream.log(entity, rr.SeriesLines(colors=rgba(BETWEEN), names="source"), static=True)
    columns = rr.Scalars.columns(scalars=values[rows])
    stream.send_columns(entity, clock.columns(rows), columns)


def _single(scene: Scene, episode: int) -> dict[str, tuple[slice, Array]]:
    """Return scalar series: the rows of the clock, and the values, (rows,)."""
    data, length = scene.trajectories, int(scene.trajectories.length[episode])
    states, fed, after = slice(0, length + 1), slice(0, length), slice(1, length + 1)
    return {
        "distance": (states, motion.distance(scene, episode)),
        "success": (states, motion.reached(scene, episode)),
        "reward": (after, data.reward[episode, fed]),
        "action_norm": (fed, np.linalg.norm(data.action[episode, fed], axis=-1)),
    }


def _several(scene: Scene, episode: int) -> dict[str, tuple[slice, Array, list[str]]]:
    """Several values per row: the rows of the clock, the values, (rows, n), and their names."""
    data, length = scene.trajectories, int(scene.trajectories.length[episode])
    fed = data.latent[episode, :length]
    found = {"latent": (slice(0, length), fed, [f"z{i + 1}" for i in range(fed.shape[1])])}
    if data.joint_position is not None and length:
        moved = np.diff(data.joint_position[episode, : length + 1], axis=0)
        speed = moved / np.diff(data.time[: length + 1])[:, None]
        found["joint_speed"] = (slice(1, length + 1), speed, [f"j{i}" for i in range(speed.shape[1])])  # as in the model
    if data.violated is not None:
        beyond = data.violated[episode, :length]
        found["violations"] = (slice(1, length + 1), beyond.astype(float), list(SAFETY_LIMITS[: beyond.shape[1]]))
    return found


def log_curves(stream: rr.RecordingStream, scene: Scene) -> None:
    """Log learning curves over `iteration`; their values are unchanged."""
    terms = [name for name in scene.curves if name.startswith("reward/")]
    for place, name in enumerate(terms):
        line = rr.SeriesLines(colors=rgba(look(place).color), names=name.removeprefix("reward/"))
        stream.log(f"learning/{curve_path(name)}", line, static=True)
    for name, values in scene.curves.items():
        index = [rr.TimeColumn("iteration", sequence=np.arange(len(values)))]
        scalars = rr.Scalars.columns(scalars=np.asarray(values, dtype=float))
        stream.send_columns(f"learning/{curve_path(name)}", index, scalars)
