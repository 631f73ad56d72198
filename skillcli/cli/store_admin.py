"""Commands that maintain the store: gc, export, import, migrate, unlock, diff."""

from __future__ import annotations

import os
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from skillcli.cli import typed
from skillcli.cli.session import Session
from skillcli.cli.store_view import FullId, Id
from skillcli.errors import SkillError, UsageError

if TYPE_CHECKING:
    from skillcli.execution.policy_file import Exported
    from skillcli.store import ArtifactId, Garbage


def register(app: typer.Typer) -> None:
    """Add the commands to the app."""
    panel = "Store"
    app.command(rich_help_panel=panel)(diff)
    app.command("gc", rich_help_panel=panel)(collect)
    app.command(rich_help_panel=panel)(export)
    app.command("import", rich_help_panel=panel)(import_)
    app.command(rich_help_panel=panel)(migrate)
    app.command(rich_help_panel=panel)(unlock)


def diff(context: typer.Context, a: FullId, b: FullId) -> None:
    """Compare two artifacts: recipes, packages, results and arrays."""
    from rich.table import Table

    from skillcli.cli.compare import differences

    session: Session = context.obj
    first, second = (session.store.read(session.store.resolve(text)) for text in (a, b))
    found = differences(first, second)
    table = Table("", str(first.id), str(second.id))
    for part, values in found.items():
        for key, (left, right) in values.items():
            table.add_row(f"{part} {key}".rstrip(), str(left), str(right))
    same = first.content_sha256 == second.content_sha256
    said = f"{first.id} and {second.id} have the same content" if same else f"{first.id} and {second.id} differ in content"
    session.result(
        {"a": str(first.id), "b": str(second.id), "same_content": same, **found}, *([table] if table.rows else []), said
    )


def collect(
    context: typer.Context,
    apply: Annotated[bool, typer.Option("--apply", help="Remove it; by default only list it.")] = False,
    keep: Annotated[int, typer.Option("--keep", help="How many of the newest versions of each NAME/STAGE to keep.", min=1)] = 1,
) -> None:
    """Remove older versions, and files of killed processes. Pinned and newest artifacts and their ancestors are kept.

    Artifacts of the last hour are kept too: another command may be about to use them.
    """
    from skillcli.store import collect_garbage, find_garbage

    session: Session = context.obj
    found = (collect_garbage if apply else find_garbage)(session.filled, keep)
    if found.unreadable:
        blocked = found.unreadable[0].id
        session.say(f"no artifact is removed while {blocked} cannot be read: `skill verify --all` says why", "yellow")
    payload: dict[str, Any] = {
        "applied": apply,
        "bytes": found.bytes,
        "artifacts": [{"id": str(header.id), "bytes": header.bytes} for header in found.artifacts],
        "leftovers": [{"path": str(one.path), "bytes": one.bytes, "why": one.why} for one in found.leftovers],
        "unreadable": [str(one.id) for one in found.unreadable],
        "unfinished": [str(path) for path in found.unfinished],
        "young": [str(header.id) for header in found.young],
    }
    session.result(payload, *(() if session.json else _garbage(found, apply)))


def _garbage(found: Garbage, applied: bool) -> list[Any]:
    from rich.table import Table

    table = Table("goes" if not applied else "gone", "why", "kB")
    for header in found.artifacts:
        table.add_row(str(header.id), "older, without children that are kept", f"{header.bytes / 1e3:,.0f}")
    for one in found.leftovers:
        table.add_row(str(one.path), one.why, f"{one.bytes / 1e3:,.0f}")
    count = len(found.artifacts) + len(found.leftovers)
    kept = [f"kept for --resume: {path}" for path in found.unfinished]
    kept += [f"kept for now, made within the last hour: {len(found.young)}"] if found.young else []
    if not count:
        return [*kept, "nothing to remove"]
    summary = f"{count} files, {found.bytes / 1e6:,.1f} MB"
    proposed = typed.runnable("`skill gc --apply` does it")
    return [table, *kept, f"removed {summary}" if applied else f"would remove {summary}; {proposed}"]


def export(
    context: typer.Context,
    source: Id = None,
    output: Annotated[
        Path | None,
        typer.Option("-o", "--output", help="The archive to write; by default named after the artifact.", metavar="FILE.tar"),
    ] = None,
    onnx: Annotated[
        Path | None,
        typer.Option(
            "--onnx",
            help="Write the policy alone instead, for a robot: an ONNX file with normaliser, action limit and metadata inside.",
            metavar="FILE.onnx",
        ),
    ] = None,
    minari: Annotated[
        Path | None,
        typer.Option(
            "--minari", help="Write its trajectories instead, as a data set of Minari below this folder.", metavar="DIR"
        ),
    ] = None,
) -> None:
    """Write an artifact with all its ancestors into one archive, for `skill import` elsewhere.

    With --onnx, write its policy into one file that needs no skill: of a pretrain, embed-means or compose artifact.
    With --minari, write its trajectories as offline data, which Minari loads by the same id.
    """
    from skillcli.store import export as write

    session: Session = context.obj
    if sum(place is not None for place in (output, onnx, minari)) > 1:
        given = " and ".join(
            name for name, place in (("-o", output), ("--onnx", onnx), ("--minari", minari)) if place is not None
        )
        hint = "give one of them: -o an archive, --onnx the policy alone, --minari the trajectories"
        raise UsageError(f"{given} write different files", hint)
    if minari is not None:
        _export_trajectories(session, source, minari)
        return
    if onnx is not None:
        _export_policy(session, source, onnx)
        return
    found = session.pick(source)
    path = output or Path(f"{found.name}-{found.stage}-v{found.version}.tar")
    ids = write(session.store, found, path)
    size = path.stat().st_size
    session.result(
        {"id": str(found), "file": str(path), "bytes": size, "artifacts": [str(one) for one in ids]},
        f"{path}: {', '.join(map(str, ids))} ({size / 1e6:.1f} MB)",
    )


def _export_trajectories(session: Session, source: str | None, root: Path) -> None:
    try:
        from skillcli.gym.minari_data import export_minari
    except ImportError:
        raise SkillError("--minari needs the package minari", "install it: pip install 'skillcli[minari]'") from None
    from skillcli.kinds import RECORDED

    found = session.pick(source, *RECORDED)
    artifact = session.store.read(found)
    folder = export_minari(artifact, root)
    episodes = len(artifact.arrays["trajectories/length"])
    session.result(
        {"id": str(found), "minari": str(folder), "dataset_id": str(found), "episodes": episodes},
        f"{folder}: {episodes} episodes; MINARI_DATASETS_PATH={root} lets minari.load_dataset({str(found)!r}) find them",
    )


def _export_policy(session: Session, source: str | None, path: Path) -> None:
    from skillcli.execution.policy_file import EXPORTED, export_policy

    found = session.pick(source, *EXPORTED)
    written = export_policy(session.store, found, path)
    payload = {
        "id": str(found),
        "onnx": str(path),
        "bytes": path.stat().st_size,
        "parity": asdict(written.parity),
        "inputs": [port.json() for port in written.inputs],
        "outputs": [port.json() for port in written.outputs],
    }
    session.result(payload, *(() if session.json else _policy(found, path, written)))


def _policy(source: ArtifactId, path: Path, written: Exported) -> list[Any]:
    from rich.table import Table

    table = Table("", "name", "shape", "unit", "what it is")
    for direction, ports in (("in", written.inputs), ("out", written.outputs)):
        for port in ports:
            rows, columns = port.shape
            table.add_row(direction, port.name, f"{rows} × {columns}", port.unit, port.meaning)
    whose = f" for {written.robot}" if written.robot else ""
    same = f"{written.parity.max_abs_error:.1g} on {written.parity.observations:,} observations"
    return [
        f"{path}: the policy of {source}{whose}, every {written.control_period:g} s",
        table,
        f"ONNX Runtime and torch differ by at most {same}",
    ]


def import_(
    context: typer.Context,
    file: Annotated[Path, typer.Argument(metavar="FILE", help="A file of `skill export`, or a single artifact's .h5 file.")],
    replace: Annotated[bool, typer.Option("--replace", help="Replace damaged artifacts by intact ones.")] = False,
) -> None:
    """Import artifacts into the store; everything in the file is checked first."""
    from skillcli.evaluation.consistency import check_meaning
    from skillcli.store import import_file

    session: Session = context.obj
    found = import_file(session.store, file, check_meaning, replace_damaged=replace)
    lines = []
    for one in found:
        renamed = f" (exported as {one.exported}, whose number is taken or too high)" if one.id != one.exported else ""
        done = "imported" if one.new else "put in the place of a damaged one:" if one.replaced else "already here:"
        lines.append(f"{done} {one.id}{renamed}")
    payload = [{"id": str(one.id), "exported": str(one.exported), "new": one.new, "replaced": one.replaced} for one in found]
    session.result({"id": str(found[-1].id), "artifacts": payload}, *lines)


def migrate(context: typer.Context, source: FullId) -> None:
    """Make a new version of an artifact in the present schema; the original is kept."""
    session: Session = context.obj
    found = session.store.resolve(source)
    artifact = session.store.migrate(found, session.command)
    session.result(
        {"id": str(artifact.id), "migrated_from": str(found), "schema_version": artifact.schema_version},
        f"{artifact.id}: {found} in schema {artifact.schema_version}",
    )


def unlock(
    context: typer.Context,
    force: Annotated[bool, typer.Option("--force", help="Remove it even if its owner seems to run.")] = False,
) -> None:
    """Remove the lock of a process that has ended on another machine. Never needed after a crash on this one."""
    from skillcli.store import unlock as remove

    session: Session = context.obj
    locked = os.path.lexists(session.filled.root / ".lock")
    owner = remove(session.root, force=force) if locked else None
    whose = str(owner) if owner else None
    said = f"removed the lock of {whose or 'an unknown process'}" if locked else "the store is not locked"
    session.result({"unlocked": locked, "owner": whose}, said)
