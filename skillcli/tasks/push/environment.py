"""The push task: the arm's finger pushes a box over the table, with real contact and friction."""

from __future__ import annotations

import math
from collections.abc import Mapping
from functools import cached_property
from typing import ClassVar

import mujoco
import numpy as np

from skillcli.errors import UsageError
from skillcli.metrics import yaw
from skillcli.robots.robot import Robot
from skillcli.robots.scene import TABLE_TOP
from skillcli.simulation import rotations, table
from skillcli.simulation.arm_environment import BASE, ArmEnvironment
from skillcli.simulation.arms import OBJECT
from skillcli.simulation.chance import Rng
from skillcli.simulation.environment import Array, ObservationTerm, RewardTerms
from skillcli.simulation.safety import BOX_TOLERANCE, SOFT_TABLE_TOLERANCE, UPRIGHT, Cover
from skillcli.simulation.settings import ArmTask
from skillcli.tasks.push.geometry import CONTACT_GAP, climb, place_behind, share
from skillcli.tasks.push.scene import push_spec
from skillcli.tasks.push.settings import TURN, PushTask

# Frames of observed terms.
FROM_OBJECT = f"gripper less the centre of the object, along the axes {BASE}"
TURNED = ObservationTerm("object_turned", "", 2, "sine and cosine of the heading of the object's x axis, seen from above")
ON_TABLE = f"centre of the object, x and y {BASE}"

CLEARANCE = 0.01  # m: height above the table below which the finger pays a cost
START_GAP = 0.002  # m: between arm and box at the start
FIRM, CRUSHING = (
    2.0,
    10.0,
)  # weights of the box: downward force at which pressing begins to cost, and costs most
LEANING = math.cos(0.2)  # cosine of the largest tilt of a box on a table: no domain tilts a table further
FREE_LEAN = math.cos(math.radians(30))  # of the finger, which costs nothing
LIFTED = 0.05  # m above its rest: a lifted box
THROWN = 2.0  # m/s: four times the speed in the fastest push
# Reward of losing the box. It must be below the return of doing nothing, else failing early pays: of standing still with the
# box 30 cm from its goal, the farthest start in the bundled recipes, at a discount of 0.97 per step.
LOST = -30.0


class PushEnvironment(ArmEnvironment):
    """N arms with a box each.

    Besides the joints, the gripper's position relative to the box is observed, m, as in the paper. The place of the box
    follows from both, but a network learns that slowly: `task.observe_place` adds it to the observation. The start of the box
    is not observable.

    A goal is a place on the table: the nominal start of the box plus the skill's displacement. The achieved goal is the
    centre of the box in the plane of the table (z = 0). Where goals name a turn, the third coordinate of both is the heading of
    the box, `settings.TURN` m per rad, which is observed too. `reward_terms` explains the shaping, `failed` when a box is lost.
    """

    position_term = ObservationTerm("gripper_relative_to_object", "m", 3, FROM_OBJECT)
    shown_terms: ClassVar[tuple[ObservationTerm, ...]] = (ObservationTerm("object_place", "m", 2, ON_TABLE),)
    privileged_terms: ClassVar[tuple[ObservationTerm, ...]] = (
        ObservationTerm("goal_relative_to_object", "m", 2),
        ObservationTerm("object_velocity", "m/s", 2),
        ObservationTerm("gripper_relative_to_place_behind", "m", 3),
        ObservationTerm("robot_friction_mass_gain_latency", "", 4),
    )
    recorded: ClassVar[Mapping[str, int]] = {"gripper_position": 3, "object_pose": 7}
    failure_reward = LOST
    table_tolerance = SOFT_TABLE_TOLERANCE

    def __init__(
        self, task: PushTask, robot: Robot, goals: Array, num_envs: int, threads: int = 0, delay: bool = False
    ) -> None:
        self._task = task
        super().__init__(task, robot, goals, num_envs, threads, delay)
        self._weight = task.box_mass * float(np.linalg.norm(self.arms.model.opt.gravity))
        if not np.allclose(self.arms.object_pose[0, :2], self._box_start):
            size, place = (", ".join(f"{x:g}" for x in numbers) for numbers in (task.box_size, task.box_start))
            raise UsageError(
                f"the arm starts inside the box of ({size}) m at ({place})",
                "make the box lower, or start the arm higher or beside it: task.start, or start of the robot's file",
            )

    @classmethod
    def scene(cls, task: ArmTask, robot: Robot, delay: bool = False) -> mujoco.MjSpec:
        """See `ArmEnvironment`."""
        assert isinstance(task, PushTask)
        return push_spec(task, robot, delay)

    def set_up(self, task: ArmTask) -> None:
        """See `ArmEnvironment`."""
        num_envs = self.num_envs
        self._box_start = np.array(self._task.box_start)
        self._table_height, self._box_offset = np.zeros(num_envs), np.zeros((num_envs, 2))
        self._tilt: Array | None = None  # (N, 2) rad, of the table
        self._half_edges = np.tile(np.array(self._task.box_size) / 2, (num_envs, 1))
        self._robot = np.tile(np.array([1.0, 1.0, 1.0, 0.0]), (num_envs, 1))

    @classmethod
    def shows(cls, task: ArmTask) -> tuple[ObservationTerm, ...]:
        """See `ArmEnvironment`."""
        if not isinstance(task, PushTask) or not (task.observe_place or task.turns):
            return ()
        return (*cls.shown_terms, TURNED) if task.turns else cls.shown_terms

    def place_object(self, ids: Array) -> Array:
        """See `ArmEnvironment`; at rest on the table."""
        pose = np.zeros((len(ids), 7))
        pose[:, :2] = self._box_start + self._box_offset[ids]
        pose[:, 2] = self._rest(pose[:, :2], ids)
        pose[:, 3] = 1.0
        if self._tilt is not None:
            pose[:, 3:] = table.quaternion(self._tilt[ids])
        return pose

    def _place(self, ids: Array) -> None:
        """Put the arms at their starts, and boxes that would overlap with an arm beside it."""
        super()._place(ids)
        pose = self.arms.object_pose[ids]
        balls = self._cover.centres(*(values[ids] for values in self.arms.geom_frames()))
        aside = _way_out(pose[:, :3], self._half_edges[ids] + START_GAP, balls, self._cover.radii)
        inside = aside.any(axis=1)
        if inside.any():
            pose[:, :2] += aside
            pose[:, 2] = self._rest(pose[:, :2], ids)
            self._put(ids[inside], pose[inside])

    @cached_property
    def _cover(self) -> Cover:
        return Cover(self.arms.model)

    def _rest(self, xy: Array, ids: Array | slice) -> Array:
        """Return the height of the centre of a box that lies on the table at places (n, 2) m, (n,) m."""
        half = self._half_edges[ids, 2]
        if self._tilt is not None:
            half = half / table.normal(self._tilt[ids])[:, 2]
        rest: Array = self._surface(xy, ids) + half
        return rest

    def _surface(self, xy: Array, ids: Array | slice) -> Array:
        """Return the height of these robots' table tops at places (n, 2) m, (n,) m."""
        if self._tilt is None:
            level: Array = TABLE_TOP + self._table_height[ids]
            return level
        return table.surface(xy, self._table_height[ids], self._tilt[ids])

    def position(self) -> Array:
        """See `ArmEnvironment`."""
        return self.arms.gripper_position - self.arms.object_pose[:, :3]

    def shown(self) -> Array:
        """See `ArmEnvironment`; the estimated place of the box on the table, m, and where goals name a turn its heading."""
        if self._task.turns:
            seen = self.object_seen()
            heading = yaw(seen[:, 3:])
            return np.column_stack([seen[:, :2], np.sin(heading), np.cos(heading)])
        if self._sensors is None:
            return self.arms.object_pose[:, :2]
        n = self.action_size
        relative, gripper = self._measured[:, n : n + 2], self._measured[:, n + 3 : n + 5]
        return gripper - relative

    def achieved_goal(self) -> Array:
        """See `Environment`."""
        return self._point(self.arms.object_pose)

    def _point(self, pose: Array) -> Array:
        """Return the achieved goal of poses (N, 7), (N, 3) m."""
        point = pose[:, :3].copy()
        point[:, 2] = TURN * yaw(pose[:, 3:]) if self._task.turns else 0.0
        return point

    def keypoints(self) -> Array:
        """See `Environment`; box and gripper."""
        return np.stack([self.achieved_goal(), self.arms.gripper_position], axis=1)

    def behind(self) -> Array:
        """Return the place from which the finger pushes the box straight to its goal, (N, 3) m; half-way up the box."""
        point: Array = self.arms.object_pose[:, :3].copy()
        turn = (self.desired_goal[:, 2] - self.achieved_goal()[:, 2]) / TURN if self._task.turns else 0.0
        point[:, :2] = place_behind(point[:, :2], self.desired_goal[:, :2], self._half_edges[:, :2], turn)
        return point

    def reward_terms(self) -> RewardTerms:
        """Return the shaping terms, per control step; distances in m.

        - goal: minus 2 times the distance of box and goal: the task itself
        - approach: minus `task.approach` times the finger's way to the point behind the box. It leads the finger round the
          box, since a push from the wrong side makes the first term worse. The way is straight, but over the box while that is
          in the way (`geometry.climb`). The term fades within 3 cm of the goal, where that point jumps.
        - near: plus 0.3 times a bonus that grows from 0 at 5 cm from the goal to 1 at the goal: it pays for the detour round
          the box that the last centimetres cost
        - struck: minus 5 times the square of the box's speed, in m/s: the box must be pushed, not struck. The final position
          of a struck box depends on the exact time and place of one touch, and differs from robot to robot.
        - tipping: minus `task.tipping` times the square of the speed at which the box tips, in rad/s: a push high up a face
          topples it, and then its final position is unpredictable.
        - low: minus 10 times the depth of the finger below 1 cm above the table, or below a quarter of the height of a box
          lower than 4 cm. Without it fingers lean on the table with up to 200 N.
        - pressed: minus up to 0.3 for pressing down on table or box, from a force of 2 weights of the box to one of 10: a
          box that is pressed from above sinks into the table. Sideways forces are free, because they push the box.
        - leaning: minus `task.upright` times how far the cosine of the finger's lean is below that of 30 degrees, only where
          that weight is not zero. Arms with free wrists otherwise learn to push with a hand turned sideways, which leaves one
          side of the box out of their reach.

        The step that loses the box earns `LOST` instead.
        """
        distance = np.linalg.norm(self.desired_goal - self.achieved_goal(), axis=1)
        finger = np.linalg.norm(self.arms.gripper_position - self.behind(), axis=1) + self._climb()
        inside = np.maximum(0.0, 1.0 - distance / 0.05)
        struck = (self.arms.object_velocity[:, :2] ** 2).sum(axis=1)
        gripper = self.arms.gripper_position
        height = gripper[:, 2] - self._surface(gripper[:, :2], slice(None))
        low = np.maximum(0.0, np.minimum(CLEARANCE, self._half_edges[:, 2] / 2) - height)
        weights = -self.arms.contact_force[:, 2] / self._weight
        pressed = np.clip((weights - FIRM) / (CRUSHING - FIRM), 0.0, 1.0)
        costs = {
            "struck": 5.0 * struck,
            "tipping": self._task.tipping * self._tipping() ** 2,
            "low": 10.0 * low,
            "pressed": 0.3 * pressed,
        }
        if self._task.upright:
            costs["leaning"] = self._task.upright * np.maximum(0.0, FREE_LEAN + self.arms.gripper_direction[:, 2])
        return RewardTerms(
            earned={"goal": -2.0 * distance, "approach": -self._task.approach * finger * share(distance), "near": 0.3 * inside},
            costs=costs,
        )

    def _climb(self) -> Array:
        """Return how much higher a finger must be to pass over a box in its way, (N,) m."""
        box = self.arms.object_pose[:, :3]
        return climb(self.arms.gripper_position, box, self.desired_goal[:, :2], self._half_edges)

    def _tipping(self) -> Array:
        """Return the speed at which the boxes turn about a horizontal axis, (N,) rad/s."""
        turning, up = self.arms.object_velocity[:, 3:], self._up()  # in the box's own frame
        spin = np.einsum("ij,ij->i", turning, up)
        speed: Array = np.linalg.norm(turning - spin[:, None] * up, axis=1)
        return speed

    def _up(self) -> Array:
        """Return the upward direction in the frames of the boxes, unit vectors (N, 3)."""
        return rotations.up(self.arms.object_pose[:, 3:])

    def violations(self) -> Array:
        """See `ArmEnvironment`; adds boxes that are pressed into the table or tip over."""
        return np.column_stack([super().violations(), self._sunk() > BOX_TOLERANCE, self._up()[:, 2] < UPRIGHT])

    def _sunk(self) -> Array:
        """Return the depth of the lowest corners of boxes on the table below its top, (N,) m."""
        position, rotation = self.arms.geom_frames()
        model = self.arms.model
        top, box = model.geom("table").id, model.geom(OBJECT).id
        plane, turn = (rotation[:, geom].reshape(-1, 3, 3) for geom in (top, box))
        centre = np.einsum("ni,nij->nj", position[:, box] - position[:, top], plane)
        reach = (np.abs(np.einsum("ni,nik->nk", plane[..., 2], turn)) * self._half_edges).sum(axis=1)  # down from there
        half = model.geom_size[top]
        on_table = (np.abs(centre[:, :2]) <= half[:2]).all(axis=1)
        sunk: Array = np.where(on_table, reach + half[2] - centre[:, 2], 0.0)
        return sunk

    def failed(self) -> Array:
        """Return which boxes fell off the table, were lifted or thrown, or which simulations are unstable, (N,) bool."""
        broken = super().failed()
        box = np.nan_to_num(self.arms.object_pose[:, :3], posinf=0.0, neginf=0.0)
        height, rest = box[:, 2], self._rest(box[:, :2], slice(None))
        speed = np.abs(self.arms.object_velocity[:, :3]).max(axis=1)
        lost: Array = broken | (height < rest - self._half_edges[:, 2]) | (height > rest + LIFTED) | ~(speed < THROWN)
        return lost

    def privileged(self) -> Array:
        """See `Environment`."""
        box, velocity = self.arms.object_pose, self.arms.object_velocity
        parts = (
            self.desired_goal[:, :2] - box[:, :2], velocity[:, :2], self.arms.gripper_position - self.behind(), self._robot,
        )  # fmt: skip
        return np.concatenate(parts, axis=1, dtype=np.float32, casting="same_kind")

    def randomize(self, parameters: Mapping[str, Array], rng: Rng) -> None:
        """See `Environment`."""
        super().randomize(parameters, rng)
        one, zero = np.ones(self.num_envs), np.zeros(self.num_envs)
        self._table_height = parameters.get("table_height", zero)
        self._box_offset = parameters.get("object_offset", np.zeros((self.num_envs, 2)))
        tilt, size = parameters.get("table_tilt"), parameters.get("object_size", one)
        self._tilt = tilt if tilt is not None and tilt.any() else None
        self._half_edges = size[:, None] * np.array(self._task.box_size) / 2
        gain = parameters.get("gain", np.ones((self.num_envs, 1))).mean(axis=1)
        friction, mass = parameters.get("contact_friction", one), parameters.get("object_mass", one)
        self._robot = np.stack([friction, mass, gain, parameters.get("latency", zero) / self.control_period], axis=1)

    def _true(self) -> Array:
        """See `ArmEnvironment`; adds the gripper's own position and the orientation of the box, (N, J+10)."""
        seen, pose = super()._true(), self.arms.object_pose
        return np.concatenate([seen, seen[:, self.action_size :] + pose[:, :3], pose[:, 3:]], axis=1)

    def object_seen(self) -> Array:
        """See `ArmEnvironment`: the place from the last observation, and an angle whose noise matches that of the place."""
        pose = self.arms.object_pose.copy()
        if self._sensors is None:
            return pose
        relative, gripper, turned = np.split(self._measured[:, self.action_size :], [3, 6], axis=1)
        pose[:, :3] = gripper - relative
        error = self._sensors.angle_error(self._half_edges[:, :2].mean(axis=1) + CONTACT_GAP)
        turned = turned / np.linalg.norm(turned, axis=1, keepdims=True)  # interpolated, it is a little too short
        pose[:, 3:] = table.turned(rotations.upright(error), turned)
        return pose

    def estimate_achieved_goal(self, object_pose: Array | None) -> Array:
        """See `ArmEnvironment`."""
        assert object_pose is not None
        return self._point(object_pose)

    def estimate_tilt(self, object_pose: Array | None) -> Array:
        """See `ArmEnvironment`: the tilt of the top face, so that a toppled box counts as upright."""
        assert object_pose is not None
        frames = rotations.frames(object_pose[:, 3:])
        on_top = np.abs(frames[:, 2]).argmax(axis=1)
        normal = frames[np.arange(self.num_envs), :, on_top]
        tilt: Array = normal[:, :2] * np.sign(normal[:, 2:])
        return tilt

    def room(self) -> Array:
        """See `ArmEnvironment`; for boxes along the axes."""
        beyond = np.abs(self.arms.gripper_position - self.arms.object_pose[:, :3]) - self._half_edges
        room: Array = np.linalg.norm(np.maximum(beyond, 0.0), axis=1)
        return room

    def set_estimated_state(self, ids: Array, state: Array, sag: Array | None = None) -> None:
        """See `Environment`; the box lies flat on this robot's own table, whatever height and tilt the other table has.

        A box that leans on the finger, further than any table is tilted, is about to fall: here it leans too, with its lowest
        corner on the table.
        """
        lying = state.copy()
        lying[:, -5] = self._rest(state[:, -7:-5], ids)
        flat = rotations.upright(2 * np.arctan2(state[:, -1], state[:, -4]))  # turn about the vertical, without tilt
        lying[:, -4:] = flat if self._tilt is None else table.turned(table.quaternion(self._tilt[ids]), flat)
        up = rotations.up(state[:, -4:])
        leans = (up[:, 2] < LEANING) & (up[:, 2] > UPRIGHT)
        reach = (np.abs(up) * self._half_edges[ids]).sum(axis=1)  # from the centre down to the lowest corner
        lying[leans, -4:] = state[leans, -4:]
        lying[leans, -5] += (reach - self._half_edges[ids, 2])[leans]
        super().set_estimated_state(ids, lying, sag)

    def recorded_state(self) -> dict[str, Array]:
        """See `Environment`."""
        return {**super().recorded_state(), "object_pose": self.arms.object_pose.copy()}


def _way_out(box: Array, half: Array, balls: Array, radii: Array) -> Array:
    """Return sideways displacements of boxes, each the shortest, until no sphere overlaps them, (n, 2) m.

    Between arms on both sides there may be no solution: the search ends after as many moves as there are spheres.

    Args:
        box: (n, 3) m, centres of boxes that are along the axes.
        half: (n, 3) m, half of their edges.
        balls: (n, P, 3) m, centres of the spheres.
        radii: (P,) m.
    """
    aside, each = np.zeros((len(box), 2)), np.arange(len(box))
    for _ in range(len(radii)):
        away = box[:, None] - balls
        away[..., :2] += aside[:, None]
        inside = half[:, None] + radii[:, None] - np.abs(away)  # (n, P, 3) along each axis
        depth = np.where((inside > 0).all(axis=2), inside[..., :2].min(axis=2), 0.0)
        if not depth.any():
            break
        deepest = depth.argmax(axis=1)
        axis = inside[each, deepest, :2].argmin(axis=1)
        aside[each, axis] += np.copysign(depth[each, deepest], away[each, deepest, axis])
    return aside
