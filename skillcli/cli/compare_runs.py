"""The command `skill compare`."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from skillcli.cli import complete
from skillcli.cli.session import Session

if TYPE_CHECKING:
    from rich.table import Table

    from skillcli.evaluation.run_comparison import Efficiency, MetricResult


def register(app: typer.Typer) -> None:
    """Add the command to the app."""
    app.command(rich_help_panel="Many runs")(compare)


def compare(
    context: typer.Context,
    sources: Annotated[
        list[str],
        typer.Argument(
            metavar="ID...",
            help="Sweeps, or single artifacts of one kind, which are grouped by recipe; unique prefixes will do.",
            autocompletion=complete.ids,
        ),
    ],
    metric: Annotated[str, typer.Option("--metric", help="Only this one; all by default.", metavar="NAME")] = "",
    png: Annotated[
        Path | None, typer.Option("--png", help="Also draw the first metric: intervals, profiles, curves.", metavar="FILE")
    ] = None,
) -> None:
    """Compare groups of runs: interquartile means with intervals, and which groups are better than which."""
    from rich.text import Text

    from skillcli.evaluation import run_comparison
    from skillcli.evaluation.run_comparison import sentence
    from skillcli.evaluation.run_groups import groups_of, shared_runs
    from skillcli.evaluation.run_metrics import METRICS
    from skillcli.kinds import SWEEP

    session: Session = context.obj
    store = session.store
    groups = groups_of(store, [store.resolve(source, (SWEEP.name, *METRICS)) for source in sources])
    results = run_comparison.compare(groups, metric)
    curves = run_comparison.learning_of(store, groups)
    if png:
        from skillcli.viz.run_figure import write_figure

        write_figure(results[0], curves, png)
    payload = {
        "metrics": [_metric(result) for result in results],
        "sample_efficiency": [_curve(curve) for curve in curves],
        "shared_runs": (shared := shared_runs(groups)),
        "png": str(png) if png else None,
    }
    warned = [f"the groups share runs ({shared}), so they are not independent"] if shared else []
    shown = [part for result in results for part in (table(result), Text("\n".join(map(sentence, result.pairs))))]
    session.result(payload, *shown, *warned, *([f"figure: {png}"] if png else []))


def table(result: MetricResult) -> Table:
    """Show every group of a metric."""
    from rich.table import Table

    better = "higher" if result.higher_is_better else "lower"
    rows = Table(f"{result.name} ({better} is better)", "n", "IQM", "95 %", "mean")
    for column in rows.columns[1:]:
        column.justify = "right"
    for group in result.groups:
        rows.add_row(group.label, str(group.n), f"{group.iqm.value:.4g}", group.interval, f"{group.mean:.4g}")
    return rows


def _metric(result: MetricResult) -> dict[str, Any]:
    return {
        "name": result.name,
        "higher_is_better": result.higher_is_better,
        "groups": [
            {
                "label": group.label,
                "n": group.n,
                "iqm": group.iqm.value,
                "ci95": [group.iqm.low, group.iqm.high],
                "mean": group.mean,
                "profile": {
                    "share": group.profile[0].tolist(),
                    "low": group.profile[1].tolist(),
                    "high": group.profile[2].tolist(),
                },
            }
            for group in result.groups
        ],
        "thresholds": result.thresholds.tolist(),
        "probability_of_improvement": [
            {
                "first": pair.first,
                "second": pair.second,
                "n": list(pair.n),
                "pairs": pair.paired,
                "probability": pair.probability,
                "ci95": list(pair.ci95),
                "p": pair.p,
                "verdict": pair.verdict,
                "needed": pair.needed,
            }
            for pair in result.pairs
        ],
    }


def _curve(curve: Efficiency) -> dict[str, Any]:
    return {
        "label": curve.label,
        "env_steps": curve.steps.tolist(),
        "iqm": curve.iqm.tolist(),
        "low": curve.low.tolist(),
        "high": curve.high.tolist(),
        "n": curve.n.tolist(),
    }
