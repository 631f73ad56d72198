"""The command `skill sweep`."""

from __future__ import annotations

import re
import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Annotated, Any

import typer
from typer.core import TyperCommand

from skillcli.cli import typed
from skillcli.cli.session import Session
from skillcli.cli.stages import checked
from skillcli.errors import UsageError

if TYPE_CHECKING:
    from skillcli.cli.sweep_view import SweepView
    from skillcli.sweeps.axes import Axis, Setting
    from skillcli.sweeps.plan import SweepPlan
    from skillcli.sweeps.run import Backend
    from skillcli.sweeps.search import Search


def register(app: typer.Typer) -> None:
    """Add the command to the app."""
    app.command(rich_help_panel="Many runs", cls=WithRay)(sweep)


class WithRay(TyperCommand):
    """Takes `--ray` with and without an address."""

    def parse_args(self, ctx: Any, args: list[str]) -> Any:
        """See typer; what follows `--ray` is an address only if it looks like one."""
        words = list[str]()
        for word, following in zip(args, [*args[1:], ""], strict=True):
            address = re.fullmatch(r"auto|local|[\w.-]+:\d+", following, re.ASCII)
            words.append("--ray=local" if word == "--ray" and not address else word)
        return super().parse_args(ctx, words)


def sweep(
    context: typer.Context,
    recipe: Annotated[str, typer.Argument(help="Recipe by name, or a .toml file.")],
    seeds: Annotated[str, typer.Option("--seeds", help="Seeds of every setting.", metavar="A-B or A,B,…")] = "0-9",
    overrides: Annotated[
        list[str] | None,
        typer.Option(
            "--set",
            help="Values of a key, such as training.iterations=20,40; with --random also LOW..HIGH and LOW..HIGH:log.",
            metavar="KEY=A,B,…",
        ),
    ] = None,
    grid: Annotated[bool, typer.Option("--grid", help="Combine every value with every other (what happens anyway).")] = False,
    random: Annotated[int | None, typer.Option("--random", help="Draw so many settings.", min=1, metavar="N")] = None,
    through: Annotated[str, typer.Option("--through", help="The last stage of every cell.", metavar="STAGE")] = "pretrain",
    name: Annotated[str | None, typer.Option("--name", help="First part of all new ids.", metavar="NAME")] = None,
    jobs: Annotated[
        int, typer.Option("--jobs", help="Cells at a time, 0 for as many as cores; they share the cores.", min=0, max=1024)
    ] = 0,
    ray: Annotated[
        str, typer.Option("--ray", help="Run on Ray: here, or on the cluster at this address.", metavar="[ADDRESS]")
    ] = "",
    optuna: Annotated[
        int | None, typer.Option("--optuna", help="Search: try so many settings, proposed by Optuna.", min=1, metavar="N")
    ] = None,
    metric: Annotated[
        str | None, typer.Option("--metric", help="What --optuna optimises; success_rate by default.", metavar="NAME")
    ] = None,
) -> None:
    """Run a recipe with many seeds and settings; every cell is an ordinary artifact, and finished ones are used again."""
    from skillcli.cli.sweep_view import SweepView, listed, table
    from skillcli.recipe import load_recipe
    from skillcli.stages.sweep import sweep as stage
    from skillcli.sweeps.axes import axis
    from skillcli.sweeps.axes import seeds as read_seeds
    from skillcli.sweeps.cell import DONE, FAILED
    from skillcli.sweeps.local import available_cores
    from skillcli.sweeps.plan import SweepPlan

    began, session = time.monotonic(), context.obj
    given = [word for word, value in (("--grid", grid), ("--random", random)) if value]
    if optuna and given:
        raise UsageError("--optuna chooses the settings itself", f"leave out {' and '.join(given)}")
    if optuna and ray:
        raise UsageError("--optuna runs on this machine only, in processes of its own", "leave out --ray")
    if metric is not None and not optuna:
        raise UsageError("--metric goes with --optuna", "give --optuna N, or `skill compare ID --metric NAME` afterwards")
    folder, axes = checked(name) or load_recipe(recipe).name, [axis(text) for text in overrides or ()]
    told = frozenset(each.key for each in axes if each.varies) if optuna else None
    settings = [()] if optuna else _settings(axes, grid, random)
    plan = SweepPlan(recipe, tuple(settings), tuple(read_seeds(seeds)), folder, through, told)
    search = _search(session, plan, axes, optuna, metric or "success_rate") if optuna else None
    at_a_time = jobs or len(available_cores())
    counted = plan if search is None else search
    view = SweepView(len(counted), counted.label, at_a_time)
    with _shown(session, view):
        artifact, outcomes = stage(
            session.store,
            plan,
            session.command,
            at_a_time,
            _backend(ray),
            "ray" if ray else "local",
            search,
            on_outcome=view.concluded,
            on_beat=view.beating,
        )
    for failure in view.failures:
        session.say(failure, "red")
    best, text = _best(search) if search else (None, "")
    reused, done = sum(outcome.reused for outcome in outcomes), any(outcome.state == DONE for outcome in outcomes)
    payload = {
        "id": str(artifact.id),
        "cells": listed(search.plan if search else plan, outcomes),
        "failed": sum(outcome.state == FAILED for outcome in outcomes),
        "reused": reused,
        "wall_seconds": time.monotonic() - began,
        **({"best": best} if search else {}),
    }
    proposed = [typed.runnable(f"next: skill compare {artifact.id}")] if done else []
    session.result(payload, table(artifact, reused), *([text] if text else []), *proposed)


def _search(session: Session, base: SweepPlan, axes: list[Axis], trials: int, metric: str) -> Search:
    from skillcli.evaluation.run_metrics import higher_is_better, metric_names
    from skillcli.recipe import load_recipe
    from skillcli.simulation.domains import find_domain
    from skillcli.sweeps.plan import THROUGH
    from skillcli.sweeps.search import Search

    stages = THROUGH[: THROUGH.index(base.through) + 1]
    known = metric_names(stages, [find_domain(domain).name for domain in load_recipe(base.recipe).transfer.domains])
    if metric not in known and not any(axis.key == "transfer.domains" for axis in axes):
        raise UsageError(
            f"--metric {metric!r}: a run through {base.through} has none of that name", f"one of {', '.join(known)}"
        )
    return Search(base, axes, trials, metric, higher_is_better(metric), session.root)


def _best(search: Search) -> tuple[dict[str, Any] | None, str]:
    """Return the best trial for --json, and its recipe as TOML."""
    from skillcli.sweeps.cell import setting_label
    from skillcli.viz.report.write import as_toml

    if (found := search.best()) is None:
        return None, "no trial was finished: there is no best recipe"
    setting, value = found
    toml = as_toml(search.base.resolved(setting).model_dump(mode="json"))
    told = f"# {search.metric} {value:.4g}, mean of {len(search.base.seeds)} seeds: {setting_label(setting)}"
    return {"settings": dict(setting), "value": value, "toml": toml}, f"{told}\n{toml}"


def _settings(axes: list[Axis], as_grid: bool, random: int | None) -> list[Setting]:
    from skillcli.sweeps.axes import drawn, grid

    if as_grid and random:
        raise UsageError("--grid runs every setting, --random draws some", "leave one of them out")
    return drawn(axes, random) if random else grid(axes)


def _backend(ray: str) -> Backend:
    """Return what runs the cells."""
    from skillcli.sweeps.run import run_locally

    if not ray:
        return run_locally
    from functools import partial

    from skillcli.evaluation.consistency import check_meaning
    from skillcli.sweeps.on_ray import run_on_ray

    return partial(run_on_ray, ray, check_meaning)


@contextmanager
def _shown(session: Session, view: SweepView) -> Iterator[None]:
    """Show the live table on a terminal; elsewhere nothing: failures are said at the end."""
    console = session.err
    if session.quiet or session.json or not console.is_terminal or console.is_dumb_terminal:
        yield
        return
    from rich.live import Live

    with Live(get_renderable=view.render, console=console, refresh_per_second=4, transient=True):
        yield
