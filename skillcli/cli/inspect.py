"""Commands that show: viz, recipes, tasks, domains and doctor."""

from __future__ import annotations

import importlib.metadata
import os
import shutil
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from skillcli.cli import complete
from skillcli.cli.session import Session
from skillcli.cli.stages import MADE_FROM
from skillcli.errors import SkillError, StoreError, UsageError

if TYPE_CHECKING:
    from subprocess import Popen

    from rich.console import Group
    from rich.table import Table

    from skillcli.simulation.domains import Domain
    from skillcli.store import ArtifactId

recipes_app = typer.Typer(help="Recipes: list them, or show one resolved.", invoke_without_command=True)


def register(app: typer.Typer) -> None:
    """Add the commands to the app."""
    app.command(rich_help_panel="Look")(viz)
    app.add_typer(recipes_app, name="recipes", rich_help_panel="Look")
    app.command(rich_help_panel="Look")(tasks)
    app.command(rich_help_panel="Look")(domains)
    app.command(rich_help_panel="Look")(doctor)


def viz(
    context: typer.Context,
    source: Annotated[str | None, typer.Argument(metavar="[ID]", help=MADE_FROM, autocompletion=complete.ids)] = None,
    output: Annotated[Path | None, typer.Option("-o", "--output", help="The recording.", metavar="FILE.rrd")] = None,
    png: Annotated[Path | None, typer.Option("--png", help="Also draw a figure, no viewer needed.", metavar="FILE")] = None,
    open_viewer: Annotated[bool, typer.Option("--open", help="Open the recording in the rerun viewer.")] = False,
    web: Annotated[bool, typer.Option("--web", help="Serve it to a browser on this machine only.")] = False,
) -> None:
    """Write a rerun recording of any artifact: arm, goals, paths, latents, curves. Of a sweep, draw its settings compared."""
    session: Session = context.obj
    from skillcli.viz.formats import FORMATS

    if output is not None and output.suffix.lower().removeprefix(".") in FORMATS:
        raise UsageError(f"{output} has the suffix of a figure, but -o writes a recording", f"for a figure: --png {output}")
    from skillcli.kinds import SWEEP
    from skillcli.viz.loading import SCENES

    found = session.pick(source, *(() if source else SCENES))
    if found.stage == SWEEP.name:
        if given := [word for word, value in (("-o", output), ("--open", open_viewer), ("--web", web)) if value]:
            raise StoreError(
                f"{found} is a sweep: there is no recording of one", f"leave out {' and '.join(given)} for a figure"
            )
        _viz_sweep(session, found, png)
        return
    from skillcli.viz import viewer
    from skillcli.viz.visualise import record

    if open_viewer or web:
        viewer.check(window=not web)
    path = output or Path(f"{found.name}-{found.stage}-v{found.version}.rrd")
    entities = record(session.store, found, path, png)
    session.result(
        {"id": str(found), "rrd": str(path), "png": str(png) if png else None, "entities": entities},
        f"{found}: {path} ({path.stat().st_size / 1e6:.1f} MB, {len(entities)} entities)" + (f", {png}" if png else ""),
    )
    if web:
        _serve(viewer.serve_web(path))
    elif open_viewer:
        viewer.open_viewer(path)


def _viz_sweep(session: Session, found: ArtifactId, png: Path | None) -> None:
    """Draw the figure of `skill compare`: there is nothing to record."""
    from rich.text import Text

    from skillcli.cli import typed
    from skillcli.viz.visualise import draw

    path = png or Path(f"{found.name}-{found.stage}-v{found.version}.png")
    draw(session.store, found, path)
    session.result(
        {"id": str(found), "rrd": None, "png": str(path), "entities": []},
        f"{found}: {path}",
        Text(typed.runnable(f"next: skill compare {found}   # the numbers; --metric NAME --png FILE draws another"), "dim"),
    )


def _serve(process: Popen[bytes]) -> None:
    """Wait for the end of a server; the user stops it with Ctrl-C."""
    try:
        process.wait()
    except KeyboardInterrupt:
        process.terminate()
        process.wait()


@recipes_app.callback()
def recipes(context: typer.Context) -> None:
    """List the bundled recipes."""
    if context.invoked_subcommand:
        return
    from rich.table import Table

    from skillcli.recipe import load_recipe, recipe_names

    session: Session = context.obj
    found = [load_recipe(name) for name in recipe_names()]
    table = Table("recipe", "task", "what for")
    for recipe in found:
        table.add_row(recipe.name, recipe.task.name, recipe.description)
    listed = [{"name": r.name, "task": r.task.name, "description": r.description} for r in found]
    session.result({"recipes": listed}, table)


@recipes_app.command("show")
def show_recipe(
    context: typer.Context,
    name: Annotated[str, typer.Argument(help="Recipe by name, or a .toml file.")],
    overrides: Annotated[list[str] | None, typer.Option("--set", metavar="KEY=VALUE", help="Replace one value.")] = None,
) -> None:
    """Print every value of a recipe as it is used, with unit and meaning."""
    from rich.table import Table

    from skillcli.recipe import describe, load_recipe

    session: Session = context.obj
    recipe = load_recipe(name, overrides or ())
    table = Table("key", "value", "unit", "meaning")
    for key, value, unit, meaning in describe(recipe):
        table.add_row(key, str(value), unit, meaning)
    session.result({"recipe": recipe.model_dump(mode="json"), "sha256": recipe.fingerprint()}, table)


def tasks(context: typer.Context) -> None:
    """List the tasks and their named compositions."""
    from rich.table import Table

    from skillcli.composition.interpolation import SETS
    from skillcli.tasks.registry import find_task, task_names

    session: Session = context.obj
    table = Table("task", "what it is", "compositions", "interpolations")
    listed = []
    for spec in map(find_task, task_names()):
        between = [*spec.chains, *SETS]
        table.add_row(spec.name, spec.description, ", ".join(spec.compositions), ", ".join(between))
        listed.append({
            "name": spec.name,
            "description": spec.description,
            "compositions": spec.compositions,
            "interpolations": between,
        })  # fmt: skip
    session.result({"tasks": listed}, table)


def domains(
    context: typer.Context,
    which: Annotated[
        str | None, typer.Argument(metavar="[NAME|FILE]", help="One domain, or a .toml file of your own; all by default.")
    ] = None,
) -> None:
    """List the target domains, or show what one of them changes, with units and meaning."""
    from skillcli.simulation.domains import PRESETS, find_domain

    session: Session = context.obj
    if which is None:
        found = [find_domain(name) for name in PRESETS]
        session.result({"domains": [_told(domain) for domain in found]}, _domain_list(found))
        return
    domain = find_domain(which)
    session.result({"domain": _told(domain)}, _domain_sheet(domain))


def _told(domain: Domain) -> dict[str, Any]:
    from skillcli.config.randomization import PARAMETERS

    return {
        "name": domain.name,
        "description": domain.description,
        "parameters": {
            name: {"range": str(values), "unit": PARAMETERS[name].unit, "meaning": PARAMETERS[name].meaning}
            for name, values in domain.parameters.items()
        },
    }


def _domain_list(found: list[Domain]) -> Table:
    from rich.table import Table
    from rich.text import Text

    from skillcli.config.randomization import PARAMETERS

    table = Table("domain", "what it is", "changes")
    for domain in found:
        table.add_section()
        changes = [f"{name} {values} {PARAMETERS[name].unit}" for name, values in domain.parameters.items()]
        table.add_row(Text(domain.name, "bold"), domain.description, "\n".join(changes))
    return table


def _domain_sheet(domain: Domain) -> Group:
    from rich.console import Group
    from rich.table import Table
    from rich.text import Text

    from skillcli.config.randomization import PARAMETERS

    table = Table("parameter", "range", "unit", "meaning")
    for name, values in domain.parameters.items():
        table.add_row(name, str(values), PARAMETERS[name].unit, PARAMETERS[name].meaning)
    untouched = [name for name in PARAMETERS if name not in domain.parameters]
    return Group(
        Text.assemble((domain.name, "bold"), f": {domain.description}"), table, f"as in the simulation: {', '.join(untouched)}"
    )


def doctor(context: typer.Context) -> None:
    """Check that everything skill needs is installed and works."""
    from rich.table import Table
    from rich.text import Text

    session: Session = context.obj
    checks = [*_packages(), _writable(session), _physics(), ("cores", f"{os.cpu_count()}", True)]
    table = Table("what", "found", "")
    for what, found, fine in checks:
        table.add_row(what, found, Text("ok", "green") if fine else Text("problem", "red"))
    healthy = all(fine for _, _, fine in checks)
    listed = [{"what": what, "found": found, "ok": fine} for what, found, fine in checks]
    payload: dict[str, Any] = {"ok": healthy, "checks": listed}
    if not healthy:
        bad = ", ".join(what for what, _, fine in checks if not fine)
        payload["error"] = {
            "type": "Unhealthy",
            "message": f"not working: {bad}",
            "hint": "reinstall the packages with `make install`",
        }
    session.result(payload, table)
    if not healthy:
        raise typer.Exit(1)


Check = tuple[str, str, bool]


def _packages() -> list[Check]:
    names = ("torch", "mujoco", "numpy", "scipy", "h5py", "pydantic", "typer", "rich", "rerun-sdk", "matplotlib")
    found: list[Check] = [("python", sys.version.split()[0], sys.version_info >= (3, 11))]
    for name in names:
        try:
            found.append((name, importlib.metadata.version(name), True))
        except importlib.metadata.PackageNotFoundError:
            found.append((name, "missing", False))
    return found


def _writable(session: Session) -> Check:
    from skillcli.store.atomic import try_writing

    folder = next(p for p in (session.root, *session.root.absolute().parents) if p.exists())
    free = shutil.disk_usage(folder).free
    try:
        try_writing(folder)
    except SkillError as error:
        return "store", error.message, False
    return "store", f"{session.root}, {free / 1e9:.0f} GB free", free > 1e9


def _physics() -> Check:
    """Step the Sawyer once with one and with two threads."""
    import numpy as np

    from skillcli.recipe import load_recipe
    from skillcli.tasks.world import World

    world = World.of(load_recipe("reach"))
    sim_states: list[Any] = []
    for threads in (1, 2):
        env = world.make_env(4, threads)
        env.step(np.ones((4, env.action_size)))
        sim_states.append(env.save(np.arange(4)))
    same = bool((sim_states[0] == sim_states[1]).all())
    return "physics", "equal with 1 and 2 threads" if same else "differs between 1 and 2 threads", same
