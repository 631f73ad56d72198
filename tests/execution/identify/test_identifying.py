"""The whole of an identification: what is fitted where a log of increments does not ask for more."""

from __future__ import annotations

import numpy as np
import pytest
from execution.logs import LIMIT, NAMES, SAWYER, recorded, wandering

from skillcli.execution.identify.identify import identify
from skillcli.trajectories import Array

pytestmark = pytest.mark.slow

GAIN = np.array([0.75, 1.25, 0.8, 1.2, 0.85, 1.15, 1.25])
RESPONSE = np.array([0.8, 0.9, 1.1, 1.0, 0.85, 1.2, 1.0])


@pytest.mark.parametrize("response", [None, RESPONSE])
def test_increments_have_a_scale_only_where_the_log_says_so(response: Array | None) -> None:
    true = {"gain": GAIN, "latency": 0.05} | ({} if response is None else {"command_response": response})
    found = identify(recorded(true, wandering(100), noise=0.002, as_targets=False), SAWYER, LIMIT, threads=1)
    assert found.kept and found.parameters["latency"].value == pytest.approx(0.05)
    assert ("command_response" in found.parameters) == (response is not None)
    if response is None:
        assert (np.abs(found.parameters["gain"].value / GAIN - 1) < 0.15).sum() >= len(NAMES) - 1
    else:
        np.testing.assert_allclose(found.parameters["command_response"].value, response, rtol=0.03)
