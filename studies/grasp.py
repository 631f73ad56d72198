"""Whether a hand can grasp, lift, carry and put down a block, by script, and how much of it hangs on contact and time step.

    python -m studies.grasp

A hand is driven along postures of inverse kinematics: open above the block, down, close, up, to another place, down, open, up.
"""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import dataclass

import mujoco
import numpy as np
from rich.console import Console
from rich.table import Table

from skillcli.recipe import resolve
from skillcli.robots.inverse_kinematics import Kinematics
from skillcli.simulation.environment import NO_SKILL
from skillcli.tasks.blocks.environment import BlocksEnvironment
from skillcli.tasks.blocks.geometry import face_heading, heading, quarter_turn
from skillcli.tasks.blocks.settings import BlocksTask
from skillcli.tasks.world import World
from skillcli.trajectories import Array

SECONDS = {"down": 1.0, "close": 0.8, "up": 1.0, "carry": 1.5, "lower": 1.0, "settle": 0.3, "open": 0.8, "away": 0.6}
OVER, HIGH = 0.07, 0.13  # m of the hand above where it grasps and lets go
REST = 5.0  # s that a block is held still
CARRIED = "carry"


@dataclass(frozen=True)
class Outcome:
    """What became of the blocks of N episodes."""

    held: Array  # (N,) bool, at the end of the carry
    slip: Array  # (N,) m, of the block in the hand, from the end of the lift to the end of the carry
    place_error: Array  # (N,) m, of the block from where it was to lie, in the plane
    let_go: Array  # (N,) bool, at the end
    final: Array  # (N, 3) m
    force: Array  # (N,) N, largest downward force of the arm


def world(**task: object) -> World:
    """Return the Panda with its block, without starts further on."""
    return World.of(resolve({"name": "grasp", "robot": "panda", "task": {"name": "blocks", "grasped_starts": False, **task}}))


def script(env: BlocksEnvironment, home: Array, goals: Array) -> Iterator[tuple[str, Array]]:
    """Yield actions (N, J+1) that pick up the attended blocks and put them down, with the name of the phase.

    Args:
        env: N simulations.
        home: (J,) rad, a posture with the hand down.
        goals: (N, 3) m, where to put the middles of the blocks.
    """
    kinematics = Kinematics(env.robot)
    kinematics.gripper(home)
    axis = kinematics.data.xaxis[kinematics.model.joint(env.robot.graspers().joints[0]).id]
    begin = env.arms.object_pose[:, :3].copy()
    turn = quarter_turn(face_heading(env.arms.object_pose[:, 3:]) - heading(axis[None]))

    def postures(places: Array, higher: float) -> Array:
        found = []
        for (x, y, z), angle in zip(places + np.array([0.0, 0.0, higher]), turn, strict=True):
            posture = kinematics.solve(np.array([x, y, z]), home, down=True)
            assert posture is not None, f"out of reach: {x:.3f}, {y:.3f}, {z:.3f}"
            found.append(posture.angles - np.eye(env.joints)[-1] * angle)  # the last joint's axis points down
        return np.array(found)

    above, at, high = (postures(begin, higher) for higher in (OVER, 0.0, HIGH))
    over, low, leave = (postures(goals, higher) for higher in (HIGH, 0.0, OVER))
    yield from _move(env, "approach", 1.5, above, 1.0)
    yield from _move(env, "down", SECONDS["down"], at, 1.0)
    yield from _move(env, "close", SECONDS["close"], at, -1.0)
    yield from _move(env, "up", SECONDS["up"], high, -1.0)
    yield from _move(env, "carry", SECONDS["carry"], over, -1.0)
    yield from _move(env, "lower", SECONDS["lower"], low, -1.0)
    yield from _move(env, "settle", SECONDS["settle"], low, -1.0)
    yield from _move(env, "open", SECONDS["open"], low, 1.0)
    yield from _move(env, "away", SECONDS["away"], leave, 1.0)


def _move(env: BlocksEnvironment, phase: str, seconds: float, target: Array, closing: float) -> Iterator[tuple[str, Array]]:
    """Yield actions that lead the commands evenly to joint angles (N, J) rad within some time."""
    steps = round(seconds / env.control_period)
    begin = env.arms.commanded.copy()
    for step in range(1, steps + 1):
        wanted = begin + step / steps * (target - begin)
        action = (wanted - env.arms.commanded) / env.arms.action_limit
        yield phase, np.column_stack([action, np.full(len(action), closing)])


def pick_and_place(env: BlocksEnvironment, starts: Array, yaw: Array, goals: Array) -> Outcome:
    """Run the script; see `script` and `Outcome`."""
    env.randomize({"object_offset": starts - env.arms.object_pose[0, :2], "object_yaw": yaw}, np.random.default_rng(0))
    env.reset(np.arange(env.num_envs), np.full(env.num_envs, NO_SKILL))
    places = np.column_stack([goals, env.arms.object_pose[:, 2]])
    inside: dict[str, Array] = {}
    held, force = np.zeros(env.num_envs, dtype=bool), np.zeros(env.num_envs)
    for phase, action in script(env, env.arms.commanded[0].copy(), places):
        env.step(action)
        inside[phase] = in_hand(env)
        force = np.maximum(force, -env.arms.contact_force[:, 2])
        if phase == CARRIED:
            held = env.held()
    final = env.arms.object_pose[:, :3].copy()
    return Outcome(
        held=held,
        slip=np.linalg.norm(inside["carry"] - inside["up"], axis=1),
        place_error=np.linalg.norm(final[:, :2] - goals, axis=1),
        let_go=~env.held() & (env.arms.gripper_position[:, 2] - final[:, 2] > 0.04),
        final=final,
        force=force,
    )


def stack(env: BlocksEnvironment) -> Array:
    """Put each further block on the ones before; return the middles of all blocks at the end, (N, K, 3) m."""
    env.reset(np.arange(env.num_envs), np.full(env.num_envs, NO_SKILL))
    home = env.arms.commanded[0].copy()
    for index in range(1, len(env.arms.objects)):
        env.attend(index - 1)
        goals = env.arms.object_pose[:, :3] + [0.0, 0.0, BlocksTask().block_size]
        env.attend(index)
        for _, action in script(env, home, goals):
            env.step(action)
    env.attend(0)
    return env.arms.object_poses.reshape(env.num_envs, -1, 7)[:, :, :3].copy()


def in_hand(env: BlocksEnvironment) -> Array:
    """Return the middle of the block in the frame of the gripper, (N, 3) m."""
    arms = env.arms
    site = arms.model.site("gripper").id
    frame = arms.batch.bind("site_xmat")[:, site].reshape(-1, 3, 3)
    return np.einsum("nij,ni->nj", frame, arms.object_pose[:, :3] - arms.gripper_position)


def hold(env: BlocksEnvironment, seconds: float = REST) -> Array:
    """Hold blocks still that are in the hand; return how far they slip, (N,) m."""
    still = np.zeros((env.num_envs, env.action_size))
    still[:, -1] = -1.0
    for _ in range(round(0.25 / env.control_period)):
        env.step(still)
    before = in_hand(env)
    for _ in range(round(seconds / env.control_period)):
        env.step(still)
    return np.linalg.norm(in_hand(env) - before, axis=1)


def draw(count: int, seed: int = 0) -> tuple[Array, Array, Array]:
    """Draw starts (n, 2) m, yaws (n,) rad and goals (n, 2) m."""
    rng = np.random.default_rng(seed)
    middle = np.array(BlocksTask().block_start)
    return (
        middle + rng.uniform(-0.1, 0.1, (count, 2)),
        rng.uniform(-np.pi, np.pi, count),
        middle + rng.uniform(-0.15, 0.15, (count, 2)),
    )


VARIANTS: dict[str, dict[str, object]] = {
    "as shipped": {},
    "impratio 1": {"impratio": 1.0},
    "impratio 10": {"impratio": 10.0},
    "impratio 100": {"impratio": 100.0},
    "pyramidal cone": {"cone": mujoco.mjtCone.mjCONE_PYRAMIDAL},
    "condim 3": {"condim": 3},
    "condim 6": {"condim": 6},
    "pads: solref 0.01": {"solref": (0.01, 1.0)},
    "pads: solref 0.02": {"solref": (0.02, 1.0)},
    "pads: impedance 0-0.99 over 1 mm": {"solimp": (0.0, 0.99, 0.001, 0.5, 1.0)},
    "pads as in push": {"solref": (0.01, 1.0), "solimp": (0.0, 0.998, 0.002, 0.5, 1.0)},
}
OF_OPTION = ("impratio", "cone")


def varied(world: World, num_envs: int, changes: dict[str, object]) -> BlocksEnvironment:
    """Make simulations whose contact differs."""
    from skillcli.tasks.blocks import environment as module

    usual = module.blocks_spec

    def spec(*args: object) -> mujoco.MjSpec:
        made = usual(*args)  # type: ignore[arg-type]
        for key, changed in changes.items():
            for owner in [made.option] if key in OF_OPTION else [made.geom(name) for name in world.robot.names.finger]:
                setattr(owner, key, changed)
        return made

    module.blocks_spec = spec
    try:
        env = world.make_env(num_envs)
    finally:
        module.blocks_spec = usual
    assert isinstance(env, BlocksEnvironment)
    return env


def main() -> None:
    """Print a table for variants of contact, at three time steps."""
    count = 16
    drawn = draw(count)
    columns = (
        "contact",
        "step",
        "held",
        "slip in 5 s",
        "slip in the carry",
        "place error: median, 90 %",
        "ends elsewhere at half the step",
        "steps/s",
    )
    table = Table(*columns)
    for name, changes in VARIANTS.items():
        before: Array | None = None
        for timestep in (0.005, 0.0025, 0.00125):
            env = varied(world(timestep=timestep), count, changes)
            begun = time.perf_counter()
            outcome = pick_and_place(env, *drawn)
            seconds = time.perf_counter() - begun
            resting = varied(world(timestep=timestep, grasped_starts=True), 1, changes)
            resting.reset(np.array([0]), np.array([2]))
            moved = None if before is None else 1000 * np.linalg.norm(outcome.final - before, axis=1)
            before = outcome.final
            table.add_row(
                name,
                f"{1000 * timestep:g} ms",
                f"{outcome.held.sum()} of {count}",
                f"{1000 * hold(resting)[0]:.2f} mm",
                f"{1000 * np.median(outcome.slip):.2f}, {1000 * outcome.slip.max():.2f} mm",
                f"{1000 * np.median(outcome.place_error):.1f}, {1000 * np.quantile(outcome.place_error, 0.9):.1f} mm",
                "" if moved is None else f"{np.median(moved):.2f} / {np.quantile(moved, 0.9):.2f} / {moved.max():.2f} mm",
                f"{count * sum(SECONDS.values()) / 0.05 / seconds:.0f}",
            )
    Console(width=180).print(table)


if __name__ == "__main__":
    main()
