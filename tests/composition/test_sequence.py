"""Plans by hand: what each entry means, and what is refused."""

from __future__ import annotations

import numpy as np
import pytest

from skillcli.composition.plan import schedule
from skillcli.composition.sequence import parse, waypoints, written
from skillcli.errors import UsageError

NUMBERS = ("1", "2", "3")
PUSHES = ("up", "down", "left")
MEANS = np.array([[0.0, 0], [4, 0], [0, 8]])
GOALS = np.array([[0.0, 0, 0], [4, 0, 0], [0, 8, 0]])


def segments(text: str, names: tuple[str, ...] = NUMBERS) -> list[tuple[str, int, int, list[float], list[float]]]:
    made = [entry.segment(MEANS, 0.25) for entry in parse(text, names, seconds=1.0)]
    return [(s.label, s.skill, s.steps, s.latent.tolist(), s.end.tolist()) for s in made]


def test_numbers_count_from_one_and_last_as_long_as_said() -> None:
    assert segments("2,3:0.5") == [("2", 1, 4, [4, 0], [4, 0]), ("3", 2, 2, [0, 8], [0, 8])]


def test_skills_go_by_name_too() -> None:
    assert segments("down, 3", PUSHES) == [("down", 1, 4, [4, 0], [4, 0]), ("3", 2, 4, [0, 8], [0, 8])]
    assert segments("2", ("2", "1", "x"))[0][1] == 0, "a name comes before a number"


def test_a_blend_runs_from_one_mean_to_the_other_and_a_share_is_held() -> None:
    blend, held = segments("1~2:0.75 2~3@0.25")
    assert blend == ("1~2", -1, 3, [0, 0], [4, 0])
    assert held == ("2~3@0.25", -1, 4, [3, 2], [3, 2])
    latent, skill = schedule([entry.segment(MEANS, 0.25) for entry in parse("1:0.25,1~2:0.75,2:0.25", NUMBERS, 1.0)])
    assert latent[:, 0].tolist() == [0, 1, 2, 3, 4] and skill.tolist() == [0, -1, -1, -1, 1], "evenly, without its ends"


def test_a_share_at_either_end_is_the_skill_itself() -> None:
    assert [found[1] for found in segments("1~2@0 1~2@1")] == [0, 1]


def test_any_latent_stands_in_brackets() -> None:
    assert segments("[1.5;-2e0]:0.5,2") == [("[1.5;-2e0]", -1, 2, [1.5, -2], [1.5, -2]), ("2", 1, 4, [4, 0], [4, 0])]
    np.testing.assert_allclose(waypoints(parse("[1;2],2,[1;3]", NUMBERS, 1.0), GOALS), [[4, 0, 0]])
    with pytest.raises(UsageError, match="holds latents only"):
        waypoints(parse("[1;2]", NUMBERS, 1.0), GOALS)
    with pytest.raises(UsageError, match="has 2 numbers, got 3"):
        segments("[1;2;3]")


def test_what_was_held_is_written_so_that_it_repeats() -> None:
    latent = np.array([[4.0, 0], [4, 0], [0.1, 0.2], [0.1, 0.2], [0.3, 0.2], [0, 8]])
    skill = np.array([1, 1, -1, -1, -1, 2])
    assert written(latent, skill, NUMBERS, 0.25) == "2:0.5,[0.1;0.2]:0.5,[0.3;0.2]:0.25,3:0.25"
    assert written(latent[:2], skill[:2], ("a b", "c d", "e"), 0.25) == "[4;0]:0.5", "names that would not be read back"


def test_lines_and_remarks_may_stand_in_a_plan() -> None:
    assert [found[0] for found in segments("1:1.0  # first\n\n# then\n1~2:1.0, 2:1.0\n")] == ["1", "1~2", "2"]


def test_a_plan_leads_to_the_goals_of_what_it_holds() -> None:
    places = waypoints(parse("1,1~2,2,2~3@0.5", NUMBERS, 1.0), GOALS)
    np.testing.assert_allclose(places, [[0, 0, 0], [4, 0, 0], [2, 4, 0]])
    np.testing.assert_allclose(waypoints(parse("1~2,2~3", NUMBERS, 1.0), GOALS), [[0, 8, 0]])


BAD = {
    "[1;2": "cannot be read",
    "[1;x]": "'x' is not a number",
    "[]": "is not a number",
    "[1;nan]": "is not a number",
    "[1;2]:0": "must last",
    "": "empty",
    " , # nothing": "empty",
    "4": "no skill '4'",
    "0": "no skill '0'",
    "-1": "no skill '-1'",
    "up": "no skill 'up'",
    "1~9": "no skill '9'",
    "1~2@1.5": r"λ must lie in \[0, 1\], got 1.5",
    "1~2@-0.1": "λ must lie",
    "1~2@nan": "not a number",
    "1~2@half": "'half' is not a number",
    "1@0.5": "cannot be read",
    "1~~2": "cannot be read",
    "1:": "cannot be read",
    "1:0": "between 0 and 600",
    "1:-1": "between 0 and 600",
    "1:inf": "not a number",
    "1:1e9": "between 0 and 600",
    "1:600 2:600 1:600 2:600 1:600 2:600 1:600": "longer than",
}


@pytest.mark.parametrize("text", BAD)
def test_what_cannot_be_meant_is_refused(text: str) -> None:
    with pytest.raises(UsageError, match=BAD[text]) as caught:
        parse(text, NUMBERS, 1.0)
    assert caught.value.hint
