from dataclasses import replace

import numpy as np
import pytest

from skillcli import metrics
from skillcli.trajectories import Trajectories


# Published values of the score interval without continuity correction.
@pytest.mark.parametrize(
    ("successes", "trials", "low", "high"),
    [(8, 10, 0.4902, 0.9433), (0, 10, 0.0, 0.2775), (10, 10, 0.7225, 1.0), (1, 1, 0.2065, 1.0), (0, 0, 0.0, 1.0)],
)
def test_wilson_interval_against_published_numbers(successes: int, trials: int, low: float, high: float) -> None:
    assert metrics.wilson_interval(successes, trials) == pytest.approx((low, high), abs=5e-5)


# 56 of 70 against 48 of 80: the example of Newcombe 1998, method 10.
def test_difference_interval_against_published_numbers_and_by_hand() -> None:
    found = metrics.difference_interval(0.8, metrics.wilson_interval(56, 70), 0.6, metrics.wilson_interval(48, 80))
    assert found == pytest.approx((0.0524, 0.3339), abs=5e-5)
    # 0.5 - hypot(0.3, 0.4), 0.5 + hypot(0.1, 0.1)
    assert metrics.difference_interval(0.8, (0.5, 0.9), 0.3, (0.2, 0.7)) == pytest.approx((0.0, 0.5 + 0.02**0.5))
    assert metrics.difference_interval(1.0, (1.0, 1.0), 0.3, (0.2, 0.7)) == pytest.approx((0.3, 0.8)), "one known exactly"


@pytest.mark.parametrize(
    ("start", "end", "turned"), [(0, 30, 30), (0, -30, -30), (170, -170, 20), (-100, 100, -160), (90, -90, 180)]
)
def test_an_object_is_turned_by_the_shorter_way(start: float, end: float, turned: float) -> None:
    def pose(degrees: float) -> list[float]:
        half = np.radians(degrees) / 2
        return [0, 0, 0, np.cos(half), 0, 0, np.sin(half)]

    path = recording([[0, 0, 0]] * 4, [0, 0, 0], length=2, box=True)
    object_pose = np.array([[pose(start), pose(77), pose(end), pose(5)]])
    found = metrics.final_yaw(replace(path, object_pose=object_pose))
    assert found == pytest.approx([turned]), "at the end of the episode, not of the array"
    assert metrics.final_yaw(recording([[0, 0, 0]] * 4, [0, 0, 0], length=2)) is None


def test_yaw_is_the_heading_as_seen_from_above() -> None:
    lean = np.radians(20) / 2
    about_x = [np.cos(lean), np.sin(lean), 0, 0]
    assert metrics.yaw(np.array(about_x)) == pytest.approx(0), "a box that leans has not turned"
    assert metrics.yaw(np.array([[0.5**0.5, 0, 0, 0.5**0.5], [1, 0, 0, 0]])) == pytest.approx([np.pi / 2, 0])


def test_distances_are_summed_up_by_quantiles() -> None:
    found = metrics.distance_summary(np.arange(11.0) ** 2)
    assert found == pytest.approx({"mean": 35, "p10": 1, "p25": 6.5, "median": 25, "p75": 56.5, "p90": 81})


def recording(end: list[list[float]], target: list[float], length: int, box: bool = False) -> Trajectories:
    path = np.array([end], dtype=float)  # (1, T+1, 3)
    steps = path.shape[1] - 1
    pose = np.concatenate([path, np.tile([1.0, 0, 0, 0], (1, steps + 1, 1))], axis=-1)
    return Trajectories(
        time=np.arange(steps + 1) * 0.05, latent=np.zeros((1, steps, 2)), skill=np.zeros((1, steps)),
        action=np.zeros((1, steps, 2)), reward=np.zeros((1, steps)), target=np.array([target]), success=np.array([True]),
        length=np.array([length]), gripper_position=path, object_pose=pose if box else None,
    )  # fmt: skip


def test_final_distance_is_taken_at_the_end_of_the_episode_and_a_box_is_judged_in_the_plane() -> None:
    path = [[0.0, 0, 0], [3, 0, 4], [9, 9, 9]]
    assert metrics.final_distance(recording(path, [0, 0, 0], length=1)) == pytest.approx([5])
    assert metrics.final_distance(recording(path, [0, 0, 0], length=1, box=True)) == pytest.approx([3])
    assert metrics.final_distance(recording(path, [9, 9, 8], length=2)) == pytest.approx([1])


def test_an_early_pass_of_a_later_waypoint_does_not_count() -> None:
    first, second = [0.0, 0, 0], [3.0, 0, 0]
    path = np.array([second, first, [1.0, 0, 0], [1.0, 0.5, 0]])
    assert metrics.ordered_approach(path, np.array([first, second]), 10.0) == pytest.approx([0, 2])
    assert metrics.ordered_approach(path, np.array([second, first]), 10.0) == pytest.approx([0, 0])


def test_a_waypoint_that_comes_again_at_the_end_is_judged_by_the_second_visit() -> None:
    path = np.array([[0.0, 0, 0], [1, 0, 0], [0.25, 0, 0]])
    loop = np.array([[0.0, 0, 0], [1, 0, 0], [0.0, 0, 0]])
    assert metrics.ordered_approach(path, loop, 10.0) == pytest.approx([0, 0, 0.25])


def test_waypoints_met_in_order_count_as_met_although_another_moment_would_be_nearer_in_sum() -> None:
    path = np.array([[0.04, 0, 0], [0.06, 0, 0], [0, 0, 0], [0.04, 0, 0]])
    closest = metrics.ordered_approach(path, np.array([[0.0, 0, 0], [0.1, 0, 0]]), 0.05)
    assert closest == pytest.approx([0.04, 0.04])


def test_step_by_step_or_all_at_once_a_waypoint_is_met_by_the_same_rule() -> None:
    rng = np.random.default_rng(0)
    met = []
    for _ in range(300):
        path, waypoints = rng.uniform(0, 1, (12, 3)) * [1, 1, 0], rng.uniform(0, 1, (3, 3)) * [1, 1, 0]
        index, kept = np.array(0), np.array(0)
        for place in path:
            index = metrics.next_waypoint(index, place, waypoints, 0.3)
            kept = metrics.next_waypoint(kept, place, waypoints, 0.3, keep_last=True)
        met.append(bool((metrics.ordered_approach(path, waypoints, 0.3) <= 0.3).all()))
        assert (index == 3) == met[-1] and kept == min(index, 2)
    assert 50 < sum(met) < 250, "both happen"


def test_one_place_may_meet_several_waypoints_and_each_path_has_its_own() -> None:
    waypoints = np.array([[0.0, 0, 0], [0.1, 0, 0], [1, 0, 0]])
    places = np.array([[0.05, 0, 0], [0.1, 0, 0], [1, 0, 0]])
    assert metrics.next_waypoint(np.array([0, 0, 2]), places, waypoints, 0.06).tolist() == [2, 0, 3]
    assert metrics.next_waypoint(np.zeros(2, dtype=int), places[:2], np.zeros((0, 3)), 0.06).tolist() == [0, 0]


def test_ordered_approach_finds_the_smallest_sum_over_all_ordered_moments() -> None:
    rng = np.random.default_rng(0)
    for _ in range(20):
        path, waypoints = rng.normal(size=(7, 3)), rng.normal(size=(3, 3))
        distance = np.linalg.norm(path[None] - waypoints[:, None], axis=-1)
        best = min(distance[0, i] + distance[1, j] + distance[2, k] for i in range(7) for j in range(i, 7) for k in range(j, 7))
        assert metrics.ordered_approach(path, waypoints, 10.0).sum() == pytest.approx(best)


def test_efficiency_of_a_square_of_equal_circles() -> None:
    square = np.array([[0.0, 0], [1, 0], [1, 1], [0, 1]])
    assert metrics.embedding_efficiency(square, np.full((4, 2), 0.1)) == pytest.approx(4 * np.pi * 0.1 * 0.1)
    assert metrics.embedding_efficiency(2 * square, np.full((4, 2), 0.1)) == pytest.approx(np.pi * 0.1 * 0.1)


@pytest.mark.parametrize("mean", [[[0, 0], [1, 1]], [[0, 0], [1, 1], [2, 2]], [[1, 1], [1, 1], [1, 1]]])
def test_efficiency_is_undefined_where_the_means_span_no_volume(mean: list[list[float]]) -> None:
    assert metrics.embedding_efficiency(np.array(mean, dtype=float), np.full((len(mean), 2), 0.1)) is None


BOX = np.array([[x, y, z] for x in (0.5, 0.7) for y in (-0.3, 0.3) for z in (0.15, 0.3)])


def test_neighbours_on_a_box_share_an_edge() -> None:
    edges = [(a, b) for a in range(8) for b in range(a + 1, 8) if (BOX[a] != BOX[b]).sum() == 1]
    assert metrics.neighbours(BOX) == edges and len(edges) == 12


def test_neighbours_around_a_centre_are_the_sides_and_not_the_diagonals() -> None:
    around = np.array([[0.15, 0, 0], [-0.15, 0, 0], [0, 0.15, 0], [0, -0.15, 0]])
    assert metrics.neighbours(around) == [(0, 2), (0, 3), (1, 2), (1, 3)]
    assert metrics.neighbours(around + 0.6) == metrics.neighbours(7 * around) == metrics.neighbours(around)
    with_centre = np.concatenate([around, np.zeros((1, 3))])
    assert [pair for pair in metrics.neighbours(with_centre) if 4 in pair] == [(0, 4), (1, 4), (2, 4), (3, 4)]


def test_neighbours_on_a_line_have_nobody_between_them() -> None:
    line = np.array([[0.0, 0, 0], [3, 0, 0], [1, 0, 0]])
    assert metrics.neighbours(line) == [(0, 2), (1, 2)]
    assert metrics.neighbours(line[:1]) == [] and metrics.neighbours(line[:2]) == [(0, 1)]


@pytest.mark.parametrize(
    ("a", "b", "expected"),
    [
        ([1, 0, 0], [5, 0, 0], 0), ([1, 0, 0], [0, 2, 0], 90), ([1, 1, 0], [1, 0, 0], 45), ([1, 0, 0], [-3, 0, 0], 180),
        ([0.1, 0.2, 0.3], [0.2, 0.4, 0.6], 0), ([0, 0, 0], [1, 0, 0], None),
    ],
)  # fmt: skip
def test_the_angle_between_two_vectors(a: list[float], b: list[float], expected: float | None) -> None:
    for first, second in ((a, b), (b, a)):
        assert metrics.angle_deg(np.array(first), np.array(second)) == pytest.approx(expected, abs=1e-5)


def test_correlation_of_distances() -> None:
    goals = np.array([[0.0, 0, 0], [1, 0, 0], [0, 3, 0], [2, 2, 2]])
    assert metrics.distance_correlation(0.3 * goals + 7, goals) == pytest.approx(1)
    # distances 1, 3, 2 against 3, 1, 2: exactly opposed
    assert metrics.distance_correlation(np.array([[0.0], [1], [3]]), np.array([[0.0], [3], [1]])) == pytest.approx(-1)
    assert metrics.distance_correlation(goals[:2], goals[:2]) is None
    assert metrics.distance_correlation(np.zeros((4, 2)), goals) is None


def test_the_most_likely_skill_weighs_distance_by_spread() -> None:
    mean, std = np.array([[0.0], [1.0]]), np.array([[1.0], [0.1]])
    assert metrics.most_likely_skill(np.array([[[0.9], [0.5]], [[1.6], [-1]]]), mean, std).tolist() == [[1, 0], [0, 0]]
