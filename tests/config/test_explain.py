"""Recipes, domains and robot files that cannot be meant: our words, one line, what was expected and what was got."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from skillcli.config.explain import shown
from skillcli.config.randomization import PARAMETERS
from skillcli.config.toml_file import read_toml
from skillcli.errors import UsageError
from skillcli.recipe import describe, load_recipe, resolve
from skillcli.robots.config import Description, read_description
from skillcli.simulation.domains import find_domain

ROBOT = (Path(__file__).parents[1] / "robots" / "torque.toml").read_text(encoding="utf-8")
FOREIGN = re.compile(r"Input should|Value error|valid|pattern|Tuple|items|something else|\n", flags=re.IGNORECASE)
ODD = (
    "true", '"1"', "many", "2.5", "-1e300", "nan", "inf", "1e400", "9" * 500, "[]", "[true]", '["1", 2]', "[[1]]", "[nan]",
    "{}", "{a=1}", "2020-01-01", "[[0.5, 0.2], 3]", "[1,2,3,4,5,6,7,8,9]", '""', "[[],[]]", "{uniform=[true, 1]}",
)  # fmt: skip


def words(error: UsageError) -> str:
    assert error.exit_code == 2 and error.hint and not FOREIGN.search(error.message), error.message
    return error.message


@pytest.mark.parametrize("task", ["point", "reach", "push"])
def test_no_value_of_any_key_is_refused_in_words_that_are_not_ours(task: str) -> None:
    base = {"name": "mine", "task": {"name": task}}
    refused = 0
    for key, *_ in describe(resolve(base)):
        for odd in ODD:
            try:
                resolve(base, [f"{key}={odd}"])
            except UsageError as error:
                assert key.split(".")[0] in words(error), error.message
                refused += 1
    assert refused > 1000


@pytest.mark.parametrize("name", PARAMETERS)
def test_nor_is_any_of_a_domain(name: str, tmp_path: Path) -> None:
    for odd in (odd for odd in ODD if odd != "2.5"):
        (tmp_path / "odd.toml").write_text(f'name = "odd"\n[parameters]\n{name} = {odd}\n', encoding="utf-8")
        with pytest.raises(UsageError) as caught:  # none of them is one
            find_domain(str(tmp_path / "odd.toml"))
        assert "cannot be read" in caught.value.message or words(caught.value)


@pytest.mark.parametrize("key", [*Description.model_fields, "base.pos", "base.quat", "gripper.pos", "gains.kp"])
def test_nor_is_any_of_a_robot(key: str, tmp_path: Path) -> None:
    path, last = tmp_path / "odd.toml", key.split(".")[-1]
    for odd in (odd for odd in ODD if odd != "many"):
        section = {"base": "\n[base]", "gripper": 'body = "hand"', "gains": "kv = [1, 1, 1, 1, 1, 1, 1]"}.get(key.split(".")[0])
        whole = f'{ROBOT.split("[gripper]")[0]}\n[gripper]\nbody = "hand"\n'
        text = (
            f"{key} = {odd}\n{ROBOT}"
            if section is None or "." not in key
            else f"{whole}\n[{key.split('.')[0]}]\n{last} = {odd}\n"
        )
        if key.startswith("gripper."):
            text = f"{whole}{last} = {odd}\n"
        path.write_text(text, encoding="utf-8")
        try:
            read_description(path)
        except UsageError as error:
            assert "cannot be read" in error.message or words(error)


@pytest.mark.parametrize(
    ("override", "said"),
    [
        ("training.learning_rate=true", "'training.learning_rate': expected a number, got true"),
        ("training.iterations=true", "'training.iterations': expected a whole number, got true"),
        ('training.iterations="60"', "'training.iterations': expected a whole number, got '60'"),
        ("training.iterations=1e-", "expected a whole number, got '1e-'"),
        ("search.interpolated=1", "'search.interpolated': expected true or false, got 1"),
        ('transfer.replan="yes"', "'transfer.replan': expected true or false, got 'yes'"),
        ("network.policy_hidden=[64, true]", "'network.policy_hidden': expected a whole number, got true"),
        ('task.goals=[[0.5, "0.2", 0.1]]', "'task.goals': expected a number, got '0.2'"),
        ("task.start=[0, 0, 0]", "'task.start': expected 7 numbers, one for each joint, got 3"),
        ("task.goals=[[0.5, 0.2, 0.1], [0.5, 0.2, 0.1, 1]]", "'task.goals', entry 2: expected three numbers, got 4"),
        ("task.goals=[[0.5, nan, 0.2]]", "'task.goals', entry 2 of entry 1: expected a finite number, got nan"),
        ("embedding.arrangement=circle", "'embedding.arrangement': expected 'goals', 'isometric' or 'random', got 'circle'"),
        ("search.grid=32", "recipe: search.grid of 32 gives 32768 latents"),
        ("description=3", "'description': expected text in quotes, got 3"),
        ("randomisation.dynamics.gain={uniform=[true, 2]}", "'randomisation.dynamics.gain': expected a number, got true"),
        ("randomisation.dynamics.gain=true", "'randomisation.dynamics.gain': expected a number, or one of"),
        ("a.b.c.d.e.f.g.h.i=1", "expected key=value"),
    ],
)  # fmt: skip
def test_what_looks_like_a_value_and_is_none_is_refused_with_its_key(override: str, said: str) -> None:
    with pytest.raises(UsageError) as caught:
        load_recipe("reach", [override])
    assert said in caught.value.message, caught.value.message


def test_whole_numbers_may_be_written_with_a_point_and_numbers_without() -> None:
    recipe = load_recipe("reach", ["training.iterations=6e1", "training.learning_rate=1", "task.goals=[[0, 1, 0]]"])
    assert (recipe.training.iterations, recipe.training.learning_rate, recipe.task.goals) == (60, 1.0, ((0.0, 1.0, 0.0),))


def test_keys_of_an_unknown_one_are_those_of_the_task_it_stands_in() -> None:
    with pytest.raises(UsageError) as caught:
        load_recipe("push", ["task.box_weight=1"])
    assert "box_mass" in caught.value.hint and "step_limit" not in caught.value.hint


def test_a_value_is_shown_as_it_is_written_and_short() -> None:
    assert [shown(item) for item in (True, "a", [1], {}, 1.5)] == ["true", "'a'", "a list", "a table of keys", "1.5"]
    assert len(shown("x" * 1000)) < 80


TEXT = 'name = "calm"\n'


def test_a_byte_order_mark_is_no_part_of_a_file(tmp_path: Path) -> None:
    marked = "\ufeff"
    (tmp_path / "domain.toml").write_text(marked + TEXT, encoding="utf-8")
    (tmp_path / "recipe.toml").write_text(marked + 'extends = "reach"\nname = "mine"\n', encoding="utf-8")
    (tmp_path / "robot.toml").write_text(marked + ROBOT, encoding="utf-8")
    assert find_domain(str(tmp_path / "domain.toml")).name == "calm"
    assert load_recipe(str(tmp_path / "recipe.toml")).name == "mine"
    assert read_description(tmp_path / "robot.toml").model == "torque.xml"


@pytest.mark.parametrize("encoding", ["utf-16", "utf-16-le", "utf-16-be", "utf-32"])
def test_text_of_another_encoding_is_named_in_one_line(encoding: str, tmp_path: Path) -> None:
    path = tmp_path / "own.toml"
    path.write_text(TEXT, encoding=encoding)
    for read in (lambda: find_domain(str(path)), lambda: load_recipe(str(path)), lambda: read_description(path)):
        with pytest.raises(UsageError, match="cannot be read: it is UTF-16 text or no text at all; save it as UTF-8") as caught:
            read()
        assert "\n" not in caught.value.message
    path.write_bytes(b"name = '\xe4'")
    with pytest.raises(ValueError, match="no UTF-8 text: byte 9 cannot be read"):
        read_toml(path)
