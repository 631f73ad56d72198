"""The command `skill report`."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from skillcli.cli import complete
from skillcli.cli.session import Session

if TYPE_CHECKING:
    from skillcli.viz.report.write import Reported


def register(app: typer.Typer) -> None:
    """Add the command to the app."""
    app.command(rich_help_panel="Look")(report)


def report(
    context: typer.Context,
    sources: Annotated[
        list[str] | None,
        typer.Argument(
            metavar="[ID]...",
            help="Ids, NAME/STAGE or unique prefixes; by default the newest of every name and kind.",
            autocompletion=complete.ids,
        ),
    ] = None,
    output: Annotated[Path, typer.Option("-o", "--output", help="The page.", metavar="FILE.html")] = Path("report.html"),
) -> None:
    """Write one HTML page with the paper's figures and tables from these artifacts, and the figures as PDF and PNG."""
    session: Session = context.obj
    store = session.store
    found = [store.resolve(source) for source in sources or ()]
    from skillcli.viz.report.write import report as stage

    done = stage(store, found, output)
    for skipped in done.page.skipped:
        session.say(f"not used: {skipped.what}: {skipped.reason}")
    for missing in done.page.not_drawn:
        session.say(f"not drawn: {missing.what}: {missing.reason}")
    for row in done.page.todo:
        session.say(f"no number: {row.what}: `{row.todo}` gives it")
    size = done.html.stat().st_size / 1e6
    drawn = len(done.page.figures) + len(done.page.comparisons)
    counted = f"{drawn} figures, also in {done.folder}; {len(done.page.origins)} artifacts"
    session.result(_payload(done), f"{done.html} ({size:.1f} MB): {counted}")


def _payload(done: Reported) -> dict[str, Any]:
    figures = [*done.page.figures, *(comparison.figure for comparison in done.page.comparisons)]
    return {
        "html": str(done.html),
        "figures": [
            {
                "paper_figure": figure.paper_figure,
                "title": figure.title,
                "file": str(done.folder / f"{figure.slug}.pdf"),
                "png": str(done.folder / f"{figure.slug}.png"),
                "artifacts": list(figure.artifacts),
            }
            for figure in figures
        ],
        "artifacts": [origin.id for origin in done.page.origins],
        "not_drawn": [{"figure": missing.what, "reason": missing.reason} for missing in done.page.not_drawn],
        "no_number": [{"what": row.what, "command": row.todo} for row in done.page.todo],
        "skipped": [{"id": skipped.what, "reason": skipped.reason} for skipped in done.page.skipped],
    }
