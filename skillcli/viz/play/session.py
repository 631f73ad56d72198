"""`PlaySession`: one simulated arm with the skills of a library, and everything that can be asked of it while it runs.

The clock runs only while something is held or played: before the first skill, while a plan is made and once it has been
played, simulated time stands still. So a plan begins in the very state that it was made for, and a take has no gaps: the same
latents from the same start repeat it.
"""

from __future__ import annotations

import threading
from collections.abc import Callable

import numpy as np

from skillcli.composition import sequence
from skillcli.composition.plan import Segment, schedule
from skillcli.errors import SkillError, UsageError
from skillcli.evaluation.library import Library
from skillcli.robots.robot import load_target
from skillcli.seeding import generator
from skillcli.simulation.environment import NO_SKILL
from skillcli.trajectories import SAFETY_LIMITS, Array
from skillcli.viz.play import knobs
from skillcli.viz.play.planning import Cancelled, Start, make_plan
from skillcli.viz.play.state import Pose, Status, between
from skillcli.viz.play.take import LONGEST, Recorder, Take

MARGIN = 3.0  # standard deviations around the means that latents can be chosen from


class PlaySession:
    """One simulation of a library's task. All methods may be called from any thread.

    Args:
        library: the skills.
        on_take: called with every finished take, from the thread that ended it.
        seed: of random methods.
    """

    def __init__(self, library: Library, on_take: Callable[[Take], None] = lambda _: None, seed: int = 0) -> None:
        self.library, self._on_take, self._seed = library, on_take, seed
        self.knobs = knobs.knobs_for(library.world.spec.uses_robot)
        self.values = knobs.nominal(self.knobs)
        self.bounds = _bounds(library)  # (2, d)
        self.lock = threading.RLock()
        self.world = library.world
        self._latent, self._skill, self._label = library.mean[0].copy(), 0, library.names[0]
        self._queue: list[Segment] = []
        self._done_of_segment = 0
        self._running = False
        self._planning, self._cancel = "", threading.Event()
        self._recorder: Recorder | None = None
        self._said, self._violations = "", dict[str, None]()
        self._goal = library.goals[0].copy()
        self._take_robot()

    # --- the simulated robot --------------------------------------------------------------------------------------------

    def _take_robot(self) -> None:
        """Simulate the robot of the present world, from the start."""
        self._env = self.world.make_randomized_env(np.array([NO_SKILL]), self._parameters(), generator(self._seed, "play"))
        self._restart()

    def _parameters(self) -> dict[str, Array]:
        return knobs.parameters(self.values, self.world.joints)

    def _restart(self) -> None:
        self._env.reset(np.array([0]), np.array([NO_SKILL]))
        self._env.desired_goal[0] = self._goal
        self._observation = self._env.observe()
        self._running, self._queue, self._steps = False, [], 0
        self._violations = {}
        self._before = self._after = self._pose()

    @property
    def period(self) -> float:
        """Return the control period, s."""
        return float(self._env.control_period)

    def reset(self) -> None:
        """Put the arm, and the box if there is one, back to the start, where it waits; ends a recording."""
        with self.lock:
            self.cancel()
            self._end_take()
            self._restart()
            self._said = "at the start"

    def set_knob(self, name: str, value: float) -> None:
        """Turn one parameter of the robot while it runs.

        Raises:
            UsageError: there is no such parameter, or the value is not a number.
        """
        with self.lock:
            self.values[name] = knobs.checked(self.knobs, name, value)
            every = np.array([0])
            state = self._env.save(every)
            self._env.randomize(self._parameters(), generator(self._seed, "play"))
            self._env.restore(every, state)

    def set_robot(self, which: str) -> None:
        """Play on another robot of the same build, from the start: the name of a bundled one, or a robot file.

        Raises:
            UsageError: there is no such robot, it is another arm, or the task has none.
        """
        source = self.library.world.robot
        if not self.library.world.spec.uses_robot:
            raise UsageError(f"the {self.library.recipe.task.name} task has no robot", "it is simulated without an arm")
        target = load_target(which, source)
        world = self.library.world if target is source else self.library.world.on(target)
        with self.lock:
            self.cancel()
            self._end_take()
            before, self.world = self.world, world
            try:
                self._take_robot()
            except SkillError:
                self.world = before
                raise
            self._said = f"the arm is {world.robot.name}" + "".join(f"; {note}" for note in target.notes)

    # --- what it does ---------------------------------------------------------------------------------------------------

    def hold_skill(self, skill: int) -> None:
        """Hold the mean latent of a skill from now on."""
        with self.lock:
            self._hold(self.library.mean[skill].copy(), skill, self.library.names[skill])

    def hold_latent(self, latent: Array) -> None:
        """Hold any latent (d,) from now on, clipped to `bounds`; the mean of a skill counts as that skill.

        Raises:
            UsageError: it has another size, or is not finite.
        """
        latent = np.asarray(latent, dtype=float)
        if latent.shape != self.library.mean.shape[1:] or not np.isfinite(latent).all():
            raise UsageError(f"a latent has {self.library.mean.shape[1]} numbers, got {latent}", "give one for each dimension")
        latent = np.clip(latent, *self.bounds)
        equal = np.flatnonzero((self.library.mean == latent).all(axis=1))
        with self.lock:
            self._hold(latent, int(equal[0]) if len(equal) else -1, self.library.names[equal[0]] if len(equal) else "latent")

    def _hold(self, latent: Array, skill: int, label: str) -> None:
        self.cancel()
        self._latent, self._skill, self._label = latent, skill, label
        self._queue, self._running, self._said = [], True, ""

    def pause(self) -> None:
        """Let the clock stand still."""
        with self.lock:
            self._running = False

    def resume(self) -> None:
        """Let the clock run on."""
        with self.lock:
            if not self._planning:
                self._running = True

    def play_plan(self, segments: list[Segment]) -> None:
        """Play a plan from the present state; afterwards the clock stands still."""
        with self.lock:
            self.cancel()
            self._queue, self._done_of_segment = list(segments), 0
            self._running = bool(segments)

    def play_text(self, text: str) -> None:
        """Play a plan written by hand, in the syntax of `compose --method sequence`.

        Raises:
            UsageError: it cannot be read.
        """
        entries = sequence.parse(text, self.library.names, 1.0)
        self.play_plan([entry.segment(self.library.mean, self.period) for entry in entries])

    def set_goal(self, place: Array) -> None:
        """Move the goal (3,) m; in a plane task its height does not count.

        Raises:
            UsageError: it is not finite.
        """
        place = np.asarray(place, dtype=float)
        if place.shape != (3,) or not np.isfinite(place).all():
            raise UsageError(f"a goal is three finite numbers, got {place}", "x, y and z in m")
        size = len(self.library.recipe.task.goals[0])
        goal = self.library.goals[0].copy()
        goal[:size] = place[:size]
        with self.lock:
            self._goal = goal
            self._env.desired_goal[0] = goal

    @property
    def goal(self) -> Array:
        """Return the goal, (3,) m."""
        goal: Array = self._goal.copy()
        return goal

    # --- planning -------------------------------------------------------------------------------------------------------

    def plan(self, method: str) -> None:
        """Plan from the present state to the goal, and play the plan; the clock stands still meanwhile.

        The planner simulates the nominal robot of the library and sees the state that the sensors show: whatever else is
        simulated here is to it what a real arm is.

        Raises:
            SkillError: the goal cannot be reached, or the method fails.
        """
        with self.lock:
            self.cancel()
            cancel = self._cancel = threading.Event()
            goal, self._running, self._planning, self._said = self.goal, False, f"{method} begins", ""
            self._env.observe()
            start = Start(self._env.estimate_state().state, goal)

        def told(text: str) -> None:
            if cancel.is_set():
                raise Cancelled
            self._planning = text

        try:
            self.library.world.check_goal(goal)
            found = make_plan(self.library, method, start, self._seed, told)
        except Cancelled:
            return
        except SkillError as error:
            self._planned(cancel, [], error.message)
            raise
        except BaseException:
            self._planned(cancel, [], "planning failed")
            raise
        seconds = sum(segment.steps for segment in found.segments) * self.period
        counted = f"{len(found.segments)} segment" + ("s" if len(found.segments) != 1 else "")
        notes = "".join(f"; {note}" for note in found.notes)
        self._planned(cancel, found.segments, f"{method}: {counted}, {seconds:.1f} s{notes}")

    def _planned(self, cancel: threading.Event, segments: list[Segment], said: str) -> None:
        with self.lock:
            if cancel.is_set():
                return
            self._planning, self._said = "", said
            self._queue, self._done_of_segment, self._running = list(segments), 0, bool(segments)

    def cancel(self) -> None:
        """Give up the plan that is being made; it stops with its next step and is dropped."""
        with self.lock:
            self._cancel.set()
            self._planning = ""

    # --- recording ------------------------------------------------------------------------------------------------------

    def record(self) -> None:
        """Begin a take at the start: a recording that does not begin there could not be repeated."""
        with self.lock:
            self.reset()
            self._recorder = Recorder(self._env, None if self.world is self.library.world else self.world.robot)
            self._said = "recording begins with the first skill, latent or plan"

    def stop_recording(self) -> None:
        """End the take, if there is one."""
        with self.lock:
            self._running = False
            self._end_take()

    def _end_take(self) -> None:
        recorder, self._recorder = self._recorder, None
        take = recorder.take() if recorder is not None else None
        if take is not None:
            self._on_take(take)

    # --- time -----------------------------------------------------------------------------------------------------------

    def step(self) -> bool:
        """Make one control step if the clock runs; returns whether it did."""
        with self.lock:
            self._before = self._after
            if not self._running:
                return False
            self._choose()
            step = self._env.step(self.library.agent.act(self._observation, self._latent[None]))
            self._observation = step.observation
            self._steps += 1
            for limit in self._broken():
                self._violations[limit] = None
            if self._recorder is not None:
                self._recorder.add(self._latent, self._skill, step, self.values)
            if step.terminated[0]:
                self._end_take()
                self._restart()
                self._said = "failed, back at the start: the simulation diverged or the task was lost"
                return True
            self._after = self._pose()
            if self._recorder is not None and self._recorder.seconds >= LONGEST:
                self._said = f"the recording ends after {LONGEST:g} s"
                self._end_take()
            return True

    def _choose(self) -> None:
        """Take the latent of this control step from the plan, if there is one; with its last step the clock stops."""
        if not self._queue:
            return
        segment = self._queue[0]
        latents, skills = schedule([segment])
        self._latent, self._skill = latents[self._done_of_segment], int(skills[self._done_of_segment])
        self._label = segment.label
        self._done_of_segment += 1
        if self._done_of_segment == segment.steps:
            self._queue, self._done_of_segment = self._queue[1:], 0
            self._running = bool(self._queue)

    def _broken(self) -> list[str]:
        violated = self._env.violations()[0]
        return [name for name, broken in zip(SAFETY_LIMITS, violated, strict=False) if broken]

    def _pose(self) -> Pose:
        state = self._env.recorded_state()
        joints, fingers = (state.get(name) for name in ("joint_position", "finger_position"))
        boxes = [state[name][0] for name in ("object_pose", "other_poses") if name in state]
        return Pose(
            self._env.achieved_goal()[0].copy(),
            None if joints is None else joints[0].copy(),
            np.concatenate(boxes) if boxes else None,
            None if fingers is None else fingers[0].copy(),
        )

    def pose(self, share: float = 1.0) -> Pose:
        """Return what to draw at this share of the way between the last two control steps."""
        with self.lock:
            return between(self._before, self._after, share)

    @property
    def latent(self) -> Array:
        """Return the present latent, (d,)."""
        latent: Array = self._latent.copy()
        return latent

    def status(self) -> Status:
        """Return what is shown beside the arm."""
        with self.lock:
            return Status(
                running=self._running,
                planning=self._planning,
                recording=None if self._recorder is None else self._recorder.seconds,
                seconds=self._steps * self.period,
                skill=self._label,
                distance=float(np.linalg.norm(self._env.achieved_goal()[0] - self._goal)),
                tolerance=self._env.tolerance,
                violated=tuple(self._broken()),
                violations=tuple(self._violations),
                said=self._said,
            )

    def say(self, message: str) -> None:
        """Show a message to everybody."""
        self._said = message

    def close(self) -> None:
        """Give up planning and end the take, so that it is kept."""
        with self.lock:
            self._running = False
            self.cancel()
            self._end_take()


def _bounds(library: Library) -> Array:
    """Return lowest and highest latent that can be chosen, (2, d)."""
    reach = MARGIN * library.std
    bounds: Array = np.stack([(library.mean - reach).min(axis=0), (library.mean + reach).max(axis=0)])
    return bounds
