from pathlib import Path

import pytest

from skillcli.errors import UsageError
from skillcli.recipe import Recipe, describe, load_recipe, recipe_names, resolve

MINIMAL = {"name": "mine", "task": {"name": "reach"}}


def refused(name: str, *overrides: str) -> UsageError:
    with pytest.raises(UsageError) as caught:
        load_recipe(name, overrides)
    assert caught.value.exit_code == 2
    assert caught.value.message and "\n" not in caught.value.message
    assert caught.value.hint
    return caught.value


@pytest.mark.parametrize("name", recipe_names())
def test_every_shipped_recipe_loads_under_its_name_and_says_what_it_is_for(name: str) -> None:
    recipe = load_recipe(name)
    assert recipe.name == name and recipe.description
    assert resolve(recipe.model_dump(mode="json")) == recipe, "what is stored resolves to the same recipe"


def test_the_promised_recipes_are_shipped() -> None:
    assert {"point", "reach", "reach-single-start", "smoke"} <= set(recipe_names())


PHYSICAL = {
    "goals", "tolerance", "horizon", "step_limit", "bound", "start", "action_limit", "control_period", "timestep", "window",
    "segments", "resolution", "goal_tolerance", "max_speed", "final_speed", "discount", "target_kl",
}  # fmt: skip


@pytest.mark.parametrize("task", ["point", "reach"])
def test_every_value_is_described_and_physical_ones_have_a_unit(task: str) -> None:
    rows = describe(resolve({"name": "mine", "task": {"name": task}}))
    assert len(rows) > 40
    for key, _, unit, description in rows:
        assert description, key
        assert unit or key.split(".")[-1] not in PHYSICAL, f"{key} has no unit"


def test_a_recipe_cannot_be_changed() -> None:
    recipe = load_recipe("point")
    with pytest.raises(ValueError, match="frozen"):
        recipe.training.iterations = 1  # type: ignore[misc]


def test_overrides_reach_nested_keys_lists_and_bare_words() -> None:
    recipe = load_recipe(
        "reach",
        ["training.iterations=7", "search.segments=[0.25, 0.5]", "compose.task=square", "network.policy_hidden=[8]",
         'description="two words"', "search.interpolated=false", "task.goals=[[0.5,0,0.2],[0.6,0,0.2]]"],
    )  # fmt: skip
    assert recipe.training.iterations == 7 and recipe.training.simulations == load_recipe("reach").training.simulations
    assert recipe.search.segments == (0.25, 0.5) and recipe.search.interpolated is False
    assert recipe.compose.task == "square" and recipe.description == "two words"
    assert recipe.network.policy_hidden == (8,) and recipe.task.goals[1] == (0.6, 0, 0.2)


def test_another_task_brings_its_own_defaults() -> None:
    assert load_recipe("point", ["task.name=reach"]).task == load_recipe("reach").task


@pytest.mark.parametrize(
    ("override", "said", "hint"),
    [
        ("training.iteratoins=3", "unknown recipe key 'training.iteratoins'", "iterations"),
        ("trainning.iterations=3", "unknown recipe key 'trainning'", "training"),
        ("task.bound=3", "unknown recipe key 'task.bound'", ""),
        ("training.simulations=-4", "greater than or equal to 1, got -4", ""),
        ("training.learning_rate=nan", "finite number", ""),
        ("training.learning_rate=inf", "finite number", ""),
        ("training.iterations=many", "valid integer", ""),
        ("training.iterations=2.5", "valid integer", ""),
        ("task.goals=[[0.5,nan,0.2]]", "finite number", ""),
        ("task.goals=[[0.5,0.2]]", "'task.goals.0.2' is missing", ""),
        ("task.goals=[]", "at least 1", ""),
        ("task.timestep=0.003", "whole number of timesteps", ""),
        ("embedding.min_std=0.9", "min_std < initial_std < max_std", ""),
        ("network.policy_hidden=[0]", "between 1 and 4096", ""),
        ("search.segments=[0]", "between 0 and 60 seconds", ""),
        ('task.names=["a","a"]', "8 goals need as many different names", ""),
        ("name=No Spaces", "pattern", ""),
        ("task.name=juggle", "task", ""),
        ("training=5", "'training'", ""),
        ("iterations", "expected key=value", "--set training.iterations=20"),
        ("=5", "expected key=value", ""),
    ],
)
def test_what_cannot_be_meant_is_refused_with_its_key(override: str, said: str, hint: str) -> None:
    error = refused("reach", override)
    assert said in error.message, error.message
    assert hint in error.hint, error.hint


def test_an_unknown_recipe_names_those_there_are(tmp_path: Path) -> None:
    assert "no recipe 'raech'" in refused("raech").message
    assert "reach" in refused("raech").hint
    assert "no recipe" in refused(str(tmp_path / "absent.toml")).message


@pytest.mark.parametrize(
    ("content", "said"),
    [
        (b"name = ", "cannot be read"),
        (b"\xff\xfe", "cannot be read"),
        (b'name = "x"', "'task' is missing"),
        (b"extends = 5", "extends must be the name"),
        (b'extends = "absent"', "no recipe 'absent'"),
        (b'name = "x"\ntask = 2020-01-01', "task"),
    ],
)
def test_a_broken_file_is_refused(tmp_path: Path, content: bytes, said: str) -> None:
    path = tmp_path / "mine.toml"
    path.write_bytes(content)
    assert said in refused(str(path)).message


def test_a_file_extends_a_shipped_recipe(tmp_path: Path) -> None:
    path = tmp_path / "mine.toml"
    path.write_text('extends = "reach"\nname = "mine"\n[training]\niterations = 3\n')
    mine, base = load_recipe(str(path)), load_recipe("reach")
    assert mine.training == base.training.model_copy(update={"iterations": 3}) and mine.search == base.search


def test_recipes_that_extend_each_other_are_refused(tmp_path: Path) -> None:
    first, second = tmp_path / "first.toml", tmp_path / "second.toml"
    first.write_text(f'extends = "{second}"')
    second.write_text(f'extends = "{first}"')
    assert "extends itself" in refused(str(first)).message


def test_the_fingerprint_follows_values_in_the_named_sections_only() -> None:
    def of(*changes: str) -> Recipe:
        return load_recipe("reach", changes)

    base, other_search, other_training = of(), of("search.budget=7"), of("training.iterations=7")
    assert base.fingerprint() == of().fingerprint() == of("training.iterations=60").fingerprint()
    assert len({one.fingerprint() for one in (base, other_search, other_training)}) == 3
    assert base.fingerprint(["training", "task"]) == other_search.fingerprint(["training", "task"])
    assert base.fingerprint(["training"]) != other_training.fingerprint(["training"])
