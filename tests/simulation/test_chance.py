"""Chance in simulations side by side: an episode draws the same, whoever is beside it and whatever else is drawn."""

from __future__ import annotations

import numpy as np
import pytest

from skillcli.simulation.chance import Chance

EVERYONE = np.arange(3)


def own(*seeds: int) -> Chance:
    return Chance([np.random.default_rng(seed) for seed in seeds])


def test_one_generator_is_used_as_it_is() -> None:
    chance, plain = Chance(np.random.default_rng(5)), np.random.default_rng(5)
    assert (chance.normal("noise", (3, 2), EVERYONE) == plain.standard_normal((3, 2))).all()
    assert (chance.uniform("angle", (3,), EVERYONE) == plain.random(3)).all()
    assert (chance.integers("latency", np.array([4, 9, 2])) == plain.integers([4, 9, 2])).all()


def test_an_episode_draws_the_same_whoever_is_beside_it() -> None:
    together, alone = own(1, 2, 3), own(2)
    assert (together.normal("noise", (3, 4), EVERYONE)[1] == alone.normal("noise", (1, 4), EVERYONE[:1])[0]).all()
    across = together.uniform("forces", (2, 3), EVERYONE, axis=1)
    assert (across[:, 1] == alone.uniform("forces", (2, 1), EVERYONE[:1], axis=1)[:, 0]).all()


def test_one_use_of_chance_does_not_change_another() -> None:
    busy, quiet = own(1, 2, 3), own(1, 2, 3)
    busy.normal("drift", (3, 50), EVERYONE)
    assert (busy.normal("noise", (3, 4), EVERYONE) == quiet.normal("noise", (3, 4), EVERYONE)).all()
    assert not (busy.normal("drift", (3, 4), EVERYONE) == quiet.normal("drift", (3, 4), EVERYONE)).any()


def test_only_the_simulations_that_are_named_draw() -> None:
    some, all_of_them = own(1, 2, 3), own(1, 2, 3)
    first = some.normal("noise", (2, 4), np.array([2, 0]))
    later = some.normal("noise", (3, 4), EVERYONE)
    expected = all_of_them.normal("noise", (3, 4), EVERYONE)
    assert (first == expected[[2, 0]]).all()
    assert (later[1] == expected[1]).all() and (later[0] != expected[0]).all()


def test_nobody_draws_nothing() -> None:
    assert own(1, 2).normal("noise", (0, 4), np.array([], dtype=int)).shape == (0, 4)


@pytest.mark.parametrize("chance", [own(1, 2, 3), Chance(np.random.default_rng(1))])
def test_whole_numbers_stay_below_the_bound_of_each_simulation(chance: Chance) -> None:
    drawn = np.array([chance.integers("latency", np.array([1, 2, 5])) for _ in range(200)])
    assert drawn.min(axis=0).tolist() == [0, 0, 0] and drawn.max(axis=0).tolist() == [0, 1, 4]
