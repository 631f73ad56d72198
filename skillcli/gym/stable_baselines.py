"""N environments in one batch for Stable-Baselines3, which has an interface of its own for several environments."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import gymnasium
import numpy as np
from gymnasium.utils import seeding
from stable_baselines3.common.vec_env import VecEnv

from skillcli.gym.environments import SkillVectorEnv
from skillcli.gym.episodes import Episodes, Observations, finite_actions
from skillcli.trajectories import Array


class BatchVecEnv(VecEnv):
    """The environments of `gymnasium.make_vec` as Stable-Baselines3 takes them.

    An episode that ends is reset in the same step; its last observation is in `infos[i]["terminal_observation"]`.

    Args:
        envs: of `gymnasium.make_vec("skill/…", num_envs=N)`; use it no more.
        seed: environment i begins as the single environment of seed + i.
    """

    def __init__(self, envs: gymnasium.vector.VectorEnv[Any, Any, Any], seed: int = 0) -> None:
        inner = envs.unwrapped
        assert isinstance(inner, SkillVectorEnv)
        self.episodes: Episodes = inner.episodes
        self.render_mode = None
        super().__init__(inner.num_envs, inner.single_observation_space, inner.single_action_space)
        self._rngs = [seeding.np_random(seed + i)[0] for i in range(self.num_envs)]
        self._action: Array = np.zeros((self.num_envs, *self.episodes.action_space.shape))

    def reset(self) -> Any:
        """See Stable-Baselines3."""
        self._begin(np.arange(self.num_envs))
        return self.episodes.observe()

    def reset_to(self, goals: Array) -> Any:
        """Start all episodes with these goals, (N, 3) m, and return the observations."""
        self.episodes.begin(np.arange(self.num_envs), goals)
        return self.episodes.observe()

    def step_async(self, actions: Any) -> None:
        """See Stable-Baselines3."""
        self._action = finite_actions(actions, self._action.shape)

    def step_wait(self) -> Any:
        """See Stable-Baselines3."""
        played = self.episodes.step(self._action, None)
        over, observations = played.terminated | played.truncated, self.episodes.observe()
        infos: list[dict[str, Any]] = [
            {"distance": float(distance), "is_success": bool(success)}
            for distance, success in zip(played.distance, played.success, strict=True)
        ]
        ended = np.flatnonzero(over)
        for i in ended:
            infos[i]["terminal_observation"] = _row(observations, int(i))
            infos[i]["TimeLimit.truncated"] = bool(played.truncated[i] and not played.terminated[i])
        if len(ended):
            self._begin(ended)
            observations = self.episodes.observe()
        return observations, played.reward.astype(np.float32), over, infos

    def _begin(self, ids: Array) -> None:
        self.episodes.begin(ids, np.array([self.episodes.goals.draw(self._rngs[i]) for i in ids]))

    def close(self) -> None:
        """See Stable-Baselines3; there is nothing to close."""

    def get_attr(self, attr_name: str, indices: Any = None) -> list[Any]:
        """See Stable-Baselines3: the attribute of the batch, once for each."""
        return [getattr(self, attr_name, None) for _ in self._get_indices(indices)]

    def set_attr(self, attr_name: str, value: Any, indices: Any = None) -> None:
        """Refuse: all environments are one."""
        raise AttributeError(f"{attr_name} cannot be set: all environments are one batch")

    def env_method(self, method_name: str, *method_args: Any, indices: Any = None, **method_kwargs: Any) -> list[Any]:
        """Call a method such as `compute_reward` of the single environments."""
        from skillcli.gym.environments import GoalEnv

        single = GoalEnv(self.episodes)
        return [getattr(single, method_name)(*method_args, **method_kwargs) for _ in self._get_indices(indices)]

    def env_is_wrapped(self, wrapper_class: Any, indices: Any = None) -> list[bool]:
        """See Stable-Baselines3: none is wrapped."""
        return [False for _ in self._get_indices(indices)]

    def seed(self, seed: int | None = None) -> Sequence[int | None]:
        """See Stable-Baselines3: environment i draws as the single environment of seed + i."""
        if seed is not None:
            self._rngs = [seeding.np_random(seed + i)[0] for i in range(self.num_envs)]
        return [None if seed is None else seed + i for i in range(self.num_envs)]


def _row(observations: Observations, i: int) -> Any:
    if isinstance(observations, dict):
        return {name: values[i] for name, values in observations.items()}
    return observations[i]
