"""The two classes that Gymnasium sees: one environment, and N of them in one batch."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import gymnasium
import numpy as np
from gymnasium.utils import seeding
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space

from skillcli.errors import UsageError
from skillcli.gym.episodes import Episodes, Observations, Played, finite_actions
from skillcli.trajectories import Array

_ALONE = np.zeros(1, dtype=np.int64)


class SkillEnv(gymnasium.Env[Any, Any]):
    """One environment: a batch of one.

    A seed determines the goal of the next episode, and with the actions all of it. A reset without a seed draws the next goal
    from the same random numbers. Options of a reset: `goal` as it is typed on the command line, or `skill`, the index of a
    trained goal.

    Args:
        episodes: one episode.
    """

    metadata = {"render_modes": []}  # noqa: RUF012

    def __init__(self, episodes: Episodes) -> None:
        self.episodes = episodes
        self.observation_space, self.action_space = episodes.observation_space, episodes.action_space
        self.metadata = {"render_modes": [], "render_fps": round(1 / episodes.control_period)}
        self._shape = episodes.action_space.shape

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Any, dict[str, Any]]:
        """See gymnasium."""
        super().reset(seed=seed)
        goal = self.episodes.goals.given(options)
        if goal is None:
            goal = self.episodes.goals.draw(self.np_random)
        self.episodes.begin(_ALONE, goal[None])
        return _first(self.episodes.observe()), {"goal": goal.copy()}

    def step(self, action: Any) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        """See gymnasium; `info` has the distance to the goal, m, and whether it is within the tolerance."""
        played = self.episodes.step(finite_actions(action, self._shape)[None], None)
        info = {"distance": float(played.distance[0]), "is_success": bool(played.success[0])}
        terminated, truncated = bool(played.terminated[0]), bool(played.truncated[0])
        return _first(self.episodes.observe()), float(played.reward[0]), terminated, truncated and not terminated, info


class GoalEnv(SkillEnv):
    """The same with `achieved_goal` and `desired_goal`, for hindsight experience replay."""

    def compute_reward(self, achieved_goal: Array, desired_goal: Array, info: Any) -> Array:
        """Return 1 within the task's tolerance of the goal and 0 elsewhere, (..., 3) m twice to (...,).

        A failure ends the episode and so earns nothing from then on: failing early never pays.
        """
        distance = np.linalg.norm(np.asarray(achieved_goal) - np.asarray(desired_goal), axis=-1)
        reward: Array = (distance <= self.episodes.world.task.tolerance).astype(float)
        return reward


class SkillVectorEnv(VectorEnv[Any, Any, Any]):
    """N environments in one batch of the engine, `gymnasium.make_vec`.

    The step after its end resets an episode, ignores its action and earns nothing (`AutoresetMode.NEXT_STEP`). Environment i
    of seed s is the single environment of seed s + i.

    Args:
        episodes: N episodes.
    """

    def __init__(self, episodes: Episodes) -> None:
        self.episodes, self.num_envs = episodes, episodes.num_envs
        self.metadata = {
            "render_modes": [],
            "render_fps": round(1 / episodes.control_period),
            "autoreset_mode": AutoresetMode.NEXT_STEP,
        }
        self.single_observation_space, self.single_action_space = episodes.observation_space, episodes.action_space
        self.observation_space = batch_space(self.single_observation_space, self.num_envs)
        self.action_space = batch_space(self.single_action_space, self.num_envs)
        self._shape = (self.num_envs, *episodes.action_space.shape)
        self._everyone = np.arange(self.num_envs)
        self._rngs: list[np.random.Generator] = []
        self._over = np.zeros(self.num_envs, dtype=bool)  # ended in the last step

    def reset(
        self, *, seed: int | Sequence[int | None] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Any, dict[str, Any]]:
        """See gymnasium."""
        self._reseed(seed)
        goal = self.episodes.goals.given(options)
        self._begin(self._everyone, goal)
        self._over[:] = False
        return self.episodes.observe(), {}

    def step(self, actions: Any) -> tuple[Any, Array, Array, Array, dict[str, Any]]:
        """See gymnasium; `infos` as that of one environment, (N,) each."""
        if not self._rngs:
            raise UsageError("the environments have no episodes yet", "call reset() before step()")
        action, over = finite_actions(actions, self._shape), self._over
        renewed = np.flatnonzero(over)
        if len(renewed) < self.num_envs:
            played = self.episodes.step(action, np.flatnonzero(~over) if len(renewed) else None)
        else:
            played = Played(*(np.zeros(self.num_envs, dtype=kind) for kind in (float, bool, bool, float, bool)))
        observed = ~over
        if len(renewed):
            self._begin(renewed)
        terminated = played.terminated & observed
        truncated = played.truncated & observed & ~terminated
        self._over = terminated | truncated
        infos = {"distance": played.distance, "_distance": observed, "is_success": played.success, "_is_success": observed}
        return self.episodes.observe(), np.where(over, 0.0, played.reward), terminated, truncated, infos

    def _reseed(self, seed: int | Sequence[int | None] | None) -> None:
        seeds = [seed + i for i in range(self.num_envs)] if isinstance(seed, int | np.integer) else seed
        if seeds is None:
            seeds = [None] * self.num_envs
        if len(seeds) != self.num_envs:
            raise UsageError(f"reset: expected {self.num_envs} seeds, got {len(seeds)}", "give one number, or one for each")
        old: Sequence[np.random.Generator | None] = self._rngs or [None] * self.num_envs
        self._rngs = [
            rng if rng is not None and one is None else seeding.np_random(one)[0] for rng, one in zip(old, seeds, strict=True)
        ]

    def _begin(self, ids: Array, goal: Array | None = None) -> None:
        goals = [self.episodes.goals.draw(self._rngs[i]) if goal is None else goal for i in ids]
        self.episodes.begin(ids, np.array(goals))


def _first(observation: Observations) -> Any:
    if isinstance(observation, dict):
        return {name: values[0] for name, values in observation.items()}
    return observation[0]
