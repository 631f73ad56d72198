"""The training loop: rollout, update, curves; and the complete state to resume from."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
import torch

from skillcli.config import randomization
from skillcli.errors import SkillError
from skillcli.learning import te_ppo
from skillcli.learning.agent import Agent
from skillcli.learning.mixtures import MIXED, Mixer
from skillcli.learning.rollout import Rollout, StartPool, VectorEnvironment, collect, privileged_size
from skillcli.learning.saved import OF_MIXTURES, WORST, check_saved
from skillcli.learning.settings import LearningRecipe
from skillcli.learning.worst import WorstEpisodes
from skillcli.seeding import generator
from skillcli.trajectories import Array

LATELY = 10  # rollouts, whose success says which skills fail
POOL_CAPACITY = 4096  # states; about sixteen rollouts of the default size


class Learner:
    """TE-PPO on one environment.

    Every rollout begins with a reset of all simulations, so the simulator has no state between two iterations: weights,
    optimisers, generator, start pool and counters are the whole state.

    Args:
        env: simulations of the task.
        recipe: what to train.
        seed: of weights and random numbers.
    """

    def __init__(self, env: VectorEnvironment, recipe: LearningRecipe, seed: int) -> None:
        self.env, self.recipe = env, recipe
        self.sees_goal = recipe.network.value_sees_goal
        aside = privileged_size(env, self.sees_goal)
        self.agent = Agent(recipe, env.observation_size, env.action_size, env.goals, seed, aside)
        self.mixer = Mixer.of(recipe.mixtures, env.goals, recipe.task.mixing)
        self.optimizers = te_ppo.Optimizers.of(self.agent, recipe.training.learning_rate)
        self.pool = StartPool(POOL_CAPACITY)
        self.worst = WorstEpisodes(env.num_envs) if recipe.training.repeat_worst else None
        self.rng = generator(seed, "training")
        self.iteration = self.env_steps = 0
        self.sampling_seconds = 0.0
        self.curves: dict[str, list[float]] = {}

    @property
    def finished(self) -> bool:
        """Whether the recipe's iterations are done."""
        return self.iteration >= self.recipe.training.iterations

    def iterate(self) -> dict[str, float]:
        """Run one rollout and one update; return this iteration's point on every curve.

        Raises:
            SkillError: training diverged.
        """
        training = self.recipe.training
        progress = self.iteration / training.iterations
        # Before the rollout and not in the update, where it would count as a change of the policy and use up the target KL.
        self.agent.policy.bound(te_ppo.annealed_std(training.final_action_std, training.settle_from, progress))
        self._randomise()
        mixer = replace(self.mixer, share=self.recipe.mixtures.share_at(progress))
        rollout = collect(
            self.env, self.agent, self.pool, training.chained_starts, self.rng, mixer, self.sees_goal, self._odds(), self.worst,
            training.repeat_worst,
        )  # fmt: skip
        seen = (torch.from_numpy(rollout.observation).flatten(0, 1), torch.from_numpy(rollout.privileged).flatten(0, 1))
        # The first update needs statistics to normalise with, which move the policy's means a little from those of the rollout.
        if self.iteration == 0:
            self.agent.update_normalizers(*seen)
        batch, prepared = te_ppo.prepare(rollout, self.agent, training)
        updated = te_ppo.update(batch, self.agent, self.optimizers, training, progress, self.rng)
        if self.iteration > 0:
            self.agent.update_normalizers(*seen)
        self.iteration += 1
        self.env_steps += rollout.reward.size
        self.sampling_seconds += rollout.seconds
        point = {"env_steps": float(self.env_steps), **self._outcome(rollout), **prepared, **updated}
        self._check(point)
        for name, number in point.items():
            self.curves.setdefault(name, []).append(number)
        return point

    def _odds(self) -> Array | None:
        """Return how often each skill shall get an episode, (K,): those that failed of late more often; None if all alike."""
        favour = self.recipe.training.favour_failing
        if not favour or not self.iteration:
            return None
        success = [self.curves[f"success/{skill + 1}"][-LATELY:] for skill in range(self.agent.skills)]
        odds: Array = 1 - favour * np.mean(success, axis=1)
        return odds

    def _randomise(self) -> None:
        """Draw new parameters and starts for every simulation; what is phased in applies to a growing share of them."""
        chosen = self.recipe.randomisation
        if not chosen.ranges:
            return
        parameters = randomization.sample(chosen.ranges, self.env.num_envs, self.rng, self.env.joints)
        progress = self.iteration / self.recipe.training.iterations
        for ranges, span in ((chosen.starts, chosen.starts_span), (chosen.sensing, chosen.sensing_span)):
            spared = self.rng.random(self.env.num_envs) >= randomization.phased_in(span, progress)
            for name in ranges:
                parameters[name][spared] = randomization.IDENTITY[name]
        self.env.randomize(parameters, np.random.default_rng(self.rng.integers(2**63)))

    def _outcome(self, rollout: Rollout) -> dict[str, float]:
        near, mixed = rollout.final_distance <= self.recipe.task.tolerance, rollout.skill == MIXED
        new = ~rollout.repeated  # those that repeat bad ones say little of how well it goes
        outcome = {
            "return": float((rollout.reward * rollout.valid).sum(0).mean()),
            "success_rate": _mean(near[new & ~mixed]),
            "final_distance": _mean(rollout.final_distance[new & ~mixed & np.isfinite(rollout.final_distance)]),
        }
        if self.recipe.mixtures.share:
            known = new & mixed & np.isfinite(rollout.final_distance)
            of_mixtures = near[new & mixed], rollout.final_distance[known]
            outcome |= {
                name: float(values.mean()) if len(values) else math.nan
                for name, values in zip(OF_MIXTURES, of_mixtures, strict=True)
            }
        outcome |= {f"reward/{name}": value for name, value in rollout.reward_terms.items()}
        for skill in range(self.agent.skills):
            outcome[f"success/{skill + 1}"] = _mean(near[new & (rollout.skill == skill)])
        return outcome

    def _check(self, point: dict[str, float]) -> None:
        not_finite = [name for name, number in point.items() if not math.isfinite(number) and name not in OF_MIXTURES]
        weights_fine = all(bool(torch.isfinite(weight).all()) for weight in self.agent.parameters())
        if not_finite or not weights_fine:
            raise SkillError(
                f"training diverged in iteration {self.iteration}: {', '.join(not_finite) or 'weights'} not finite",
                "lower training.learning_rate or training.target_kl, or raise training.minibatch",
            )

    def state(self) -> tuple[dict[str, Array], dict[str, Any]]:
        """Return everything needed to resume: arrays by path, and the rest as JSON values."""
        arrays = {f"agent/{name}": array for name, array in self.agent.arrays().items()}
        for group, optimizer in vars(self.optimizers).items():
            for index, slots in optimizer.state_dict()["state"].items():
                arrays |= {f"optimizer/{group}/{index}/{slot}": tensor.numpy() for slot, tensor in slots.items()}
        if self.pool.sim_states is not None:
            arrays["pool"] = self.pool.sim_states
        if self.worst is not None:
            arrays |= {f"worst/{column}": array for column, array in zip(WORST, self.worst.columns, strict=True)}
        arrays |= {f"curves/{name}": np.array(values) for name, values in self.curves.items()}
        return arrays, {
            "iteration": self.iteration,
            "env_steps": self.env_steps,
            "sampling_seconds": self.sampling_seconds,
            "policy_rate": self.optimizers.policy_rate,
            "generator": self.rng.bit_generator.state,
            "pool": [self.pool.filled, self.pool.next],
            **({} if self.worst is None else {"worst": [self.worst.filled, self.worst.next]}),
        }

    def load(self, arrays: Mapping[str, Array], state: Mapping[str, Any]) -> None:
        """Resume from what `state` returned.

        Raises:
            ValueError: it belongs to no training on this environment, recipe and seed; nothing has changed.
        """
        check_saved(self, arrays, state)
        self.agent.load(_below(arrays, "agent/"))
        for group, optimizer in vars(self.optimizers).items():
            self._load_optimizer(optimizer, _below(arrays, f"optimizer/{group}/"))
        self.optimizers.policy_rate = state["policy_rate"]
        self.curves = {name: values.tolist() for name, values in _below(arrays, "curves/").items()}
        self.pool.sim_states = arrays.get("pool")
        self.pool.filled, self.pool.next = state["pool"]
        if self.worst is not None:
            self.worst.columns = tuple(arrays[f"worst/{column}"] for column in WORST)
            self.worst.filled, self.worst.next = state["worst"]
        self.rng.bit_generator.state = state["generator"]
        self.iteration, self.env_steps = state["iteration"], state["env_steps"]
        self.sampling_seconds = state["sampling_seconds"]

    @staticmethod
    def _load_optimizer(optimizer: torch.optim.Adam, arrays: Mapping[str, Array]) -> None:
        content = optimizer.state_dict()
        slots: dict[int, dict[str, torch.Tensor]] = {}
        for path, array in arrays.items():
            index, slot = path.split("/")
            slots.setdefault(int(index), {})[slot] = torch.from_numpy(np.array(array))
        optimizer.load_state_dict({**content, "state": slots})


def _mean(values: Array) -> float:
    """Return the mean, zero without values."""
    return float(values.mean()) if len(values) else 0.0


def _below(arrays: Mapping[str, Array], prefix: str) -> dict[str, Array]:
    return {path.removeprefix(prefix): array for path, array in arrays.items() if path.startswith(prefix)}
