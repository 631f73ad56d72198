"""What a stage found out, as a table for a person."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any

from rich.console import Group
from rich.table import Table
from rich.text import Text

from skillcli.store import Artifact


def _centimetres(metres: float | None) -> str:
    return "–" if metres is None else f"{100 * metres:.1f} cm"


def _table(*columns: str) -> Table:
    table = Table()
    for index, column in enumerate(columns):
        table.add_column(column, justify="left" if index == 0 else "right")
    return table


def _title(artifact: Artifact, more: str = "") -> Text:
    return Text.assemble((str(artifact.id), "bold"), more)


def pretrain(artifact: Artifact) -> Group:
    """Every skill of a training."""
    found, speed = artifact.results, artifact.measured["throughput"]
    table = _table("skill", "goal (m)", "at the mean", "sampled latents")
    for skill in found["skills"]:
        goal = ", ".join(f"{x:g}" for x in skill["goal"])
        table.add_row(skill["name"], goal, _centimetres(skill["final_distance_m"]), f"{skill['success_rate']:.0%}")
    ratio = speed["training_ratio"]
    share = f", {ratio:.0%} of the bare engine" if ratio else ""
    caption = (
        f"{found['env_steps']:,} control steps in {artifact.measured['wall_seconds']:.0f} s"
        f" ({speed['env_steps_per_second']:,.0f}/s{share}); success {found['success_rate']:.1%}, "
        f"skills recognised {found['embedding']['inference_accuracy']:.1%}"
    )
    if found.get("randomised"):
        other = found["randomised"]
        median = _centimetres(other["final_distance_m"]["median"])
        caption += f"\non robots and starts as varied as in training: success {other['success_rate']:.1%}, median {median}"
    return Group(_title(artifact), table, caption)


def means(artifact: Artifact) -> Group:
    """Every skill's mean latent."""
    table = _table("skill", "mean latent", "std", "at the mean")
    for skill in artifact.results["skills"]:
        mean, std = (" ".join(f"{x:5.2f}" for x in skill[key]) for key in ("mean", "std"))
        table.add_row(skill["name"], mean, std, _centimetres(skill["final_distance_m"]))
    efficiency, r = artifact.results["efficiency"], artifact.results["latent_goal_correlation"]
    shown = ["–" if number is None else f"{number:.3f}" for number in (efficiency, r)]
    caption = f"embedding efficiency {shown[0]} (lower is better separated), latent against goal distances r = {shown[1]}"
    return Group(_title(artifact), table, caption, *_between(artifact))


def _between(artifact: Artifact) -> list[Table]:
    """What the mean of two neighbouring latents does."""
    if not artifact.results["halfway"]:
        return []
    table = _table("mean of", "from half-way between the goals", "direction off by", "way against that")
    for pair in artifact.results["halfway"]:
        angle, ratio = pair["direction_error_deg"], pair["magnitude_ratio"]
        shown = ("–" if angle is None else f"{angle:.0f}°", "–" if ratio is None else f"{ratio:.2f}")
        table.add_row(f"{pair['from']}, {pair['to']}", _centimetres(pair["final_distance_m"]), *shown)
    return [table]


def plan(artifact: Artifact) -> Group:
    """Every waypoint of a composition."""
    found = artifact.results
    table = _table("waypoint", "target (m)", "closest")
    for index, waypoint in enumerate(found["waypoints"]):
        target = ", ".join(f"{x:g}" for x in waypoint["target"])
        table.add_row(str(index + 1), target, _centimetres(waypoint["closest_m"]))
    steps = " ".join(f"{segment['skill']}:{segment['seconds']:.2f}s" for segment in found["segments"])
    met = "success" if found["success"] else "no success"
    limits = [f"breaks {where(broken)}" for broken in found.get("broken", ())]  # older artifacts do not say
    ends = f"ends {_centimetres(found['final_distance_m'])} from the last goal"
    if found["routes"] > 1:
        met, ends = f"{round(found['success_rate'] * found['routes'])} of {found['routes']} routes succeed", f"the worst {ends}"
        steps = "; ".join(
            " ".join(f"{each['skill']}:{each['seconds']:.2f}s" for each in found["segments"] if each["route"] == route)
            for route in range(found["routes"])
        )
    effort = f"planned in {artifact.measured['planning_seconds']:.1f} s, {found['expanded_nodes']} nodes"
    caption = "\n".join([f"{met}, {ends}; {effort}", *limits, f"plan {steps}"])
    return Group(_title(artifact, f": {found['method']}, {found['task']}"), table, caption)


def where(broken: dict[str, Any]) -> str:
    """Which limit a plan breaks, and where first."""
    steps, place = broken["control_steps"], ", ".join(f"{x:.2f}" for x in broken["gripper_m"])
    return (
        f"{broken['limit']} in route {broken['route'] + 1} for {steps} control step{'s' if steps > 1 else ''}, "
        f"first at {broken['seconds']:.2f} s in segment {broken['segment'] + 1} with the gripper at ({place}) m"
    )


def transfer(artifact: Artifact) -> Group:
    """Every domain of a transfer."""
    found = artifact.results
    table = _table("domain", "success", "95 %", "gap", "retention", "median", "p90", "replay")
    for domain in found["domains"]:
        distance, retention = domain["final_distance_m"], domain["retention"]
        gap, replay = domain.get("gap"), domain.get("replay_error_m")  # older artifacts do not say
        table.add_row(
            domain["name"], f"{domain['successes']}/{domain['episodes']}", _interval(domain),
            "–" if gap is None else f"{gap:.0%}", "–" if retention is None else f"{retention:.2f}",
            _centimetres(distance["median"]), _centimetres(distance["p90"]), _centimetres(replay["median"] if replay else None),
        )  # fmt: skip
    again = ", planned again on the way" if found.get("replanned") else ""
    robot = f"the robot of {found['robot']['file']}" if found.get("robot") else "other robots"
    said = [f"source: success {found['source']['success_rate']:.0%}", *_footnotes(found)]
    parts = [part for domain in found["domains"] if (part := _sensitivity(domain))]
    return Group(_title(artifact, f": {artifact.parents[0].id} on {robot}{again}"), table, "\n".join(said), *parts)


def _interval(outcome: Mapping[str, Any]) -> str:
    """The interval of a success rate, where anything is left to chance."""
    low, high = outcome["ci95"]
    return "exact" if outcome.get("deterministic") else f"{low:.0%}–{high:.0%}"


def _once(domains: Sequence[Mapping[str, Any]]) -> list[str]:
    """Of domains in which every episode would be the same."""
    once = [domain for domain in domains if domain.get("deterministic")]
    names = ", ".join(domain["name"] for domain in once)
    return [f"{names}: deterministic, one episode of each route or skill, no interval"] if once else []


def _unstable(domains: Sequence[Mapping[str, Any]]) -> list[str]:
    """Of domains in which simulations came apart."""
    told = [f"{each['name']} in {each['unstable']} of {each['episodes']} episodes" for each in domains if each.get("unstable")]
    return [f"unstable: {', '.join(told)}; the simulation came apart, no distance is counted"] if told else []


def _gave_up(domains: Sequence[Mapping[str, Any]]) -> list[str]:
    """Of domains in which episodes that were planned again ended away from their goal."""
    told = [f"{each['name']} in {each['gave_up']} of {each['episodes']} episodes" for each in domains if each.get("gave_up")]
    return [f"gave up: {', '.join(told)}; no latent that was tried led near the goal in time"] if told else []


def _footnotes(found: Mapping[str, Any]) -> list[str]:
    """Of a transfer: what `replay` is, limits that are broken, the worst episode by the name that it has in the viewer."""
    said = [*_unstable(found["domains"]), *_gave_up(found["domains"]), *_once(found["domains"])]
    if "worst" not in found["domains"][0]:
        return said
    lines = [*said, "replay: the source's commands sent blindly, median distance between where they end here and there"]
    broken = [
        f"{name}: {limit} in {count} episodes"
        for name, part in [("source", found["source"]), *((domain["name"], domain) for domain in found["domains"])]
        for limit, count in part["violations"].items()
        if count
    ]
    lines += [f"safety limits broken: {'; '.join(broken)}"] if broken else []
    ended = [(each["final_distance_m"], each["episode"] - first, name) for name, first, each in _worst(found["domains"])]
    if not ended:
        return lines
    distance, episode, name = max(ended)
    return [*lines, f"farthest off: {name} {episode}, {_centimetres(distance)}"]


def _worst(domains: Sequence[Mapping[str, Any]]) -> Iterator[tuple[str, int, Mapping[str, Any]]]:
    """The episode of each domain that ends farthest off, with the domain and the number of its first episode."""
    first = 0
    for domain in domains:
        ended = [each for each in domain["worst"] if each["final_distance_m"] is not None]
        yield from ((domain["name"], first, each) for each in ended[:1])
        first += domain["episodes"]


def _sensitivity(domain: dict[str, Any]) -> Table | None:
    """Each parameter of a domain alone."""
    if not domain.get("sensitivity"):
        return None
    table = _table(f"{domain['name']}: alone", "success", "95 %", "median")
    for row in domain["sensitivity"]:
        shown = f"{row['successes']}/{row['episodes']}", _interval(row)
        table.add_row(row["parameter"], *shown, _centimetres(row["final_distance_m"]["median"]))
    return table


SHOWN: dict[str, Callable[[Artifact], Group]] = {
    "pretrain": pretrain,
    "embed-means": means,
    "compose": plan,
    "transfer-eval": transfer,
}
