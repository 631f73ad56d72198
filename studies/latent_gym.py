"""What Stable-Baselines3 learns on our Gymnasium environments, as a study of its own: `python -m studies.latent_gym --help`.

`ppo` learns on skill/Latent-v0 for goals anywhere between the trained ones, `sac` with hindsight on skill/ReachGoal-v0. Each
prints a table with its curve: how many unseen goals are met after so many steps, and how long that took.
"""

from __future__ import annotations

import argparse
import time
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np

import skillcli.gym
from skillcli.hull import Hull
from skillcli.seeding import generator
from skillcli.trajectories import Array


def unseen_goals(env: Any, count: int) -> Array:
    """Places drawn uniformly between the trained goals with another seed than any training, (count, 3) m."""
    return Hull(env.unwrapped.episodes.world.goals).draw(count, generator(0, "unseen goals of the study"))


def final_distances(model: Any, env: Any, goals: Array) -> Array:
    """Distance to each goal at the end of its episode, the policy without noise, (count,) m."""
    distances = []
    for goal in goals:
        observation, _ = env.reset(options={"goal": goal})
        over = False
        while not over:
            action, _ = model.predict(observation, deterministic=True)
            observation, _, terminated, truncated, info = env.step(action)
            over = terminated or truncated
        distances.append(info["distance"])
    return np.array(distances)


def learn(model: Any, env: Any, steps: int, rounds: int, count: int, within: float) -> None:
    """Learn in rounds, and print a row after each."""
    goals, began = unseen_goals(env, count), time.process_time()
    print(f"| steps | CPU s | unseen goals within {100 * within:g} cm | median | worst |\n|---|---|---|---|---|")
    for round_ in range(rounds):
        model.learn(steps // rounds, reset_num_timesteps=round_ == 0)
        far, spent = final_distances(model, env, goals), time.process_time() - began
        near = int((far <= within).sum())
        median, worst = 100 * np.median(far), 100 * far.max()
        print(f"| {model.num_timesteps:,} | {spent:.0f} | {near} of {count} | {median:.1f} cm | {worst:.1f} cm |", flush=True)


def ppo(given: argparse.Namespace) -> Any:
    """PPO over latents."""
    from stable_baselines3 import PPO

    env = gymnasium.make(skillcli.gym.LATENT, library=given.id, store=given.store)
    model = PPO(
        "MlpPolicy", env, seed=given.seed, n_steps=1024, batch_size=128, n_epochs=10, gamma=0.9, learning_rate=1e-3,
        policy_kwargs={"log_std_init": -0.7}, device="cpu",
    )  # fmt: skip
    learn(model, env, given.steps or 61_440, 6, given.goals, 0.02)
    return model


def sac(given: argparse.Namespace) -> Any:
    """SAC with hindsight experience replay, on joint increments."""
    from stable_baselines3 import SAC, HerReplayBuffer

    env = gymnasium.make(skillcli.gym.task_id("reach", True))
    model = SAC(
        "MultiInputPolicy", env, seed=given.seed, replay_buffer_class=HerReplayBuffer, gamma=0.95, learning_starts=1000,
        learning_rate=1e-3, train_freq=4, device="cpu", policy_kwargs={"net_arch": [128, 128]},
    )  # fmt: skip
    learn(model, env, given.steps or 30_000, 6, given.goals, env.unwrapped.episodes.world.task.tolerance)
    return model


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("learner", choices=("ppo", "sac"))
    parser.add_argument("--store", type=Path, default=Path("artifacts"))
    parser.add_argument("--id", default="reference-reach/embed-means")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--steps", type=int, help="of the environment; by default enough")
    parser.add_argument("--goals", type=int, default=50)
    parser.add_argument("-o", "--output", type=Path, help="where to save the model, for `skill compose --method sb3:FILE`")
    given = parser.parse_args()
    model = {"ppo": ppo, "sac": sac}[given.learner](given)
    if given.output:
        model.save(given.output)


if __name__ == "__main__":
    main()
