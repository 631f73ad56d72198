"""What a stage found out, as a table for a person."""

from __future__ import annotations

from collections.abc import Callable

from rich.console import Group
from rich.table import Table

from skillcli.store import Artifact


def _centimetres(metres: float | None) -> str:
    return "–" if metres is None else f"{100 * metres:.1f} cm"


def _table(*columns: str) -> Table:
    table = Table()
    for index, column in enumerate(columns):
        table.add_column(column, justify="left" if index == 0 else "right")
    return table


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
    return Group(f"[bold]{artifact.id}[/]", table, caption)


def means(artifact: Artifact) -> Group:
    """Every skill's mean latent."""
    table = _table("skill", "mean latent", "std", "at the mean")
    for skill in artifact.results["skills"]:
        mean, std = (" ".join(f"{x:5.2f}" for x in skill[key]) for key in ("mean", "std"))
        table.add_row(skill["name"], mean, std, _centimetres(skill["final_distance_m"]))
    efficiency, r = artifact.results["efficiency"], artifact.results["latent_goal_correlation"]
    shown = ["–" if number is None else f"{number:.3f}" for number in (efficiency, r)]
    caption = f"embedding efficiency {shown[0]} (lower is better separated), latent against goal distances r = {shown[1]}"
    return Group(f"[bold]{artifact.id}[/]", table, caption, *_between(artifact))


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
    ends = f"ends {_centimetres(found['final_distance_m'])} from the last goal"
    if found["routes"] > 1:
        met, ends = f"{round(found['success_rate'] * found['routes'])} of {found['routes']} routes succeed", f"the worst {ends}"
        steps = "; ".join(
            " ".join(f"{each['skill']}:{each['seconds']:.2f}s" for each in found["segments"] if each["route"] == route)
            for route in range(found["routes"])
        )
    effort = f"planned in {artifact.measured['planning_seconds']:.1f} s, {found['expanded_nodes']} nodes"
    caption = f"{met}, {ends}; {effort}\nplan {steps}"
    return Group(f"[bold]{artifact.id}[/]: {found['method']}, {found['task']}", table, caption)


def transfer(artifact: Artifact) -> Group:
    """Every domain of a transfer."""
    table = _table("domain", "success", "95 %", "median", "p90", "retention")
    for domain in artifact.results["domains"]:
        low, high = domain["ci95"]
        distance, retention = domain["final_distance_m"], domain["retention"]
        table.add_row(
            domain["name"], f"{domain['successes']}/{domain['episodes']}", f"{low:.0%}–{high:.0%}",
            _centimetres(distance["median"]), _centimetres(distance["p90"]), "–" if retention is None else f"{retention:.2f}",
        )  # fmt: skip
    caption = f"source: success {artifact.results['source']['success_rate']:.0%}"
    return Group(f"[bold]{artifact.id}[/]: {artifact.parents[0].id} on other robots", table, caption)


SHOWN: dict[str, Callable[[Artifact], Group]] = {
    "pretrain": pretrain,
    "embed-means": means,
    "compose": plan,
    "transfer-eval": transfer,
}
