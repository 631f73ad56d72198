import numpy as np
import pytest

from skillcli.composition.plan import Choices, Plan, Segment, latent_grid, schedule, stored_steps

MEANS = np.array([[0.0, 0], [2, 0], [0, 4]])
NAMES = [str(k + 1) for k in range(len(MEANS))]


def test_the_choices_are_the_means_and_where_asked_the_half_way_latents_of_all_pairs() -> None:
    plain = Choices.of(MEANS, NAMES, interpolated=False)
    assert plain.label == ("1", "2", "3") and plain.skill.tolist() == [0, 1, 2]
    np.testing.assert_array_equal(plain.latent, MEANS)
    more = Choices.of(MEANS, NAMES, interpolated=True)
    assert more.label == ("1", "2", "3", "1~2", "1~3", "2~3") and more.skill.tolist() == [0, 1, 2, -1, -1, -1]
    assert more.latent[3:].tolist() == [[1, 0], [0, 2], [1, 2]]


def test_a_grid_spans_the_box_between_its_corners() -> None:
    grid = latent_grid(np.array([0.0, -1.0]), np.array([2.0, 1.0]), 3)
    assert grid.tolist() == [[0, -1], [0, 0], [0, 1], [1, -1], [1, 0], [1, 1], [2, -1], [2, 0], [2, 1]]
    assert latent_grid(np.zeros(3), np.ones(3), 2).shape == (8, 3)


def test_grid_latents_come_last_are_no_skill_and_are_labelled_by_their_coordinates() -> None:
    grid = np.array([[-0.5, 1.0], [0.125, -0.0625]])
    found = Choices.of(MEANS, NAMES, interpolated=True, grid=grid)
    assert found.label == ("1", "2", "3", "1~2", "1~3", "2~3", "(-0.50,1.00)", "(0.12,-0.06)")
    assert found.skill.tolist() == [0, 1, 2, -1, -1, -1, -1, -1]
    np.testing.assert_array_equal(found.latent[6:], grid)


def test_a_schedule_holds_each_latent_for_its_steps() -> None:
    latent, skill = schedule([Segment(MEANS[1], 1, "2", 2), Segment(MEANS[2], -1, "x", 1)])
    assert latent.tolist() == [[2, 0], [2, 0], [0, 4]] and skill.tolist() == [1, 1, -1]


PLAN = Plan((
    (Segment(MEANS[1], 1, "2", 2), Segment(MEANS[1], -1, "2~3", 3, until=MEANS[2])),
    (Segment(MEANS[2], 2, "3", 1),),
))  # fmt: skip


def test_a_plan_is_read_as_it_was_written() -> None:
    arrays, records = PLAN.arrays(0.05), PLAN.records(0.05)
    assert arrays["plan/seconds"].tolist() == [0.1, pytest.approx(0.15), 0.05] and arrays["plan/route"].tolist() == [0, 0, 1]
    assert [record.latent_end for record in records] == [None, (0, 4), None]
    again = Plan.read(arrays, 0.05, [record.skill for record in records])
    assert again.records(0.05) == records and again.steps == 6 and stored_steps(arrays, 0.05).tolist() == [5, 1]
    for first, second in zip(PLAN.schedules(), again.schedules(), strict=True):
        np.testing.assert_array_equal(first, second)


def test_a_plan_without_blends_has_no_latents_that_they_lead_to() -> None:
    held = Plan(PLAN.routes[1:])
    assert "plan/latent_end" not in held.arrays(0.05) and Plan.read(held.arrays(0.05), 0.05).steps == 1


def test_shorter_routes_rest_at_their_last_latent() -> None:
    latent, skill, steps = PLAN.schedules()
    assert steps.tolist() == [5, 1] and latent.shape == (2, 5, 2)
    assert skill.tolist() == [[1, 1, -1, -1, -1], [2] * 5] and latent[1].tolist() == [[0, 4]] * 5
