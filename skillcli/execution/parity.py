"""Compare an exported policy, as ONNX Runtime plays it, with the library's own, as torch plays it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import onnxruntime

from skillcli.errors import SkillError
from skillcli.evaluation.library import Library
from skillcli.execution.policy_ports import Targets
from skillcli.execution.policy_samples import Samples
from skillcli.simulation.targets import next_target
from skillcli.trajectories import Array

TOLERANCE = 1e-5  # of every output: in units of the action limit, and rad or m


class ParityError(SkillError):
    """The exported policy answers differently than the library."""


@dataclass(frozen=True)
class Parity:
    """How far two answers to the same observations differ."""

    max_abs_error: float  # of any output
    observations: int


def expected(library: Library, targets: Targets | None, samples: Samples) -> dict[str, Array]:
    """Return the outputs by name as torch and the simulation compute them, (N, a) each."""
    limit = library.world.task.action_scale
    action = library.agent.act(samples.observation, samples.latent)
    increment = np.clip(limit * action.astype(float), -limit, limit)
    outputs = {"action": action, "increment": increment}
    if targets is not None:
        commanded, measured = samples.commanded.astype(float), samples.observation[:, targets.measured].astype(float)
        outputs["target"] = next_target(commanded, increment, measured, targets.low, targets.high, targets.lead)
    return outputs


def measure_parity(path: Path, samples: Samples, wanted: Mapping[str, Array]) -> Parity:
    """Run an exported policy on all rows at once, and on each row alone as a robot does; compare with the outputs wanted.

    Raises:
        ParityError: an output differs by more than `TOLERANCE`, or is not finite.
    """
    session = _session(path)
    given = {"observation": samples.observation, "latent": samples.latent, "commanded": samples.commanded}
    feed = {port.name: given[port.name] for port in session.get_inputs()}
    names = list(wanted)
    together = session.run(names, feed)
    alone = [session.run(names, {name: rows[k : k + 1] for name, rows in feed.items()}) for k in range(len(samples))]
    largest = 0.0
    for name, answers, rows in zip(names, together, zip(*alone, strict=True), strict=True):
        for found in (answers, np.concatenate(rows)):
            error = float(np.abs(found - wanted[name]).max())
            if not error <= TOLERANCE:  # also NaN
                raise ParityError(
                    f"ONNX Runtime and torch differ in `{name}` by {error:.2g}, expected at most {TOLERANCE:g}",
                    "nothing was written; try another version of onnxruntime, and `skill verify` the artifact",
                )
            largest = max(largest, error)
    return Parity(largest, len(samples))


def _session(path: Path) -> onnxruntime.InferenceSession:
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = options.inter_op_num_threads = 1
    options.log_severity_level = 3  # errors only
    return onnxruntime.InferenceSession(path, options, providers=["CPUExecutionProvider"])
