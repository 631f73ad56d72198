"""Tables that compare the paper's results with ours, with the origin of every number."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from skillcli.kinds import COMPOSE, EMBED_MEANS, PRETRAIN, TRANSFER_EVAL
from skillcli.kinds.compose import ComposeResults
from skillcli.kinds.outcome import Outcome
from skillcli.metrics import angle_deg
from skillcli.viz.report import paper
from skillcli.viz.report.content import Number, Row, Table
from skillcli.viz.report.executions import NOTE as EXECUTED
from skillcli.viz.report.executions import executed
from skillcli.viz.report.selection import Exhibit, Material

Goal = tuple[float, ...]

SIMULATED = "smaller, but in simulation"
SHORT = "falls short"
HOLDS = 0.9  # of the source's success: from here on a transfer is said to hold
NEAR = 1e-3  # m between goals that count as the same


def tables(material: Material) -> list[Table]:
    """Make every table with at least one line; paper numbers without a counterpart name the command that would give it."""
    found = [
        Table("Point: the embedding", list(_point(material))),
        Table("Reach: eight skills, final distance", list(_reach_skills(material)), "Paper: played on the real robot."),
        Table("Reach: composed", list(_reach_composed(material))),
        Table(
            "Push: four skills, where the box ends", list(_push_skills(material)), "Paper: on the real robot, goals 15 cm away."
        ),
        Table("Push: the mean of two neighbouring skills", list(_push_means(material)), "How far the direction is off."),
        Table("Push: searched to goals outside the trained square", list(_push_searched(material))),
        Table(
            "Transfer to robots that differ",
            list(_transfer(material)),
            f"“holds” is said from {HOLDS:.0%} of the source's success on. Interval: Wilson, 95 %.",
        ),
        Table("Executed in real time", list(executed(material)), EXECUTED),
        Table("Interpolation", list(_interpolation(material)), "Error: fraction of the way against the latent's share."),
        Table("Training", list(_training(material)), "Of our own; the paper gives no counterpart."),
    ]
    return [table for table in found if table.rows]


# --- themes -----------------------------------------------------------------------------------------------------------


def _point(material: Material) -> Iterator[Row]:
    for one in material.find(PRETRAIN, "point"):
        theirs = f"{paper.POINT_EFFICIENCY}"
        yield _lower(
            "ellipses over hull of the means", theirs, paper.POINT_EFFICIENCY, one, "{:.3f}", "embedding", "efficiency"
        )
        steps = f"{paper.POINT_STEPS:,} until separated"
        yield _lower("control steps of the training", steps, paper.POINT_STEPS, one, "{:,.0f}", "env_steps")


def _reach_skills(material: Material) -> Iterator[Row]:
    for one in material.find(PRETRAIN, "reach")[:1]:
        for index, skill in enumerate(PRETRAIN.results_of(one.artifact).skills):
            goal = _goal(one, skill.goal)
            theirs = _match(paper.REACH_FINAL, goal)
            path = ("skills", index, "final_distance_m")
            yield _distance(f"skill {skill.name} to {_place(goal)}{_on(one)}", theirs, one, path, real=True)
    for one in material.find(TRANSFER_EVAL, "reach", _bare):
        yield from _domains(
            one, f"0 of {len(paper.REACH_FINAL)} within {100 * paper.REACH_TOLERANCE:.0f} cm (real)", "bare skills"
        )


def _reach_composed(material: Material) -> Iterator[Row]:
    composed = material.find(COMPOSE, "reach")
    for goal, theirs in paper.REACH_UNSEEN.items():
        made = [one for one in composed if _targets(one) == [goal]]
        what, asked = f"unseen point {_place(goal)}", f"--method ddpg --goal={','.join(f'{x:g}' for x in goal)}"
        for one in made:
            label = f"{what}, {_plan(one).method}{_on(one)}"
            yield _distance(label, theirs, one, ("final_distance_m",), real=True)
        if not made:
            yield Row(what, f"{_cm(theirs)} (ddpg, real)", None, "", _compose(material, "reach", asked))
    for one in [one for one in composed if _plan(one).task == "triangle"]:
        yield _lower(
            f"triangle: planning{_on(one)}",
            "less than 1 min (sim)",
            paper.TRIANGLE_SECONDS,
            one,
            "{:.1f} s",
            "planning_seconds",
            group="measured",
        )
        if closest := [waypoint.closest_m for waypoint in _plan(one).waypoints]:
            worst = int(np.argmax(closest))
            yield _lower(
                f"triangle: the vertex passed at the largest distance{_on(one)}", "within 5 cm (sim)", paper.TRIANGLE_TOLERANCE,
                one, "{:.1f} cm", "waypoints", worst, "closest_m", scale=100,
            )  # fmt: skip
    for one in material.find(EMBED_MEANS, "reach"):
        number = EMBED_MEANS.results_of(one.artifact).latent_goal_correlation
        if number is not None:
            key = "results.latent_goal_correlation"
            verdict = "better" if number > paper.REACH_CORRELATION else SHORT
            what = f"latent against goal distances, Pearson r, {one.name}"
            yield Row(what, f"{paper.REACH_CORRELATION}", Number(f"{number:.2f}", one.id, key), verdict)


def _push_skills(material: Material) -> Iterator[Row]:
    for one in material.find(PRETRAIN, "push"):
        for index, skill in enumerate(PRETRAIN.results_of(one.artifact).skills):
            wanted, pushed = _goal(one, skill.goal)[:2], paper.PUSH_GOALS.get(skill.name)
            same = pushed is not None and math.dist(pushed, wanted) < NEAR  # other arms may have other goals
            moved = paper.PUSH_MOVED[skill.name] if same else None
            theirs = None if moved is None else math.dist(moved, wanted)
            told = f"{_place(moved)}: {_cm(theirs)} off (real)" if moved and theirs is not None else ""
            path = ("skills", index, "final_distance_m")
            yield _distance(f"{skill.name}, {one.name}{_on(one)}", theirs, one, path, real=True, told=told)
    for one in material.find(TRANSFER_EVAL, "push", _bare):
        yield from _domains(one, "", "bare skills")


def _push_means(material: Material) -> Iterator[Row]:
    for one in material.find(EMBED_MEANS, "push"):
        goals = {name: goal[:2] for name, goal in zip(one.scene.skills, one.scene.goals - _start(one), strict=True)}
        for index, pair in enumerate(EMBED_MEANS.results_of(one.artifact).halfway):
            a, b = pair.from_, pair.to
            moved, ours = paper.PUSH_MEANS.get(frozenset((a, b))), pair.direction_error_deg
            if ours is None:
                continue
            theirs = angle_deg(np.array(moved), (goals[a] + goals[b]) / 2) if moved and a in goals and b in goals else None
            verdict = "" if theirs is None else "smaller, but in simulation" if ours < theirs else SHORT
            key = f"results.halfway[{index}].direction_error_deg"
            told = "" if theirs is None else f"{_place(moved)}: {theirs:.0f}° off (real)"
            yield Row(f"{a} and {b}, {one.name}", told, Number(f"{ours:.0f}° off", one.id, key), verdict)


def _push_searched(material: Material) -> Iterator[Row]:
    composed = material.find(COMPOSE, "push")
    for goal, theirs in paper.PUSH_SEARCHED.items():
        made = [one for one in composed if _targets(one) == [goal]]
        for one in made:
            label = f"{_place(goal)}, {_plan(one).method}{_on(one)}"
            yield _distance(label, theirs, one, ("final_distance_m",), real=False)
        if not made:
            command = _compose(material, "push", f"--goal={goal[0]:g},{goal[1]:g}")
            yield Row(_place(goal), f"{_cm(theirs)} (sim)", None, "", command)
    for one in composed:
        found, tolerance = _plan(one), one.scene.tolerance
        ends = found.final_distances_m
        if len(ends) > 1:
            text = f"{sum(end <= 0.02 for end in ends)} of {len(ends)} within 2 cm, worst {_cm(max(ends))}"
            yield Row(
                f"{found.task}: {len(ends)} goals",
                "",
                Number(text, one.id, "results.final_distances_m"),
                _within(max(ends), tolerance),
            )


def _transfer(material: Material) -> Iterator[Row]:
    for one in material.find(TRANSFER_EVAL, where=lambda one: not _bare(one)):
        parent = one.artifact.parents[0].id if one.artifact.parents else one.artifact.id
        yield from _domains(one, paper.TRANSFER.get(one.scene.task, ""), str(parent))


def _interpolation(material: Material) -> Iterator[Row]:
    for one in material.find(COMPOSE):
        for what, path in (
            ("error of held latents between skills, all pairs", ("calibration", "mean_error")),
            ("… half-way, all pairs", ("calibration", "mean_error_at_half")),
            ("… half-way, neighbours only", ("calibration", "neighbours", "mean_error_at_half")),
        ):
            number = one.value("results", *path)
            if isinstance(number, float):
                yield Row(f"{what}, {one.name}", "not calibrated", Number(f"{number:.3f}", one.id, _key("results", path)), "")


def _training(material: Material) -> Iterator[Row]:
    for one in material.find(PRETRAIN):
        for what, form, group, path in (
            ("sampled latents that succeed", "{:.1%}", "results", ("success_rate",)),
            ("control steps", "{:,.0f}", "results", ("env_steps",)),
            ("wall time", "{:,.1f} s", "measured", ("wall_seconds",)),
            ("sampling against the bare engine", "{:.2f}", "measured", ("throughput", "sampling_ratio")),
            ("training against the bare engine", "{:.2f}", "measured", ("throughput", "training_ratio")),
        ):
            number = one.value(group, *path)
            if _is_number(number):
                yield Row(f"{one.name}: {what}", "", Number(form.format(number), one.id, _key(group, path)), "")


# --- rows -------------------------------------------------------------------------------------------------------------


def _domains(one: Exhibit, theirs: str, what: str) -> Iterator[Row]:
    """Write one line per domain: successes of episodes with the interval, the median distance and the retained share."""
    for index, domain in enumerate(TRANSFER_EVAL.results_of(one.artifact).domains):
        kept, median = domain.retention, domain.final_distance_m.median
        ended = "all unstable" if median is None else f"median {_cm(median)}"
        text = f"{domain.successes} of {domain.episodes} ({_interval(domain)}), {ended}"
        verdict = "" if kept is None else "holds" if kept >= HOLDS else f"{SHORT}: {kept:.2f} of the source"
        yield Row(f"{what} on {domain.name}", theirs, Number(text, one.id, f"results.domains[{index}]"), verdict)


def _interval(outcome: Outcome) -> str:
    low, high = outcome.ci95
    return "exact" if outcome.deterministic else f"{100 * low:.0f}–{100 * high:.0f} %"


def _distance(what: str, theirs: float | None, one: Exhibit, path: Sequence[str | int], real: bool, told: str = "") -> Row:
    """Write a distance in cm beside the paper's; our simulation is never called better than its real robot."""
    where, number = "real" if real else "sim", one.value("results", *path)
    told = told or ("" if theirs is None else f"{_cm(theirs)} ({where})")
    if not _is_number(number):
        return Row(what, told, None, "not recorded")
    verdict = "" if theirs is None else SHORT if number > theirs else SIMULATED if real else "better"
    return Row(what, told, Number(_cm(number), one.id, _key("results", path)), verdict)


def _lower(
    what: str, told: str, theirs: float, one: Exhibit, form: str, *path: str | int, group: str = "results", scale: float = 1.0
) -> Row:
    """Write a number for which less is better."""
    number = one.value(group, *path)
    if not _is_number(number):
        return Row(what, told, None, "not recorded")
    return Row(
        what, told, Number(form.format(scale * number), one.id, _key(group, path)), "better" if number <= theirs else SHORT
    )


def _within(distance: float, tolerance: float) -> str:
    return f"all within {_cm(tolerance)}" if distance <= tolerance else f"{SHORT} of {_cm(tolerance)}"


# --- reading ----------------------------------------------------------------------------------------------------------


def _compose(material: Material, task: str, asked: str) -> str:
    """Return the command that composes with the first library of a task on the paper's arm: goals of the paper are its own."""
    found = [*material.find(EMBED_MEANS, task), *material.find(PRETRAIN, task)]
    libraries = [one for one in found if not one.robot]
    return f"skill compose {libraries[0].artifact.id.series if libraries else 'ID'} {asked}"


def _plan(one: Exhibit) -> ComposeResults:
    return COMPOSE.results_of(one.artifact)


def _on(one: Exhibit) -> str:
    """Name an arm that is not the paper's, after what it did."""
    return f", on the {one.robot}" if one.robot else ""


def _bare(one: Exhibit) -> bool:
    """Return whether a transfer is of skills and not of a composition."""
    return not len(one.scene.waypoints)


def _is_number(item: Any) -> bool:
    return isinstance(item, float | int) and not isinstance(item, bool) and math.isfinite(item)


def _key(group: str, path: Iterable[str | int]) -> str:
    """Write a path as text: results.skills[0].name."""
    return group + "".join(f"[{step}]" if isinstance(step, int) else f".{step}" for step in path)


def _start(one: Exhibit) -> Any:
    """Return the origin of goals, (3,) m."""
    if not one.scene.figure_settings.goals_from_start:
        return np.zeros(3)
    return np.round(one.scene.trajectories.achieved_goal[0, 0], 3)


def _goal(one: Exhibit, goal: Any) -> Goal:
    """Convert a goal to the form in which it is typed."""
    return tuple(float(x) for x in np.asarray(goal, dtype=float) - _start(one)[: len(goal)])


def _targets(one: Exhibit) -> list[Goal]:
    """Return the waypoints of a composition in the form in which they are typed, to the millimetre."""
    size = one.scene.figure_settings.goal_size
    return [tuple(round(float(x), 3) + 0.0 for x in place[:size]) for place in one.scene.waypoints - _start(one)]


def _match(known: Mapping[tuple[float, float, float], float], goal: Goal) -> float | None:
    return next((number for other, number in known.items() if len(other) == len(goal) and math.dist(other, goal) < NEAR), None)


def _place(goal: Goal | None) -> str:
    return "" if goal is None else "(" + ", ".join(f"{round(x, 3) + 0.0:g}".replace("-", "−") for x in goal) + ")"


def _cm(distance: float) -> str:
    return f"{100 * distance:.1f} cm"
