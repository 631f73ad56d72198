"""N arms on `mujoco.batch`, in closed loop: the one engine of training, planning and transfer."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from typing import Any

import mujoco
import numpy as np
from mujoco.batch import Batch
from numpy.typing import NDArray

import skillcli.robots.quiet  # noqa: F401
from skillcli.robots.posture import joint_ranges
from skillcli.robots.scene import GRIPPER, Hand, Names
from skillcli.simulation import table
from skillcli.simulation.fingers import Fingers
from skillcli.simulation.targets import command_range, next_target

Array = NDArray[Any]
# Compute positions and velocities at the new state; a persistent batch continues from there, so they cost nothing extra.
_NEW_STATE = int(mujoco.mjtStage.mjSTAGE_VEL)

OBJECT = "box"
MOST_OBJECTS = 3  # "box", "box2", "box3"
CONTACT_FORCE = "contact_force"  # sensor of the force on whatever touches the arm, in scenes that have one

LEVER_DAMPING = 0.03  # m/rad: damps joints with a shorter lever

# A state beyond these is unstable: joints many turns off, objects hundreds of metres away, or extreme speeds.
_FARTHEST, _FASTEST = 100.0, 1000.0


@dataclasses.dataclass
class Stretch:
    """Some control steps to do again: the state before the first of them, and the commands of each."""

    first: int  # control steps to let pass before it
    length: int  # control steps
    sim_states: Array | None = None  # (N, S)
    commands: list[Array] = dataclasses.field(default_factory=list)  # (N, J) rad each

    def note(self, sim_states: Array, commands: Array) -> None:
        """Note the next control step, if it belongs to the stretch."""
        if self.first > 0:
            self.first -= 1
        elif len(self.commands) < self.length:
            if self.sim_states is None:
                self.sim_states = sim_states.copy()
            self.commands.append(commands.copy())


class ArmBatch:
    """N simulations of one model. Increments of a commanded joint angle drive the arm.

    Increments add to the command, not to the measured position: with the wrist's 9 N·m, `measured + 0.04` stalls at 0.018 rad.
    The command is part of the simulation's control vector, so a saved state is complete.

    Args:
        model: has n joints with one position servo each, whose controls follow each other in that order, the site
            "gripper" and the geom "table"; it may have an object, a body "box" with a free joint and a geom of that name, and
            behind it further ones, see `object_names`.
        num_envs: simulations.
        substeps: physics steps per control step.
        action_limit: largest joint increment per control step, rad.
        names: the model's names of joints, servos and finger.
        threads: of the engine; results do not depend on it. 0 takes all cores.
        hand: two fingers that move; None if they stay as the model has them.
    """

    # The target may lead the arm by this much, rad: the servos lag 0.08 rad at full speed, and an arm that is held back
    # must not wind its target up.
    MAX_TRACKING_ERROR = 0.2

    def __init__(
        self,
        model: mujoco.MjModel,
        num_envs: int,
        substeps: int,
        action_limit: float,
        names: Names,
        threads: int = 0,
        hand: Hand | None = None,
    ) -> None:
        self.model, self.num_envs, self.substeps, self.action_limit = model, num_envs, substeps, action_limit
        self.batch = Batch(model, num_envs, threads, persistent=True)
        self.names = names
        servos = [model.actuator(name).id for name in names.servos]
        self._stiffness = -model.actuator_biasprm[servos, 1]  # N·m/rad
        limited = model.actuator_forcelimited[servos].astype(bool)
        strength = np.where(limited, model.actuator_forcerange[servos, 1], np.inf)  # N·m
        self.largest_sag = strength / self._stiffness  # (J,) rad: a torque beyond the servo's would drive the joint away
        joints = [model.joint(name) for name in names.joints]
        self._qpos_address = np.array([joint.qposadr[0] for joint in joints])
        together = bool((np.diff(self._qpos_address) == 1).all())  # as in most models; a slice is copied more quickly
        self._arm = slice(self._qpos_address[0], self._qpos_address[-1] + 1) if together else self._qpos_address
        self._dof_address = np.array([joint.dofadr[0] for joint in joints])
        self._range = joint_ranges(model, names.joints)
        self._low, self._high = command_range(model, names).T
        first = model.actuator_ctrladr[servos[0]]
        self._qpos, self._ctrl = self.batch.bind("qpos"), self.batch.bind("ctrl")[:, first : first + len(servos)]
        self._site = self.batch.bind("site_xpos")[:, model.site(GRIPPER).id]
        self._site_axes = self.batch.bind("site_xmat")[:, model.site(GRIPPER).id]
        self.objects = object_names(model)
        self.attended = np.zeros(num_envs, dtype=np.int64)  # of several objects the one that pose and velocity are of
        if self.objects:
            self._first_object = model.joint(self.objects[0])
        if any(model.sensor(k).name == CONTACT_FORCE for k in range(model.nsensor)):
            first = model.sensor(CONTACT_FORCE).adr[0]
            self._contact_force = slice(first, first + 3)
        self._qvel = self.batch.bind("qvel")
        self._fingers = None if hand is None else Fingers(self.batch, hand)
        self._default_row = self.batch.state[0].copy()
        self.active: Array | None = None  # ids of the simulations to step; None for all
        self._perturbed: set[str] = set()  # model fields that differ between simulations
        self._history = ActuatorHistory(self.batch, servos, substeps)
        self._response: Array | None = None  # (N, J) share of an increment that moves the command; None: all of it
        self._restart: Array | None = None  # (N, 1) share of the lead that a command forgets; None: nothing
        self.noted: Stretch | None = None  # control steps that somebody wants to do again

    @property
    def joint_position(self) -> Array:
        """Return true joint angles, (N, J) rad."""
        arm: Array = self._qpos[:, self._arm]
        return arm.copy() if isinstance(self._arm, slice) else arm

    @property
    def commanded(self) -> Array:
        """Return commanded joint angles, including delayed ones, (N, J) rad; a live view."""
        target: Array = self._ctrl
        return target

    @property
    def target_range(self) -> tuple[Array, Array]:
        """Return the lowest and the highest commanded angle of each joint, (J,) rad each."""
        return self._low, self._high

    @property
    def joint_velocity(self) -> Array:
        """Return true joint speeds, (N, J) rad/s."""
        speed: Array = self._qvel[:, self._dof_address]
        return speed

    @property
    def fingers(self) -> Fingers:
        """Return the two fingers of the hand; only where they move."""
        assert self._fingers is not None
        return self._fingers

    def past_range(self) -> Array:
        """Return how far each joint is beyond its range, (N, J) rad; negative inside."""
        low, high = self._range.T
        arm = self.joint_position
        past: Array = np.maximum(low - arm, arm - high)
        return past

    def geom_frames(self) -> tuple[Array, Array]:
        """Return positions (N, G, 3) m and rotation matrices (N, G, 9) of all geoms; live views."""
        return self.batch.bind("geom_xpos"), self.batch.bind("geom_xmat")

    @property
    def gripper_position(self) -> Array:
        """Return the gripper site in the base frame, (N, 3) m; a live view."""
        site: Array = self._site
        return site

    @property
    def gripper_direction(self) -> Array:
        """Return the direction in which the gripper points, unit vectors (N, 3) in the base frame."""
        direction: Array = self._site_axes.reshape(-1, 3, 3)[:, :, 2]
        return direction

    def of_attended(self, values: Array) -> Array:
        """Return the part of values (N, wK) of K objects that is of the one attended, (N, w).

        It is a view where all attend to the first.
        """
        width = values.shape[1] // len(self.objects)
        if not self.attended.any():
            return values[:, :width]
        part: Array = values[np.arange(len(values))[:, None], width * self.attended[:, None] + np.arange(width)]
        return part

    @property
    def object_poses(self) -> Array:
        """Return the poses of all objects, one after the other, (N, 7K) m and w x y z; a live view."""
        first = self._first_object.qposadr[0]
        poses: Array = self._qpos[:, first : first + 7 * len(self.objects)]
        return poses

    @property
    def object_pose(self) -> Array:
        """Return the pose of the attended object in the base frame, (N, 7) m and w x y z; see `of_attended`."""
        return self.of_attended(self.object_poses)

    @property
    def object_velocity(self) -> Array:
        """Return its velocity, linear in the base frame and angular in its own, (N, 6) m/s and rad/s; see `of_attended`."""
        first = self._first_object.dofadr[0]
        return self.of_attended(self._qvel[:, first : first + 6 * len(self.objects)])

    @property
    def contact_force(self) -> Array:
        """Return the net force of the arm on everything it touches, in the last physics step, (N, 3) N; a live view."""
        force: Array = self.batch.bind("sensordata")[:, self._contact_force]
        return force

    def reset_to(self, ids: Array, joint_position: Array, object_pose: Array | None = None, hand: Array | None = None) -> None:
        """Put arms at rest at joint angles (n, J) rad, clipped to the joint range, with servos holding them there.

        An object is put at rest at poses (n, 7) m and w x y z, several at poses (n, 7K); for the hand see `set_state`.
        """
        q = np.clip(joint_position, self._low, self._high)
        self.set_state(ids, q, np.zeros_like(q), q[:, None], object_pose, hand=hand)

    def set_state(
        self,
        ids: Array,
        joint_position: Array,
        joint_velocity: Array,
        commands: Array,
        object_pose: Array | None = None,
        sag: Array | None = None,
        hand: Array | None = None,
    ) -> None:
        """Put arms into a state of motion; an object and the fingers are at rest.

        Args:
            ids: (n,) simulations.
            joint_position: (n, J) rad.
            joint_velocity: (n, J) rad/s.
            commands: (n, c, J) rad, commanded angles of the last control steps, the present one last; before them the first
                one was held.
            object_pose: (n, 7) m and w x y z; of several objects (n, 7K).
            sag: (n, J) rad, resting offset of the joints from their commands: from now on a torque pulls them there. It is part
                of the state; at most `largest_sag`.
            hand: (n, 2) m, width between the fingers, and the commanded width.
        """
        self.batch.state[ids] = self._default_row
        self._qpos[np.ix_(ids, self._qpos_address)] = joint_position
        self._qvel[np.ix_(ids, self._dof_address)] = joint_velocity
        if object_pose is not None:
            self.object_poses[ids] = object_pose
        if sag is not None:
            self.batch.bind("qfrc_applied")[np.ix_(ids, self._dof_address)] = self._stiffness * sag
        if hand is not None:
            self.fingers.set_state(ids, hand)
        self._ctrl[ids] = commands[:, -1]
        self._history.fill(ids, commands)  # else the servos would first follow a history of zeros
        self.batch.forward(np.sort(ids), stage=_NEW_STATE)

    def step(self, increment: Array, latency: Array | None = None) -> Array:
        """Add increments (N, J) rad to the commands and advance by one control step.

        A robot may follow a share of an increment only (`command_response`), or add it to the joint angle instead of the
        command (`command_restart`).

        Args:
            increment: of each joint's command.
            latency: (N,) physics steps of this control step during which the previous commands still hold.

        Returns:
            (N, J) rad: how far the commanded targets moved, after clipping to the action limit, to at most `MAX_TRACKING_ERROR`
            from the measured joint angle, and to the joint range. More than the action limit only where an arm that is pushed
            takes its target along.
        """
        increment = np.clip(increment, -self.action_limit, self.action_limit)
        measured, commanded = self.joint_position, self._ctrl
        if self._response is not None:
            increment = increment * self._response
        begin = commanded if self._restart is None else commanded - self._restart * (commanded - measured)
        target = next_target(begin, increment, measured, self._low, self._high, self.MAX_TRACKING_ERROR)
        as_asked = target == commanded + increment if self._restart is None else np.False_
        moved: Array = np.where(as_asked, increment, target - commanded)
        if self.noted is not None:
            self.noted.note(self.batch.state, target)
        done = 0
        for late in np.unique(latency) if latency is not None else (0,):
            if late > done:
                self.batch.step(self.active, nstep=int(late - done), stage=_NEW_STATE)
                done = late
            due = slice(None) if latency is None else latency == late
            self._ctrl[due] = target[due]
        if done < self.substeps:
            self.batch.step(self.active, nstep=int(self.substeps - done), stage=_NEW_STATE)
        return moved

    def coast(self, substeps: int) -> None:
        """Advance by physics steps with the commands as they are."""
        self.batch.step(self.active, nstep=substeps, stage=_NEW_STATE)

    def save(self, ids: Array) -> Array:
        """Return whole simulator states, (n, S); valid for the same model and MuJoCo version only."""
        sim_states: Array = self.batch.state[ids]
        return sim_states

    def restore(self, ids: Array, sim_states: Array) -> None:
        """Put saved states into these simulations."""
        self.batch.state[ids] = sim_states
        self.batch.forward(np.sort(ids), stage=_NEW_STATE)

    def randomize(self, parameters: Mapping[str, Array]) -> None:
        """Give each simulation parameters of its own; see `skillcli.config.randomization.PARAMETERS`.

        Args:
            parameters: (N,) or (N, n) by name; absent ones are as in the model. Start and sensors are not handled here.
        """
        self._response = _unless(1.0, parameters.get("command_response"))
        self._restart = _unless(0.0, parameters.get("command_restart"))
        batch, model = self.batch, self.model
        dofs = np.array([model.joint(name).dofadr[0] for name in self.names.joints])
        links = np.array([model.joint(name).bodyid[0] for name in self.names.joints])
        servos = np.array([model.actuator(name).id for name in self.names.servos])
        top = model.geom("table").id
        touching = np.array(
            [model.geom(name).id for name in ("table", *((*self.objects, *self.names.finger) if self.objects else ()))]
        )
        objects = np.array([model.body(name).id for name in self.objects], dtype=int)
        boxes = np.array([model.geom(name).id for name in self.objects], dtype=int)
        changed: dict[str, list[tuple[str, tuple[Any, ...], int]]] = {
            # parameter: model field, index in it, and the power to which it multiplies; 0: it is added
            "link_mass": [("body_mass", (links,), 1), ("body_inertia", (links,), 1)],
            "link_inertia": [("body_inertia", (links,), 1)],
            "armature": [("dof_armature", (dofs,), 1)],
            "gravity_compensation": [("body_gravcomp", (slice(None),), 1)],
            "object_mass": [("body_mass", (objects,), 1), ("body_inertia", (objects,), 1)],
            # set_const computes bounding volumes from the size
            "object_size": [("geom_size", (boxes,), 1), ("body_inertia", (objects,), 2)],
            "joint_damping": [("dof_damping", (dofs,), 1)],
            "joint_friction": [("dof_frictionloss", (dofs,), 1)],
            # kp is in gain and bias, kv in the bias: kv must scale too, since dampratio is fixed at compile time
            "gain": [("actuator_gainprm", (servos,), 1), ("actuator_biasprm", (servos,), 1)],
            "contact_friction": [("geom_friction", (touching, slice(0, 1)), 1)],
            "table_height": [("geom_pos", (top, slice(2, 3)), 0)],
            "table_tilt": [("geom_pos", (top,), 0), ("geom_quat", (top,), 0)],
            "latency": [("actuator_delay", (servos,), 0)],
        }
        drawn = {name: values for name, values in parameters.items() if name in changed}
        self._perturbed |= {field for name in drawn for field, _, _ in changed[name]}
        live = {field: batch.expand(field) for field in sorted(self._perturbed)}
        for field, values in live.items():
            values[:] = getattr(model, field)
        if "table_tilt" in drawn:
            self._tilt_table(live, top, drawn.pop("table_tilt"))
        for name in sorted(drawn):
            for field, where, power in changed[name]:
                values, at = live[field], (slice(None), *where)
                change = drawn[name].reshape(self.num_envs, -1, *(1,) * (values[at].ndim - 2))
                values[at] = values[at] * change**power if power else values[at] + change
        batch.set_const()

    def _tilt_table(self, live: Mapping[str, Array], top: int, tilt: Array) -> None:
        """Turn the table about the middle of its top, by rotation vectors (N, 2) rad."""
        half = self.model.geom_size[top, 2]
        upright = np.array([0.0, 0.0, 1.0])
        live["geom_pos"][:, top] += half * (upright - table.normal(tilt))
        live["geom_quat"][:, top] = table.quaternion(tilt)

    def apply_external_force(self, arm: Array, box: Array) -> None:
        """Apply forces (N, 3) N to the last link and to the box, if there is one, until `release`."""
        forces = self.batch.bind("xfrc_applied")
        forces[:, self.model.site("gripper").bodyid[0], :3] = arm
        if self.objects:
            forces[:, self.model.body(OBJECT).id, :3] = box

    def release(self) -> None:
        """Remove the forces of `apply_external_force`."""
        self.batch.bind("xfrc_applied")[:] = 0.0

    def reported_shift(self, offset: Array) -> Array:
        """Return the error of the gripper position computed from joint angles with errors (N, J) rad, (N, 3) m; first order."""
        shift: Array = np.einsum("nj,njk->nk", offset, self._lever())
        return shift

    def turns_towards(self, shift: Array) -> Array:
        """Return the smallest turns of the joints, (N, J) rad, that move the grippers by (N, 3) m; first order, damped."""
        lever = self._lever()
        across = lever.transpose(0, 2, 1) @ lever + LEVER_DAMPING**2 * np.eye(3)
        turn: Array = (lever @ np.linalg.solve(across, shift[:, :, None]))[:, :, 0]
        return turn

    def _lever(self) -> Array:
        """Return the Jacobian of the gripper position, (N, J, 3) m/rad."""
        joints = [self.model.joint(name).id for name in self.names.joints]
        axis, anchor = self.batch.bind("xaxis")[:, joints], self.batch.bind("xanchor")[:, joints]
        lever: Array = np.cross(axis, self._site[:, None] - anchor)
        return lever

    def unstable(self) -> Array:
        """Return which simulations have a state that is not finite or far out of range, (N,) bool."""
        qpos, qvel = self._qpos, self._qvel
        # As a rule none is: the norm of a whole state, quick to compute, bounds every number in it.
        far, fast = np.einsum("ij,ij->i", qpos, qpos), np.einsum("ij,ij->i", qvel, qvel)
        if far.max() < _FARTHEST**2 and fast.max() < _FASTEST**2:  # false for NaN
            return np.zeros(self.num_envs, dtype=bool)
        broken: Array = ~((np.abs(qpos).max(axis=1) < _FARTHEST) & (np.abs(qvel).max(axis=1) < _FASTEST))
        return broken


def object_names(model: mujoco.MjModel) -> tuple[str, ...]:
    """Return the names of the objects in a model in order."""
    known = {model.joint(joint).name for joint in range(model.njnt)}
    return tuple(name for name in (OBJECT, *(f"{OBJECT}{index}" for index in range(2, MOST_OBJECTS + 1))) if name in known)


def _unless(neutral: float, values: Array | None) -> Array | None:
    """Return values (N,) or (N, J) with one column for each joint or for all, None where all are neutral."""
    if values is None or (values == neutral).all():
        return None
    return values.reshape(len(values), -1)


class ActuatorHistory:
    """The commands that servos keep: delayed ones, and the state of servos that filter them."""

    def __init__(self, batch: Batch, servos: list[int], substeps: int) -> None:
        model, self._substeps = batch.model, substeps
        self._buffer, self._act = batch.bind("history"), batch.bind("act")  # (N, 0) if the model keeps none
        # per actuator: two counters, n times, n values
        self._values = [
            (joint, model.actuator_historyadr[servo] + 2 + samples + np.arange(samples))
            for joint, servo in enumerate(servos)
            if (samples := model.actuator_history[servo, 0])
        ]
        self._filters = [(joint, adr) for joint, servo in enumerate(servos) if (adr := model.actuator_actadr[servo]) >= 0]

    def fill(self, ids: Array, commands: Array) -> None:
        """Set the history of these simulations to the commands of the last control steps.

        Args:
            ids: (n,) simulations.
            commands: (n, c, J) rad, the present command last; before the first, the first was held.
        """
        last = commands.shape[1] - 1
        for joint, values in self._values:
            steps_ago = np.arange(len(values) - 1, -1, -1) // self._substeps
            self._buffer[np.ix_(ids, values)] = commands[:, np.maximum(last - steps_ago, 0), joint]
        for joint, address in self._filters:
            self._act[ids, address] = commands[:, -1, joint]
