"""Commands that show the store and single artifacts: ls, show, verify, rm, pin, unpin."""

from __future__ import annotations

from collections import Counter
from typing import TYPE_CHECKING, Annotated, Any

import typer

from skillcli.cli import complete
from skillcli.cli.remote import list_remote
from skillcli.cli.session import Session
from skillcli.errors import UsageError

if TYPE_CHECKING:
    from rich.console import RenderableType

    from skillcli.store import Artifact, ArtifactId, Header, Listing

Id = Annotated[
    str | None,
    typer.Argument(
        metavar="[ID]",
        help="Id, NAME/STAGE or a unique prefix; by default the newest that fits.",
        autocompletion=complete.ids,
    ),
]
FullId = Annotated[str, typer.Argument(metavar="ID", help="A full id.", autocompletion=complete.ids)]


LONG = 200  # rows; longer listings are printed without a frame
_COLUMNS = ("id", "made (UTC)", "recipe", "seed", "kB", "note")
_LESSER = ("recipe", "kB", "seed", "note", "made (UTC)")  # left out first if there is little room


def register(app: typer.Typer) -> None:
    """Add the commands to the app."""
    panel = "Store"
    app.command("ls", rich_help_panel=panel)(list_artifacts)
    app.command(rich_help_panel=panel)(show)
    app.command(rich_help_panel=panel)(verify)
    app.command("rm", rich_help_panel=panel)(remove)
    app.command(rich_help_panel=panel)(pin)
    app.command(rich_help_panel=panel)(unpin)


def list_artifacts(
    context: typer.Context,
    kind: Annotated[str, typer.Option("--kind", help="Only this kind.", metavar="STAGE")] = "",
    name: Annotated[str, typer.Option("--name", help="Only these names; * is any.", metavar="PATTERN")] = "*",
    recipe: Annotated[str, typer.Option("--recipe", help="Only from these recipes; * is any.", metavar="PATTERN")] = "*",
    since: Annotated[str, typer.Option("--since", help="Only made at or after this (UTC).", metavar="DATE[THH:MM]")] = "",
    before: Annotated[str, typer.Option("--before", help="Only made before this (UTC).", metavar="DATE[THH:MM]")] = "",
    remote: Annotated[
        str, typer.Option("--remote", help="List this shared store instead, and what of it is here.", metavar="REMOTE")
    ] = "",
    cells: Annotated[
        bool, typer.Option("--cells", help="Also list the cells of sweeps, as --kind, --name and --json do anyway.")
    ] = False,
) -> None:
    """List the artifacts, the newest last; a sweep with all its cells is one row."""
    from fnmatch import fnmatchcase

    from skillcli.kinds import KINDS, SWEEP

    if kind and kind not in KINDS:
        raise UsageError(f"no kind {kind!r}", f"kinds: {', '.join(KINDS)}")
    first, last = _instant("--since", since), _instant("--before", before)
    session: Session = context.obj
    if remote:
        if recipe != "*":
            raise UsageError("--recipe and --remote do not go together", "a shared store is listed without reading artifacts")
        list_remote(session, remote, kind, name, lambda made: (not first or made >= first) and (not last or made < last))
        return
    found = session.filled.listing()
    chosen = [
        header
        for header in found.headers
        if (not kind or header.kind == kind)
        and fnmatchcase(header.id.name, name)
        and fnmatchcase(header.recipe_name, recipe)
        and (not first or header.created_utc >= first)
        and (not last or header.created_utc < last)
    ]
    for broken in found.unreadable:
        session.say(f"{broken.id}: {broken.problem}", "red")
    sweeps = frozenset(header.id.name for header in found.headers if SWEEP.name == header.kind)
    _print_listing(session, found._replace(headers=chosen), sweeps, fold=not (cells or kind or name != "*"))


def _print_listing(session: Session, found: Listing, sweeps: frozenset[str], fold: bool) -> None:
    from skillcli.kinds import SWEEP
    from skillcli.sweeps.cell import sweep_of

    pinned = session.store.pinned()
    member = {header.id.name: "" for header in found.headers}
    member = {name: sweep_of(name, sweeps) for name in member} if sweeps else member
    if session.json:
        listed = [{**_entry(header, header.id in pinned), "sweep": member[header.id.name] or None} for header in found.headers]
        unreadable = [{"id": str(broken.id), "problem": broken.problem} for broken in found.unreadable]
        session.result({"artifacts": listed, "unreadable": unreadable})
        return
    folded = Counter(sweep for header in found.headers if fold and (sweep := member[header.id.name]))
    last = {header.id.name: header.id for header in found.headers if header.kind == SWEEP.name}
    rows = [
        _row(header, header.id in pinned, folded[header.id.name] if last.get(header.id.name) == header.id else 0)
        for header in found.headers
        if not (fold and member[header.id.name] in last)
    ]
    session.result({}, plain_table(_COLUMNS, rows) if len(rows) > LONG else _table(rows, session.out.width))


def _row(header: Header, pinned: bool, folded: int) -> tuple[str, ...]:
    made = header.created_utc[:16].replace("T", " ")
    notes = ["pinned"] * pinned + [f"{folded} artifacts of its cells"] * bool(folded) + _schema_note(header)
    return str(header.id), made, header.recipe_name, str(header.seed), f"{header.bytes / 1e3:,.0f}", ", ".join(notes)


def _table(rows: list[tuple[str, ...]], width: int) -> RenderableType:
    """Make the listing in a frame; on a narrow terminal without the less important columns."""
    from rich.table import Table

    shown = list(range(len(_COLUMNS)))
    room = [max(map(len, cells)) + 3 for cells in zip(_COLUMNS, *rows, strict=True)]  # including the frame
    for column in map(_COLUMNS.index, _LESSER):
        if 1 + sum(room[index] for index in shown) > width:
            shown.remove(column)
    table = Table()
    for index in shown:  # an id is never cut, so that it can be copied
        table.add_column(_COLUMNS[index], no_wrap=True, overflow="fold")
    for row in rows:
        table.add_row(*(row[index] for index in shown))
    return table


def plain_table(columns: tuple[str, ...], rows: list[tuple[str, ...]]) -> RenderableType:
    """Align columns without a frame, which is fast for thousands of rows."""
    from rich.control import strip_control_codes
    from rich.segment import Segment, Segments

    widths = [max(map(len, cells)) for cells in zip(columns, *rows, strict=True)]
    lines = ("  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip() for row in (columns, *rows))
    return Segments([Segment(f"{strip_control_codes(line)}\n") for line in lines])  # `Text` would search for places to wrap


def _entry(header: Header, pinned: bool) -> dict[str, Any]:
    return {
        "id": str(header.id),
        "kind": header.kind,
        "created_utc": header.created_utc,
        "bytes": header.bytes,
        "parents": [str(parent.id) for parent in header.parents],
        "recipe": header.recipe_name,
        "seed": header.seed,
        "schema_version": header.schema_version,
        "pinned": pinned,
    }


def _schema_note(header: Header) -> list[str]:
    from skillcli.kinds import kind_spec

    ours = kind_spec(header.kind).version
    if header.schema_version == ours:
        return []
    return [f"schema {header.schema_version}: {'migrate' if header.schema_version < ours else 'newer skill'}"]


def _instant(option: str, text: str) -> str:
    """Convert a date or time to the format of artifacts, which compares as text; "" if none is given."""
    from datetime import UTC, datetime

    if not text:
        return ""
    try:
        found = datetime.fromisoformat(text)
    except ValueError:
        raise UsageError(f"{option} {text!r} is not a date", "for example 2026-11-22 or 2026-11-22T15:00") from None
    return found.replace(tzinfo=found.tzinfo or UTC).astimezone(UTC).isoformat(timespec="microseconds")


def show(context: typer.Context, source: Id = None) -> None:
    """Show one artifact: its origin, results, curves and ancestors."""
    session: Session = context.obj
    store = session.store
    artifact = store.read(session.pick(source))
    payload: dict[str, Any] = {
        "id": str(artifact.id),
        "kind": artifact.kind,
        "schema_version": artifact.schema_version,
        "content_sha256": artifact.content_sha256,
        "created_utc": artifact.created_utc,
        "command": artifact.command,
        "recipe": dict(artifact.recipe),
        "recipe_sha256": artifact.recipe_sha256,
        "robot": artifact.robot or None,
        "seed": artifact.seed,
        "parents": [{"id": str(parent.id), "content_sha256": parent.content_sha256} for parent in artifact.parents],
        "lineage": [str(one) for one in store.lineage(artifact.id)],
        "dependents": [str(one) for one in store.dependents(artifact.id)],
        "pinned": store.is_pinned(artifact.id),
        "packages": dict(artifact.packages),
        "git": {"commit": artifact.git_commit, "dirty": artifact.git_dirty},
        "model_sha256": artifact.model_sha256,
        "results": dict(artifact.results),
        "measured": dict(artifact.measured),
        "arrays": {path: list(array.shape) for path, array in sorted(artifact.arrays.items())},
    }
    session.result(payload, *(() if session.json else _shown(session, artifact)))


def _shown(session: Session, artifact: Artifact) -> list[Any]:
    from rich.markdown import Markdown
    from rich.pretty import Pretty

    from skillcli.cli import terminal_plots

    parts: list[Any] = [Markdown(artifact.provenance()), terminal_plots.recipe(artifact.recipe)]
    if curves := artifact.group("curves"):
        parts.append(terminal_plots.curves(curves, session.out.width))
    parts += [
        Pretty(artifact.results, max_length=12),
        Pretty(artifact.measured),
        terminal_plots.lineage(session.store, artifact.id),
    ]
    return parts


def verify(
    context: typer.Context,
    source: Id = None,
    lineage: Annotated[bool, typer.Option("--lineage", help="Also check all ancestors.")] = False,
    everything: Annotated[bool, typer.Option("--all", help="Check every artifact of the store.")] = False,
) -> None:
    """Check artifacts bit by bit: file, content, schema, values, and parents."""
    from rich.text import Text

    from skillcli.evaluation.consistency import check_meaning

    session: Session = context.obj
    store = session.filled if everything else session.store
    if everything and source:
        raise UsageError("verify takes an ID or --all, not both", "leave one of them out")
    found = None if everything else session.pick(source)
    ids = [found, *(_known(session, found) if lineage else ())] if found else []
    problems = store.verify_all(check_meaning) if everything else {one: store.verify(one, check_meaning) for one in ids}
    listed = [problem for each in problems.values() for problem in each]
    payload: dict[str, Any] = {"id": str(found) if found else None, "ok": not listed, "problems": listed}
    strangers = [path for path in store.strangers() if path.name not in _pictures()] if everything else []
    for path in strangers:
        session.say(f"no artifact: {path}", "yellow")
    if everything:
        payload["strangers"] = [str(path) for path in strangers]
    if everything or lineage:
        payload["artifacts"] = [{"id": str(one), "ok": not each, "problems": each} for one, each in problems.items()]
    if listed:
        bad = [str(one) for one, each in problems.items() if each]
        payload["error"] = {
            "type": "StoreError",
            "message": f"{', '.join(bad[:3])}{' and more' if len(bad) > 3 else ''} damaged: {listed[0]}",
            "hint": "restore it from a copy, or remove it with its children and make it again",
        }
    lines = [Text.assemble((str(one), "red"), f": {problem}") for one, each in problems.items() for problem in each]
    whole = f"{found} is intact" if len(ids) == 1 else f"{len(problems)} artifacts are intact"
    session.result(payload, *(lines or [Text(whole, "green")]))
    if listed:
        raise typer.Exit(1)


def _pictures() -> set[str]:
    """Return the names of the files that `skill run` puts beside artifacts."""
    from skillcli.kinds import COMPOSE, KINDS

    return {*(f"{kind}.png" for kind in KINDS), f"{COMPOSE.name}.rrd"}


def _known(session: Session, found: ArtifactId) -> list[ArtifactId]:
    """Return the existing ancestors as far as they are known; a missing one is a problem of its child."""
    from skillcli.errors import StoreError

    try:
        return [one for one in session.store.lineage(found) if session.store.path(one).exists()]
    except StoreError:
        return []


def remove(context: typer.Context, source: FullId) -> None:
    """Remove one artifact, unless it is pinned or has children. Its number is never given again."""
    session: Session = context.obj
    from skillcli.store import ArtifactId

    found = ArtifactId.parse(source)
    session.store.remove(found)
    session.result({"id": str(found), "removed": True}, f"removed {found}")


def pin(context: typer.Context, source: FullId) -> None:
    """Protect an artifact and all its ancestors from `gc` and `rm`."""
    _pin(context.obj, source, True)


def unpin(context: typer.Context, source: FullId) -> None:
    """End the protection of an artifact."""
    _pin(context.obj, source, False)


def _pin(session: Session, source: str, wanted: bool) -> None:
    found = session.store.resolve(source)
    session.store.pin(found, wanted)
    session.result({"id": str(found), "pinned": wanted}, f"{'pinned' if wanted else 'no longer pinned:'} {found}")
