"""Synthetic scenes of every kind: smooth motion to goals that a small arm can reach, solved from the model itself."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from typing import Any

import mujoco
import numpy as np

from skillcli.metrics import wilson_interval
from skillcli.tasks.registry import find_task
from skillcli.trajectories import Array, Trajectories
from skillcli.viz.scene import Runs, Scene

ARM_JOINTS = ("right_j0", "right_j1", "right_j2")
RUNS = {"pretrain": Runs.SAMPLED, "embed-means": Runs.BETWEEN, "compose": Runs.PLANNED, "transfer-eval": Runs.DOMAINS}
TASKS = ("point", "reach", "push")

ARM = """
<mujoco>
  <worldbody>
    <body name="table" pos="0.55 0 -0.03">
      <geom type="box" size="0.35 0.5 0.02" rgba="0.7 0.6 0.5 1"/>
    </body>
    <body name="base" pos="0 0 0.3" quat="0.9238795 0 0 0.3826834">
      <geom type="cylinder" size="0.08 0.3" pos="0 0 -0.15" rgba="0.2 0.2 0.2 1"/>
      <body name="upper">
        <joint name="right_j0" axis="0 0 1"/>
        <joint name="right_j1" axis="0 1 0"/>
        <geom type="capsule" fromto="0 0 0 0.45 0 0" size="0.05" rgba="0.6 0.1 0.1 1"/>
        <geom type="sphere" size="0.07" rgba="0.2 0.2 0.2 1"/>
        <body name="lower" pos="0.45 0 0">
          <joint name="right_j2" axis="0 1 0"/>
          <geom type="capsule" fromto="0 0 0 0.35 0 0" size="0.04" rgba="0.6 0.1 0.1 1" group="3"/>
          <site name="gripper" pos="0.45 0 0"/>
        </body>
      </body>
    </body>
    BOX
  </worldbody>
</mujoco>
"""
BOX = """
    <body name="box" pos="0.6 0 0.02">
      <freejoint name="box"/>
      <geom type="box" size="0.03 0.03 0.03" rgba="0.1 0.4 0.7 1"/>
    </body>
"""

TETRAHEDRON = """
<mujoco>
  <asset><mesh name="tip" vertex="0.1 0 0  0.4 0 0  0.1 0.2 0  0.1 0 0.1" face="0 2 1  0 1 3  0 3 2  1 2 3"/></asset>
  <worldbody>
    <body name="hand" pos="0 0 0.3">
      <joint name="right_j0" axis="0 0 1"/>
      <geom type="mesh" mesh="tip" pos="0.2 0 0" quat="1 0 0 1" rgba="0.2 0.4 0.6 1" group="1" contype="0" conaffinity="0"/>
      <geom type="mesh" mesh="tip" pos="0.2 0 0" quat="1 0 0 1" rgba="1 0 0 1"/>
    </body>
  </worldbody>
</mujoco>
"""

REACH_GOALS = np.array([(x, y, z) for x in (0.5, 0.7) for z in (0.15, 0.3) for y in (0.3, -0.3)])
PUSH_GOALS = np.array([(0.75, 0, 0.0), (0.45, 0, 0.0), (0.6, 0.15, 0.0), (0.6, -0.15, 0.0)])
POINT_GOALS = np.array([(0.0, 3.0, 0.0), (3.0, 0.0, 0.0), (0.0, -3.0, 0.0), (-3.0, 0.0, 0.0)])
TRIANGLE = np.array([(0.6, 0.3, 0.15), (0.6, -0.3, 0.15), (0.6, 0.0, 0.3), (0.6, 0.3, 0.15)])
POINT_SQUARE = np.array([(2.0, 2.0, 0.0), (-2.0, 2.0, 0.0)])

START = {"reach": np.array([0.49, 0.195, 0.263]), "push": np.array([0.6, 0.0, 0.02]), "point": np.zeros(3)}
GOALS = {"reach": REACH_GOALS, "push": PUSH_GOALS, "point": POINT_GOALS}
TOLERANCE = {"reach": 0.05, "push": 0.03, "point": 0.5}
DOMAINS = ("nominal", "mild", "real-like")


def arm_model(with_box: bool = False) -> mujoco.MjModel:
    """A two-link arm with the joint names of the real one, a table and, if wanted, a box."""
    return mujoco.MjModel.from_xml_string(ARM.replace("BOX", BOX if with_box else ""))


def solve(model: mujoco.MjModel, where: Array, joints: int) -> Array:
    """Joint angles (n, joints) that bring the site `gripper` to (n, 3): damped least squares, row after row."""
    data = mujoco.MjData(model)
    address = [int(model.joint(f"right_j{i}").qposadr[0]) for i in range(joints)]
    column = [int(model.joint(f"right_j{i}").dofadr[0]) for i in range(joints)]
    site, jacobian, rows = model.site("gripper").id, np.zeros((3, model.nv)), []
    data.qpos[address] = ([0.0, -0.6, 1.2] if joints == 3 else [0.0, -1.0, 0.0, 1.6, 0.0, 0.9, 0.0])[:joints]
    for point in where:
        for _ in range(100 if not rows else 8):
            mujoco.mj_kinematics(model, data)
            mujoco.mj_comPos(model, data)
            mujoco.mj_jacSite(model, data, jacobian, None, site)
            used = jacobian[:, column]
            gap = np.clip(point - data.site_xpos[site], -0.05, 0.05)
            data.qpos[address] += used.T @ np.linalg.solve(used @ used.T + 1e-4 * np.eye(3), gap)
        rows.append(data.qpos[address].copy())
    return np.array(rows)


def leg(start: Array, goal: Array, steps: int, rng: np.random.Generator, spread: float) -> Array:
    """A bent way from start towards a goal that ends near it, (steps, 3)."""
    progress = 1 - np.exp(-4.5 * np.arange(1, steps + 1) / steps)[:, None]
    bend = np.cross(goal - start, [0.0, 0.0, 1.0]) * rng.uniform(-0.25, 0.25)
    miss = rng.normal(size=3) * spread * np.array([1.0, 1.0, 0.0 if goal[2] == start[2] else 1.0])
    return start + progress * (goal + miss - start) + np.sin(np.pi * progress) * bend


def _means(task: str) -> tuple[Array, Array]:
    goals = GOALS[task] - GOALS[task].mean(axis=0)
    means = goals / np.abs(goals).max(axis=0).clip(1e-9)
    means = means if task == "reach" else means[:, :2] * 1.1
    return means, np.full_like(means, 0.18) * np.linspace(0.7, 1.3, len(means))[:, None]


def _plan(kind: str, task: str, sampled: int) -> tuple[list[list[tuple[Array, Array, int]]], list[str], Array]:
    """Per episode its legs (goal, latent, skill); the labels; the waypoints."""
    rng = np.random.default_rng(1)
    goals, (means, stds) = GOALS[task], _means(task)
    skills = range(len(goals))
    if kind in ("pretrain", "embed-means"):
        runs = [[(goals[k], means[k], k)] for k in skills]
        labels = [f"skill {k + 1}" for k in skills]
        for k in skills if kind == "pretrain" else ():
            for i in range(sampled):
                runs.append([(goals[k], rng.normal(means[k], stds[k]), -1)])
                labels.append(f"skill {k + 1}, latent {i + 1}")
        return runs, labels, np.zeros((0, 3))
    waypoints = {"reach": TRIANGLE, "point": POINT_SQUARE, "push": np.array([(0.4, 0.1, 0.0)])}[task]
    legs = []
    for point in waypoints:
        near = np.argsort(np.linalg.norm(goals - point, axis=-1))[:2]
        legs.append((goals[near[0]] * 0.3 + point * 0.7, means[near[0]], int(near[0])))
        legs.append((point, means[near].mean(axis=0), -1))
    if kind == "compose":
        return [legs], ["triangle"], waypoints
    return [legs] * (6 * len(DOMAINS)), [f"{name} {i}" for name in DOMAINS for i in range(6)], waypoints


def joints_of(model: mujoco.MjModel) -> tuple[str, ...]:
    """Names of the joints of an arm in a model."""
    names = (str(model.joint(i).name) for i in range(model.njnt))
    return tuple(name for name in names if name.startswith("right_j"))


@cache
def make(kind: str, task: str, *, sampled: int = 2, model: Any = None, skills: tuple[str, ...] = ()) -> Scene:
    """A scene of this kind; legs take 20 control steps of 0.05 s, single legs 60."""
    rng = np.random.default_rng(0)
    runs, labels, waypoints = _plan(kind, task, sampled)
    steps = 60 if len(runs[0]) == 1 else 20
    wild = {"nominal": 0.3, "mild": 0.6, "real-like": 1.2}
    paths, latents, fed = [], [], []
    for label, legs in zip(labels, runs, strict=True):
        spread = TOLERANCE[task] * wild.get(label.rpartition(" ")[0], 0.3 if len(legs) == 1 else 0.2)
        path = [START[task][None]]
        for goal, _, _ in legs:
            path.append(leg(path[-1][-1], goal, steps, rng, spread / 2))
        paths.append(np.concatenate(path))
        latents.append(np.concatenate([np.tile(z, (steps, 1)) for _, z, _ in legs]))
        fed.append(np.repeat([k for _, _, k in legs], steps))
    trajectories = _trajectories(task, np.array(paths), np.array(latents), np.array(fed), runs, waypoints, model)
    means, stds = _means(task)
    skills = skills or tuple(f"skill {k + 1}" for k in range(len(means)))
    count = 80
    learned = 1 - np.exp(-np.arange(count) / 15)
    curves = {
        "env_steps": np.arange(count) * 8192.0,
        "success_rate": learned,
        "final_distance": 0.5 * np.exp(-np.arange(count) / 12) + 0.004,
        "return": -30 + 25 * learned,
        "kl": 0.01 + 0.005 * rng.random(count),
        "embedding_std": np.linspace(1, 0.2, count),
        **{f"success/{name}": learned ** (1 + k / 2) for k, name in enumerate(skills)},
    }
    transfer = kind == "transfer-eval"
    half = np.arange(len(labels)) % 2  # every second robot of the last domain answers late
    return Scene(
        title=f"{task}/{kind}-v1",
        kind=kind,
        runs=RUNS[kind],
        task=task,
        figure_settings=find_task(task).figure_settings,
        provenance=f"# {task}/{kind}-v1\n\n| field | value |\n|---|---|\n| seed | 0 |\n| recipe | {task} |\n",
        trajectories=trajectories,
        model=None if task == "point" else (model or arm_model(task == "push")),
        joints=ARM_JOINTS if model is None else joints_of(model),
        skills=skills,
        goals=GOALS[task],
        waypoints=waypoints,
        waypoint_route=np.zeros(len(waypoints), dtype=int),
        episode_route=np.zeros(len(labels), dtype=int),
        tolerance=TOLERANCE[task],
        means=means,
        stds=stds,
        curves=curves if kind == "pretrain" else {},
        episode_labels=tuple(labels),
        intervals=_intervals(trajectories.success, labels) if transfer else {},
        source=trajectories.select([0]) if transfer else None,
        episode_source=np.zeros(len(labels) if transfer else 0, dtype=int),
        parameters={
            "latency": np.where([label.startswith("real") for label in labels], 0.05 * half, np.nan),
            "gain": np.where([[label.startswith("real")] for label in labels], np.full((len(labels), 7), 1.25), np.nan),
        }
        if transfer
        else {},
    )


def rewarded(scene: Scene) -> Scene:
    """The same, with the curves of two terms of the reward."""
    total = scene.curves["return"]
    return replace(scene, curves={**scene.curves, "reward/goal": 0.9 * total, "reward/pressed $x$": 0.1 * total})


def breaking(scene: Scene, step: int) -> Scene:
    """The same, with the second limit broken from a control step of the first episode on."""
    data = scene.trajectories
    violated = np.zeros((*data.skill.shape, 3), dtype=bool)
    violated[0, step:, 1] = True
    return replace(scene, trajectories=replace(data, violated=violated, violations=violated.sum(axis=1, dtype=np.int32)))


def _intervals(success: Array, labels: list[str]) -> dict[str, tuple[float, float, float]]:
    found = {}
    for name in DOMAINS:
        of = success[[label.startswith(name) for label in labels]]
        found[name] = (float(of.mean()), *wilson_interval(int(of.sum()), len(of)))
    return found


def _trajectories(
    task: str, paths: Array, latents: Array, fed: Array, runs: list[Any], waypoints: Array, model: Any
) -> Trajectories:
    episodes, rows = paths.shape[:2]
    target = np.array([legs[-1][0] for legs in runs]) if not len(waypoints) else np.tile(waypoints[-1], (episodes, 1))
    gaps = np.linalg.norm(paths - target[:, None], axis=-1)
    base = Trajectories(
        time=0.05 * np.arange(rows),
        latent=latents,
        skill=fed,
        action=np.diff(paths, axis=1)[..., : 2 if task == "point" else 3],
        reward=-gaps[:, 1:],
        target=target,
        success=gaps[:, -1] <= TOLERANCE[task],
        length=np.full(episodes, rows - 1),
    )
    if task == "point":
        return replace(base, position=paths[..., :2])
    box = None
    gripper = paths
    if task == "push":
        box = np.concatenate([paths, np.tile([0.9659258, 0.0, 0.0, 0.2588190], (episodes, rows, 1))], axis=-1)
        gripper = paths + np.array([-0.05, 0.01, 0.05])
    arm = model or arm_model(task == "push")
    joints = sum(str(arm.joint(i).name).startswith("right_j") for i in range(arm.njnt))
    solved = np.array([solve(arm, path, joints) for path in gripper])
    return replace(base, joint_position=solved, gripper_position=gripper, object_pose=box)
