"""What Stable-Baselines3 learns on our Gymnasium environments, as a study of its own: `python -m studies.latent_gym --help`.

`ppo` learns on skill/Latent-v0 for goals anywhere between the trained ones, `sac` with hindsight on skill/PointGoal-v0 or the
goals of another task. Each prints a table with its curve: how many unseen goals are met after so many steps, and how long
that took.
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


def final_distances(model: Any, envs: Any, count: int) -> Array:
    """Distance to each of `count` unseen goals at the end of its episode, the policy without noise, (count,) m."""
    goals = Hull(envs.episodes.world.goals).draw(count, generator(0, "unseen goals of the study"))
    observation, far, normalizer = envs.reset_to(goals), np.full(count, np.nan), model.get_vec_normalize_env()
    while np.isnan(far).any():
        seen = observation if normalizer is None else normalizer.normalize_obs(observation)
        action, _ = model.predict(seen, deterministic=True)
        observation, _, over, infos = envs.step(action)
        for i in np.flatnonzero(over & np.isnan(far)):
            far[i] = infos[i]["distance"]
    return far


def learn(model: Any, judges: Any, steps: int, rounds: int, within: float) -> None:
    """Learn, and print a row of the table now and then, and at the end."""
    from stable_baselines3.common.callbacks import ConvertCallback, EveryNTimesteps

    began = time.process_time()
    print(f"| steps | CPU s | unseen goals within {100 * within:g} cm | median | worst |\n|---|---|---|---|---|", flush=True)

    def judge(*_: Any) -> bool:
        far, spent = final_distances(model, judges, judges.num_envs), time.process_time() - began
        near, median, worst = int((far <= within).sum()), 100 * np.median(far), 100 * far.max()
        row = f"| {model.num_timesteps:,} | {spent:.0f} | {near} of {len(far)} | {median:.1f} cm | {worst:.1f} cm |"
        print(row, flush=True)
        return True

    model.learn(steps, callback=EveryNTimesteps(steps // rounds, ConvertCallback(judge)))
    judge()


def ppo(given: argparse.Namespace) -> Any:
    """PPO over latents."""
    from stable_baselines3 import PPO

    from skillcli.gym.stable_baselines import BatchVecEnv

    def make(count: int) -> BatchVecEnv:
        envs = gymnasium.make_vec(
            skillcli.gym.LATENT, num_envs=count, library=given.id, store=given.store, threads=given.threads
        )
        return BatchVecEnv(envs, given.seed)

    model = PPO(
        "MlpPolicy", make(given.simulations), seed=given.seed, n_steps=32, batch_size=256, n_epochs=10, gamma=0.9,
        learning_rate=lambda left: 2e-3 * left, policy_kwargs={"log_std_init": -0.7}, device="cpu",
    )  # fmt: skip
    learn(model, make(given.goals), given.steps or 327_680, given.rows, 0.02)
    return model


def sac(given: argparse.Namespace) -> Any:
    """SAC with hindsight experience replay, on joint increments."""
    from stable_baselines3 import SAC, HerReplayBuffer
    from stable_baselines3.common.vec_env import VecNormalize

    from skillcli.gym.stable_baselines import BatchVecEnv

    def make(count: int, *settings: str) -> BatchVecEnv:
        name = skillcli.gym.task_id(given.task, True)
        return BatchVecEnv(gymnasium.make_vec(name, num_envs=count, threads=given.threads, settings=settings), given.seed)

    envs: Any = make(given.simulations, *(() if given.tolerance is None else (f"task.tolerance={given.tolerance}",)))
    if given.normalise:
        envs = VecNormalize(envs, norm_reward=False, norm_obs_keys=["observation", "achieved_goal", "desired_goal"])
    model = SAC(
        "MultiInputPolicy", envs, seed=given.seed, replay_buffer_class=HerReplayBuffer, gamma=given.discount,
        learning_starts=given.simulations * 65, learning_rate=lambda left: 1e-3 * (left if given.anneal else 1.0),
        train_freq=1, gradient_steps=given.updates, ent_coef=f"auto_{given.entropy}", device="cpu",
        policy_kwargs={"net_arch": [128, 128]},
    )  # fmt: skip
    judges = make(given.goals)
    learn(model, judges, given.steps or 20_480, given.rows, judges.episodes.world.task.tolerance)
    return model


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("learner", choices=("ppo", "sac"))
    parser.add_argument("--store", type=Path, default=Path("artifacts"))
    parser.add_argument("--id", default="reference-reach/embed-means")
    parser.add_argument("--task", default="point", help="whose goals `sac` learns to meet")
    parser.add_argument("--updates", type=int, default=8, help="gradient steps of `sac` for every step of all environments")
    parser.add_argument("--simulations", type=int, default=32, help="environments side by side")
    parser.add_argument("--discount", type=float, default=0.95, help="gamma of `sac`")
    parser.add_argument("--entropy", type=float, default=1.0, help="entropy coefficient from which `sac` adapts it")
    parser.add_argument("--normalise", action="store_true", help="`sac` sees observations and goals by VecNormalize")
    parser.add_argument("--tolerance", type=float, help="m, of success while `sac` learns; by default that of the task")
    parser.add_argument("--anneal", action="store_true", help="the step size of `sac` falls to zero")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--steps", type=int, help="of the environment; by default enough")
    parser.add_argument("--rows", type=int, default=5, help="of the curve")
    parser.add_argument("--goals", type=int, default=50)
    parser.add_argument("--threads", type=int, default=0, help="of the engine, 0 for all cores")
    parser.add_argument(
        "-o", "--output", type=Path, help="where to save the model; `skill compose --method sb3:FILE` takes that of `ppo`"
    )
    given = parser.parse_args()
    model = {"ppo": ppo, "sac": sac}[given.learner](given)
    if given.output:
        model.save(given.output)
        normalizer = model.get_vec_normalize_env()
        if normalizer is not None:  # a policy without it sees other numbers than those it learned on
            normalizer.save(given.output.with_suffix(".normalize.pkl"))


if __name__ == "__main__":
    main()
