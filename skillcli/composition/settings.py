"""Recipe sections of the ways to compose."""

from __future__ import annotations

from typing import Literal

from pydantic import model_validator

from skillcli.config.base import Section, value


class Search(Section):
    """Uniform cost search over latents."""

    segments: tuple[float, ...] = value((0.25,), "how long one latent may be held", "s", min_length=1)
    interpolated: bool = value(False, "offer the half-way latents of all pairs of skills beside the means")
    grid: int = value(
        0,
        "offer a grid of this many latents per dimension, over the box of the means +- 2 std, beside the means",
        "",
        ge=0,
        le=32,
    )
    resolution: float = value(0.02, "two states closer than this count as one", "m", ge=1e-4, le=10)
    goal_tolerance: float = value(0.02, "a waypoint counts as met within this; the task's tolerance is the judge", "m", gt=0)
    max_speed: float = value(
        2.0, "no faster motion of the judged point is thought possible; gives the heuristic, 0 for none", "m/s", ge=0
    )
    approach_speed: float = value(
        0.0, "speed of the gripper on its way behind the box, for the heuristic of push; 0 leaves that out", "m/s", ge=0
    )
    weight: float = value(
        1.0, "weight of the heuristic: 0 uniform cost, 1 A*, above 1 faster to find, up to that much longer", "", ge=0
    )
    final_speed: float = value(0.0, "the last goal counts as met only at or below this speed; 0 for any", "m/s", ge=0)
    batch: int = value(32, "nodes that are expanded at once", "nodes", ge=1, le=4096)
    budget: int = value(5_000, "expanded nodes after which the best plan so far is taken", "nodes", ge=1)

    @model_validator(mode="after")
    def _positive(self) -> Search:
        if any(not 0 < s <= 60 for s in self.segments):
            raise ValueError("every segment must last between 0 and 60 seconds")
        return self


class Interpolate(Section):
    """Hold the mean of one skill, blend into that of the next, hold it, and so on."""

    skills: str = value("", "skills to go through, such as 3,4,8,7, where no named task is given")
    hold: float = value(1.0, "how long each mean is held", "s", gt=0, le=60)
    blend: float = value(1.0, "how long each blend from one mean to the next takes", "s", gt=0, le=60)
    shares: int = value(11, "latents (1-λ) z_a + λ z_b per pair of skills, λ from 0 to 1, for the calibration", ge=3, le=101)


class Sequence(Section):
    """A plan written by hand."""

    plan: str = value("", "such as 3,4,8,7 or 3:1.0,3~4:1.0,3~4@0.25:0.5 (see --plan), or a file that holds one")
    seconds: float = value(1.0, "how long an entry without a duration lasts", "s", gt=0, le=60)


class Episodes(Section):
    """The decision problem that a learned composer solves: from the start, a latent every segment."""

    segment: float = value(0.25, "how long one latent is held", "s", gt=0, le=60)
    seconds: float = value(2.0, "length of an episode, for each waypoint of the route", "s", gt=0, le=600)
    simulations: int = value(32, "episodes side by side; the first one is played without exploration", "", ge=2, le=4096)
    iterations: int = value(100, "rounds of episodes, each followed by learning", "", ge=1, le=100_000)
    goal_tolerance: float = value(0.02, "an episode, and the plan, ends within this of the last waypoint", "m", gt=0)
    good_enough: float = value(
        0.02, "learning ends once the composer without exploration ends this close to the last waypoint; 0 never", "m", ge=0
    )
    reward_scale: float = value(5.0, "factor on the reward, minus the metres left to go", "1/m", gt=0)
    discount: float = value(0.9, "gamma", "1/segment", ge=0, lt=1)
    hidden: tuple[int, ...] = value((64, 64), "hidden layers of every network", "units", min_length=1, max_length=16)

    @model_validator(mode="after")
    def _whole(self) -> Episodes:
        if self.segment > self.seconds:
            raise ValueError("a segment cannot last longer than an episode")
        if any(not 1 <= n <= 4096 for n in self.hidden):
            raise ValueError("every hidden layer needs between 1 and 4096 units")
        return self


class Ddpg(Episodes):
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


class Ppo(Episodes):
    """Proximal policy optimisation over latents (Schulman et al. 2017)."""

    epochs: int = value(8, "passes over each round of episodes", "", ge=1, le=100)
    minibatch: int = value(128, "samples per gradient step", "samples", ge=1)
    gae_lambda: float = value(0.95, "lambda of generalised advantage estimation", "", ge=0, le=1)
    clip: float = value(0.2, "clipping range of the policy ratio", "", gt=0, lt=1)
    learning_rate: float = value(2e-3, "step size at the start, and of the value function", "", gt=0)
    target_kl: float = value(0.02, "the step size is adapted to this KL divergence per update", "nat", gt=0)
    initial_std: float = value(0.5, "exploration at the start, in units of half the latent box", "", gt=0, le=1)
    max_grad_norm: float = value(0.5, "gradients are clipped to this norm", "", gt=0)


class Mpc(Section):
    """Model predictive control in the latent space: the cross-entropy method, anew for every segment."""

    segment: float = value(0.25, "how long one latent is held, and after which there is replanning", "s", gt=0, le=60)
    lookahead: int = value(2, "segments that are looked ahead", "segments", ge=1, le=100)
    samples: int = value(48, "sequences of latents tried at once", "", ge=2, le=4096)
    elites: int = value(8, "of these, the best ones that the next are drawn around", "", ge=1)
    rounds: int = value(2, "times that sequences are drawn before each segment", "", ge=1, le=100)
    seconds: float = value(5.0, "longest plan, for each waypoint of the route", "s", gt=0, le=600)
    goal_tolerance: float = value(0.02, "the plan ends within this of the last waypoint", "m", gt=0)

    @model_validator(mode="after")
    def _fewer_elites(self) -> Mpc:
        if self.elites >= self.samples:
            raise ValueError("elites must be fewer than samples")
        return self
