"""Artifacts that claim to be the finished work that somebody is about to do."""

from __future__ import annotations

import tempfile
from collections.abc import Callable
from pathlib import Path

from .case import add
from .checkpoints import KEYS
from .forge import Forged, forge
from .good import NAME, Good

CHAIN = ("search.budget=12", "search.batch=4", "transfer.episodes=2")
SETTINGS = tuple(word for key in (*KEYS, *CHAIN) for word in ("--set", key))


def trained(seed: int, *keys: str) -> Forged:
    """What a short training gives."""
    from skillcli.recipe import load_recipe
    from skillcli.stages.pretrain import pretrain
    from skillcli.store import Store

    with tempfile.TemporaryDirectory() as folder:
        store = Store(Path(folder))
        made = pretrain(store, load_recipe("point", (*KEYS, *CHAIN, *keys)), seed, NAME, "skill")
        return forge(store.path(made.id).read_bytes())


def claims(seed: int, *keys: str) -> Callable[[Good], bytes]:
    """Trained so, it says that it comes of seed 0 and the settings that are asked for."""

    def build(_: Good) -> bytes:
        from skillcli.evaluation.inputs import pretrain_inputs
        from skillcli.recipe import load_recipe
        from skillcli.tasks.world import World

        copy = trained(seed, *keys)
        recipe = load_recipe("point", KEYS)
        copy.header["inputs_sha256"] = pretrain_inputs(recipe, World.of(recipe), 0)
        return copy.file()

    return build


for name, build in {
    "of_another_seed": claims(77),
    "of_fewer_iterations": claims(0, "training.iterations=1"),
    "of_other_goals": claims(0, "task.goals=[[1.0, 1.0], [2.0, 2.0]]"),
    "of_another_network": claims(0, "network.policy_hidden=[8]"),
}.items():
    add(f"reuse.{name}", build, "either", form="reuse")
