"""The figures of the report: which can be drawn from which artifacts, and their captions."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from skillcli.kinds import COMPOSE, EMBED_MEANS, PRETRAIN, TRANSFER_EVAL
from skillcli.kinds.compose import GOALS, ComposeResults
from skillcli.trajectories import Array
from skillcli.viz import motion
from skillcli.viz.figure_style import encoded, styled
from skillcli.viz.formats import FORMATS
from skillcli.viz.paper_figures import composers, interpolation, learning, point, push, reach, transfer
from skillcli.viz.report import paper
from skillcli.viz.report.content import Missing, ReportFigure
from skillcli.viz.report.selection import Exhibit, Material
from skillcli.viz.scene import Runs, label
from skillcli.viz.subplots_time import reward_terms

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@dataclass(frozen=True)
class Plan:
    """A figure that can be drawn."""

    caption: str
    used: Sequence[Exhibit]
    make: Callable[[], Figure]


@dataclass(frozen=True)
class Subject:
    """A figure of the report: its title, how to draw it, and what it needs."""

    slug: str
    paper_figure: str
    title: str
    plan: Callable[[Material], Plan | None]
    needs: str


def make_figures(material: Material) -> tuple[list[ReportFigure], list[Missing]]:
    """Draw every figure that the material allows, and say why the others are missing."""
    figures, missing = [], []
    for subject in SUBJECTS:
        plan = subject.plan(material)
        number = f" (figure {subject.paper_figure} of the paper)" if subject.paper_figure else ""
        if plan is None:
            missing.append(Missing(f"{subject.title}{number}", f"there is no {subject.needs}{_remedy(subject, material)}"))
            continue
        with styled():
            figure = plan.make()
            files = {suffix: encoded(figure, suffix) for suffix in FORMATS}
        ids = [one.id for one in plan.used]
        caption = plan.caption + _arms_of(plan.used)
        figures.append(ReportFigure(subject.slug, subject.paper_figure, subject.title, caption, ids, files))
    return figures, missing


def _arms_of(used: Sequence[Exhibit]) -> str:
    """Say which libraries are of other arms than the paper's."""
    arms = dict.fromkeys(f"{one.name} ({one.robot})" for one in used if one.robot)
    return f" On other arms than the paper's: {', '.join(arms)}." if arms else ""


def _remedy(subject: Subject, material: Material) -> str:
    """Return the commands for figure 10, whose artifacts no chain makes."""
    libraries = material.find(EMBED_MEANS, "reach", lambda one: not one.robot)
    if subject.plan is not _arm_returns or not libraries:
        return ""
    goal = ",".join(f"{x:g}" for x in next(iter(paper.REACH_UNSEEN)))
    compose = f"skill compose {libraries[0].artifact.id.series} --method ddpg --goal={goal} --latents"
    return f": `{compose} continuous` and `{compose} interpolated`"


# --- of the paper -----------------------------------------------------------------------------------------------------


def _latents_and_paths(material: Material) -> Plan | None:
    for one in material.find(PRETRAIN, "point"):
        sampled = one.scene.trajectories.episodes - len(motion.mean_episodes(one.scene))
        caption = (
            f"Left: the mean latents. Middle: each skill's Gaussian close up, one and two standard deviations, with the "
            f"latents that were drawn (n = {sampled}). Right: the paths that they give from the origin, the mean latents bold; "
            f"circles: goals with the tolerance of {100 * one.scene.tolerance:.0f} cm. In the paper the "
            "embedding separates the skills "
            f"after {paper.POINT_STEPS:,} steps, with ellipses of {paper.POINT_EFFICIENCY} of the hull of the means; here "
            f"{_said(one, 'embedding', 'efficiency', form='.3f')}. Dashes and markers tell apart what colours do."
        )
        return Plan(caption, [one], partial(point.latents_and_paths, one.scene))
    return None


def _skill_paths(material: Material) -> Plan | None:
    sources = material.find(PRETRAIN, "reach") or material.find(EMBED_MEANS, "reach")
    if not sources:
        return None
    one = sources[0]
    targets = material.find(TRANSFER_EVAL, "reach", lambda other: other.name == one.name and not len(other.scene.waypoints))
    target = targets[0] if targets else None
    others = one.scene.trajectories.episodes - len(motion.mean_episodes(one.scene))
    below = (
        "Below: the mean latents on target domains, parameters drawn anew for every episode."
        if target
        else "No target domain: there is no transfer-eval of these bare skills."
    )
    whose = "its own" if one.robot else "these"
    caption = (
        f"Gripper paths of {len(one.scene.skills)} skills at their mean latents (bold) and of {others} sampled "
        "latents (thin) in the "
        f"source; circles: goals with the tolerance of {100 * one.scene.tolerance:.0f} cm. {below} "
        f"In the paper the real robot ended {_range_cm(paper.REACH_FINAL.values())} cm from {whose} goals, none within "
        f"{100 * paper.REACH_TOLERANCE:.0f} cm."
    )
    return Plan(caption, [one, *targets[:1]], lambda: reach.skill_paths(one.scene, target.scene if target else None))


def _reach_compositions(material: Material) -> Plan | None:
    composed = _of_one_library(material.find(COMPOSE, "reach"))
    chain = [one for one in composed if _plan_of(one).task == "u-shape"][:1]
    points = [one for one in composed if len(one.scene.waypoints) == 1]
    learned = [one for one in points if _plan_of(one).method == "ddpg"]
    triangle = [one for one in composed if _plan_of(one).task == "triangle"][:1]
    used = [*chain, *(learned or points)[:1], *triangle]
    if not used:
        return None
    titles = [_composed(one) for one in used]
    parts = (("interpolated U", chain), ("composition to an unseen point", points), ("searched triangle", triangle))
    lacking = [name for name, found in parts if not found]
    ends = ", ".join(f"{title} {_closest(one)}" for title, one in zip(titles, used, strict=True))
    caption = (
        "Executed in the source, one episode each; the look of a line is the skill that is fed. Largest distance "
        "at which a waypoint "
        f"was passed: {ends}. The paper drew the U on the robot, ended {_range_cm(paper.REACH_UNSEEN.values())} cm from "
        "unseen points (DDPG, real robot), and searched "
        f"the triangle within {100 * paper.TRIANGLE_TOLERANCE:.0f} cm in simulation."
        + (f" Not in the store: {' and '.join(lacking)}." if lacking else "")
    )
    return Plan(caption, used, lambda: reach.compositions([one.scene for one in used], titles))


def _of_one_library(exhibits: list[Exhibit]) -> list[Exhibit]:
    """Keep the exhibits of the first library: colours are by skill number, which differs between libraries."""
    return [one for one in exhibits if one.name == exhibits[0].name]


def _skill_pushes(material: Material) -> Plan | None:
    for one in material.find(PRETRAIN, "push") or material.find(EMBED_MEANS, "push"):
        skills = one.value("results", "skills")
        told = ", ".join(
            f"{name} {100 * skill.final_distance_m:.1f}" for name, skill in zip(one.scene.skills, skills, strict=True)
        )
        sampled = (
            (one.scene.trajectories.episodes - len(motion.mean_episodes(one.scene))) if one.scene.runs is Runs.SAMPLED else 0
        )
        caption = (
            f"Box (bold: mean latent, thin: {sampled} sampled latents) and gripper from above; cross: goal, "
            "dotted circle: tolerance of "
            f"{100 * one.scene.tolerance:.0f} cm. Final distance at the mean latent, cm: {told}. In the paper the "
            "real robot's box ended "
            f"{_and(_cm(math.dist(moved, paper.PUSH_GOALS[name])) for name, moved in paper.PUSH_MOVED.items())} cm from the "
            f"goals of {_and(paper.PUSH_MOVED)}."
        )
        return Plan(caption, [one], partial(push.skill_pushes, one.scene))
    return None


def _mean_pushes(material: Material) -> Plan | None:
    for one in material.find(EMBED_MEANS, "push", lambda one: one.scene.trajectories.episodes > len(one.scene.skills)):
        pairs = one.scene.trajectories.episodes - len(one.scene.skills)
        caption = (
            f"n = {pairs} pairs, one episode each. Left: path of the box while the mean of two neighbouring latents is held; "
            "cross: half-way between the two goals. Right: the angle between where the box went and that "
            "cross."
        )
        if one.robot:  # its goals are not those of the paper
            return Plan(caption, [one], partial(push.mean_pushes, one.scene, {}))
        caption += " Open marks: the paper's recorded ends on the real robot, which it calls “not reliable for half”."
        return Plan(caption, [one], partial(push.mean_pushes, one.scene, paper.PUSH_MEANS))
    return None


def _searched_pushes(material: Material) -> Plan | None:
    searched = _of_one_library(material.find(COMPOSE, "push", lambda one: _plan_of(one).method == "search"))
    if not searched:
        return None
    searched = sorted(searched, key=lambda one: one.scene.trajectories.episodes)
    routes = [(one, episode) for one in searched for episode in range(one.scene.trajectories.episodes)][: push.MAX_ROUTES]
    used = list(dict.fromkeys(one for one, _ in routes))
    success = sum(bool(one.scene.trajectories.success[episode]) for one, episode in routes)
    caption = (
        "Each panel is one plan, executed in the source: goal as displacement in m, and how far from it the box "
        f"ends; {success} of "
        f"{len(routes)} within the tolerance of {100 * used[0].scene.tolerance:.0f} cm. The look of a line is the "
        "skill that is held. "
        f"The paper searched ({', '.join(f'±{abs(x):g}' for x in next(iter(paper.PUSH_SEARCHED)))}) in simulation and ended "
        f"{_and(map(_cm, paper.PUSH_SEARCHED.values()))} cm off."
    )
    return Plan(caption, used, lambda: push.searched_pushes([(one.scene, episode) for one, episode in routes]))


def _arm_returns(material: Material) -> Plan | None:
    groups: dict[str, list[Exhibit]] = {}
    for one in material.find(COMPOSE, where=_with_arm):
        goals = str(np.round(one.scene.waypoints, 4).tolist())
        groups.setdefault(f"{one.artifact.parents[0].content_sha256} {goals}", []).append(one)  # of the same skills
    compared = [runs for runs in groups.values() if len({_arm(one) for one in runs}) > 1]
    if not compared:
        return None
    runs = max(compared, key=len)
    arms: dict[str, tuple[Array, Array]] = {}
    for name in sorted({_arm(one) for one in runs}):
        arms[name] = _padded([one for one in runs if _arm(one) == name])
    goal = ", ".join(f"{x:g}" for x in runs[0].scene.waypoints[-1])
    counts = ", ".join(f"{len(returns)} {name}" for name, (_, returns) in arms.items())
    caption = (
        f"Return of a DDPG composer, played without exploration, while it learns to reach ({goal}); mean over "
        "runs with different seeds "
        f"(n = {counts}), band: 95 % bootstrap interval of the mean ({composers.DRAWS:,} draws). A run that "
        "stopped early keeps its last "
        f"value. The paper found the {paper.ARMS} than the discrete latents."
    )
    return Plan(caption, runs, lambda: composers.arm_returns(arms, "return without exploration"))


# --- our own ----------------------------------------------------------------------------------------------------------


def _curves(material: Material) -> Plan | None:
    used = material.find(PRETRAIN, where=lambda one: "final_distance" in one.scene.curves)
    used = sorted(used[: learning.MAX_LIBRARIES], key=lambda one: one.name)
    if not used:
        return None
    counted = ", ".join(f"{one.name} {len(one.scene.curves['final_distance'])}" for one in used)
    caption = (
        "Success of each skill (black: their mean) and mean final distance of the episodes that were collected "
        "with exploration, one "
        f"training each (updates: {counted}); dashed: tolerance."
    )
    return Plan(caption, used, lambda: learning.curves([one.scene for one in used]))


def _reward_terms(material: Material) -> Plan | None:
    used = material.find(PRETRAIN, where=lambda one: bool(reward_terms(one.scene)))
    used = sorted(used[: learning.MAX_LIBRARIES], key=lambda one: one.name)
    if not used:
        return None
    caption = (
        "What each term of the reward gave per episode, costs below zero, and the return (black), their sum; mean over the "
        f"episodes that were collected with exploration, n = 1 training for each of {len(used)} libraries."
    )
    return Plan(caption, used, lambda: learning.reward_terms([one.scene for one in used]))


def _distances(material: Material) -> Plan | None:
    several = material.find(EMBED_MEANS, where=lambda one: len(one.scene.skills) > 1)
    used = sorted(several[: learning.MAX_LIBRARIES], key=lambda one: one.name)
    if not used:
        return None
    r = [EMBED_MEANS.results_of(one.artifact).latent_goal_correlation for one in used]
    caption = (
        "One mark per pair of skills: distance of the mean latents against distance of the goals, with Pearson's "
        "r. On a straight line "
        "through the origin the latent space would have the metric of the task. The paper reports r = "
        f"{paper.REACH_CORRELATION} for reach."
    )
    return Plan(caption, used, lambda: learning.distances([one.scene for one in used], r))


def _success(material: Material) -> Plan | None:
    used, titles = _transfers(material)
    if not used:
        return None
    replanned = [
        title.split("\n")[0]
        for one, title in zip(used, titles, strict=True)
        if TRANSFER_EVAL.results_of(one.artifact).replanned
    ]
    how = "sent as they were made"
    if replanned:
        how = f"made again on the way ({', '.join(dict.fromkeys(replanned))}) or {how}"
    caption = (
        "Share of episodes that succeed on each domain, bar: Wilson's 95 % interval; exact where all episodes would be the "
        f"same. Plans are {how}, robots drawn anew for every episode. The paper reports no rates; of composed pushes it "
        "says “not able to reliably transfer”."
    )
    return Plan(caption, used, lambda: transfer.success([one.scene for one in used], titles))


def _final_distances(material: Material) -> Plan | None:
    used, titles = _transfers(material)
    if not used:
        return None
    counted = sum(one.scene.trajectories.episodes for one in used)
    caption = (
        f"The same {counted} episodes: distance to the last goal in the end, one mark each; box: quartiles, bold line: median; "
        "dashed: tolerance."
    )
    return Plan(caption, used, lambda: transfer.distances([one.scene for one in used], titles))


def _calibration(material: Material) -> Plan | None:
    for one in material.find(COMPOSE, where=lambda one: "calibration/end" in one.artifact.arrays):
        arrays = one.artifact.arrays
        pair, share, end = (arrays[f"calibration/{name}"] for name in ("pair", "share", "end"))
        half = _said(one, "calibration", "neighbours", "mean_error_at_half", form=".2f")
        caption = (
            "Latents between two skills, held from the start to the end of an episode: how far along and away "
            "from the line between "
            f"the two goals they lead (n = {len(pair)} pairs, {len(share)} latents each). Mean error half-way, "
            f"neighbours: {half}. The paper "
            "saw motions between a pair land much closer to one end, and calls interpolation not calibrated."
        )
        return Plan(caption, [one], partial(interpolation.calibration, pair, share, end, one.scene.goals))
    return None


SUBJECTS = (
    Subject("figure-02-point", "2", "Point: latents and paths", _latents_and_paths, "pretrain artifact of point"),
    Subject("figure-04-reach", "4", "Reach: gripper paths of the skills", _skill_paths, "library of reach"),
    Subject("figure-05-composed", "5", "Reach: composed in the latent space", _reach_compositions, "composition of reach"),
    Subject("figure-07-push", "7", "Push: box and gripper of the skills", _skill_pushes, "library of push"),
    Subject("figure-08-means", "8", "Push: means of neighbouring skills", _mean_pushes, "embed-means artifact of push"),
    Subject("figure-09-searched", "9", "Push: searched sequences", _searched_pushes, "searched composition of push"),
    Subject(
        "figure-10-arms", "10", "Composer: continuous against discrete latents", _arm_returns,
        "pair of ddpg compositions with the same goal and different ddpg.latents",
    ),
    Subject("learning", "", "Learning curves", _curves, "pretrain artifact"),
    Subject("reward-terms", "", "Terms of the reward", _reward_terms, "pretrain artifact that keeps the terms of its reward"),
    Subject("distances", "", "Latent against goal distances", _distances, "embed-means artifact"),
    Subject("calibration", "", "Interpolation between skills", _calibration, "interpolated composition"),
    Subject("transfer-success", "", "Success on robots that differ", _success, "transfer-eval artifact"),
    Subject("transfer-distance", "", "Final distances on robots that differ", _final_distances, "transfer-eval artifact"),
)  # fmt: skip
SLUGS = frozenset(subject.slug for subject in SUBJECTS)


# --- reading ----------------------------------------------------------------------------------------------------------


def _plan_of(one: Exhibit) -> ComposeResults:
    return COMPOSE.results_of(one.artifact)


def _cm(distance: float) -> str:
    return f"{100 * distance:.1f}"


def _range_cm(distances: Iterable[float]) -> str:
    """Write the range of distances in whole cm."""
    known = list(distances)
    return f"{100 * min(known):.0f} to {100 * max(known):.0f}"


def _and(words: Iterable[str]) -> str:
    *first, last = words
    return f"{', '.join(first)} and {last}"


def _said(one: Exhibit, *path: str, form: str) -> str:
    """Write a number of the results."""
    number = one.value("results", *path)
    return format(number, form) if isinstance(number, float) else "not recorded"


def _composed(one: Exhibit) -> str:
    """Describe a composition briefly."""
    found = _plan_of(one)
    goal = ", ".join(f"{x:g}" for x in one.scene.waypoints[-1])
    return label(f"{found.method}: ({goal})" if found.task == GOALS else f"{found.method}: {found.task}")


def _closest(one: Exhibit) -> str:
    return f"{100 * max(motion.closest(one.scene, 0), default=0.0):.1f} cm"


def _transfers(material: Material) -> tuple[list[Exhibit], list[str]]:
    """Return transfers of compositions and then of bare skills, with labels."""
    found = sorted(material.find(TRANSFER_EVAL), key=lambda one: (not len(one.scene.waypoints), one.name))[
        : transfer.MAX_TRANSFERS
    ]
    return found, [f"{one.name}\n{'composed' if len(one.scene.waypoints) else 'bare skills'}" for one in found]


def _arm(one: Exhibit) -> str:
    """Return the set of latents of a composer."""
    ddpg = one.artifact.recipe.get("ddpg")
    return label(str(ddpg.get("latents", ""))) if isinstance(ddpg, dict) else ""


def _with_arm(one: Exhibit) -> bool:
    curves = one.scene.curves
    return _plan_of(one).method == "ddpg" and bool(_arm(one)) and {"greedy_return", "env_steps"} <= curves.keys()


def _padded(runs: Sequence[Exhibit]) -> tuple[Array, Array]:
    """Return control steps (I,), thousands, and returns (R, I) of runs; shorter runs keep their last value."""
    longest = max(runs, key=lambda one: len(one.scene.curves["greedy_return"]))
    count = len(longest.scene.curves["greedy_return"])
    rows = [one.scene.curves["greedy_return"] for one in runs]
    returns = np.array([np.concatenate([row, np.full(count - len(row), row[-1])]) for row in rows])
    return np.asarray(longest.scene.curves["env_steps"]) / 1000, returns
