# ruff: noqa: E501 - tables of one case a line
"""Checkpoints of a training that nobody did; packed as the store does, so that all hashes are right, but not checked."""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from .case import Right, add
from .good import NAME, Good

KEYS = ("training.iterations=4", "training.simulations=8", "task.horizon=8", "evaluation.latents=2", "evaluation.stored=1")
SETTINGS = tuple(word for key in KEYS for word in ("--set", key))
State = dict[str, Any]
Edit = Callable[[dict[str, Any], State], Any]


def place(root: Path) -> Path:
    """Where `skill pretrain point --name hostile` keeps its checkpoint."""
    from skillcli.store import Store

    return Store(root).checkpoint_path(NAME, "pretrain", inputs())


def inputs() -> str:
    """What the training says that it was made of, and a checkpoint too."""
    from skillcli.evaluation.inputs import pretrain_inputs
    from skillcli.recipe import load_recipe
    from skillcli.tasks.world import World

    recipe = load_recipe("point", KEYS)
    return pretrain_inputs(recipe, World.of(recipe), 0)


@lru_cache(maxsize=4)
def training(seed: int) -> tuple[dict[str, Any], State]:
    """Arrays and state of a training after two of four iterations."""
    from skillcli.learning.learner import Learner
    from skillcli.recipe import load_recipe
    from skillcli.tasks.world import World

    recipe = load_recipe("point", KEYS)
    learner = Learner(World.of(recipe).make_env(recipe.training.simulations, 1), recipe, seed)
    learner.iterate()
    learner.iterate()
    arrays, state = learner.state()
    return {path: np.array(array) for path, array in arrays.items()}, {**state, "wall_seconds": 1.0, "inputs_sha256": inputs()}


def saved(edit: Edit, seed: int = 0) -> Callable[[Good], bytes]:
    def build(_: Good) -> bytes:
        from skillcli.store.container import Contents, checked_arrays, pack, text_array
        from skillcli.store.provenance import package_versions

        arrays, state = (dict(part) for part in training(seed))
        changed = edit(arrays, state)
        text = json.dumps(state if changed is None else changed, sort_keys=True, separators=(",", ":"))
        header = {"kind": "checkpoint", "schema_version": 1, "packages": package_versions()}
        contents = Contents({}, {**checked_arrays(arrays), "record/state": text_array(text)})
        return bytes(pack(header, contents, lambda _, ndim: (",".join(f"axis{i}" for i in range(ndim)), ""), gzip=False))

    return build


def says(**values: Any) -> Edit:
    return lambda _, state: state.update(values)


def lacks(key: str) -> Edit:
    def edit(_: dict[str, Any], state: State) -> None:
        del state[key]

    return edit


def array(path: str, change: Callable[[Any], Any]) -> Edit:
    def edit(arrays: dict[str, Any], _: State) -> None:
        arrays[path] = change(arrays[path])

    return edit


def without(start: str) -> Edit:
    def edit(arrays: dict[str, Any], _: State) -> None:
        for path in [path for path in arrays if path.startswith(start)]:
            del arrays[path]

    return edit


def generator(**values: Any) -> Edit:
    return lambda _, state: state.update(generator={**state["generator"], **values})


def more(path: str, value: Any) -> Edit:
    return lambda arrays, _: arrays.update({path: value})


WEIGHT = "agent/policy.body.0.weight"
DAMAGES: dict[str, tuple[Right, Edit]] = {
    "iteration_of_a_billion": ("refused", says(iteration=10**9)),
    "iteration_below_zero": ("refused", says(iteration=-5)),
    "iteration_of_a_fraction": ("refused", says(iteration=1.5)),
    "iteration_is_a_text": ("refused", says(iteration="2")),
    "iteration_is_true": ("refused", says(iteration=True)),
    "iteration_is_nothing": ("refused", says(iteration=None)),
    "iteration_is_the_last": ("refused", says(iteration=4)),
    "iteration_is_not_that_of_the_curves": ("refused", says(iteration=1)),
    "env_steps_below_zero": ("refused", says(env_steps=-1)),
    "env_steps_of_a_fraction": ("refused", says(env_steps=0.5)),
    "env_steps_beyond_64_bits": ("refused", says(env_steps=10**30)),
    "env_steps_are_a_text": ("refused", says(env_steps="many")),
    "seconds_are_nan": ("refused", says(sampling_seconds=math.nan)),
    "seconds_below_zero": ("refused", says(sampling_seconds=-1e9)),
    "seconds_of_zero": ("either", says(sampling_seconds=0.0)),
    "seconds_are_a_list": ("refused", says(sampling_seconds=[1])),
    "wall_seconds_are_a_text": ("refused", says(wall_seconds="long")),
    "wall_seconds_are_infinite": ("refused", says(wall_seconds=math.inf)),
    "rate_is_nan": ("refused", says(policy_rate=math.nan)),
    "rate_below_zero": ("refused", says(policy_rate=-1.0)),
    "rate_is_a_text": ("refused", says(policy_rate="fast")),
    "rate_is_huge": ("refused", says(policy_rate=1e300)),
    "pool_of_three": ("refused", says(pool=[1, 2, 3])),
    "pool_is_a_number": ("refused", says(pool=3)),
    "pool_filled_beyond": ("refused", says(pool=[10**9, 0])),
    "pool_filled_below_zero": ("refused", says(pool=[-1, 0])),
    "pool_goes_on_beyond": ("refused", says(pool=[1, 10**9])),
    "pool_of_texts": ("refused", says(pool=["1", "2"])),
    "pool_rows_of_another_width": ("refused", array("pool", lambda rows: rows[:, :1])),
    "pool_rows_fewer": ("refused", array("pool", lambda rows: rows[:1])),
    "pool_rows_are_nan": ("refused", array("pool", lambda rows: rows * np.nan)),
    "pool_rows_missing": ("refused", without("pool")),
    "generator_is_a_text": ("refused", says(generator="garbage")),
    "generator_is_empty": ("refused", says(generator={})),
    "generator_of_another_kind": ("refused", generator(bit_generator="MT19937")),
    "generator_unknown": ("refused", generator(bit_generator="[/]")),
    "generator_state_below_zero": ("refused", generator(state={"state": -1, "inc": 1})),
    "generator_state_of_2_to_the_200": ("refused", generator(state={"state": 2**200, "inc": 1})),
    "generator_state_is_a_text": ("refused", generator(state={"state": "x", "inc": "y"})),
    "generator_state_is_a_list": ("refused", generator(state=[1, 2])),
    "generator_step_is_even": ("either", generator(state={"state": 1, "inc": 2})),
    "generator_number_left_over": ("refused", generator(has_uint32="x", uinteger=[])),
    "state_is_a_list": ("refused", lambda *_: [1, 2, 3]),
    "state_is_a_number": ("refused", lambda *_: 3),
    "state_is_null": ("refused", lambda arrays, state: "null"),
    "state_is_empty": ("refused", lambda *_: {}),
    "state_with_more": ("either", says(more=1)),
    "state_nested_900_deep": ("refused", says(more=json.loads("[" * 900 + "]" * 900))),
    "state_of_500000_numbers": ("either", says(more=[0] * 500_000)),
    "weight_of_another_shape": ("refused", array(WEIGHT, lambda w: w[:3])),
    "weight_is_nan": ("refused", array(WEIGHT, lambda w: w * np.nan)),
    "weight_is_a_number": ("refused", array(WEIGHT, lambda w: np.float32(0))),
    "weight_is_whole": ("refused", array(WEIGHT, lambda w: w.astype(np.int64))),
    "weight_is_precise": ("refused", array(WEIGHT, lambda w: w.astype(np.float64))),
    "weight_missing": ("refused", without(WEIGHT)),
    "weights_missing": ("refused", without("agent/")),
    "weight_more": ("refused", more("agent/surprise", np.zeros(3))),
    "optimizer_missing": ("refused", without("optimizer/")),
    "optimizer_of_half": ("refused", without("optimizer/policy")),
    "optimizer_slot_of_another_shape": ("refused", lambda a, _: a.update({k: v[:1] for k, v in a.items() if k.endswith("exp_avg") and v.ndim})),
    "optimizer_slot_is_nan": ("refused", lambda a, _: a.update({k: v * np.nan for k, v in a.items() if k.endswith("exp_avg_sq")})),
    "optimizer_slot_below_zero": ("refused", lambda a, _: a.update({k: -1 - v for k, v in a.items() if k.endswith("exp_avg_sq")})),
    "optimizer_step_below_zero": ("refused", lambda a, _: a.update({k: v * 0 - 5 for k, v in a.items() if k.endswith("/step")})),
    "optimizer_slot_unknown": ("refused", more("optimizer/policy/0/surprise", np.zeros(3))),
    "optimizer_index_is_a_text": ("refused", more("optimizer/policy/x/step", np.zeros(()))),
    "optimizer_path_too_long": ("refused", more("optimizer/policy/0/more/step", np.zeros(()))),
    "curve_shorter": ("refused", array("curves/return", lambda c: c[:1])),
    "curve_longer": ("refused", array("curves/return", lambda c: np.resize(c, 1000))),
    "curve_missing": ("refused", without("curves/return")),
    "curves_missing": ("refused", without("curves/")),
    "curve_is_nan": ("either", array("curves/return", lambda c: c * np.nan)),
    "curve_of_two_dimensions": ("refused", array("curves/return", lambda c: c.reshape(1, -1))),
    "curve_more": ("refused", more("curves/surprise", np.zeros(2))),
    "inputs_of_another_training": ("refused", says(inputs_sha256="0" * 64)),
    "inputs_are_a_number": ("refused", says(inputs_sha256=3)),
    "array_more": ("either", more("surprise", np.zeros(2))),
}  # fmt: skip
for name, (right, edit) in DAMAGES.items():
    add(f"checkpoints.{name}", saved(edit), right, form="checkpoint")
for key in ("iteration", "env_steps", "sampling_seconds", "policy_rate", "generator", "pool", "wall_seconds", "inputs_sha256"):
    add(f"checkpoints.no_{key}", saved(lacks(key)), form="checkpoint")
add("checkpoints.of_another_seed", saved(lambda *_: None, seed=77), form="checkpoint")
add("checkpoints.good", saved(lambda *_: None), "accepted", form="checkpoint")
add("checkpoints.is_an_artifact", lambda good: good.forged().file(), form="checkpoint")
add("checkpoints.is_empty", lambda _: b"", form="checkpoint")
