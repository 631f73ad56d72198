"""Logs as tests want them: a few joints that are told apart by their numbers, and a simulated Sawyer that moves."""

from __future__ import annotations

from typing import Any

import numpy as np

from skillcli.execution.log import Log
from skillcli.robots.robot import load_robot
from skillcli.simulation.replay import REMEMBERED, Replay, Start
from skillcli.trajectories import Array

SAWYER = load_robot("sawyer")
NAMES = SAWYER.description.joints
PERIOD, LIMIT = 0.05, 0.04


def small_log(lengths: tuple[int, ...] = (4, 3), **changes: Any) -> Log:
    """Two joints; row t of the log is at angles t and 10 t, and is told to go 0.01 further."""
    rows = np.arange(sum(lengths))
    position = np.stack([rows, 10.0 * rows], axis=1) / 100
    stamps = PERIOD * np.concatenate([np.arange(length) for length in lengths])
    starts = tuple(int(first) for first in np.cumsum([0, *lengths[:-1]]))
    return Log(**{
        "names": ("a", "b"), "stamps": stamps, "position": position, "sent": position + 0.01, "increments": False,
        "starts": starts, **changes,
    })  # fmt: skip


def wandering(steps: int, seed: int = 0, still: tuple[int, ...] = ()) -> Array:
    """Increments (T, J) rad of a motion that changes its mind every fifth step; some joints stay still."""
    rng = np.random.default_rng(seed)
    increments = np.repeat(rng.uniform(-LIMIT, LIMIT, (-(-steps // 5), len(NAMES))), 5, axis=0)[:steps]
    increments[:, list(still)] = 0.0
    return increments


def recorded(
    parameters: dict[str, Any], increments: Array, noise: float = 0.0, episodes: int = 1, as_targets: bool = True
) -> Log:
    """What a simulated Sawyer with these parameters does when it is sent increments (E, T, J), or the same in each episode."""
    if increments.ndim == 2:
        increments = np.stack([np.roll(increments, episode, axis=1) for episode in range(episodes)])
    given = {name: np.asarray(value, dtype=float) for name, value in parameters.items()}
    count, steps, joints = increments.shape
    home = np.repeat(np.array(SAWYER.home)[None], count, axis=0)
    start = Start(home, np.zeros_like(home), np.repeat(home[:, None], REMEMBERED, axis=1)[None], increments)
    angles = Replay(SAWYER, PERIOD, LIMIT, threads=1).run(start, [given], increments=True)[0]
    position = np.concatenate([home[:, None], angles], axis=1)
    targets = home[:, None] + np.cumsum(increments, axis=1)
    sent = (
        np.concatenate([targets, targets[:, -1:]], axis=1)
        if as_targets
        else np.concatenate([increments, 0 * home[:, None]], axis=1)
    )
    measured = position + noise * np.random.default_rng(1).standard_normal(position.shape)
    rows = steps + 1
    return Log(
        names=NAMES,
        stamps=np.tile(PERIOD * np.arange(rows), count),
        position=measured.reshape(-1, joints),
        sent=sent.reshape(-1, joints),
        increments=not as_targets,
        starts=tuple(range(0, count * rows, rows)),
    )
