"""PPO as a method of composition. The composer is imported only when it learns, because torch is slow to import."""

from __future__ import annotations

from skillcli.composition.episodes import EpisodeSettings, learn_to_plan
from skillcli.composition.method import MethodSpec, Option, PlanningProblem, PlanResult
from skillcli.config.base import value


class PpoSettings(EpisodeSettings):
    """Proximal policy optimisation over latents (Schulman et al. 2017)."""

    epochs: int = value(8, "passes over each round of episodes", "", ge=1, le=100)
    minibatch: int = value(128, "samples per gradient step", "samples", ge=1)
    gae_lambda: float = value(0.95, "lambda of generalised advantage estimation", "", ge=0, le=1)
    clip: float = value(0.2, "clipping range of the policy ratio", "", gt=0, lt=1)
    learning_rate: float = value(2e-3, "step size at the start, and of the value function", "", gt=0)
    target_kl: float = value(0.02, "the step size is adapted to this KL divergence per update", "nat", gt=0)
    initial_std: float = value(0.5, "exploration at the start, in units of half the latent box", "", gt=0, le=1)
    max_grad_norm: float = value(0.5, "gradients are clipped to this norm", "", gt=0)


def plan(problem: PlanningProblem) -> PlanResult:
    """Plan with a composer that learns on-policy."""
    from skillcli.learning.ppo_composer import PpoComposer

    settings = problem.settings_as(PpoSettings)
    return learn_to_plan(problem, lambda features: PpoComposer(features, problem.bounds, settings, problem.seed))


METHOD = MethodSpec(
    name="ppo",
    settings=PpoSettings,
    plan=plan,
    hint="try more --iterations, or another --seed",
    options=(Option("iterations", "Rounds of episodes at most.", "N", int),),
    draws=True,
    on_target=True,
    learns=True,
)
