"""Tables of the results of a stage."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence

from rich.console import Group
from rich.pretty import Pretty
from rich.table import Table
from rich.text import Text

from skillcli.cli import sweep_view
from skillcli.composition.registry import replanning
from skillcli.kinds import COMPOSE, EMBED_MEANS, EXECUTION, PLAY, PRETRAIN, SWEEP, TRANSFER_EVAL, ByKind, kind_spec
from skillcli.kinds.compose import Violation
from skillcli.kinds.embed_means import Halfway
from skillcli.kinds.outcome import Outcome
from skillcli.kinds.transfer_eval import DomainResults, TransferEvalResults, WorstEpisode
from skillcli.store import Artifact

TABLES: ByKind[Callable[[Artifact], Group]] = ByKind("table")


def table_of(artifact: Artifact) -> Group:
    """Return the table of an artifact; without one for its kind, its plain results.

    Raises:
        StoreError: its kind is unknown.
    """
    kind = kind_spec(artifact.kind, str(artifact.id)).name
    return TABLES.of(kind)(artifact) if kind in TABLES else Group(_title(artifact), Pretty(artifact.results, max_length=12))


def _centimetres(metres: float | None) -> str:
    return "–" if metres is None else f"{100 * metres:.1f} cm"


def _degrees(degrees: float) -> str:
    return f"{degrees:.0f}°"


def _table(*columns: str) -> Table:
    table = Table()
    for index, column in enumerate(columns):
        table.add_column(column, justify="left" if index == 0 else "right")
    return table


def _title(artifact: Artifact, more: str = "") -> Text:
    return Text.assemble((str(artifact.id), "bold"), more)


@TABLES.register(PRETRAIN)
def pretrain(artifact: Artifact) -> Group:
    """List every skill of a training."""
    found, measured = PRETRAIN.results_of(artifact), PRETRAIN.measured_of(artifact)
    turned = [_degrees(skill.final_yaw_deg) for skill in found.skills if skill.final_yaw_deg is not None]
    table = _table("skill", "goal (m)", "at the mean", *["box turned"] * bool(turned), "sampled latents")
    for index, skill in enumerate(found.skills):
        goal = ", ".join(f"{x:g}" for x in skill.goal)
        distance = _centimetres(skill.final_distance_m)
        table.add_row(skill.name, goal, distance, *turned[index : index + 1], f"{skill.success_rate:.0%}")
    ratio = measured.throughput.training_ratio
    share = f", {ratio:.0%} of the bare engine" if ratio else ""
    caption = (
        f"{found.env_steps:,} control steps in {measured.wall_seconds:.0f} s"
        f" ({measured.throughput.env_steps_per_second:,.0f}/s{share}); success {found.success_rate:.1%}, "
        f"skills recognised {found.embedding.inference_accuracy:.1%}"
    )
    if other := found.randomised:
        median = _centimetres(other.final_distance_m.median)
        caption += f"\non robots and starts as varied as in training: success {other.success_rate:.1%}, median {median}"
    return Group(_title(artifact), table, caption)


@TABLES.register(EMBED_MEANS)
def means(artifact: Artifact) -> Group:
    """List every skill's mean latent."""
    found = EMBED_MEANS.results_of(artifact)
    table = _table("skill", "mean latent", "std", "at the mean")
    for skill in found.skills:
        mean, std = (" ".join(f"{x:5.2f}" for x in latent) for latent in (skill.mean, skill.std))
        table.add_row(skill.name, mean, std, _centimetres(skill.final_distance_m))
    shown = ["–" if number is None else f"{number:.3f}" for number in (found.efficiency, found.latent_goal_correlation)]
    caption = f"embedding efficiency {shown[0]} (lower is better separated), latent against goal distances r = {shown[1]}"
    if found.map:
        ends = f"median {_centimetres(found.map.median_m)}, 95 % within {_centimetres(found.map.p95_m)}"
        caption += f"\nmap: {found.map.places} places between the goals, one held latent each, end off by {ends}"
        if found.map.on_robots:
            there = found.map.on_robots
            ends = f"median {_centimetres(there.median_m)}, 95 % within {_centimetres(there.p95_m)}"
            caption += f"; each on a robot of {there.domain}: {ends}"
    return Group(_title(artifact), table, caption, *_between(found.halfway))


def _between(halfway: Sequence[Halfway]) -> list[Table]:
    """List the results of the means of two neighbouring latents."""
    if not halfway:
        return []
    table = _table("mean of", "from half-way between the goals", "direction off by", "way against that")
    for pair in halfway:
        angle, ratio = pair.direction_error_deg, pair.magnitude_ratio
        shown = ("–" if angle is None else f"{angle:.0f}°", "–" if ratio is None else f"{ratio:.2f}")
        table.add_row(f"{pair.from_}, {pair.to}", _centimetres(pair.final_distance_m), *shown)
    return [table]


RELIABLE = 0.9  # predicted success from which on a plan may be sent blindly


@TABLES.register(COMPOSE)
def plan(artifact: Artifact) -> Group:
    """List every waypoint of a composition."""
    found = COMPOSE.results_of(artifact)
    table = _table("waypoint", "target (m)", "closest")
    for index, waypoint in enumerate(found.waypoints):
        target = ", ".join(f"{x:g}" for x in waypoint.target)
        table.add_row(str(index + 1), target, _centimetres(waypoint.closest_m))
    steps = " ".join(f"{segment.skill}:{segment.seconds:.2f}s" for segment in found.segments)
    met = "success" if found.success else "failed"
    limits = [f"violates {where(violation)}" for violation in found.broken]
    ends = f"ends {_centimetres(found.final_distance_m)} from the last goal"
    if found.final_yaws_deg:
        ends += f", the box turned by {_degrees(max(found.final_yaws_deg, key=abs))}"
    if found.routes > 1:
        met, ends = f"{round(found.success_rate * found.routes)} of {found.routes} routes succeed", f"the worst {ends}"
        steps = "; ".join(
            " ".join(f"{each.skill}:{each.seconds:.2f}s" for each in found.segments if each.route == route)
            for route in range(found.routes)
        )
    if (ahead := found.predicted) is not None:
        low, high = ahead.ci95
        safe = ahead.successes if ahead.successes_within_limits is None else ahead.successes_within_limits
        limits.append(
            f"sent blindly to {ahead.domain} robots, {ahead.successes} of {ahead.robots} succeed ({low:.0%}–{high:.0%})"
            + (f", {safe} of them without violating a safety limit" if safe < ahead.successes else "")
            + ("" if safe >= RELIABLE * ahead.robots else f"; {_way_out(found.method)}")
        )
    effort = f"planned in {COMPOSE.measured_of(artifact).planning_seconds:.1f} s, {found.expanded_nodes} nodes"
    caption = "\n".join([f"{met}, {ends}; {effort}", *limits, f"plan {steps}"])
    return Group(_title(artifact, f": {found.method}, {found.task}"), table, caption)


def _way_out(method: str) -> str:
    """Say what to do with a plan that will often fail."""
    able = replanning()
    if method in able:
        return "look on the way: skill transfer-eval --replan"
    return f"{' and '.join(able)} can --replan on the way"


def where(violation: Violation) -> str:
    """Describe which limit a plan violates, and where first."""
    steps, place = violation.control_steps, ", ".join(f"{x:.2f}" for x in violation.gripper_m)
    return (
        f"{violation.limit} in route {violation.route + 1} for {steps} control step{'s' if steps > 1 else ''}, "
        f"first at {violation.seconds:.2f} s in segment {violation.segment + 1} with the gripper at ({place}) m"
    )


@TABLES.register(TRANSFER_EVAL)
def transfer(artifact: Artifact) -> Group:
    """List every domain of a transfer."""
    found = TRANSFER_EVAL.results_of(artifact)
    turns = any(domain.final_yaw_deg for domain in found.domains)
    table = _table("domain", "success", "95 %", "gap", "retention", "median", "p90", *["box turned"] * turns, "replay")
    for domain in found.domains:
        distance, replay, turned = domain.final_distance_m, domain.replay_error_m, domain.final_yaw_deg
        table.add_row(
            domain.name, f"{domain.successes}/{domain.episodes}", _interval(domain),
            "–" if domain.gap is None else f"{domain.gap:.0%}", "–" if domain.retention is None else f"{domain.retention:.2f}",
            _centimetres(distance.median), _centimetres(distance.p90),
            *[_degrees(turned.median) if turned else "–"] * turns, _centimetres(replay.median if replay else None),
        )  # fmt: skip
    again = ", with replanning" if found.replanned else ""
    robot = f"the robot of {found.robot.file}" if found.robot else "other robots"
    said = [f"source: success {found.source.success_rate:.0%}", *_footnotes(found)]
    parts = [part for domain in found.domains if (part := _sensitivity(domain))]
    return Group(_title(artifact, f": {artifact.parents[0].id} on {robot}{again}"), table, "\n".join(said), *parts)


def _interval(outcome: Outcome) -> str:
    """Write the interval of a success rate, if anything is random."""
    low, high = outcome.ci95
    return "exact" if outcome.deterministic else f"{low:.0%}–{high:.0%}"


def _once(domains: Sequence[DomainResults]) -> list[str]:
    """Name the domains in which every episode is the same."""
    names = ", ".join(domain.name for domain in domains if domain.deterministic)
    return [f"{names}: deterministic, one episode of each route or skill, no interval"] if names else []


def _unstable(domains: Sequence[DomainResults]) -> list[str]:
    """Name the domains with unstable simulations."""
    told = [f"{each.name} in {each.unstable} of {each.episodes} episodes" for each in domains if each.unstable]
    return [f"unstable: {', '.join(told)}; the simulation diverged, no distance is counted"] if told else []


def _gave_up(domains: Sequence[DomainResults]) -> list[str]:
    """Name the domains in which replanned episodes ended away from their goal."""
    told = [f"{each.name} in {each.gave_up} of {each.episodes} episodes" for each in domains if each.gave_up]
    return [f"gave up: {', '.join(told)}; no latent led close enough to the goal in time"] if told else []


def _footnotes(found: TransferEvalResults) -> list[str]:
    """Explain a transfer: the meaning of `replay`, violated limits, and the worst episode by its name in the viewer."""
    said = [*_unstable(found.domains), *_gave_up(found.domains), *_once(found.domains)]
    if not found.domains[0].worst:
        return said
    lines = [*said, "replay: the source's commands sent blindly, median distance between where they end here and there"]
    counted = [("source", found.source.violations), *((domain.name, domain.violations) for domain in found.domains)]
    violated = [f"{name}: {limit} in {count} episodes" for name, part in counted for limit, count in part.items() if count]
    lines += [f"safety limits violated: {'; '.join(violated)}"] if violated else []
    ended = [
        (each.final_distance_m, each.episode - first, name)
        for name, first, each in _worst(found.domains)
        if each.final_distance_m is not None
    ]
    if not ended:
        return lines
    distance, episode, name = max(ended)
    return [*lines, f"farthest off: {name} {episode}, {_centimetres(distance)}"]


def _worst(domains: Sequence[DomainResults]) -> Iterator[tuple[str, int, WorstEpisode]]:
    """Yield the worst episode of each domain, with the domain and the number of its first episode."""
    first = 0
    for domain in domains:
        ended = [each for each in domain.worst if each.final_distance_m is not None]
        yield from ((domain.name, first, each) for each in ended[:1])
        first += domain.episodes


def _sensitivity(domain: DomainResults) -> Table | None:
    """List each parameter of a domain alone."""
    if not domain.sensitivity:
        return None
    table = _table(f"{domain.name}: alone", "success", "95 %", "median")
    for row in domain.sensitivity:
        shown = f"{row.successes}/{row.episodes}", _interval(row)
        table.add_row(row.parameter, *shown, _centimetres(row.final_distance_m.median))
    return table


@TABLES.register(EXECUTION)
def execution(artifact: Artifact) -> Group:
    """Tell how an execution went."""
    found, measured = EXECUTION.results_of(artifact), EXECUTION.measured_of(artifact)
    clock = measured.deadlines
    table = _table("arm", "success", "95 %", "median", "p90", "filtered steps", "late", "99 % within")
    arm = found.robot.name if found.domain is None else f"{found.robot.name}, simulated: {found.domain}"
    table.add_row(
        arm, f"{found.successes}/{found.episodes}", _interval(found), _centimetres(found.final_distance_m.median),
        _centimetres(found.final_distance_m.p90), f"{found.filtered_steps}", f"{clock.missed}/{clock.steps}",
        f"{clock.p99_ms:.1f} ms",
    )  # fmt: skip
    said = ["nothing was sent: a dry run"] if found.dry_run else []
    if found.replanned:
        took = f", {measured.seconds_per_plan:.2f} s for each plan" if measured.seconds_per_plan else ""
        said.append(f"with replanning{took}" + (f"; gave up in {found.gave_up} episodes" if found.gave_up else ""))
    if found.max_speed < 1:
        said.append(f"at {found.max_speed:.0%} of the usual speed")
    if found.filtered:
        said.append("filtered: " + ", ".join(f"{limit} in {count} steps" for limit, count in found.filtered.items()))
    if violated := {limit: count for limit, count in found.violations.items() if count}:
        said.append("safety limits violated: " + ", ".join(f"{limit} in {count} episodes" for limit, count in violated.items()))
    if (stop := found.stopped) is not None:
        said.append(f"stopped in episode {stop.episode + 1} after {stop.seconds:.2f} s, {stop.reason}: {stop.message}")
    parts = ["\n".join(said)] if said else []
    return Group(_title(artifact, f": {artifact.parents[0].id} by the driver {found.driver}"), table, *parts)


@TABLES.register(PLAY)
def play(artifact: Artifact) -> Group:
    """Tell what was played by hand."""
    found = PLAY.results_of(artifact)
    table = _table("robot", "goal", "final distance", "lasts")
    reached = "failed" if found.failed else "reached" if found.success else "not reached"
    table.add_row(found.robot.name, reached, _centimetres(found.final_distance_m), f"{found.seconds:.2f} s")
    violated = ", ".join(f"{limit} in {count} control steps" for limit, count in found.violations.items())
    parts = [f"safety limits violated: {violated}"] if violated else []
    return Group(_title(artifact, f": {artifact.parents[0].id}, by hand"), table, *parts)


TABLES.register(SWEEP)(sweep_view.table)
