"""DDPG as a method of composition. The composer is imported only when it learns, because torch is slow to import."""

from __future__ import annotations

from typing import Literal

from skillcli.composition.episodes import EpisodeSettings, learn_to_plan
from skillcli.composition.method import MethodSpec, Option, PlanningProblem, PlanResult
from skillcli.composition.plan import Choices
from skillcli.config.base import value


class DdpgSettings(EpisodeSettings):
    """Deep deterministic policy gradient over latents (Lillicrap et al. 2016)."""

    latents: Literal["continuous", "means", "interpolated"] = value(
        "continuous", "what the composer may choose: any latent, a skill's mean, or a mean or the half-way latent of two"
    )
    candidates: int = value(1, "of discrete choices, the critic decides between this many nearest ones", "", ge=1)
    gradient_steps: int = value(100, "per round of episodes", "", ge=1, le=10_000)
    minibatch: int = value(128, "transitions per gradient step", "samples", ge=1)
    replay: int = value(100_000, "transitions that are kept", "samples", ge=1, le=10_000_000)
    warm_up: int = value(4, "rounds of episodes with random latents before learning", "", ge=1)
    learning_rate: float = value(1e-3, "step size of actor and critic", "", gt=0)
    target_rate: float = value(0.02, "tau: how fast the target networks follow, per gradient step", "", gt=0, le=1)
    noise: float = value(0.4, "exploration at the start, in units of half the latent box; falls to a tenth", "", ge=0)


def plan(problem: PlanningProblem) -> PlanResult:
    """Plan with a composer that learns off-policy."""
    from skillcli.learning.ddpg_composer import DdpgComposer

    settings, choices = problem.settings_as(DdpgSettings), None
    if settings.latents != "continuous":
        choices = Choices.of(problem.mean, problem.names, settings.latents == "interpolated").latent
    return learn_to_plan(problem, lambda features: DdpgComposer(features, problem.bounds, choices, settings, problem.seed))


METHOD = MethodSpec(
    name="ddpg",
    settings=DdpgSettings,
    plan=plan,
    hint="try more --iterations, or another --seed",
    options=(
        Option("iterations", "Rounds of episodes at most.", "N", int),
        Option("latents", "What may be chosen: continuous, means, interpolated.", "NAME"),
    ),
    draws=True,
    on_target=True,
    learns=True,
)
