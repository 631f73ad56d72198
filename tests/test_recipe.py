from pathlib import Path

import numpy as np
import pytest
from ranges import log_uniform, one_of, uniform

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


def test_an_arm_like_the_recorded_one_is_met_in_training() -> None:
    recipe, recorded = (
        load_recipe("reach-recorded"),
        load_recipe("reach", ["randomisation=sawyer-recorded"]).randomisation.ranges,
    )
    assert recipe.task.observe_command and recipe.randomisation.ranges["latency"] == recorded["latency"]
    for name in ("command_response", "gain", "joint_damping", "joint_friction", "link_mass", "gravity_compensation"):
        low, high = recipe.randomisation.ranges[name].values
        lowest, highest = np.array(recorded[name].values).reshape(2, -1)
        middle = (lowest + highest) / 2  # of each joint
        assert (low <= middle).all() and (middle <= high).all(), name
    assert recipe.randomisation.ranges["command_restart"].values[1] == recorded["command_restart"].values[0] == 1.0


def test_the_promised_recipes_are_shipped() -> None:
    assert {"point", "reach", "reach-single-start", "push", "push-single-start", "push-robust", "smoke"} <= set(recipe_names())


PHYSICAL = {
    "goals", "tolerance", "horizon", "step_limit", "bound", "start", "action_limit", "control_period", "timestep", "window",
    "segments", "resolution", "goal_tolerance", "max_speed", "approach_speed", "final_speed", "discount", "target_kl",
    "box_start", "box_size", "box_mass",
}  # fmt: skip


@pytest.mark.parametrize("task", ["point", "reach", "push"])
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
    assert load_recipe("reach", ["task.name=push"]).task == load_recipe("push-single-start").task


@pytest.mark.parametrize(
    ("override", "said", "hint"),
    [
        ("training.iteratoins=3", "unknown recipe key 'training.iteratoins'", "iterations"),
        ("trainning.iterations=3", "unknown recipe key 'trainning'", "training"),
        ("task.bound=3", "unknown recipe key 'task.bound'", ""),
        ("training.simulations=-4", "expected at least 1, got -4", ""),
        ("training.learning_rate=nan", "finite number", ""),
        ("training.learning_rate=inf", "finite number", ""),
        ("training.iterations=many", "expected a whole number, got 'many'", ""),
        ("training.iterations=2.5", "expected a whole number, got 2.5", ""),
        ("task.goals=[[0.5,nan,0.2]]", "finite number", ""),
        ("task.goals=[[0.5,0.2]]", "'task.goals', entry 1: expected three numbers, got 2", ""),
        ("task.goals=[]", "expected at least one entry, got none", ""),
        ("task.timestep=0.003", "whole number of timesteps", ""),
        ("embedding.min_std=0.9", "'embedding': min_std < initial_std < max_std must hold, got min_std 0.9", ""),
        ("network.policy_hidden=[0]", "between 1 and 4096", ""),
        ("search.segments=[0]", "between 0 and 60 seconds", ""),
        ('task.names=["a","a"]', "8 goals need as many different names", ""),
        ("name=No Spaces", "expected 1 to 64 lower-case letters", ""),
        ("task.name=juggle", "'task.name': expected one of 'point', 'reach', 'push', 'blocks', got 'juggle'", ""),
        ("training=5", "'training': expected a table of keys, got 5", ""),
        ("iterations", "expected key=value", "--set training.iterations=20"),
        ("=5", "expected key=value", ""),
    ],
)
def test_what_cannot_be_meant_is_refused_with_its_key(override: str, said: str, hint: str) -> None:
    error = refused("reach", override)
    assert said in error.message, error.message
    assert hint in error.hint, error.hint


@pytest.mark.parametrize(
    ("override", "said"),
    [
        ("task.goals=[[0.1,0,0,0]]", "'task.goals', entry 1: expected at most three numbers, got 4"),
        ("task.goals=[[0.1]]", "'task.goals', entry 1: expected at least two numbers, got 1"),
        ("task.goals=[[0.1,0,0],[0.1,0]]", "goals name x and y, or x, y and a turn, all of them alike"),
        ("task.goals=[[0.1,0],[0.1,0],[0,0.1],[0,-0.1]]", "two skills have the same goal"),
        ('task.names=["up"]', "4 goals need as many different names"),
        ("task.box_size=[0.06,0.06]", "'task.box_size': expected three numbers, got 2"),
        ("task.box_size=[0.06,0.005,0.06]", "between 0.01 and 0.3 m"),
        ("task.box_size=[0.06,0.06,0.31]", "between 0.01 and 0.3 m"),
        ("task.box_mass=0", "expected more than 0, got 0"),
        ("task.box_mass=5.1", "expected at most 5, got 5.1"),
        ("task.friction=-0.6", "expected more than 0, got -0.6"),
        ("task.box_start=[0.6,nan]", "finite number"),
        ("task.timestep=0.003", "whole number of timesteps"),
        ("task.bound=3", "unknown recipe key 'task.bound'"),
    ],
)
def test_a_push_that_cannot_be_meant_is_refused_with_its_key(override: str, said: str) -> None:
    error = refused("push", override)
    assert said in error.message, error.message


def test_other_goals_need_other_names_and_none_at_all_are_fine() -> None:
    task = load_recipe("push", ["task.goals=[[0.1, 0], [0, 0.1]]", "task.names=[]"]).task
    assert task.goals == ((0.1, 0), (0, 0.1)) and task.names == ()
    assert load_recipe("push", ["task.goals=[[0.1, 0], [0, 0.1]]"]).task == task, "nor are those of the default goals theirs"
    assert load_recipe("push", ["task.box_mass=0.5"]).task.names == ("up", "down", "left", "right")


@pytest.mark.parametrize(
    ("overrides", "said", "hint"),
    [
        (("dynamics.gain=1.1", "sensing.gain=1.2"), "gain is named more than once", ""),
        (("starts.gain=1.1", "dynamics.gain=1.1"), "gain is named more than once", ""),
        (("dynamics.wind=1.0",), "no parameter 'wind'", ""),
        (("sensing.wind=1.0",), "'randomisation.sensing'", ""),
        (("starts_span=[0.8, 0.7]",), "two shares of the training in order", ""),
        (("sensing_span=[-0.1, 0.5]",), "between 0 and 1, got [-0.1, 0.5]", ""),
        (("starts_span=[0.5, 1.1]",), "between 0 and 1", ""),
        (("starts_span=0.5",), "'randomisation.starts_span'", ""),
        (("dynamics.gain={uniform=[-0.1, 1]}",), "gain must lie between 0 and 1000 as a factor, got -0.1", ""),
        (("sensing.latency=0.2",), "latency must lie between 0 and 0.155 s, got 0.2", ""),
        (("sensing.latency=many",), "'randomisation.sensing.latency'", ""),
        (("dynamics.gain={uniform=[1.2, 0.8]}",), "low <= high", ""),
        (("sometimes.gain=1.1",), "unknown recipe key 'randomisation.sometimes'", "dynamics, sensing"),
    ],
)
def test_a_randomisation_that_cannot_be_meant_is_refused_with_its_key(overrides: tuple[str, ...], said: str, hint: str) -> None:
    error = refused("push", *(f"randomisation.{override}" for override in overrides))
    assert "randomisation" in error.message and said in error.message, error.message
    assert hint in error.hint, error.hint


def test_randomisation_is_read_from_a_file_and_replaced_one_by_one(tmp_path: Path) -> None:
    path = tmp_path / "mine.toml"
    path.write_text(
        'name = "mine"\n[task]\nname = "push"\n'
        "[randomisation.dynamics]\ngain = { uniform = [0.7, 1.3] }\n"
        "[randomisation.starts]\nobject_offset = { uniform = [-0.1, 0.1] }\n"
        "[randomisation.sensing]\nlatency = { one_of = [0.0, 0.05] }\njoint_noise = 0.005\n"
    )
    change = "randomisation.sensing.joint_noise={uniform=[0.0, 0.01]}"
    found = load_recipe(str(path), ["randomisation.dynamics.gain=1.0", change])
    assert found.randomisation.dynamics == {"gain": one_of(1.0)}
    assert found.randomisation.starts == {"object_offset": uniform(-0.1, 0.1)}
    assert found.randomisation.sensing == {"latency": one_of(0.0, 0.05), "joint_noise": uniform(0.0, 0.01)}
    assert found.randomisation.ranges.keys() == {"gain", "object_offset", "latency", "joint_noise"}
    assert resolve(found.model_dump(mode="json")) == found


def test_randomisation_may_be_that_of_a_domain(tmp_path: Path) -> None:
    (tmp_path / "arm.toml").write_text(
        'name = "arm"\n[parameters]\ngain = 1.1\nlatency = 0.05\nstart_offset = 0.01\njoint_noise = 0.002\n'
    )
    whole = load_recipe("push-robust", [f"randomisation={tmp_path / 'arm.toml'}"]).randomisation
    assert (whole.dynamics, whole.starts) == ({"gain": one_of(1.1)}, {"start_offset": one_of(0.01)})
    assert whole.sensing == {"latency": one_of(0.05), "joint_noise": one_of(0.002)}
    assert resolve(load_recipe("reach", ["randomisation=mild"]).model_dump(mode="json")).randomisation.ranges[
        "gain"
    ] == uniform(0.95, 1.05)
    (tmp_path / "mine.toml").write_text(
        'name = "mine"\n[task]\nname = "reach"\n[randomisation]\ndomain = "arm.toml"\nsensing_span = [0.1, 0.2]\n'
        "[randomisation.dynamics]\ngain = 2.0\n"
    )
    beside = load_recipe(str(tmp_path / "mine.toml")).randomisation
    assert beside.dynamics == {"gain": one_of(2.0)} and beside.sensing == whole.sensing and beside.sensing_span == (0.1, 0.2)
    with pytest.raises(UsageError, match="no domain 'milder'"):
        load_recipe("reach", ["randomisation=milder"])
    with pytest.raises(UsageError, match="randomisation"):  # an artifact opens no file
        resolve({"name": "mine", "task": {"name": "reach"}, "randomisation": str(tmp_path / "arm.toml")})


def test_a_range_can_be_replaced_by_one_of_another_kind() -> None:
    ranges = load_recipe("push-robust", ["randomisation.dynamics.gain={log_uniform=[0.5, 2.0]}"]).randomisation.ranges
    assert ranges["gain"] == log_uniform(0.5, 2.0)
    stored = load_recipe("push-robust").model_dump(mode="json")
    assert resolve(stored, ["randomisation.dynamics.gain={one_of=[1.0, 1.1]}"]).randomisation.ranges["gain"] == one_of(1, 1.1)


def test_nothing_is_randomised_unless_asked() -> None:
    for task in ("point", "reach", "push"):
        assert resolve({"name": "mine", "task": {"name": task}}).randomisation.ranges == {}
    assert load_recipe("push-single-start").randomisation.ranges == {}
    assert load_recipe("push").randomisation.ranges.keys() == {"start_offset", "object_offset"}, "random starts alone"
    robust = load_recipe("push-robust").randomisation
    assert robust.dynamics and robust.starts and robust.sensing, "what a training must be robust against"


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
    randomised = of("randomisation.dynamics.gain=1.1")
    assert base.fingerprint(["randomisation"]) != randomised.fingerprint(["randomisation"])
    assert base.fingerprint(["training", "task"]) == randomised.fingerprint(["training", "task"])
