"""Artifacts that are whole but not what their recipe says: refused in one line by everything that uses them."""

from __future__ import annotations

import json
import resource
import subprocess
import sys
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from command import CHAIN, skill
from forge import forge
from worlds import make_env, sizes

from skillcli.errors import StoreError
from skillcli.evaluation import consistency
from skillcli.evaluation.consistency import check_meaning
from skillcli.evaluation.library import open_library
from skillcli.learning.agent import Agent
from skillcli.learning.shapes import weight_shapes
from skillcli.recipe import load_recipe, recipe_names, resolve
from skillcli.store import Artifact, ArtifactId, Store
from skillcli.tasks.world import World
from skillcli.viz.loading import scene_of

pytestmark = pytest.mark.slow  # every artifact is read and judged

Change = Callable[[dict[str, Any], dict[str, Any]], None]  # of arrays and recipe


def arrays(path: str, function: Callable[[Any], Any]) -> Change:
    def change(found: dict[str, Any], _: dict[str, Any]) -> None:
        found[path] = function(np.array(found[path]))

    return change


def recipe(section: str, **values: Any) -> Change:
    def change(_: dict[str, Any], found: dict[str, Any]) -> None:
        found[section] = {**found[section], **values}

    return change


def forged(store: Store, good: Artifact, change: Change, **others: Any) -> Artifact:
    found, values = dict(good.arrays), dict(good.recipe)
    change(found, values)
    return store.read(forge(store, good, arrays=found, recipe=values, **others))


def moved(folder: Path, chain: Path, stage: str = "pretrain") -> tuple[Store, Artifact]:
    """A store of its own with one artifact of the chain, and its ancestors."""
    store, one = Store(folder / "artifacts"), ArtifactId("tiny", stage, 1)
    for each in (one, *Store(chain).lineage(one)):
        store.path(each).parent.mkdir(parents=True, exist_ok=True)
        store.path(each).write_bytes(Store(chain).path(each).read_bytes())
    return store, store.read(one)


@pytest.mark.parametrize("stage", CHAIN)
def test_what_the_stages_write_means_what_it_says(chain: Path, push_chain: Path, stage: str) -> None:
    for store, name in ((Store(chain), "tiny"), (Store(push_chain), "pushed")):
        artifact = ArtifactId(name, stage, 1)
        check_meaning(store.read(artifact))
        assert store.verify(artifact, check_meaning) == []


def test_every_shipped_artifact_means_what_it_says() -> None:
    store = Store(Path(__file__).parents[2] / "artifacts")
    shipped = [one for one in store.ids() if one.name.startswith("reference-")]
    assert len(shipped) > 10
    for one in shipped:
        open_library(store, store.read(one))


LIBRARIES: list[tuple[Change, str]] = [
    (lambda found, _: found.pop("weights/policy.log_std"), "weights/policy.log_std is missing"),
    (lambda found, _: found.update({"weights/more": np.zeros(3, np.float32)}), "weights/more is none of its networks"),
    (arrays("weights/policy.log_std", lambda one: one[0]), "weights/policy.log_std has shape (), expected (7,)"),
    (arrays("weights/normalizer.mean", lambda one: one[:-1]), "weights/normalizer.mean has shape (9,), expected (10,)"),
    (arrays("weights/normalizer.variance", lambda one: -one), "weights/normalizer.variance is negative"),
    (arrays("weights/policy.log_std", lambda one: one.astype(float)), "weights/policy.log_std holds float64"),
    (arrays("weights/embedding.raw_mean", lambda one: one + 1), "embedding/mean is not what its weights say"),
    (arrays("weights/embedding.raw_std", lambda one: one - 99), "embedding/std is not what its weights say"),
    (arrays("skills/goal", lambda one: one + 0.01), "skills/goal holds other goals"),
    (arrays("curves/return", lambda one: np.resize(one, 1000)), "curves/return has 1000 points, the training"),
    (arrays("trajectories/time", lambda one: 2 * one), "trajectories/time does not advance by 0.05 s"),
    (arrays("trajectories/joint_position", lambda one: one[..., :6]), "trajectories/joint_position has shape"),
    (arrays("trajectories/action", lambda one: one[..., :2]), "trajectories/action has shape"),
    (lambda found, _: found.pop("trajectories/gripper_position"), "its positions are not those of the reach task"),
    (recipe("network", policy_hidden=[5]), "weights/policy.body.0.weight has shape"),
    (recipe("network", linear_latent=True), "weights/policy.body.0.weight has shape"),
    (recipe("network", policy_hidden=[4096] * 16), "weights/policy.body.10.bias is missing"),
    (recipe("embedding", window=64), "weights/inference.body.0.weight has shape (64, 60), expected (64, 640)"),
    (recipe("embedding", size=4), "embedding/mean has shape (8, 3), expected (8, 4)"),
    (recipe("task", horizon=17), "its episodes have 16 control steps, its recipe 17"),
    (recipe("task", names=list("abcdefgh")), "results.skills names other skills"),
    (recipe("task", observe_command=True), "weights/normalizer.mean has shape (10,), expected (17,)"),
    (recipe("evaluation", latents=9), "evaluation/final_distance has shape (8, 4), expected (8, 10)"),
    (recipe("evaluation", stored=0), "it keeps 16 episodes, expected 8"),
    (recipe("task", goals=[[0.5, 0.3, z / 1e4] for z in range(1000)]), "embedding/mean has shape (8, 3), expected (1000, 3)"),
]


@pytest.mark.parametrize(("change", "told"), LIBRARIES, ids=[told for _, told in LIBRARIES])
def test_a_library_that_is_not_what_its_recipe_says_is_refused(chain: Path, tmp_path: Path, change: Change, told: str) -> None:
    store, good = moved(tmp_path, chain)
    bad = forged(store, good, change)
    for refused in (lambda: check_meaning(bad), lambda: open_library(store, bad)):
        with pytest.raises(StoreError, match="tiny/pretrain-v1 is not what its recipe says") as caught:
            refused()
        assert told in caught.value.message and "\n" not in caught.value.message


UNKNOWN: list[tuple[Change, str]] = [
    (recipe("network", policy_hidden=[8] * 17), "policy_hidden"),
    (recipe("network", policy_hidden=[10**6]), "hidden layer"),
    (recipe("embedding", window=6_400_000), "window"),
    (recipe("task", goals=[[0.5, 0.3, z / 1e6] for z in range(2_000)]), "goals"),
    (recipe("task", timestep=1e-9), "timestep"),
    (recipe("task", name="dance"), "task"),
    (recipe("embedding", surprise=1), "surprise"),
    (lambda _, found: found.pop("task"), "task"),
]


@pytest.mark.parametrize(("change", "told"), UNKNOWN, ids=[told for _, told in UNKNOWN])
def test_a_stored_recipe_that_is_none_is_refused(chain: Path, tmp_path: Path, change: Change, told: str) -> None:
    store, good = moved(tmp_path, chain)
    bad = forged(store, good, change)
    with pytest.raises(StoreError, match="the recipe stored in tiny/pretrain-v1 is not one that this skill") as caught:
        open_library(store, bad)
    assert told in caught.value.message and "\n" not in caught.value.message


@pytest.mark.parametrize(
    ("name", "shape", "told"),
    [
        ("latency", (), ""),
        ("table_tilt", (2,), ""),
        ("gain", (6,), ""),
        ("latency", (7,), "domains/mild/latency has (7,) values in each episode, expected 1"),
        ("table_tilt", (), "expected 2"),
        ("gain", (), "expected one for each joint"),
        ("gain", (50_000,), "expected one for each joint"),
        ("gain", (6, 1), "expected one for each joint"),
        ("magic", (), "a domain varies magic, which is not a parameter"),
    ],
)
def test_parameters_of_a_domain_have_as_many_values_as_are_drawn(name: str, shape: tuple[int, ...], told: str) -> None:
    found = " and ".join(consistency._parameter(f"domains/mild/{name}", shape))
    assert found.endswith(told) and bool(found) == bool(told)


PLANS: list[tuple[Change, str]] = [
    (arrays("plan/seconds", lambda one: one + 1e9), "its plan lasts"),
    (arrays("plan/skill", lambda one: one * 0 + 8), "plan/latent and plan/skill are not those of 8 skills"),
    (arrays("trajectories/skill", lambda one: one * 0 + 8), "trajectories/skill names skill 8, there are 8"),
    (arrays("trajectories/time", lambda one: 2 * one), "trajectories/time does not advance by"),
]


@pytest.mark.parametrize(("change", "told"), PLANS, ids=[told for _, told in PLANS])
def test_a_plan_that_is_not_what_its_recipe_says_is_refused(chain: Path, tmp_path: Path, change: Change, told: str) -> None:
    store, good = moved(tmp_path, chain, "compose")
    bad = forged(store, good, change)
    with pytest.raises(StoreError, match="tiny/compose-v1 is not what its recipe says") as caught:
        open_library(store, bad)
    assert told in caught.value.message


def test_a_plan_by_no_method_is_refused(chain: Path, tmp_path: Path) -> None:
    store, good = moved(tmp_path, chain, "compose")
    bad = forged(store, good, lambda *_: None, results={**good.results, "method": "magic"})
    with pytest.raises(StoreError, match=r"results\.method must be one of search"):
        check_meaning(bad)


def test_plans_of_an_earlier_skill_keep_what_their_recipes_say_of_planning(chain: Path, tmp_path: Path) -> None:
    store, good = moved(tmp_path, chain, "compose")
    check_meaning(forged(store, good, recipe("search", refinement=3)))


def test_a_plan_made_with_other_skills_is_refused(chain: Path, tmp_path: Path) -> None:
    store, good = moved(tmp_path, chain, "compose")
    bad = forged(store, good, recipe("task", action_limit=0.03))
    with pytest.raises(StoreError, match=r"tiny/compose-v1 was made with other skills than those of tiny/pretrain-v1"):
        open_library(store, bad)


USES: Mapping[str, tuple[str, ...]] = {
    "verify": ("verify", "--all"),
    "import": ("import", "{file}"),
    "embed-means": ("embed-means", "tiny/pretrain"),
    "compose": ("compose", "tiny/pretrain", "--goal", "0.6,0,0.2"),
    "sequence": ("compose", "tiny/pretrain", "--method", "sequence", "--plan", "1,2"),
    "transfer-eval": ("transfer-eval", "tiny/pretrain", "--domain", "nominal", "--episodes", "2"),
    "viz": ("viz", "tiny/pretrain", "-o", "{folder}/x.rrd"),
    "report": ("report", "tiny/pretrain", "-o", "{folder}/x.html"),
}


@pytest.mark.parametrize("words", USES.values(), ids=USES)
@pytest.mark.parametrize(
    "change", [recipe("network", policy_hidden=[4096] * 16), recipe("task", name="dance")], ids=["large", "unknown"]
)
def test_every_use_refuses_in_one_line(chain: Path, tmp_path: Path, words: tuple[str, ...], change: Change) -> None:
    store, good = moved(tmp_path, chain)
    forged(store, good, change)
    root = tmp_path / "other" if words[0] == "import" else store.root
    filled = [word.format(file=store.path(good.id), folder=tmp_path) for word in words]
    result = skill("--store", root, "--json", *filled)
    error = result.json["error"]
    assert result.code in (1, 2) and error["type"] in ("StoreError", "Damaged"), error
    assert "tiny/pretrain-v1" in str(result.json) and "unexpected" not in result.err and "\n" not in error["message"]
    assert not root.joinpath("tiny", "pretrain-v1.h5").exists() or words[0] != "import"


LARGE = """
import json, resource, sys
from pathlib import Path
from skillcli.errors import StoreError
from skillcli.evaluation import consistency
from skillcli.evaluation.consistency import check_meaning
from skillcli.store import ArtifactId, Store
store = Store(Path(sys.argv[1]))
artifact = store.read(ArtifactId("tiny", "pretrain", 1))
try:
    check_meaning(artifact)
    refused = ""
except StoreError as error:
    refused = error.message
seconds = resource.getrusage(resource.RUSAGE_SELF)
heavy = sorted({"torch"} & set(sys.modules))
print(json.dumps({"refused": refused, "seconds": seconds.ru_utime, "megabytes": seconds.ru_maxrss / 1024, "heavy": heavy}))
"""


def test_a_recipe_of_gigabytes_costs_nothing(chain: Path, tmp_path: Path) -> None:
    store, good = moved(tmp_path, chain)
    hidden = {f"{part}_hidden": [4096] * 16 for part in ("policy", "value", "inference")}
    forged(store, good, recipe("network", **hidden))
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024  # a child begins with what its parent had
    done = subprocess.run([sys.executable, "-c", LARGE, str(store.root)], capture_output=True, text=True, check=True)
    found = json.loads(done.stdout)
    assert "is missing" in found["refused"] and found["heavy"] == []
    assert found["seconds"] < 5 and found["megabytes"] < max(before + 1, 400), found


@pytest.mark.parametrize("name", recipe_names())
def test_sizes_of_weights_are_those_of_the_networks(name: str) -> None:
    variants: list[list[str]] = [
        [],
        ["network.policy_hidden=[]", "network.value_hidden=[3,4,5]", "network.inference_hidden=[2]", "embedding.size=2"],
        ["network.linear_latent=true", "embedding.window=2", "network.policy_hidden=[7]"],
    ]
    for overrides in variants:
        one = load_recipe(name, overrides)
        world = World.of(one)
        env = world.make_env(1)
        assert world.sizes == (env.observation_size, env.action_size, env.privileged_size)
        agent = Agent(one, env.observation_size, env.action_size, env.goals, privileged=env.privileged_size)
        assert weight_shapes(one, *world.sizes) == {path: array.shape for path, array in agent.arrays().items()}


def test_sizes_of_an_observation_follow_the_task() -> None:
    for given in ({"observe_command": True}, {"observe_place": True}, {"observe_command": True, "observe_place": True}):
        task = resolve({"name": "p", "task": {"name": "push", **given}}).task
        assert sizes(task)[0] == make_env(task, 1).observation_size


def test_a_parent_of_another_kind_is_no_library(chain: Path, tmp_path: Path) -> None:
    store, good = moved(tmp_path, chain, "embed-means")
    orphan = store.read(forge(store, good, parents=()))
    with pytest.raises(StoreError, match="has no pretrain among its ancestors"):
        open_library(store, orphan)


def test_what_is_drawn_beside_an_artifact_must_be_of_the_same_skills(chain: Path, tmp_path: Path) -> None:
    store, good = moved(tmp_path, chain, "transfer-eval")
    plan = store.read(ArtifactId("tiny", "compose", 1))
    assert len(scene_of(store, good.id).waypoints) > 0
    forged(store, plan, recipe("task", action_limit=0.03))
    with pytest.raises(StoreError, match=r"tiny/compose-v1 was made with other skills than those of tiny/pretrain-v1"):
        scene_of(store, good.id)
