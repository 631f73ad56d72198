"""The latent space with its skills, and the markers that move through it and through space."""

from __future__ import annotations

import numpy as np
import rerun as rr

from skillcli.viz import motion
from skillcli.viz.palette import BETWEEN, TARGET_IN_VIEWER, rgba
from skillcli.viz.recording.clock import Clock
from skillcli.viz.recording.entities import called, episode_color, extent, in_space, key, latent_extent, skill_colors
from skillcli.viz.recording.notes import title
from skillcli.viz.recording.space import rest_after
from skillcli.viz.scene import Runs, Scene


def log_means(stream: rr.RecordingStream, scene: Scene) -> None:
    """Log the skills' latents: means with names, and one-sigma ellipsoids."""
    if not len(scene.means):
        return
    means, stds, colors = in_space(scene.means), in_space(scene.stds), skill_colors(scene)
    points = rr.Points3D(
        means,
        radii=latent_extent(scene) / 120,
        colors=[rgba(c) for c in colors],
    )
    stream.log("latent/means", points, static=True)
    names = rr.Points3D(means, radii=0, colors=rgba(TARGET_IN_VIEWER), labels=called(scene), show_labels=True)
    stream.log("latent/names", names, static=True)
    thin = latent_extent(scene) / 1000  # an ellipsoid needs some height in a missing dimension
    shells = rr.Ellipsoids3D(
        centers=means,
        half_sizes=np.maximum(stds, thin),
        colors=[rgba(c, 0.3) for c in colors],
        fill_mode=rr.components.FillMode.Solid,
    )
    stream.log("latent/one_sigma", shells, static=True)


def log_moving(stream: rr.RecordingStream, scene: Scene, clock: Clock) -> None:
    """Log a named marker at the achieved goal and one at the present latent."""
    data = scene.trajectories
    length = int(data.length[clock.episode])
    transferred = scene.runs is Runs.DOMAINS  # a label has the colour of its marker
    color = rgba(TARGET_IN_VIEWER if transferred else episode_color(scene, clock.episode))
    # elsewhere the goal has the same label, and two at one place are unreadable
    said = [title(scene, clock.episode)] if transferred else None
    fed = in_space(data.latent[clock.episode, :length])
    for entity, rows, radius, where, labels in (
        ("world/now", slice(0, length + 1), extent(scene) / 90, motion.path(scene, clock.episode), said),
        ("latent/now", slice(0, length), latent_extent(scene) / 60, fed, None),
    ):
        if not len(where):
            continue
        # colour and name hold until the next episode; only the position changes with every step
        first = rr.Points3D.columns(colors=[color], radii=[radius], labels=labels)
        stream.send_columns(entity, clock.columns(slice(rows.start, rows.start + 1)), first)
        stream.send_columns(entity, clock.columns(rows), rr.Points3D.columns(positions=where))
    _log_source(stream, scene, clock)
    if length and np.any(data.latent[clock.episode, :length] != data.latent[clock.episode, 0]):
        strip = rr.LineStrips3D([fed], colors=[rgba(BETWEEN)], radii=latent_extent(scene) / 300)
        stream.log(f"latent/paths/{key(scene, clock.episode)}", strip, static=True)


def _log_source(stream: rr.RecordingStream, scene: Scene, clock: Clock) -> None:
    """Log the source's achieved goal at the same time, in a transfer."""
    sent = motion.sent(scene)
    if sent is None:
        return
    index, length = int(scene.episode_source[clock.episode]), int(scene.trajectories.length[clock.episode])
    where = sent.trajectories.achieved_goal[index, rest_after(np.arange(length + 1), sent, index)]
    times = clock.columns(slice(0, length + 1))
    look = rr.Points3D.columns(colors=[rgba(TARGET_IN_VIEWER)], radii=[extent(scene) / 90], labels=["source"])
    stream.send_columns("source/now", clock.columns(slice(0, 1)), look)
    stream.send_columns("source/now", times, rr.Points3D.columns(positions=where))
