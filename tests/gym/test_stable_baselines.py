"""The batch as Stable-Baselines3 takes it: the same episodes, reset in the step in which they end."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import data_equivalence

import skillcli
import skillcli.gym

REFERENCE = Path(skillcli.__file__).parents[1] / "artifacts"
SHORT = ("task.horizon=4",)


@pytest.fixture(autouse=True)
def without_the_old_gym(monkeypatch: pytest.MonkeyPatch) -> None:
    """Stable-Baselines3 looks for OpenAI's `gym`, and must not take this folder for it."""
    monkeypatch.setitem(sys.modules, "gym", None)


def batch(name: str, num_envs: int, **kwargs: Any) -> Any:
    pytest.importorskip("stable_baselines3")
    from skillcli.gym.stable_baselines import BatchVecEnv

    return BatchVecEnv(gymnasium.make_vec(name, num_envs=num_envs, **kwargs), seed=5)


@pytest.mark.parametrize("name", ["skill/Reach-v0", "skill/ReachGoal-v0"])
def test_episodes_are_those_of_single_environments(name: str) -> None:
    many = batch(name, 2, settings=SHORT)
    single = [gymnasium.make(name, settings=SHORT) for _ in range(2)]
    seen, alone = many.reset(), [env.reset(seed=5 + i)[0] for i, env in enumerate(single)]
    rng = np.random.default_rng(0)
    for step in range(1, 10):
        action = rng.uniform(-1, 1, (2, 7))
        seen, rewards, over, infos = many.step(action)
        results = [env.step(one) for env, one in zip(single, action, strict=True)]
        alone = [result[0] for result in results]
        assert rewards == pytest.approx([result[1] for result in results]) and over.tolist() == [step % 4 == 0] * 2
        if over.all():
            for info, last in zip(infos, alone, strict=True):
                assert info["TimeLimit.truncated"] and data_equivalence(info["terminal_observation"], last)
            alone = [env.reset()[0] for env in single]
        for i in range(2):
            row = {key: values[i] for key, values in seen.items()} if isinstance(seen, dict) else seen[i]
            assert data_equivalence(row, alone[i])


@pytest.mark.slow
def test_stable_baselines_learns_on_it() -> None:
    sb3 = pytest.importorskip("stable_baselines3")
    library = {"library": "reference-reach/embed-means", "store": REFERENCE}
    envs = batch(skillcli.gym.LATENT, 4, **library)
    assert sb3.PPO("MlpPolicy", envs, n_steps=8, batch_size=32, seed=0, device="cpu").learn(64).num_timesteps == 64
    goals, hindsight = batch("skill/PointGoal-v0", 4), sb3.HerReplayBuffer
    sac = sb3.SAC("MultiInputPolicy", goals, replay_buffer_class=hindsight, learning_starts=220, seed=0, device="cpu")
    sac.learn(240)
    assert 0 < float(sac.replay_buffer.sample(64).rewards.mean()) < 1  # hindsight: some goals were met
