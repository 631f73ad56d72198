"""Commands about robots: list them, show one, make a robot file for a new one."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from skillcli.cli.session import Session
from skillcli.errors import UsageError

if TYPE_CHECKING:
    from rich.console import Group

    from skillcli.robots.robot import Robot

robots_app = typer.Typer(help="Robots: list them, show one, or make a robot file for a new arm.", invoke_without_command=True)


def register(app: typer.Typer) -> None:
    """Add the commands to the app."""
    app.add_typer(robots_app, name="robots", rich_help_panel="Look")


@robots_app.callback()
def robots(context: typer.Context) -> None:
    """List the bundled robots."""
    if context.invoked_subcommand:
        return
    from rich.table import Table

    from skillcli.robots.config import bundled_robots, describe_robot

    session: Session = context.obj
    table = Table("robot", "joints", "what it is")
    listed = []
    for name in bundled_robots():
        found = describe_robot(name)
        table.add_row(name, str(len(found.joints)), found.description)
        listed.append({"name": name, "joints": list(found.joints), "description": found.description})
    session.result({"robots": listed}, table)


@robots_app.command("show")
def show(
    context: typer.Context,
    which: Annotated[str, typer.Argument(metavar="NAME|FILE", help="A robot's name, see `skill robots`, or a robot file.")],
    png: Annotated[Path | None, typer.Option("--png", help="Draw the arm at its start, with its workspace.")] = None,
) -> None:
    """Print an arm's joints, limits, servos and workspace, and the notes of loading it."""
    from skillcli.robots.robot import load_robot

    session: Session = context.obj
    robot = load_robot(which)
    if png is not None:
        _draw(robot, which, png)
    session.result({**_payload(robot), "png": None if png is None else str(png)}, _sheet(robot, png))


@robots_app.command("new")
def new(
    context: typer.Context,
    model: Annotated[str, typer.Argument(metavar="MODEL", help="An MJCF or URDF file, or menagerie:NAME.")],
    output: Annotated[
        Path | None,
        typer.Option("-o", "--output", help="The robot file; by default the model's name.", metavar="FILE.toml"),
    ] = None,
) -> None:
    """Write a robot file for a model: find its arm, hand, servos and a start, and say what only a person can know."""
    from rich.text import Text

    from skillcli.files import replacing
    from skillcli.robots.new_file import propose_robot

    session: Session = context.obj
    file = output or Path(f"{Path(model.removeprefix('menagerie:')).stem}.toml")
    if file.suffix != ".toml":
        raise UsageError(f"a robot file is TOML, got {str(file)!r}", "end its name in .toml")
    if file.exists():
        raise UsageError(f"{file} is there already", "choose another name with -o, or move it away")
    found = propose_robot(model, file)
    with replacing(file) as (temporary,):
        temporary.write_text(found.text, encoding="utf-8")
    lines = [f"written: {file}", *(f"guessed: {item}" for item in found.guessed)]
    lines += [f"only you can know: {item}" for item in found.unknown]
    session.result(
        {"file": str(file), "joints": list(found.joints), "guessed": list(found.guessed), "unknown": list(found.unknown)},
        Text("\n".join(lines)),
        Text(f"next: skill robots show {file} --png arm.png; skill pretrain reach --robot {file}", "dim"),
    )


def _draw(robot: Robot, which: str, png: Path) -> None:
    """Draw the arm at the start of the reach task with its goals; at home if the task has no room."""
    import numpy as np

    from skillcli.recipe import resolve
    from skillcli.viz.figures import robot_figure

    start, goals = robot.home, np.zeros((0, 3))
    try:
        task = resolve({"name": "show", "robot": which, "task": {"name": "reach"}}).task
        start, goals = getattr(task, "start", start), np.array(task.goals)
    except UsageError:
        pass
    robot_figure(robot, start, goals, png)


def _payload(robot: Robot) -> dict[str, Any]:
    import numpy as np

    rows = []
    limits = zip(robot.speed_limit, robot.acceleration_limit, strict=True)
    for name, joint, fastest in zip(robot.description.joints, robot.names.joints, limits, strict=True):
        found = robot.model.joint(joint)
        limited = bool(robot.model.jnt_limited[found.id])
        low, high = (float(x) for x in found.range) if limited else (None, None)
        speed, acceleration = (float(limit) if np.isfinite(limit) else None for limit in fastest)
        rows.append({"name": name, "low": low, "high": high, "speed": speed, "acceleration": acceleration})
    return {
        "name": robot.name,
        "description": robot.description.description,
        "joints": rows,
        "home": list(robot.home),
        "servos": _servos(robot),
        "workspace": robot.workspace.model_dump(mode="json"),
        "timestep": float(robot.model.opt.timestep),
        "finger": "ours" if robot.description.finger is None else list(robot.description.finger),
        "fingerprint": robot.fingerprint,
        "notes": list(robot.notes),
    }


def _servos(robot: Robot) -> list[dict[str, float | None]]:
    """List stiffness N·m/rad, damping N·m·s/rad and largest torque N·m of each joint; None: unlimited."""
    rows = []
    for name in robot.names.servos:
        i = robot.model.actuator(name).id
        force = float(robot.model.actuator_forcerange[i, 1]) if robot.model.actuator_forcelimited[i] else None
        kp, kv = float(robot.model.actuator_gainprm[i, 0]), abs(float(robot.model.actuator_biasprm[i, 2]))
        rows.append({"kp": kp, "kv": kv, "force": force})
    return rows


def _sheet(robot: Robot, png: Path | None) -> Group:
    from rich.console import Group
    from rich.table import Table
    from rich.text import Text

    found = _payload(robot)
    table = Table("joint", "low", "high", "speed", "accel.", "kp", "kv", "torque", "home")
    for joint, servo, home in zip(found["joints"], found["servos"], found["home"], strict=True):
        limits = [joint["low"], joint["high"], joint["speed"], joint["acceleration"]]
        numbers = [*limits, servo["kp"], servo["kv"], servo["force"], home]
        table.add_row(joint["name"], *("–" if number is None else f"{number:.4g}" for number in numbers))
    room = robot.workspace
    lines = [
        "rad, rad/s, rad/s², N·m/rad, N·m·s/rad, N·m; –: no limit is known",
        f"the finger reaches {room.reach:.2f} m from ({', '.join(f'{x:g}' for x in room.shoulder)})",
        *(f"note: {note}" for note in robot.notes),
        *([f"drawn: {png}"] if png else []),
    ]
    return Group(Text.assemble((robot.name, "bold"), f": {robot.description.description}"), table, Text("\n".join(lines)))
