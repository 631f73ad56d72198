"""Commands about a shared store: upload, download, and the listing of `ls --remote`."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from fnmatch import fnmatchcase
from typing import TYPE_CHECKING, Annotated, Any

import typer

from skillcli.cli import complete
from skillcli.cli.session import Session
from skillcli.errors import Interrupted

if TYPE_CHECKING:
    from skillcli.store import ArtifactId, Transfer
    from skillcli.store.remote_index import Catalog, Entry

Remote = Annotated[
    str, typer.Argument(metavar="REMOTE", help="Address of the shared store: file://, s3://, gs://, sftp:// or hf://.")
]
Ids = Annotated[
    list[str], typer.Argument(metavar="ID", help="Ids, NAME/STAGE or unique prefixes.", autocompletion=complete.ids)
]
TheirIds = Annotated[list[str], typer.Argument(metavar="ID", help="Ids there, NAME/STAGE or unique prefixes.")]

_COLUMNS = ("id", "made (UTC)", "kB", "here")


def register(app: typer.Typer) -> None:
    """Add the commands to the app."""
    panel = "Store"
    app.command(rich_help_panel=panel)(upload)
    app.command(rich_help_panel=panel)(download)


def upload(context: typer.Context, remote: Remote, ids: Ids) -> None:
    """Copy artifacts with all their ancestors to a shared store, and read back what was sent; a sweep takes its cells along.

    Nothing is overwritten there: an artifact whose id other content has gets the next free version.
    """
    from skillcli.store import open_remote
    from skillcli.store import upload as send

    session: Session = context.obj
    chosen = [session.filled.resolve(text) for text in ids]
    wanted = _contents(session, chosen)
    held: dict[str, ArtifactId] = {}
    for header in session.store.headers() if wanted else ():
        held.setdefault(header.content_sha256, header.id)
    cells = [held[content] for content in wanted if content in held]
    with _resumable("upload"), session.progress() as on_progress:
        files = open_remote(remote)
        done = send(session.store, files, [*cells, *chosen], on_progress)
    session.result(*_transfer(done, files.address, "there"), *_gone(len(wanted) - len(cells), "here"))


def download(context: typer.Context, remote: Remote, ids: TheirIds) -> None:
    """Copy artifacts with all their ancestors from a shared store, each checked first; a sweep takes its cells along.

    Nothing is overwritten here: an artifact whose id other content has gets the next free version.
    """
    from skillcli.evaluation.consistency import check_meaning
    from skillcli.store import download as fetch
    from skillcli.store import open_remote
    from skillcli.store.remote_index import Catalog

    session: Session = context.obj
    with _resumable("download"), session.progress() as on_progress:
        files = open_remote(remote)
        done = fetch(session.store, files, ids, check_meaning, on_progress)
        wanted = _contents(session, [done.renamed.get(one, one) for one in (*done.transferred, *done.skipped)])
        held = {entry.content_sha256: str(entry.id) for entry in Catalog.of(files).entries} if wanted else {}
        cells = [held[content] for content in wanted if content in held]
        if cells:
            done.join(fetch(session.store, files, cells, check_meaning, on_progress))
    session.result(*_transfer(done, files.address, "here"), *_gone(len(wanted) - len(cells), "there"))


def _contents(session: Session, ids: list[ArtifactId]) -> list[str]:
    """Return the content hashes of the finished cells of those ids that are sweeps, each once."""
    from skillcli.kinds import SWEEP
    from skillcli.kinds.sweep import DONE, sha_text

    found = dict[str, None]()
    for one in ids:
        if one.stage == SWEEP.name:
            arrays = session.store.read(one).arrays
            found |= dict.fromkeys(sha_text(words) for words in arrays["cells/content"][arrays["cells/state"] == DONE])
    return list(found)


def _gone(count: int, side: str) -> list[str]:
    """Say how many cells could not go along."""
    again = "run the sweep again to make them anew" if side == "here" else "upload the sweep again from a store that has them"
    return [f"cells of the sweep that were not sent, since they are not {side}: {count}; {again}"] if count else []


@contextmanager
def _resumable(command: str) -> Iterator[None]:
    try:
        yield
    except KeyboardInterrupt:
        raise Interrupted("interrupted", f"what was transferred is whole and kept: `skill {command}` again goes on") from None


def _transfer(done: Transfer, address: str, side: str) -> tuple[Any, ...]:
    payload = {
        "remote": address,
        "transferred": [str(one) for one in done.transferred],
        "skipped": [str(one) for one in done.skipped],
        "renamed": {str(one): str(other) for one, other in done.renamed.items()},
        "bytes": done.bytes,
    }
    renamed = [f"{one} is {other} {side}, where other content has that id" for one, other in done.renamed.items()]
    named = [f"transferred: {one}" for one in done.transferred] + [f"already {side}: {one}" for one in done.skipped]
    counts = f"{len(done.transferred)} transferred ({done.bytes / 1e6:.1f} MB), {len(done.skipped)} already {side}"
    return payload, *named, *renamed, counts


def list_remote(session: Session, remote: str, kind: str, name: str, made: Callable[[str], bool]) -> None:
    """List a shared store, the newest last; no artifact is opened there.

    Args:
        session: the context of the command.
        remote: the address.
        kind: only this kind; "" for all.
        name: only these names; * is any.
        made: whether an artifact of this time is wanted.
    """
    from skillcli.store import open_remote
    from skillcli.store.remote_index import Catalog, nothing_there

    files = open_remote(remote)
    catalog = Catalog.of(files)
    if not catalog.entries:
        raise nothing_there(files.address)
    if catalog.strangers:
        session.say(f"not understood there: {len(catalog.strangers)} files, such as {catalog.strangers[0]}", "yellow")
    chosen = [
        entry
        for entry in catalog.entries
        if (not kind or entry.id.stage == kind) and fnmatchcase(entry.id.name, name) and made(entry.created_utc)
    ]
    _print(session, files.address, catalog, chosen)


def _print(session: Session, address: str, catalog: Catalog, chosen: list[Entry]) -> None:
    from rich.table import Table

    from skillcli.cli.store_view import LONG, plain_table

    local: dict[tuple[str, str], str] = {}
    for header in session.store.headers():
        for where in (str(header.id), header.id.series):
            local[where, header.content_sha256] = str(header.id)

    def here(entry: Entry) -> str | None:
        content = entry.content_sha256
        return local.get((str(entry.id), content)) or local.get((entry.id.series, content))

    if session.json:
        listed = [
            {
                "id": str(entry.id),
                "kind": entry.id.stage,
                "created_utc": entry.created_utc,
                "bytes": entry.bytes,
                "content_sha256": entry.content_sha256,
                "here": here(entry),
                "whole": catalog.has_file(entry),
            }
            for entry in chosen
        ]
        session.result({"remote": address, "artifacts": listed})
        return
    rows = [_row(entry, here(entry), catalog.has_file(entry)) for entry in chosen]
    if len(rows) > LONG:
        session.result({}, plain_table(_COLUMNS, rows))
        return
    table = Table()
    for column in _COLUMNS:
        table.add_column(column, no_wrap=True, overflow="fold")
    for row in rows:
        table.add_row(*row)
    session.result({}, table)


def _row(entry: Entry, here: str | None, whole: bool) -> tuple[str, ...]:
    note = "its file is missing there" if not whole else "yes" if here == str(entry.id) else f"as {here}" if here else ""
    return str(entry.id), entry.created_utc[:16].replace("T", " "), f"{entry.bytes / 1e3:,.0f}", note
