"""Identify an arm from a log: what its commands mean, how late it is, how it follows, where its gripper is."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from skillcli.errors import UsageError
from skillcli.execution.identify import structure
from skillcli.execution.identify.fit import Fit, fit
from skillcli.execution.identify.kinematics import ToolFit, fit_tool, within
from skillcli.execution.identify.knobs import Knobs
from skillcli.execution.identify.model import Meaning, Model, Parameters
from skillcli.execution.identify.noise import white_noise
from skillcli.execution.identify.result import Errors, Estimate, Identified
from skillcli.execution.identify.windows import (
    HALF_SECOND,
    RUN_IN,
    Windows,
    held_out,
    how_held_out,
    in_steps,
    short_windows,
    stretches,
)
from skillcli.execution.log import Log
from skillcli.progress import OnProgress, Progress, silent
from skillcli.robots.robot import Robot
from skillcli.simulation.replay import TIMESTEP, ForwardKinematics, Replay
from skillcli.trajectories import Array

DYNAMICS = ("gain", "joint_damping", "joint_friction", "link_mass", "gravity_compensation")
MOST_STEPS = 1000  # control steps that a fit takes from a log, spread evenly over it
AGAIN = 4  # evaluations of a fit that goes on from another one
TOLD = 0.7  # an interval narrower than this share of what was believed is news
STAGES = 5


def identify(log: Log, robot: Robot, action_limit: float, on_progress: OnProgress = silent, threads: int = 0) -> Identified:
    """Fit what the log can tell, and measure on held-out parts how much better that predicts.

    Args:
        log: of this arm, its columns in the order of the robot file.
        robot: the arm.
        action_limit: increments are clipped to it before they are sent, rad.
        on_progress: called between the parts of the work.
        threads: of the engine, 0 for all cores; results do not depend on it.

    Raises:
        UsageError: the log is of another arm, too short, or says nothing.
    """
    _check(log, robot)

    def tell(done: int, what: str) -> None:
        on_progress(Progress("identify", done, STAGES, "parts", note=what))

    period = _whole(log.period)
    models = structure.readings(log, Replay(robot, period, action_limit, TIMESTEP, threads))
    held, everything = held_out(log), np.ones(len(log.stamps), dtype=bool)
    half = in_steps(HALF_SECOND, log.period)
    short = short_windows(log, half, ~held)
    if not len(short.first) or not len(short_windows(log, half, held).first):
        raise UsageError("the log is too short to fit and to check the fit", "record at least three seconds in one episode")
    tell(0, "unit, meaning and latency of the commands")
    meanings = (Meaning.ADDED, Meaning.RESTARTED) if log.increments else (Meaning.TARGETS,)
    names = ("command_response",) if log.increments else ("gain",)
    best = structure.compare(models, short, meanings, Knobs(names, log.joints))[0]
    model = best.model
    tell(1, "how the joints follow")
    found, late = _fitted(best, ~held)
    tell(2, "prediction of held-out parts")
    nominal, run_in = meanings[0], in_steps(RUN_IN, log.period)
    if best.meaning is Meaning.RESTARTED or not len(short_windows(log, half, held, run_in).first):
        run_in = 0
    errors = [
        Errors(
            nominal=_rms(model, windows, nominal, {}),
            fitted=_rms(model, windows, best.meaning, found.parameters),
            unmoved=_root_mean_square(model.measured(windows) - log.position[windows.first + run_in][:, None], windows),
        )
        for windows in (short_windows(log, length, held, run_in) for length in (half, 1))
    ]
    kept = errors[0].fitted < errors[0].nominal
    if kept:
        tell(3, "the same on all of the log")
        found, late = _fitted(best, everything, found)
    tell(4, "zeros and tool")
    tool = fit_tool(ForwardKinematics(robot), log)
    parameters = _estimates(found, late, best.meaning) if kept else _nothing(found.knobs)
    if not kept:
        errors = [Errors(each.nominal, each.nominal, each.unmoved) for each in errors]
    tell(STAGES, "done")
    return Identified(
        parameters={**parameters, **_of_tool(tool)},
        meaning=_in_words(best.meaning if kept else nominal, best.unit),
        half_second=errors[0],
        one_step=errors[1],
        heldout_steps=int(held.sum()),
        heldout=how_held_out(log),
        kept=kept,
        notes=(*log.notes, *_notes(kept, tool)),
    )


def _check(log: Log, robot: Robot) -> None:
    wanted = robot.description.joints
    if log.joints != len(wanted) or (log.names and tuple(log.names) != tuple(wanted)):
        got = ", ".join(log.names) or f"{log.joints} joints without names"
        raise UsageError(
            f"the log is of another arm; expected the joints {', '.join(wanted)}; got {got}", "give its robot file"
        )
    if np.ptp(log.position, axis=0).max() < 1e-3:
        raise UsageError("no joint moves by more than 1 mrad in the log: it tells nothing", "record a motion")


def _whole(period: float) -> float:
    """Return the control period as a whole number of the usual time step, s: the stamps of a log are never exact."""
    if period < TIMESTEP:
        return period
    return round(round(period / TIMESTEP) * TIMESTEP, 9)


def _fitted(best: structure.Structure, wanted: Array, before: Fit | None = None) -> tuple[Fit, structure.Lateness]:
    """Fit all that windows of the rows `wanted`, (T,) bool, tell: twice, since the first fit says how noisy the log is.

    Only increments have a scale of their own. It is fitted where the log is likelier with it than without.
    """
    model, log, meaning = best.model, best.model.log, best.meaning
    windows = _windows(log, meaning, wanted)
    if before is None:
        knobs = Knobs(("command_response", *DYNAMICS) if log.increments else DYNAMICS, log.joints)
        first = fit(model, meaning, windows, knobs, best.latency)
        second = fit(model, meaning, windows, knobs, best.latency, first.x, first.noise, AGAIN)
        if log.increments:
            second = max(second, _unscaled(best, windows, second), key=lambda each: each.log_evidence)
    else:
        second = fit(model, meaning, windows, before.knobs, best.latency, before.x, before.noise, AGAIN)
    late = structure.refine(model, meaning, windows, second)
    if not math.isclose(late.value, best.latency, abs_tol=1e-9):
        second = fit(model, meaning, windows, second.knobs, late.value, second.x, second.noise, AGAIN)
    return second, late


def _unscaled(best: structure.Structure, windows: Windows, scaled: Fit) -> Fit:
    """Fit the same again, but take increments as they are: beside a response of each joint its gain is known less well."""
    knobs = Knobs(DYNAMICS, best.model.log.joints)
    start = np.concatenate([scaled.x[scaled.knobs.where(name)] for name in DYNAMICS])
    return fit(best.model, best.meaning, windows, knobs, best.latency, start, scaled.weight, AGAIN)


def _windows(log: Log, meaning: Meaning, wanted: Array) -> Windows:
    """Return what a fit predicts.

    Where servos pull the arm to targets that are known, a simulation forgets the noise of the state that it began in, so long
    stretches tell most. Where every command starts at the measured angle it forgets nothing, and half seconds are predicted.
    """
    if meaning is Meaning.RESTARTED:
        return short_windows(log, in_steps(HALF_SECOND, log.period), wanted).thinned(MOST_STEPS)
    return stretches(log, wanted).thinned(MOST_STEPS)


def _rms(model: Model, windows: Windows, meaning: Meaning, parameters: Parameters) -> float:
    return _root_mean_square(model.predict(windows, meaning, [parameters])[0] - model.measured(windows), windows)


def _root_mean_square(errors: Array, windows: Windows) -> float:
    """Return the size of the errors (W, L, J) that count."""
    return float(np.sqrt(np.square(errors[windows.counted]).mean()))


def _estimates(found: Fit, late: structure.Lateness, meaning: Meaning) -> dict[str, Estimate]:
    """Return value and interval of every parameter of the dynamics."""
    spread = np.sqrt(np.diag(found.covariance))
    estimates = {"latency": Estimate.of(late.value, late.low, late.high)}
    if meaning is not Meaning.TARGETS:
        restarts = float(meaning is Meaning.RESTARTED)
        estimates["command_restart"] = Estimate.of(restarts, restarts, restarts)
    for name in found.knobs.names:
        told = bool((spread[found.knobs.where(name)] < TOLD).any())
        estimates[name] = Estimate.of(*found.knobs.interval(name, found.x, spread), told)
    estimates["joint_noise"] = Estimate.of(*_noise(found, meaning))
    return estimates


def _noise(found: Fit, meaning: Meaning) -> tuple[float, float, float]:
    """Return the white noise of the encoders; where the simulation starts at noisy angles it cannot be told from the rest."""
    if meaning is Meaning.RESTARTED:
        return 0.0, 0.0, float(np.nanstd(found.residual[:, 0])) / math.sqrt(2)
    return white_noise(found.residual)


def _nothing(knobs: Knobs) -> dict[str, Estimate]:
    """Return what was believed before."""
    x, spread = np.zeros(knobs.count), np.ones(knobs.count)
    estimates = {"latency": Estimate.of(0.0, 0.0, 0.0)}
    return {**estimates, **{name: Estimate.of(*knobs.interval(name, x, spread), told=False) for name in knobs.names}}


def _of_tool(tool: ToolFit | None) -> dict[str, Estimate]:
    if tool is None:
        return {}
    return {
        "joint_offset": Estimate.of(tool.zero, *within(tool.zero, tool.zero_spread)),
        "tool_offset": Estimate.of(tool.tool, *within(tool.tool, tool.tool_spread)),
        "position_noise": Estimate.of(tool.noise, tool.noise, tool.noise),
    }


def _in_words(meaning: Meaning, unit: str) -> str:
    return meaning.value if unit == "rad" else f"{meaning.value}, in {unit}"


def _notes(kept: bool, tool: ToolFit | None) -> Sequence[str]:
    notes = []
    if not kept:
        notes.append("the fit predicts held-out parts no better than the nominal simulation, so the nominal values stay")
    if tool is not None:
        notes.append(f"the measured gripper is met to {1000 * tool.median:.1f} mm in the median")
    return notes
