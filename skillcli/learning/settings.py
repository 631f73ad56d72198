"""Recipe sections of learning: embedding, networks, mixtures, TE-PPO."""

from __future__ import annotations

from typing import Any, Literal, Protocol

from pydantic import model_validator

from skillcli.config.base import Section, optional_value, value
from skillcli.config.randomization import Randomisation, Span, check_span, phased_in
from skillcli.learning.worst import MOST

MAX_LAYERS = 16


class Embedding(Section):
    """Settings of the skill embedding p(z|t) and the inference network q(z|window)."""

    size: int = value(3, "dimensions of the latent space", "", ge=1, le=64)
    window: int = value(6, "observations that the inference network sees", "steps", ge=1, le=64)
    arrangement: Literal["goals", "isometric", "random"] = value(
        "goals",
        "means start arranged as the goals are, long axes shortened so that skills lie apart; or as they are, every axis by one"
        " scale; or spread at random",
        "",
    )
    fixed_means: bool = value(False, "the means stay where they start; only the standard deviations are learned")
    initial_std: float = value(0.3, "standard deviation of p(z|t) at the start", "", gt=0)
    min_std: float = value(0.05, "lower bound of the standard deviation of p(z|t)", "", gt=0)
    max_std: float = value(0.5, "upper bound of the standard deviation of p(z|t)", "", gt=0)

    @model_validator(mode="after")
    def _ordered(self) -> Embedding:
        if not self.min_std < self.initial_std < self.max_std:
            three = f"min_std {self.min_std:g}, initial_std {self.initial_std:g}, max_std {self.max_std:g}"
            raise ValueError(f"min_std < initial_std < max_std must hold, got {three}")
        return self


class Network(Section):
    """Sizes of the networks; all of them are tanh multilayer perceptrons."""

    policy_hidden: tuple[int, ...] = value((128, 128), "hidden layers of the policy", "units", max_length=MAX_LAYERS)
    linear_latent: bool = value(
        False, "the policy's mean is affine in the latent: between two latents it acts between the two, in every state"
    )
    value_hidden: tuple[int, ...] = value((128, 128), "hidden layers of the value function", "units", max_length=MAX_LAYERS)
    inference_hidden: tuple[int, ...] = value(
        (64, 64), "hidden layers of the inference network", "units", max_length=MAX_LAYERS
    )
    value_sees_goal: bool = optional_value(
        False,
        "the value function also observes the way to the goal; policy and skills never do, and it is used in training only",
    )
    initial_action_std: float = value(0.6, "exploration at the start, in units of the action limit", "", ge=0.02, le=1)

    @model_validator(mode="after")
    def _positive(self) -> Network:
        if any(n < 1 or n > 4096 for n in (*self.policy_hidden, *self.value_hidden, *self.inference_hidden)):
            raise ValueError("every hidden layer needs between 1 and 4096 units")
        return self


class Training(Section):
    """TE-PPO: proximal policy optimisation of policy and embedding together."""

    simulations: int = value(256, "simulations side by side", "", ge=1, le=8192)
    iterations: int = value(60, "rollouts, each followed by one update", "", ge=1, le=1_000_000)
    chained_starts: float = value(
        0.7, "share of episodes that begin where an earlier rollout passed; the others begin at the start", "", ge=0, le=1
    )
    favour_failing: float = optional_value(
        0.0,
        "episodes go more often to skills that fail: one that always succeeds gets this share fewer than one that always fails",
        "",
        ge=0,
        lt=1,
    )
    repeat_worst: float = optional_value(
        0.0,
        "share of episodes that repeat one of those that ended farthest from their goals of late: same start, same goal",
        "",
        ge=0,
        le=MOST,
    )
    discount: float = value(0.99, "gamma", "1/step", ge=0, le=1)
    gae_lambda: float = value(0.95, "lambda of generalised advantage estimation", "", ge=0, le=1)
    epochs: int = value(5, "passes over each rollout", "", ge=1, le=100)
    minibatch: int = value(4096, "samples per gradient step", "samples", ge=1)
    clip: float = value(0.2, "clipping range of the policy ratio", "", gt=0, lt=1)
    learning_rate: float = value(1e-3, "step size at the start, and of value and inference", "", gt=0, le=1)
    target_kl: float = value(0.01, "the step size is adapted to this KL divergence per update", "nat", gt=0)
    settle_from: float = value(
        0.0, "share of the training from which on the target KL shrinks, linearly to a twentieth at the end", "", ge=0, le=1
    )
    final_action_std: float = value(
        1.0, "exploration at the end is at most this, in units of the action limit; comes down to it from settle_from on", "",
        ge=0.02, le=1,
    )  # fmt: skip
    max_grad_norm: float = value(0.5, "gradients are clipped to this norm", "", gt=0)
    reward_scale: float = value(5.0, "factor on the task's reward", "", gt=0)
    value_scale: float = value(10.0, "value targets are divided by this", "", gt=0)
    embedding_entropy: float = value(0.002, "alpha_1: weight of H{p(z|t)}", "", ge=0)
    inference_reward: float = value(0.02, "alpha_2: weight of log q(z|window) in the reward", "", ge=0)
    inference_clip: float = value(6.0, "log q(z|window) is clipped to plus and minus this", "nat", gt=0)
    policy_entropy: float = value(0.001, "alpha_3: weight of H{pi(a|s,z)}", "", ge=0)


class Mixtures(Section):
    """Training on mixtures of skills, which makes the latent space a map; none by default."""

    share: float = value(
        0.0, "share of the episodes whose latent is a mixture of those of the skills, and whose goal is that of the goals", "",
        ge=0, lt=1,
    )  # fmt: skip
    weights: Literal["multilinear", "neighbours", "dirichlet"] = value(
        "dirichlet",
        "how the weights are drawn: those of a place drawn uniformly between goals that are the corners of a cuboid; those of"
        " a place between two neighbouring goals; or any, see concentration",
        "",
    )
    concentration: float = value(
        0.5, "of the Dirichlet distribution: at 1 all weights are alike, below it few skills have most, above it all have some",
        "", gt=0, le=1000,
    )  # fmt: skip
    span: Span = value((0.0, 0.0), "shares of the training at which mixtures begin, and at which they have their share", "")

    @model_validator(mode="after")
    def _ordered(self) -> Mixtures:
        check_span(self.span)
        return self

    def share_at(self, progress: float) -> float:
        """Return the share of mixtures at a progress of the training from 0 to 1."""
        return self.share * phased_in(self.span, progress)


class LearnedTask(Protocol):
    """What learning needs of a task's settings."""

    @property
    def goals(self) -> tuple[Any, ...]:
        """One goal per skill."""

    @property
    def tolerance(self) -> float:
        """Success radius, m."""

    @property
    def mixing(self) -> tuple[int, ...]:
        """Indices of the skills whose goals can be mixed."""


class LearningRecipe(Protocol):
    """What learning needs of a recipe."""

    @property
    def task(self) -> LearnedTask:
        """Settings of the task."""

    @property
    def embedding(self) -> Embedding:
        """The latent space."""

    @property
    def network(self) -> Network:
        """Sizes of the networks."""

    @property
    def training(self) -> Training:
        """Settings of training."""

    @property
    def mixtures(self) -> Mixtures:
        """Settings of mixtures."""

    @property
    def randomisation(self) -> Randomisation:
        """Domain randomization."""
