"""How much the end of a stored push depends on the time step, and how deep bodies sink into each other.

    python -m studies.contact [ID [STORE]]

The actions of every stored trajectory of a push library are sent again, open loop, at the recipe's time step, at half and
at a quarter of it. ID is a pretraining: its trajectories all begin at the recipe's own start.
"""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
from rich.console import Console
from rich.table import Table

from skillcli.recipe import resolve
from skillcli.simulation.arms import OBJECT
from skillcli.store import Store
from skillcli.tasks.push.settings import PushTask
from skillcli.tasks.world import World
from skillcli.trajectories import Array


def replay(world: World, action: Array, halvings: int) -> Array:
    """Where the box is after each control step, (T, E, 2) m, when actions (E, T, J) rad are sent again."""
    task = world.task
    assert isinstance(task, PushTask)
    env = replace(world, task=task.model_copy(update={"timestep": task.timestep / 2**halvings})).make_env(len(action))
    path = []
    for t in range(action.shape[1]):
        env.step(action[:, t] / task.action_scale)
        path.append(env.achieved_goal()[:, :2])
    return np.stack(path)


def penetration(model: mujoco.MjModel, joint_position: Array, object_pose: Array) -> float:
    """Deepest overlap of the box with anything in recorded states (n, J) and (n, 7), m."""
    data, deepest = mujoco.MjData(model), 0.0
    box = model.geom(OBJECT).id
    for q, pose in zip(joint_position, object_pose, strict=True):
        data.qpos[: len(q)], data.qpos[len(q) :] = q, pose
        mujoco.mj_fwdPosition(model, data)
        deepest = max([deepest, *(-contact.dist for contact in data.contact if box in contact.geom)])
    return deepest


def tilt(object_pose: Array) -> Array:
    """How far boxes in poses (..., 7) have turned away from upright, (...,) degrees."""
    degrees: Array = np.degrees(np.arccos(np.clip(1 - 2 * (object_pose[..., 4] ** 2 + object_pose[..., 5] ** 2), -1, 1)))
    return degrees


def main() -> None:
    """Measure and print."""
    store = Store(Path(sys.argv[2] if len(sys.argv) > 2 else "artifacts"))
    artifact = store.read(store.resolve(sys.argv[1] if len(sys.argv) > 1 else "reference-push/pretrain"))
    world = World.of(resolve(artifact.recipe))
    task = world.task
    assert isinstance(task, PushTask)
    if artifact.id.stage != "pretrain":
        sys.exit(f"{artifact.id} may begin anywhere; give the id of a pretraining")
    recorded = artifact.group("trajectories")
    ends = [replay(world, recorded["action"], halvings)[-1] for halvings in range(3)]
    table = Table("time step", "box ends elsewhere: median", "90 %", "largest", "below 5 mm")
    for halvings in range(2):
        moved = 1000 * np.linalg.norm(ends[halvings] - ends[halvings + 1], axis=1)
        steps = [1000 * task.timestep / 2**h for h in (halvings, halvings + 1)]
        numbers = [f"{x:.1f} mm" for x in (np.median(moved), np.quantile(moved, 0.9), moved.max())]
        table.add_row(f"{steps[0]:g} → {steps[1]:g} ms", *numbers, f"{(moved < 5).mean():.0%} of {len(moved)}")
    console = Console()
    console.print(table)
    model = world.model()
    assert model is not None
    poses = recorded["joint_position"].reshape(-1, world.joints), recorded["object_pose"].reshape(-1, 7)
    depth = penetration(model, *poses)
    tipped = tilt(recorded["object_pose"]).max(axis=1)
    console.print(f"deepest penetration of the box in the stored trajectories: {1000 * depth:.2f} mm")
    console.print(f"boxes tipped by more than 20 degrees: {(tipped > 20).mean():.0%}, at most {tipped.max():.0f} degrees")


if __name__ == "__main__":
    main()
