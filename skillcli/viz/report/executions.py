"""Lines of the report about executions: pooled for each plan and arm, and beside the transfer that foresaw them."""

from __future__ import annotations

from collections.abc import Iterator

from skillcli import metrics
from skillcli.evaluation.executed import Pooled, pool
from skillcli.kinds import EXECUTION, TRANSFER_EVAL
from skillcli.kinds.transfer_eval import DomainResults
from skillcli.viz.report.content import Number, Row
from skillcli.viz.report.selection import Material

NOTE = (
    "Several executions of one plan on one arm count together; of simulated ones with the same seed only the longest does."
    " An episode that somebody interrupted is none. Distances as the arm's own sensors show them. Interval: Wilson, 95 %."
    " Two rates agree if Newcombe's interval of their difference holds zero."
)


def executed(material: Material) -> Iterator[Row]:
    """Write one line for each plan and arm: successes of episodes with the interval, distances, and how a transfer compares."""
    for found in pool(one.artifact for one in material.find(EXECUTION)):
        newest, low, high = found.used[0], *found.ci95
        text = (
            f"{found.successes} of {found.episodes} ({100 * low:.0f}–{100 * high:.0f} %), median {100 * found.median:.1f} cm,"
            f" 90 % within {100 * found.p90:.1f} cm"
        )
        key = "results" if len(found.used) == 1 else f"results, with {', '.join(str(one.id) for one in found.used[1:])}"
        yield Row(_what(found), "", Number(text, str(newest.id), key), "; ".join(_verdicts(material, found)))


def _what(found: Pooled) -> str:
    results, source = found.results, found.used[0].parents[0].id
    arm = results.driver if results.domain is None else f"{results.driver}, {results.domain}"
    several = f", {len(found.used)} executions" if len(found.used) > 1 else ""
    speed = "" if results.max_speed == 1 else f", {results.max_speed:.0%} of the speed"
    return f"{source} on {results.robot.name} ({arm}{', replanned' if results.replanned else ''}{speed}){several}"


def _verdicts(material: Material, found: Pooled) -> Iterator[str]:
    if (foreseen := _foreseen(material, found)) is not None:
        low, high = metrics.difference_interval(found.success_rate, found.ci95, foreseen.success_rate, foreseen.ci95)
        said = "agrees with" if low <= 0 <= high else "differs from"
        yield f"{said} transfer-eval: {foreseen.successes} of {foreseen.episodes}"
    if found.stopped:
        yield f"stopped: {', '.join(found.stopped)}"
    if found.repeated:
        yield f"{len(found.repeated)} of the same seed left out"


def _foreseen(material: Material, found: Pooled) -> DomainResults | None:
    """Return what a transfer of the same plan to the same domain, on the same arm, says."""
    results, plan = found.results, found.used[0].parents[0].content_sha256
    if results.domain is None or results.max_speed < 1:
        return None
    own = EXECUTION.measured_of(found.used[0]).robot_file is None  # the arm of the skills
    for one in material.find(TRANSFER_EVAL):
        transfer = TRANSFER_EVAL.results_of(one.artifact)
        same_arm = own if transfer.robot is None else transfer.robot.fingerprint == results.robot.fingerprint
        if same_arm and transfer.replanned == results.replanned and one.artifact.parents[0].content_sha256 == plan:
            for domain in transfer.domains:
                if domain.name == results.domain:
                    return domain
    return None
