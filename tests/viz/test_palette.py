"""Colours of skills and of what lies between them."""

from __future__ import annotations

import numpy as np
import pytest

from skillcli.viz.palette import BETWEEN, COLORS, latent_look, look, rgba

MEANS = np.array([[0.0, 0.0], [4.0, 0.0], [0.0, 100.0]])


def test_a_skills_own_latent_has_its_look_wherever_it_lies() -> None:
    assert latent_look(1, np.zeros(2), MEANS) == look(1)


@pytest.mark.parametrize(("place", "share"), [(0.0, 1.0), (1.0, 0.75), (2.0, 0.5), (3.0, 0.25)])
def test_between_two_means_the_colours_mix_as_the_way_is_shared(place: float, share: float) -> None:
    mixed = latent_look(-1, np.array([place, 0.0]), MEANS)
    expected = share * np.array(rgba(COLORS[0])) + (1 - share) * np.array(rgba(COLORS[1]))
    np.testing.assert_allclose(rgba(mixed.color), expected, atol=0.51)
    assert (mixed.dash, mixed.marker) == look(-1)[1:], "still told from a skill in grey"


def test_with_fewer_than_two_skills_there_is_nothing_to_mix() -> None:
    assert latent_look(-1, np.zeros(2), MEANS[:1]).color == BETWEEN
