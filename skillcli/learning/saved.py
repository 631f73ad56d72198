"""Check a checkpoint: types, shapes and ranges of everything in it.

A checkpoint may be days old. If it did not fit, training would resume to another result without an error.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
import torch

from skillcli.learning.ppo_update import RATES
from skillcli.trajectories import Array

if TYPE_CHECKING:
    from skillcli.learning.learner import Learner

COLLECTED = ("env_steps", "return", "success_rate", "final_distance")
UPDATED = (
    "inference_log_prob", "explained_variance", "kl", "learning_rate", "action_std", "embedding_std", "value_loss",
    "inference_loss",
)  # fmt: skip
OF_MIXTURES = ("mixed/success_rate", "mixed/final_distance")
"""Curves with gaps, NaN, in iterations without mixtures."""
WORST = ("sim_states", "skill", "weights")
"""Columns of the worst episodes, where some are repeated."""
_KEYS = {"iteration", "env_steps", "sampling_seconds", "policy_rate", "generator", "pool"}
_SLOTS = ("exp_avg", "exp_avg_sq", "step")  # of Adam
_LONGEST = 1e10  # s, of a training
_SHOWN = 60  # characters of a value


def curve_names(skills: int, reward_names: Iterable[str], mixed: bool = False) -> set[str]:
    """Return the names of all learning curves."""
    terms = (f"reward/{name}" for name in reward_names)
    return {*COLLECTED, *UPDATED, *terms, *(OF_MIXTURES if mixed else ()), *(f"success/{skill + 1}" for skill in range(skills))}


def check_saved(learner: Learner, arrays: Mapping[str, Array], state: Mapping[str, Any]) -> None:
    """Refuse a state that `Learner.state` cannot have returned for this environment, recipe and seed.

    Raises:
        ValueError: names the first problem.
    """
    for problem in (*_counters(learner, state), *_generator(learner, state)):
        raise ValueError(problem)
    for problem in (*_arrays(learner, arrays, state["iteration"]), *_pool(learner, arrays, state["pool"])):
        raise ValueError(problem)
    for problem in _worst(learner, arrays, state):
        raise ValueError(problem)
    for problem in _agreement(learner, arrays, state):
        raise ValueError(problem)


def is_seconds(found: Any) -> bool:
    """Return whether a value is a valid duration of a training."""
    return type(found) in (int, float) and 0 <= found <= _LONGEST


def shown(found: Any) -> str:
    """Write a value in a message, cut short."""
    text = repr(found)
    return text if len(text) <= _SHOWN else f"{text[:_SHOWN]}…"


def _counters(learner: Learner, state: Mapping[str, Any]) -> Iterator[str]:
    keys = _KEYS if learner.worst is None else _KEYS | {"worst"}
    if state.keys() != keys:
        yield f"its state lacks or should not have {shown(sorted(state.keys() ^ keys))}"
        return
    last, steps = learner.recipe.training.iterations, learner.env.num_envs * learner.env.horizon
    iteration, rate = state["iteration"], state["policy_rate"]
    if type(iteration) is not int or not 1 <= iteration <= last:
        yield f"iteration must be between 1 and {last}, got {shown(iteration)}"
    elif type(state["env_steps"]) is not int or state["env_steps"] != iteration * steps:
        yield f"env_steps must be {iteration * steps}, got {shown(state['env_steps'])}"
    if not is_seconds(state["sampling_seconds"]):
        yield f"sampling_seconds must be a duration, got {shown(state['sampling_seconds'])}"
    if type(rate) is not float or not RATES[0] <= rate <= RATES[1]:
        yield f"policy_rate must be between {RATES[0]} and {RATES[1]}, got {shown(rate)}"
    for name in keys & {"pool", "worst"}:
        if not isinstance(state[name], list) or [type(each) for each in state[name]] != [int, int]:
            yield f"{name} must be two whole numbers"


def _generator(learner: Learner, state: Mapping[str, Any]) -> Iterator[str]:
    """Check that the generator has the type and the stream of the seed; its position may be any."""
    own, found = learner.rng.bit_generator.state, state.get("generator")
    if not isinstance(found, dict) or found.keys() != own.keys() or not isinstance(found["state"], dict):
        yield "generator is not the state of one"
        return
    numbers = [found["state"].get("state"), found["has_uint32"], found["uinteger"]]
    limits = (2**128, 2, 2**32)
    if not all(type(each) is int and 0 <= each < limit for each, limit in zip(numbers, limits, strict=True)):
        yield "generator is not the state of one"
    if found["bit_generator"] != own["bit_generator"] or found["state"] != {**own["state"], "state": numbers[0]}:
        yield "generator is that of another seed"


def _arrays(learner: Learner, arrays: Mapping[str, Array], iterations: int) -> Iterator[str]:
    wanted = {f"agent/{name}": (array.shape, array.dtype) for name, array in learner.agent.arrays().items()}
    wanted |= {f"optimizer/{path}": (shape, np.dtype(np.float32)) for path, shape in _slots(learner).items()}
    wanted |= {
        f"curves/{name}": ((iterations,), np.dtype(float))
        for name in curve_names(learner.agent.skills, learner.env.reward_names, learner.recipe.mixtures.share > 0)
    }
    if learner.worst is not None:
        shapes = _worst_shapes(learner)
        wanted |= {f"worst/{name}": (shape, np.dtype(float)) for name, shape in shapes.items()}
    if different := sorted(wanted.keys() ^ (arrays.keys() - {"pool"})):
        yield f"{different[0]} is {'missing' if different[0] in wanted else 'not part of it'}"
        return
    for path, (shape, dtype) in wanted.items():
        found = arrays[path]
        if found.shape != shape or found.dtype != dtype:
            yield f"{path} holds {found.dtype} of shape {found.shape}, expected {dtype} of shape {shape}"
        elif not np.isfinite(found).all() and path.removeprefix("curves/") not in OF_MIXTURES:
            yield f"{path} holds values that are not finite"
        elif path.endswith((".variance", ".count", "/exp_avg_sq", "/step")) and (found < 0).any():
            yield f"{path} is negative"


def _slots(learner: Learner) -> dict[str, tuple[int, ...]]:
    """Return the optimisers' state of every learned weight, after the first update."""
    shapes: dict[str, tuple[int, ...]] = {}
    for group, optimizer in vars(learner.optimizers).items():
        assert isinstance(optimizer, torch.optim.Adam)
        for number, weight in enumerate(optimizer.param_groups[0]["params"]):
            if weight.requires_grad:
                shapes |= {f"{group}/{number}/{slot}": () if slot == "step" else tuple(weight.shape) for slot in _SLOTS}
    return shapes


def _pool(learner: Learner, arrays: Mapping[str, Array], pool: list[int]) -> Iterator[str]:
    """Check the states that were passed."""
    sim_states, (filled, _), capacity = arrays.get("pool"), pool, learner.pool.capacity
    yield from _ring("pool", pool, capacity)
    width = learner.env.save(np.array([0])).shape[1]
    if sim_states is None:
        if filled:
            yield "pool is missing"
    elif sim_states.shape != (capacity, width) or sim_states.dtype != np.float64:
        yield f"pool holds {sim_states.dtype} of shape {sim_states.shape}, expected float64 of shape {(capacity, width)}"
    elif not np.isfinite(sim_states).all():
        yield "pool holds values that are not finite"


def _ring(name: str, counters: list[int], capacity: int) -> Iterator[str]:
    """Check that a ring is filled from the front, and later overwritten anywhere."""
    filled, following = counters
    if not (0 <= filled <= capacity and 0 <= following < capacity and (filled == capacity or following == filled)):
        yield f"{name} cannot have {filled} states, the next one in place {following}, of {capacity}"


def _worst_shapes(learner: Learner) -> dict[str, tuple[int, ...]]:
    """Return the shapes of the columns of the worst episodes."""
    assert learner.worst is not None
    capacity, width = learner.worst.capacity, learner.env.save(np.array([0])).shape[1]
    return dict(zip(WORST, ((capacity, width), (capacity,), (capacity, learner.agent.skills)), strict=True))


def _worst(learner: Learner, arrays: Mapping[str, Array], state: Mapping[str, Any]) -> Iterator[str]:
    """Check that the worst episodes are of skills, with weights that add to 1."""
    if learner.worst is None:
        return
    yield from _ring("worst", state["worst"], learner.worst.capacity)
    filled, skills = state["worst"][0], learner.agent.skills
    skill, weights = arrays["worst/skill"][:filled], arrays["worst/weights"][:filled]
    if not np.isin(skill, np.arange(skills)).all():
        yield f"worst/skill names a skill that is none of {skills}"
    if (weights < 0).any() or not np.allclose(weights.sum(axis=1), 1):
        yield "worst/weights are no shares of skills"


def _agreement(learner: Learner, arrays: Mapping[str, Array], state: Mapping[str, Any]) -> Iterator[str]:
    """Check that curves and counters agree."""
    each = learner.env.num_envs * learner.env.horizon
    if not np.array_equal(arrays["curves/env_steps"], each * np.arange(1, state["iteration"] + 1)):
        yield "curves/env_steps does not count its control steps"
    if not math.isclose(arrays["curves/learning_rate"][-1], state["policy_rate"]):
        yield "policy_rate is not where its curve ends"
