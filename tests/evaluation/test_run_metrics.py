"""The names of metrics that runs are compared by."""

from __future__ import annotations

from pathlib import Path

from command import CHAIN

from skillcli.evaluation.run_metrics import last_success, metric_names, metrics_of
from skillcli.kinds import TRANSFER_EVAL
from skillcli.store import ArtifactId, Store


def test_every_metric_of_a_run_is_known_before_it_runs(chain: Path, push_chain: Path) -> None:
    for folder, name in ((chain, "tiny"), (push_chain, "pushed")):
        run = [Store(folder).read(ArtifactId(name, stage, 1)) for stage in CHAIN]
        domains = [domain.name for domain in TRANSFER_EVAL.results_of(run[-1]).domains]
        found = metrics_of(run).keys()
        known = set(metric_names(CHAIN, domains))
        assert found <= known and known - found <= {"randomised.success_rate", "compose.predicted.success_rate"}
        assert not any(one.startswith("compose.") for one in metric_names(CHAIN[:2], domains))


def test_the_success_of_a_run_is_that_of_its_last_stage_that_has_one() -> None:
    domains = ["mild", "hard"]
    for count, shown in (
        (1, ["success_rate"]),
        (2, ["success_rate"]),  # the means are not judged
        (3, ["compose.success_rate"]),
        (4, ["transfer-eval.mild.success_rate", "transfer-eval.hard.success_rate"]),
    ):
        assert last_success(metric_names(CHAIN[:count], domains)) == shown
    assert last_success([]) == []
