"""The command that drives an arm: execute."""

from __future__ import annotations

import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Annotated, Any

import typer

from skillcli.cli import complete, typed
from skillcli.cli.session import Session
from skillcli.cli.stages import MADE_FROM, Name, Seed, checked, payload
from skillcli.errors import Interrupted, UsageError
from skillcli.plaintext import line

SIMULATION = "simulation"


def register(app: typer.Typer) -> None:
    """Add the command to the app."""
    app.command(rich_help_panel="Stages")(execute)


def execute(
    context: typer.Context,
    source: Annotated[str | None, typer.Argument(metavar="[ID]", help=MADE_FROM, autocompletion=complete.ids)] = None,
    driver: Annotated[
        str, typer.Option("--driver", help="How the arm is reached: simulation, franka, rosbridge or lerobot.", metavar="NAME")
    ] = SIMULATION,
    driver_settings: Annotated[
        Path | None, typer.Option("--driver-settings", help="Settings of the driver (docs/drivers.md).", metavar="FILE")
    ] = None,
    robot: Annotated[
        Path | None, typer.Option("--robot", help="Robot file of the arm, if it is not that of the skills.", metavar="FILE")
    ] = None,
    episodes: Annotated[int, typer.Option("--episodes", help="How many, one after the other.", min=1, max=10_000)] = 1,
    max_speed: Annotated[
        float, typer.Option("--max-speed", help="Share of the usual speed, for a first run.", min=0.01, max=1.0)
    ] = 1.0,
    home: Annotated[bool, typer.Option("--home", help="Move the arm to the start first, slowly.")] = False,
    yes: Annotated[bool, typer.Option("--yes", help="Do not ask before anything moves.")] = False,
    dry_run: Annotated[bool, typer.Option("--dry-run", help="Do everything but send.")] = False,
    domain: Annotated[
        str | None,
        typer.Option("--domain", help="Simulated robots are drawn from it, see `skill domains`.", metavar="NAME|FILE"),
    ] = None,
    speed: Annotated[float | None, typer.Option("--speed", help="Simulated seconds in a second.", min=0.01, max=100.0)] = None,
    replan: Annotated[
        bool, typer.Option("--replan", help="After every segment, look where the arm is and plan again; it holds meanwhile.")
    ] = False,
    seed: Seed = 0,
    name: Name = None,
) -> None:
    """Execute a composition, or bare skills, on an arm: simulated in real time, or a real one (stage 3)."""
    session: Session = context.obj
    settings = _settings(driver, driver_settings, {"domain": domain, "speed": speed})
    from skillcli.kinds import EXECUTION

    usual, *others = EXECUTION.made_from
    found = session.pick(source, usual, *(others if source else ()))
    from skillcli.evaluation.consistency import stored_recipe
    from skillcli.execution.execute import Asked
    from skillcli.robots.robot import load_robot, load_target
    from skillcli.stages.execution import Via
    from skillcli.stages.execution import execute as stage

    other = None
    if robot is not None:
        other = load_target(robot, load_robot(stored_recipe(session.store.read(found)).robot))
        for note in other.notes:
            session.say(f"{robot}: {note}")
    asked = Asked(episodes=episodes, share=max_speed, home=home, dry=dry_run, replan=replan)
    with session.progress() as on_progress:
        artifact = stage(
            session.store, found, Via(driver, settings, other), asked, _asking(session, yes), session.command, checked(name),
            seed, on_progress,
        )  # fmt: skip
    _done(session, artifact)


def _done(session: Session, artifact: Any) -> None:
    """Print the result; an execution that was stopped has failed, though it is stored."""
    from rich.text import Text

    from skillcli.cli.tables import table_of
    from skillcli.kinds import EXECUTION

    stopped = EXECUTION.results_of(artifact).stopped
    if stopped is not None and stopped.reason == "interrupted":
        raise Interrupted(f"stopped: the arm holds; what was executed is {artifact.id}", f"skill show {artifact.id}")
    session.result(payload(artifact), table_of(artifact), Text(typed.runnable(f"next: skill viz {artifact.id} --open"), "dim"))
    if stopped is not None:
        print(f"error: stopped, {stopped.reason}: {line(stopped.message)}; the arm holds", file=sys.stderr)
        print(f" hint: docs/execute.md says what to do; what was executed is {artifact.id}", file=sys.stderr)
        raise typer.Exit(1)


def _asking(session: Session, yes: bool) -> Callable[[Sequence[str]], bool]:
    def confirm(lines: Sequence[str]) -> bool:
        for told in lines:
            session.say(told)
        if yes:
            return True
        if session.json or not sys.stdin.isatty():
            raise UsageError("before an arm moves somebody has to agree, and there is nobody to ask", "--yes agrees")
        return typer.confirm("move the arm?", err=True)

    return confirm


def _settings(driver: str, file: Path | None, options: dict[str, object]) -> dict[str, object]:
    """Read the driver's settings, and add those of the command line.

    Raises:
        UsageError: the file cannot be read, or an option is for simulated arms only.
    """
    given = {key: value for key, value in options.items() if value is not None}
    if given and driver != SIMULATION:
        raise UsageError(f"{', '.join(f'--{key}' for key in given)}: the arm of --driver {driver} is real", "leave it out")
    if file is None:
        return given
    from skillcli.config.toml_file import read_toml
    from skillcli.paths import expanded

    try:
        content: dict[str, object] = read_toml(expanded(file))
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", "") or error
        raise UsageError(f"--driver-settings {file} cannot be read: {reason}", "it is a TOML file: docs/drivers.md") from None
    if twice := sorted(given.keys() & content.keys()):
        raise UsageError(f"{', '.join(twice)} is said by the command and by {file}", "say it once")
    return {**content, **given}
