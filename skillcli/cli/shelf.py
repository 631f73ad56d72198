"""Commands on the store: ls, show, verify and rm."""

from __future__ import annotations

from typing import Annotated, Any

import typer

from skillcli.cli.learn import MADE_FROM
from skillcli.cli.session import Session

Id = Annotated[str | None, typer.Argument(metavar="[ID]", help=MADE_FROM)]


def register(app: typer.Typer) -> None:
    """Add the commands to the app."""
    panel = "Store"
    app.command("ls", rich_help_panel=panel)(list_artifacts)
    app.command(rich_help_panel=panel)(show)
    app.command(rich_help_panel=panel)(verify)
    app.command("rm", rich_help_panel=panel)(remove)


def list_artifacts(context: typer.Context) -> None:
    """List the artifacts, the newest last."""
    from rich.table import Table

    session: Session = context.obj
    found = session.store.listing()
    table = Table()
    for column in ("id", "made (UTC)", "recipe", "seed", "kB"):  # an id is never cut: it is there to be copied
        table.add_column(column, no_wrap=True, overflow="fold")
    for header in found.headers:
        made = header.created_utc[:16].replace("T", " ")
        table.add_row(str(header.id), made, header.recipe_name, str(header.seed), f"{header.bytes / 1e3:,.0f}")
    for broken in found.unreadable:
        session.say(f"[red]{broken.id}[/]: {broken.problem}")
    session.result(
        {
            "artifacts": [
                {
                    "id": str(header.id),
                    "kind": header.kind,
                    "created_utc": header.created_utc,
                    "bytes": header.bytes,
                    "parents": [str(parent.id) for parent in header.parents],
                    "recipe": header.recipe_name,
                    "seed": header.seed,
                }
                for header in found.headers
            ],
            "unreadable": [{"id": str(broken.id), "problem": broken.problem} for broken in found.unreadable],
        },
        table,
    )


def show(context: typer.Context, source: Id = None) -> None:
    """Show one artifact: where it comes from and what it found out."""
    from rich.markdown import Markdown
    from rich.pretty import Pretty

    session: Session = context.obj
    artifact = session.store.read(session.pick(source))
    parents = [{"id": str(parent.id), "content_sha256": parent.content_sha256} for parent in artifact.parents]
    payload: dict[str, Any] = {
        "id": str(artifact.id),
        "kind": artifact.kind,
        "content_sha256": artifact.content_sha256,
        "created_utc": artifact.created_utc,
        "command": artifact.command,
        "recipe": dict(artifact.recipe),
        "recipe_sha256": artifact.recipe_sha256,
        "seed": artifact.seed,
        "parents": parents,
        "packages": dict(artifact.packages),
        "git": {"commit": artifact.git_commit, "dirty": artifact.git_dirty},
        "model_sha256": artifact.model_sha256,
        "results": dict(artifact.results),
        "measured": dict(artifact.measured),
        "arrays": {path: list(array.shape) for path, array in sorted(artifact.arrays.items())},
    }
    session.result(payload, Markdown(artifact.provenance()), Pretty(artifact.results, max_length=12), Pretty(artifact.measured))


def verify(context: typer.Context, source: Id = None) -> None:
    """Check one artifact bit by bit: file, content, schema and parents."""
    session: Session = context.obj
    found = session.pick(source)
    problems = session.store.verify(found)
    payload: dict[str, Any] = {"id": str(found), "ok": not problems, "problems": problems}
    if problems:
        hint = "restore it from a copy, or remove it with what was made from it and make it anew"
        payload["error"] = {"type": "StoreError", "message": f"{found} is damaged: {problems[0]}", "hint": hint}
    whole = f"[green]{found} is whole[/]"
    session.result(payload, *([f"[red]{found}[/]: {problem}" for problem in problems] or [whole]))
    if problems:
        raise typer.Exit(1)


def remove(context: typer.Context, source: Annotated[str, typer.Argument(metavar="ID", help="A full id.")]) -> None:
    """Remove one artifact; refused while another one was made from it. Its number is never given again."""
    session: Session = context.obj
    from skillcli.store import ArtifactId

    found = ArtifactId.parse(source)
    session.store.remove(found)
    session.result({"id": str(found), "removed": True}, f"removed {found}")
