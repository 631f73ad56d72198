"""The part of the report about many runs: the settings of each sweep compared."""

from __future__ import annotations

from collections.abc import Sequence

from skillcli.errors import SkillError
from skillcli.evaluation.run_comparison import MetricResult, compare, learning_of, sentence
from skillcli.evaluation.run_groups import groups_of
from skillcli.store import Artifact, Store
from skillcli.viz.figure_style import encoded, styled
from skillcli.viz.formats import FORMATS
from skillcli.viz.report.content import ComparedGroup, ComparedMetric, Comparison, Missing, ReportFigure
from skillcli.viz.report.selection import MOST_SWEEPS
from skillcli.viz.run_figure import draw_comparison

MOST_METRICS = 6  # of one sweep
MOST_PAIRS = 12  # told of one metric
RUN_SLUGS = frozenset(f"runs-{number + 1}" for number in range(MOST_SWEEPS))


def compare_sweeps(store: Store, sweeps: Sequence[Artifact]) -> tuple[list[Comparison], list[Missing]]:
    """Compare the settings of each sweep, and say which ones cannot be."""
    found: list[Comparison] = []
    missing: list[Missing] = []
    for sweep in sweeps:
        try:
            found.append(_comparison(store, sweep, f"runs-{len(found) + 1}"))
        except SkillError as error:
            missing.append(Missing(f"comparison of {sweep.id}", error.message))
    return found, missing


def _comparison(store: Store, sweep: Artifact, slug: str) -> Comparison:
    groups = groups_of(store, [sweep.id])
    results = compare(groups)
    with styled():
        drawn = draw_comparison(results[0], learning_of(store, groups))
        files = {suffix: encoded(drawn, suffix) for suffix in FORMATS}
    caption = (
        f"Of {results[0].name}: interquartile means, performance profiles, success over control steps of training, and the "
        "probability that a run of the first setting is better than one of the second."
    )
    figure = ReportFigure(slug, "", f"Settings of {sweep.id.name} compared", caption, [str(sweep.id)], files)
    return Comparison(str(sweep.id), [_metric(result) for result in results[:MOST_METRICS]], figure)


def _metric(result: MetricResult) -> ComparedMetric:
    groups = [ComparedGroup(group.label, group.n, f"{group.iqm.value:.4g}", group.interval) for group in result.groups]
    return ComparedMetric(result.name, groups, [sentence(pair) for pair in result.pairs[:MOST_PAIRS]])
