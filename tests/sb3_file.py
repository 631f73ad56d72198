"""A file in the form of Stable-Baselines3, of a policy that learned nothing: for reach on the Sawyer, latents of size 3."""

from __future__ import annotations

import io
import zipfile
from pathlib import Path

import torch

FEATURES, LATENT = 13, 3


def write_model(path: Path, policy: bytes | None = None, data: bytes = b"{}") -> Path:
    """Write it; `policy` and `data` replace its weights and its settings."""
    buffer = io.BytesIO()
    weights = {
        "mlp_extractor.policy_net.0.weight": torch.ones(4, FEATURES),
        "mlp_extractor.policy_net.0.bias": torch.zeros(4),
        "action_net.weight": torch.ones(LATENT, 4) / 8,
        "action_net.bias": torch.zeros(LATENT),
    }
    torch.save(weights, buffer)
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("policy.pth", buffer.getvalue() if policy is None else policy)
        archive.writestr("data", data)
    return path
