"""What is computed in pieces."""

from __future__ import annotations

import pytest
import torch

from skillcli.learning import descent


@pytest.mark.parametrize("steps", [1, 5, 8, 17])
def test_pieces_give_what_the_whole_gives(steps: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(descent, "PIECE", 32)
    x, nothing = torch.rand(steps, 8, 3), torch.rand(steps, 8, 0)
    found = descent.in_pieces(lambda a, b: (2 * a).sum(-1) + b.sum(-1), x, nothing)
    torch.testing.assert_close(found, 2 * x.sum(-1))
