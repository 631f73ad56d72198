"""The command that fits a domain to the log of an arm."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from skillcli.cli import complete
from skillcli.cli.session import Session
from skillcli.errors import UsageError

if TYPE_CHECKING:
    from rich.console import Group

    from skillcli.execution.identify.result import Identified
    from skillcli.execution.log import Log
    from skillcli.robots.robot import Robot

USUAL_LIMIT = 0.04  # rad, the action limit of every recipe of the Sawyer


def register(app: typer.Typer) -> None:
    """Add the command to the app."""
    app.command(rich_help_panel="Stages")(identify)


def identify(
    context: typer.Context,
    source: Annotated[
        str,
        typer.Argument(
            metavar="ID|LOG",
            help="An artifact with trajectories, or a log: a .csv or .npz file.",
            autocompletion=complete.ids,
        ),
    ],
    robot: Annotated[
        str, typer.Option("--robot", help="The arm: a name of `skill robots`, or a robot file.", metavar="NAME|FILE")
    ],
    output: Annotated[Path, typer.Option("-o", "--output", help="The domain file to write.", metavar="DOMAIN.toml")],
    period: Annotated[
        float | None,
        typer.Option("--period", help="Control period of a log without time stamps, s; 0.05 by default.", min=1e-3, max=1),
    ] = None,
    action_limit: Annotated[
        float | None,
        typer.Option(
            "--action-limit", help="Increments of a log are clipped to this, rad; 0.04 by default.", min=1e-4, max=0.2
        ),
    ] = None,
    relative: Annotated[
        bool, typer.Option("--relative", help="Angles count from an unknown start: find it from the gripper positions.")
    ] = False,
    threads: Annotated[
        int, typer.Option("--threads", help="Threads of the physics, 0 for all cores; same results.", min=0, max=1024)
    ] = 0,
) -> None:
    """Fit a domain to what an arm did: latency, meaning of its commands, gains, friction, zeros and tool."""
    from rich.text import Text

    from skillcli.execution.identify.domain_text import domain_name, domain_text
    from skillcli.execution.identify.identify import identify as fit
    from skillcli.execution.identify.relative import counts_from_start, from_start
    from skillcli.execution.log_files import is_log_file
    from skillcli.files import replacing
    from skillcli.robots.robot import load_robot

    session: Session = context.obj
    if output.suffix != ".toml":
        raise UsageError(f"a domain file is TOML, got {str(output)!r}", "end its name in .toml")
    arm = load_robot(robot)
    log = _read(session, source, arm, period)
    if relative:
        log = from_start(log, arm)
    elif counts_from_start(log, arm):
        session.say("every episode begins with all joints at zero: if the angles count from the start, give --relative")
    for note in log.notes:
        session.say(note)
    with session.progress() as on_progress:
        found = fit(log, arm, action_limit or USUAL_LIMIT, on_progress, threads)
    name = domain_name(output)
    with replacing(output) as (temporary,):
        temporary.write_text(
            domain_text(name, found, Path(source).name if is_log_file(source) else source, robot), encoding="utf-8"
        )
    session.result(
        {"file": str(output), "name": name, **found.json()},
        _sheet(found),
        Text(f"written: {output}"),
        Text(f"next: skill transfer-eval --domain {output}; skill pretrain RECIPE --set randomisation={output}", "dim"),
    )


def _read(session: Session, source: str, robot: Robot, period: float | None) -> Log:
    from skillcli.execution.log import log_of_trajectories
    from skillcli.execution.log_files import is_log_file, read_log
    from skillcli.kinds import RECORDED
    from skillcli.trajectories import Trajectories

    joints = robot.description.joints
    if is_log_file(source):
        return read_log(source, joints, period)
    artifact = session.filled.read(session.filled.resolve(source, RECORDED))
    arrays = artifact.group("trajectories")
    return log_of_trajectories(Trajectories(**arrays), joints, str(artifact.id), artifact.arrays.get("execution/commanded"))


def _sheet(found: Identified) -> Group:
    from rich.console import Group
    from rich.table import Table
    from rich.text import Text

    from skillcli.config.randomization import PARAMETERS

    table = Table("parameter", "value", "low", "high", "unit", "")
    for name, estimate in found.parameters.items():
        unit = PARAMETERS[name].unit if name in PARAMETERS else "m"
        ends = [" ".join(f"{part:.3g}" for part in end.ravel()) for end in (estimate.value, estimate.low, estimate.high)]
        table.add_row(name, *ends, unit, "" if estimate.told else "not told by the log")
    lines = [f"commands: {found.meaning}; held out: {found.heldout}, {found.heldout_steps} control steps"]
    for what, errors in (("half a second", found.half_second), ("one step", found.one_step)):
        lines.append(
            f"error over {what}: {1000 * errors.fitted:.2f} mrad, nominal {1000 * errors.nominal:.2f}, "
            f"an arm that stays {1000 * errors.unmoved:.2f} (root mean square)"
        )
    return Group(table, Text("\n".join([*lines, *(f"note: {note}" for note in found.notes)])))
