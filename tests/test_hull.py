"""Weights of goals and places between them, by numbers worked out by hand."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from skillcli.hull import Cuboid, GoalMap, Hull

BOX = np.array([[x, y, z] for x in (0.5, 0.7) for y in (0.3, -0.3) for z in (0.15, 0.3)])
DIAMOND = np.array([[0.75, 0, 0], [0.45, 0, 0], [0.6, 0.15, 0], [0.6, -0.15, 0]])  # a square on its tip
TRIANGLE = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0]])
PENTAGON = np.array([[0.0, 0, 1], [2, 0, 1], [2, 1, 1], [1, 2, 1], [0, 1, 1]])
SHAPES = {"box": BOX, "diamond": DIAMOND, "triangle": TRIANGLE, "pentagon": PENTAGON, "segment": BOX[:2], "point": BOX[:1]}


@pytest.mark.parametrize("goals", SHAPES.values(), ids=SHAPES)
def test_weights_are_shares_that_give_the_place_and_a_goal_is_all_its_own(goals: np.ndarray) -> None:
    hull = Hull(goals)
    places = np.concatenate([hull.draw(50, np.random.default_rng(0)), goals])
    weights = hull.weights(places)
    assert (weights >= 0).all()
    np.testing.assert_allclose(weights.sum(axis=1), 1)
    np.testing.assert_allclose(weights @ goals, places, atol=1e-6)
    np.testing.assert_allclose(weights[50:], np.eye(len(goals)), atol=1e-6)


def test_the_corners_of_a_box_have_multilinear_weights() -> None:
    hull = Hull(BOX)
    np.testing.assert_allclose(hull.weights(BOX.mean(axis=0)[None])[0], np.full(8, 1 / 8))
    # a quarter of the way along x, half along y, all along z: products of (3/4, 1/4), (1/2, 1/2) and (0, 1)
    weights = hull.weights(np.array([[0.55, 0.0, 0.3]]))[0]
    np.testing.assert_allclose(weights, [0, 3 / 8, 0, 3 / 8, 0, 1 / 8, 0, 1 / 8], atol=1e-12)


def test_the_corners_may_come_in_any_order_and_direction() -> None:
    for order in itertools.permutations(range(4)):
        cuboid = Cuboid.of(DIAMOND[list(order)])
        assert cuboid is not None and len(cuboid.edges) == 2
    # half-way along one edge of the square on its tip: between (0.75, 0) and (0.6, 0.15)
    np.testing.assert_allclose(Hull(DIAMOND).weights(np.array([[0.675, 0.075, 0]]))[0], [0.5, 0, 0.5, 0], atol=1e-12)


@pytest.mark.parametrize(
    "goals",
    [TRIANGLE, PENTAGON, BOX[:7], BOX * [1, 1, 0], np.array([[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [2, 1, 0]]), BOX[[0, 0]]],
    ids=["triangle", "pentagon", "a corner short", "flat", "slanted", "the same place"],
)
def test_other_goals_are_no_cuboid(goals: np.ndarray) -> None:
    assert Cuboid.of(goals) is None


def test_where_several_weights_give_a_place_the_most_even_ones_are_taken() -> None:
    trapezium = np.array([[0.0, 0, 0], [4, 0, 0], [3, 1, 0], [1, 1, 0]])
    # symmetric about x = 2: w = (a, a, b, b) with b = y / 2 and a = (1 - y) / 2 at (2, y)
    np.testing.assert_allclose(Hull(trapezium).weights(np.array([[2, 0.5, 0]]))[0], [0.25] * 4, atol=1e-6)


@pytest.mark.parametrize(
    ("goals", "place", "gap"),
    [
        (BOX, (0.6, 0.0, 0.4), 0.1),
        (BOX, (0.8, 0.4, 0.2), 0.02**0.5),
        (TRIANGLE, (1, 1, 0), 0.5**0.5),
        (DIAMOND, (0.6, 0, 0.2), 0.2),
    ],
)
def test_a_place_outside_is_as_far_off_as_the_nearest_one_inside(
    goals: np.ndarray, place: tuple[float, float, float], gap: float
) -> None:
    assert Hull(goals).gap(np.array([place]))[0] == pytest.approx(gap, abs=1e-6)


def test_places_are_drawn_evenly() -> None:
    rng = np.random.default_rng(0)
    for goals, middle in ((BOX, (0.6, 0, 0.225)), (DIAMOND, (0.6, 0, 0)), (TRIANGLE, (1 / 3, 1 / 3, 0))):
        places = Hull(goals).draw(2000, rng)
        np.testing.assert_allclose(places.mean(axis=0), middle, atol=0.02)
    low = (places[:, 0] < 0.5).mean()  # a triangle: 1 - (1/2)^2 of its area lies there
    assert low == pytest.approx(0.75, abs=0.03)


def test_a_map_gives_places_the_same_mixture_of_latents_as_of_goals() -> None:
    # the middle skill of three does something else, and has no part in the map of the others along x
    goals, mean = np.array([[0.0, 0, 0], [9, 9, 9], [1, 0, 0]]), np.array([[0.0, 0], [5, 5], [0.4, -0.2]])
    goal_map = GoalMap.of(goals, mean, (0, 2))
    places = np.array([[0.25, 0, 0], [0.75, 0, 0], [3, 1, 0]])  # the last is beyond the end
    np.testing.assert_allclose(goal_map.latents(places), [[0.1, -0.05], [0.3, -0.15], [0.4, -0.2]])
    np.testing.assert_allclose(goal_map.hull.inside(places), [[0.25, 0, 0], [0.75, 0, 0], [1, 0, 0]])
    assert goal_map.nearest(places).tolist() == [0, 2, 2]
