"""The blocks task: the arm's hand grasps a block, carries it and puts it down, with real contact and friction."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import ClassVar

import mujoco
import numpy as np

from skillcli.robots.robot import Robot
from skillcli.robots.scene import TABLE_TOP
from skillcli.simulation.arm_environment import BASE, ArmEnvironment
from skillcli.simulation.chance import Rng
from skillcli.simulation.environment import SAFETY_LIMITS, Array, ObservationTerm, RewardTerms, Step
from skillcli.simulation.fingers import Fingers
from skillcli.simulation.rotations import frames, quaternions, up, upright
from skillcli.simulation.safety import SOFT_TABLE_TOLERANCE
from skillcli.simulation.settings import ArmTask
from skillcli.tasks.blocks.geometry import QUARTERS, face_heading, hand_frames, heading, quarter_turn
from skillcli.tasks.blocks.scene import blocks_spec
from skillcli.tasks.blocks.settings import KINDS, BlocksTask
from skillcli.tasks.blocks.starts import Postures, postures

# Frames of observed terms.
FROM_BLOCK = f"gripper less the middle of the block, along the axes {BASE}"
MIDDLE = f"middle of the block {BASE}"
TURNED = "sine and cosine of four times the angle from the hand's closing direction to a side face, seen from above"
UP = "upward axis of the block's own frame, along the axes of the base"
POINTING = "direction in which the hand points, along the axes of the base"

ABOVE, LIFT, CARRY, PLACE = range(len(KINDS))
WHOLE = len(KINDS)  # no skill: a whole task, in which the block goes to its goal and is let go

HAND_ABOVE, HAND_HIGH = 0.09, 0.15  # m: heights of the gripper over the table where skills begin
JITTER = 0.3  # share of `start_offset` that an open hand above a block is off: two centimetres at its end
CARRIED = 1.5  # how much farther than blocks begin from their nominal start they are when carried or put down
OVER_THE_OTHER = 0.005  # m over another block, at which a block that is let go on it begins
BESIDE_THE_OTHER = 0.1  # m per rad of `start_offset` that it is off its middle: a centimetre at its end
REACH_OF_FINGERS = 0.025  # m from the gripper within which the middle of a held block is
AROUND = 2 * REACH_OF_FINGERS  # m from the gripper within which fingers that are not open enough have not let go of a block
IN_PLACE = 0.01  # m from its place, at which a block that is let go is done with, and the next one is attended to
PRESSING = 0.008  # m by which the command of a hand that holds something leads the width
LET_GO = 0.025  # m: the opened fingers leave a block this much room
DOWN = 0.015  # m over the table, below which a block in the hand can be put down
SUNK, SEEN_LYING = 0.002, 0.015  # m off the height at which it would lie: what its weight does, and what bad sight may do
AT_HEIGHT = 0.015  # m higher than the goal, a block is down there: it may drop that far
NEAR = 0.05  # m from the goal, within which a bonus grows
STEADY, CRUSHED = 5.0, 150.0  # N, downward force of the arm: begins to cost, and crushes a block
PRESSED = 40.0  # N at which pressing costs most
THROWN = 2.0  # m/s: twice the speed of a block that falls from where it is carried
FALLEN = 0.5  # of its edge below the table top: a block that fell off
STANDING = math.cos(math.radians(30))  # of the upward axis of a block that others are stacked on
FREE_LEAN = math.cos(math.radians(10))  # of the hand, which costs nothing
LOWEST = 0.004  # m over the table, below which the gripper pays
# Reward of losing the block. It must be below the return of doing nothing, else failing early pays: of standing still with the
# block 30 cm from its goal, at a discount of 0.97 per step.
LOST = -30.0


class BlocksEnvironment(ArmEnvironment):
    """N arms with a block each, and fingers that move.

    A goal is a place. Of `above` the achieved goal is the gripper, of lift the height of the block, of carry its middle. Of
    place, and of a whole task (`NO_SKILL`), a block that is not let go counts as higher by what the fingers have yet to open:
    at the goal it lies, and the fingers leave it room. `reward_terms` explains the shaping, `failed` when a block is lost.
    """

    grasps = True
    position_term = ObservationTerm("gripper_relative_to_object", "m", 3, FROM_BLOCK)
    shown_terms: ClassVar[tuple[ObservationTerm, ...]] = (
        ObservationTerm("object_place", "m", 3, MIDDLE),
        ObservationTerm("object_turned", "", 2, TURNED),
        ObservationTerm("object_up", "", 3, UP),
        ObservationTerm("hand_direction", "", 3, POINTING),
        ObservationTerm("finger_width", "m", 1),
        ObservationTerm("finger_lead", "m", 1, "measured less commanded width"),
    )
    privileged_terms: ClassVar[tuple[ObservationTerm, ...]] = (
        ObservationTerm("goal_relative_to_achieved", "m", 3),
        ObservationTerm("object_velocity", "m/s", 3),
        ObservationTerm("held", "", 1),
    )
    recorded: ClassVar[Mapping[str, int]] = {"gripper_position": 3, "object_pose": 7, "finger_position": 2}
    failure_reward = LOST
    table_tolerance = SOFT_TABLE_TOLERANCE

    def __init__(
        self, task: BlocksTask, robot: Robot, goals: Array, num_envs: int, threads: int = 0, delay: bool = False
    ) -> None:
        self._task = task
        super().__init__(task, robot, goals, num_envs, threads, delay)

    @classmethod
    def scene(cls, task: ArmTask, robot: Robot, delay: bool = False) -> mujoco.MjSpec:
        """See `ArmEnvironment`."""
        assert isinstance(task, BlocksTask)
        return blocks_spec(task, robot, delay)

    def set_up(self, task: ArmTask) -> None:
        """See `ArmEnvironment`."""
        num_envs = self.num_envs
        self._kinds = np.array([KINDS.index(kind) for kind in self._task.kinds] + [WHOLE])  # the last of skill -1
        self._kind = np.full(num_envs, WHOLE)
        self._block_start, self._half = np.array(self._task.block_start), self._task.block_size / 2
        self._offset, self._yaw = np.zeros((num_envs, 2)), np.zeros(num_envs)
        self._progress = np.zeros(num_envs)
        self._build = np.array(self._task.build)
        heights = (TABLE_TOP + self._half, HAND_ABOVE, HAND_HIGH, TABLE_TOP + 3 * self._half + OVER_THE_OTHER)
        self._postures: Postures | None = None
        if self._task.grasped_starts:
            self._postures = postures(self.robot, tuple(self._start), self._task.block_start, heights)

    def reset(self, ids: Array, skill: Array) -> None:
        """See `ArmEnvironment`."""
        self._kind[ids] = self._kinds[skill]
        if len(self._build):
            self.arms.attended[ids] = 0
        super().reset(ids, skill)

    def step(self, action: Array) -> Step:
        """See `Environment`; a block that was let go in its place is seen there once, and then the next one is attended to."""
        self._attend_next(np.arange(self.num_envs))
        return super().step(action)

    def restore(self, ids: Array, sim_states: Array) -> None:
        """See `Environment`."""
        super().restore(ids, sim_states)
        self._attend_next(ids)
        if len(self._build) and self._sensors is not None:
            self._sensors.settle(ids, self._true()[ids])

    def reset_to_state(self, ids: Array, sim_states: Array, skill: Array) -> None:
        """See `Environment`; a skill that needs a block in the hand, or none, begins at its own start if that is not so."""
        self._kind[ids] = self._kinds[skill]
        self.arms.restore(ids, sim_states)
        if self._postures is not None:
            kind, held = self._kind[ids], self.held()[ids]
            down = self.arms.object_pose[ids, 2] < TABLE_TOP + self._half + DOWN
            fit = {CARRY: held, PLACE: held & down, WHOLE: np.ones(len(ids), dtype=bool)}
            unfit = ~np.select([kind == each for each in fit], list(fit.values()), ~held)
            if unfit.any():
                self._place(ids[unfit])
        self._begin(ids, skill)

    def _begin(self, ids: Array, skill: Array) -> None:
        super()._begin(ids, skill)
        moved = np.isin(self._kind[ids], (ABOVE, LIFT, PLACE))
        away = self.arms.object_pose[ids, :2] - self._block_start
        self.desired_goal[ids, :2] += np.where(moved[:, None], away, 0.0)
        placing = ids[self._kind[ids] == PLACE]
        under = np.round((self.arms.object_pose[placing, 2] - self.desired_goal[placing, 2]) / (2 * self._half))
        self.desired_goal[placing, 2] += 2 * self._half * np.maximum(under, 0.0)  # on as many blocks as it is now

    def _place(self, ids: Array) -> None:
        """Put arms and blocks where the skills begin; see `BlocksTask.grasped_starts`."""
        super()._place(ids)
        if self._postures is not None:
            ahead = ids[np.isin(self._kind[ids], (LIFT, CARRY, PLACE))]
            if len(ahead):
                self._place_ahead(ahead, self._postures)

    def _place_ahead(self, ids: Array, found: Postures) -> None:
        """Put hands over, around, or with blocks: how far on, `start_progress` says in thirds."""
        kind, third = self._kind[ids], np.minimum((3 * self._progress[ids]).astype(int), 2)
        # heights of the hand, by kind and third, as indices: 0 at the block's own, 1 above it, 2 high, 3 on another block
        level = np.array([[1, 0, 0], [2, 1, 0], [0, 0, 3 if self._task.others else 0]])[kind - LIFT, third]
        grasped = (kind != LIFT) | (third == 2)
        place = self._block_start + np.where(kind == LIFT, 1.0, CARRIED)[:, None] * self._offset[ids]
        angles = found.at(place, level)
        # A lift leaves the arm in other postures than these: far above the table a hand with a block may begin in any.
        jitter = np.select([level == 2, (level == 1) & ~grasped], [1.0, JITTER], 0.0)
        angles += jitter[:, None] * self._start_offset[ids]
        self.arms.reset_to(ids, angles)
        # The hand turns to the block; in the air the block turns with the hand.
        turn = quarter_turn(self._yaw[ids] - heading(self.arms.fingers.axis[ids]))
        angles[:, -1] += turn * self._turning(ids)
        open_width, closed = self.arms.fingers.widest, 2 * self._half
        width = np.where(grasped, closed, open_width)
        hand = np.stack([width, np.where(grasped, closed - Fingers.MAX_LEAD, open_width)], axis=1)
        poses = self.place_object(ids).reshape(len(ids), -1, 7)
        self.arms.reset_to(ids, angles, poses.reshape(len(ids), -1), hand)
        rows, attended = np.arange(len(ids)), self.arms.attended[ids]
        pose = poses[rows, attended]
        inside = self.arms.gripper_position[ids]
        pose[grasped, :3] = inside[grasped]
        pose[grasped, 2] = np.maximum(inside[grasped, 2], TABLE_TOP + self._half)
        axis, pointing = self.arms.fingers.axis[ids], self.arms.gripper_direction[ids]
        pose[grasped, 3:] = upright(heading(axis[grasped]))
        leaning = grasped & (level == 2)
        pose[leaning, 3:] = quaternions(hand_frames(axis[leaning], pointing[leaning]))
        poses[rows, attended] = pose
        stacked = np.flatnonzero(level == 3)
        if len(stacked):
            under = pose[stacked]
            under[:, :2] += BESIDE_THE_OTHER * self._start_offset[ids][stacked, :2]
            under[:, 2] = TABLE_TOP + self._half
            poses[stacked, np.where(attended[stacked] == 0, 1, 0)] = under
        self.arms.reset_to(ids, angles, poses.reshape(len(ids), -1), hand)

    def _turning(self, ids: Array) -> Array:
        """Return in which direction a hand that points down turns with its last joint, seen from above, (n,) 1 or -1."""
        last = self.arms.model.joint(self.arms.names.joints[-1]).id
        turning: Array = np.sign(self.arms.batch.bind("xaxis")[ids, last, 2])
        return turning

    def _put(self, ids: Array, object_pose: Array | None) -> None:
        widest = np.full((len(ids), 2), self.arms.fingers.widest)
        self.arms.reset_to(ids, self._start + self._start_offset[ids], object_pose, widest)

    def place_object(self, ids: Array) -> Array:
        """See `ArmEnvironment`; at rest on the table. The attended block may begin anywhere, the others where the task says."""
        places = np.array([self._task.block_start, *self._task.others])
        poses = np.zeros((len(ids), len(places), 7))
        poses[:, :, :2] = places
        poses[:, :, 2] = TABLE_TOP + self._half
        poses[:, :, 3] = 1.0
        rows, attended = np.arange(len(ids)), self.arms.attended[ids]
        poses[rows, attended, :2] = self._block_start + self._offset[ids]
        poses[rows, attended, 3:] = upright(self._yaw[ids])
        return poses.reshape(len(ids), -1)

    def attend(self, block: int) -> None:
        """Choose the block, of several, that skills see and goals are about from now on; with `task.build` the task does."""
        self.arms.attended[:] = block

    def _attend_next(self, ids: Array) -> None:
        """With `task.build`, attend to the first block that is not in its place, or not let go there; at last to the last."""
        if not len(self._build):
            return
        block = self.arms.object_poses[ids].reshape(len(ids), -1, 7)[:, :, :3]
        away = np.linalg.norm(block - self.arms.gripper_position[ids, None], axis=2)
        touched = (away == away.min(axis=1, keepdims=True)) & (away < AROUND)
        block[:, :, 2] += np.where(touched, self._to_open(self.arms.fingers.width[ids])[:, None], 0.0)
        off = np.linalg.norm(block[:, : len(self._build)] - self._build, axis=2)
        there = off < np.where(touched[:, : len(self._build)], IN_PLACE, self.tolerance)
        self.arms.attended[ids] = np.where(there.all(axis=1), len(self._build) - 1, (~there).argmax(axis=1))

    def position(self) -> Array:
        """See `ArmEnvironment`."""
        return self.arms.gripper_position - self.arms.object_pose[:, :3]

    def held(self) -> Array:
        """Return which hands press on a block between the fingers, (N,) bool."""
        held: Array = self._pressing() & (np.linalg.norm(self.position(), axis=1) < REACH_OF_FINGERS)
        return held

    def _pressing(self) -> Array:
        """Return which fingers press on something between them, (N,) bool."""
        pressing: Array = self.arms.fingers.width - self.arms.fingers.commanded > PRESSING
        return pressing

    def achieved_goal(self) -> Array:
        """See `Environment`."""
        block = self.arms.object_pose[:, :3].copy()
        block[:, 2] += np.where(self._kind >= PLACE, self._yet_to_open(), 0.0)
        block[:, :2] = np.where((self._kind == LIFT)[:, None], self.desired_goal[:, :2], block[:, :2])
        goal: Array = np.where((self._kind == ABOVE)[:, None], self.arms.gripper_position, block)
        return goal

    def _yet_to_open(self) -> Array:
        """Return by how much fingers around a block have to open to let it go, (N,) m."""
        return np.where(np.linalg.norm(self.position(), axis=1) < AROUND, self._to_open(self.arms.fingers.width), 0.0)

    def _to_open(self, width: Array) -> Array:
        """Return by how much fingers with these widths (n,) m have to open to let a block go, (n,) m."""
        to_open: Array = np.clip(LET_GO - (width - 2 * self._half), 0.0, LET_GO)
        return to_open

    def keypoints(self) -> Array:
        """See `Environment`; achieved goal, gripper and block."""
        return np.stack([self.achieved_goal(), self.arms.gripper_position, self.arms.object_pose[:, :3]], axis=1)

    def reward_terms(self) -> RewardTerms:
        """Return the shaping terms, per control step; distances in m.

        - goal: minus 2 times the distance of achieved and desired goal: the skill itself
        - near: plus 0.3 times a bonus that grows from 0 at 5 cm from the goal to 1 at the goal
        - reach (lift): minus 2 times the distance of the gripper from the middle of the block
        - enclose (lift): plus up to 0.5 for closing the fingers where the block is between them
        - hold (lift, carry): plus 0.3 for a block between fingers that press
        - release (place): plus up to 0.5 for opening the fingers around a block that is down at the goal's height
        - early (above, lift): minus up to 0.1 for fingers that are closed and have no block between them
        - turned (above, lift): minus up to 0.2 for a hand that is not along the faces of the block
        - dragged (place): minus 2 times the sideways speed of a block in the hand: where it began cannot be seen, but
          whether it stays there can
        - leaning: minus how far the cosine of the hand's lean is below that of 10 degrees
        - struck: minus 0.5 times the square of the block's speed, 5 times that of a block that is not held: it is neither
          knocked nor dropped
        - low: minus 10 times the depth of the gripper below 4 mm above the table
        - pressed: minus up to 0.3 for pressing down with 5 to 40 N

        The step that loses the block earns `LOST` instead.
        """
        kind, fingers, held = self._kind, self.arms.fingers, self.held()
        distance = np.linalg.norm(self.desired_goal - self.achieved_goal(), axis=1)
        away, above_or_lift = self.position(), kind <= LIFT
        enclosed = self._enclosed(away)
        closed = 1.0 - np.clip((fingers.commanded - 2 * self._half) / (fingers.widest - 2 * self._half), 0.0, 1.0)
        tightest = 2 * self._half - Fingers.MAX_LEAD  # m, the command of fingers that hold a block with all their force
        opened = np.clip((fingers.commanded - tightest) / (LET_GO + Fingers.MAX_LEAD), 0.0, 1.0)
        velocity = self.arms.object_velocity[:, :3]
        force = np.maximum(0.0, -self.arms.contact_force[:, 2])
        lean = np.maximum(0.0, FREE_LEAN + self.arms.gripper_direction[:, 2])
        return RewardTerms(
            earned={
                "goal": -2.0 * distance,
                "near": 0.3 * np.maximum(0.0, 1.0 - distance / NEAR),
                "reach": np.where(kind == LIFT, -2.0 * np.linalg.norm(away, axis=1), 0.0),
                "enclose": np.where(kind == LIFT, 0.5 * enclosed * closed, 0.0),
                "hold": np.where((kind == LIFT) | (kind == CARRY), 0.3 * held, 0.0),
                "release": np.where(kind == PLACE, 0.5 * self._lies() * opened, 0.0),
            },
            costs={
                "early": np.where(above_or_lift, 0.1 * closed * (1.0 - enclosed), 0.0),
                "turned": np.where(above_or_lift, 0.1 * (1.0 - np.cos(QUARTERS * self._misalignment())), 0.0),
                "dragged": np.where((kind == PLACE) & held, 2.0 * np.hypot(velocity[:, 0], velocity[:, 1]), 0.0),
                "leaning": lean,
                "struck": np.where(held, 0.5, 5.0) * (velocity**2).sum(axis=1),
                "low": 10.0 * np.maximum(0.0, TABLE_TOP + LOWEST - self.arms.gripper_position[:, 2]),
                "pressed": 0.3 * np.clip((force - STEADY) / (PRESSED - STEADY), 0.0, 1.0),
            },
        )

    def _lies(self) -> Array:
        """Return which blocks are down where they should be, on the table or on another one, (N,) bool."""
        lies: Array = self.arms.object_pose[:, 2] < self.desired_goal[:, 2] + AT_HEIGHT
        return lies

    def _enclosed(self, away: Array) -> Array:
        """Return how far blocks are between the fingers, (N,) from 0 to 1, given gripper less block, (N, 3) m."""
        along = np.abs(np.einsum("ni,ni->n", away, self.arms.fingers.axis))
        beside = np.sqrt(np.maximum(0.0, (away**2).sum(axis=1) - along**2))
        share: Array = np.clip(2.0 - along / self._half, 0.0, 1.0) * np.clip(2.0 - beside / (0.5 * self._half), 0.0, 1.0)
        return share

    def _misalignment(self) -> Array:
        """Return the angle from the hand's closing direction to a side face of the block, seen from above, (N,) rad."""
        angle: Array = face_heading(self.arms.object_pose[:, 3:]) - heading(self.arms.fingers.axis)
        return angle

    def violations(self) -> Array:
        """See `ArmEnvironment`; adds a hand that presses on anything with more than its lasting force.

        A block in a hand may lean, and is on the table only at the end: the limits of a box do not apply.
        """
        force = np.linalg.norm(self.arms.contact_force, axis=1)
        of_arm = super().violations()
        of_box = np.zeros((self.num_envs, SAFETY_LIMITS.index("hand_force") - of_arm.shape[1]), dtype=bool)
        return np.column_stack([of_arm, of_box, force > self.robot.graspers().force])

    def failed(self) -> Array:
        """Return which blocks fell off the table, were thrown or crushed, whose other blocks toppled, and what is unstable."""
        broken = super().failed()
        height = np.nan_to_num(self.arms.object_pose[:, 2], posinf=0.0, neginf=0.0)
        speed = np.abs(self.arms.object_velocity[:, :3]).max(axis=1)
        force = -self.arms.contact_force[:, 2]
        broken |= self._toppled()
        lost: Array = broken | (height < TABLE_TOP - FALLEN * self._half) | ~(speed < THROWN) | ~(force < CRUSHED)
        return lost

    def _toppled(self) -> Array:
        """Return where one of the other blocks leans as it does not while it stands on a face, (N,) bool."""
        toppled = np.zeros(self.num_envs, dtype=bool)
        for other in range(len(self._task.others) + 1):
            turned = np.nan_to_num(self.arms.object_poses[:, 7 * other + 3 : 7 * other + 7])
            toppled |= (other != self.arms.attended) & (up(turned)[:, 2] < STANDING)
        return toppled

    def privileged(self) -> Array:
        """See `Environment`."""
        parts = (self.desired_goal - self.achieved_goal(), self.arms.object_velocity[:, :3], self.held()[:, None])
        return np.concatenate(parts, axis=1, dtype=np.float32, casting="unsafe")

    def randomize(self, parameters: Mapping[str, Array], rng: Rng) -> None:
        """See `Environment`."""
        zero = np.zeros(self.num_envs)
        self._offset = parameters.get("object_offset", np.zeros((self.num_envs, 2)))
        self._yaw = parameters.get("object_yaw", zero)
        self._progress = parameters.get("start_progress", zero)
        super().randomize(parameters, rng)

    def _true(self) -> Array:
        """See `ArmEnvironment`; adds what `shown` needs, (N, J+3+15)."""
        arms = self.arms
        hand = (arms.gripper_position, arms.object_pose[:, 3:], arms.fingers.axis, arms.gripper_direction)
        widths = np.stack([arms.fingers.width, arms.fingers.commanded], axis=1)
        return np.concatenate([super()._true(), *hand, widths], axis=1)

    def shown(self) -> Array:
        """See `ArmEnvironment`."""
        sensed = self._true() if self._sensors is None else self._measured
        ends = np.cumsum([self.joints, 3, 3, 4, 3, 3, 2])
        _, relative, gripper, turned, axis, pointing, widths, _ = np.split(sensed, ends, axis=1)
        angle = QUARTERS * (face_heading(turned) - heading(axis))
        upward = frames(turned)[:, :, 2]
        parts = (gripper - relative, np.sin(angle)[:, None], np.cos(angle)[:, None], upward, pointing)
        return np.concatenate([*parts, widths[:, :1], widths[:, :1] - widths[:, 1:]], axis=1)

    def object_seen(self) -> Array:
        """See `ArmEnvironment`; of all blocks, (N, 7K)."""
        poses = self.arms.object_poses.copy()
        if self._sensors is not None:
            relative, gripper, turned = np.split(self._measured[:, self.joints : self.joints + 10], [3, 6], axis=1)
            pose = np.concatenate([gripper - relative, turned / np.linalg.norm(turned, axis=1, keepdims=True)], axis=1)
            poses.reshape(self.num_envs, -1, 7)[np.arange(self.num_envs), self.arms.attended] = pose
        return poses

    def set_estimated_state(self, ids: Array, state: Array, sag: Array | None = None) -> None:
        """See `Environment`; a block that fingers press on is between them, and one that seems to lie on something lies there.

        As measured it would be some millimetres inside of a finger, or of the table, and be thrown out.
        """
        super().set_estimated_state(ids, state, sag)  # for where the hand is
        self._attend_next(ids)
        touching = state.copy()
        rows, attended = np.arange(len(ids)), self.arms.attended[ids]
        poses = touching[:, -self.arms.object_poses.shape[1] :].reshape(len(ids), -1, 7)
        block = poses[rows, attended]
        away = block[:, :3] - self.arms.gripper_position[ids]
        away -= (away * self.arms.fingers.axis[ids]).sum(axis=1, keepdims=True) * self.arms.fingers.axis[ids]
        distance = np.linalg.norm(away, axis=1)
        held = self._pressing()[ids] & (distance < AROUND)
        away *= np.minimum(1.0, REACH_OF_FINGERS / np.maximum(distance, 1e-9))[:, None]
        block[held, :3] = (self.arms.gripper_position[ids] + away)[held]
        lowest = TABLE_TOP + self._half
        beside = np.linalg.norm(poses[:, :, :2] - block[:, None, :2], axis=2)
        under = (beside < self._half) & (poses[:, :, 2] < block[:, None, 2] - self._half)
        lying = np.maximum(lowest, np.where(under, poses[:, :, 2] + 2 * self._half, 0.0).max(axis=1))
        off = np.abs(block[:, 2] - lying)
        lies = ~held & (off > SUNK) & (off < SEEN_LYING) & (np.abs(frames(block[:, 3:])[:, 2]).max(axis=1) > STANDING)
        block[lies, 2] = lying[lies]
        block[:, 2] = np.where(held, np.maximum(block[:, 2], lowest), block[:, 2])
        poses[rows, attended] = block
        touching[:, -poses[0].size :] = poses.reshape(len(ids), -1)
        super().set_estimated_state(ids, touching, sag)

    def estimate_achieved_goal(self, object_pose: Array | None) -> Array:
        """See `ArmEnvironment`."""
        assert object_pose is not None
        return self.achieved_goal() + self.arms.of_attended(object_pose)[:, :3] - self.arms.object_pose[:, :3]

    def recorded_state(self) -> dict[str, Array]:
        """See `Environment`."""
        state = super().recorded_state()
        first, others = np.split(self.arms.object_poses.copy(), [7], axis=1)
        more = {"other_poses": others} if others.shape[1] else {}
        return {**state, "object_pose": first, **more, "finger_position": self.arms.fingers.position}
