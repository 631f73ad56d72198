"""The `skill` app: commands, global options, and the report of failures."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Annotated, NoReturn

import typer

from skillcli import __version__
from skillcli.cli import (
    compare_runs,
    execute,
    identify,
    inspect,
    play,
    remote,
    report,
    robots,
    stages,
    store_admin,
    store_view,
    sweep,
    trouble,
    typed,
)
from skillcli.cli.session import Session
from skillcli.errors import SkillError
from skillcli.plaintext import line
from skillcli.stopping import Interrupt, answered

app = typer.Typer(
    name="skill",
    help="Learn robot skills in a latent space, compose them into new tasks, and evaluate them on other robots.",
    no_args_is_help=True,
    rich_markup_mode="rich",
    add_completion=True,
    pretty_exceptions_enable=False,
)


def _version(wanted: bool) -> None:
    if wanted:
        print(f"skill {__version__}")
        raise typer.Exit


@app.callback()
def options(
    context: typer.Context,
    store: Annotated[
        Path, typer.Option("--store", envvar="SKILL_STORE", help="Folder that the artifacts are kept in.", metavar="DIR")
    ] = Path("artifacts"),
    as_json: Annotated[bool, typer.Option("--json", help="Print exactly one JSON object on stdout.")] = False,
    quiet: Annotated[bool, typer.Option("--quiet", help="No progress and no messages.")] = False,
    debug: Annotated[bool, typer.Option("--debug", help="Show the traceback of a failure.")] = False,
    version: Annotated[bool, typer.Option("--version", help="Print the version.", callback=_version, is_eager=True)] = False,
) -> None:
    """Options of every command."""
    try:
        Path.cwd()
    except FileNotFoundError:  # libraries would end the process
        raise SkillError("the current folder no longer exists", "cd to an existing folder") from None
    source = context.get_parameter_source("store")
    named = source is not None and source.name in ("COMMANDLINE", "ENVIRONMENT")
    context.obj = Session(store, named, as_json, quiet, debug)


stages.register(app)
sweep.register(app)
compare_runs.register(app)
execute.register(app)
identify.register(app)
inspect.register(app)
play.register(app)
robots.register(app)
report.register(app)
store_view.register(app)
store_admin.register(app)
remote.register(app)


def main() -> None:
    """Run the command line; every failure ends as one line and an exit code."""
    ours, rest = typed.split(sys.argv[1:])
    interrupt = Interrupt()
    try:
        with answered(interrupt):
            code = app(args=[*ours, *rest], standalone_mode=False)
        if code == 130:  # how typer reports Ctrl-C
            raise KeyboardInterrupt
        sys.exit(code if isinstance(code, int) else 0)
    except SkillError as error:
        _fail(type(error).__name__, error.message, error.hint, error.exit_code)
    except typer.TyperException as error:
        _fail("UsageError", error.format_message(), _help_of(error) if error.exit_code == 2 else "", error.exit_code)
    except (KeyboardInterrupt, typer.Abort):
        _fail(*INTERRUPTED)
    except Exception as error:
        if interrupt.pressed:  # extension modules turn Ctrl-C into an error of their own while they load
            _fail(*INTERRUPTED)
        _fail(type(error).__name__, *trouble.explain(error), 1)


def _help_of(error: typer.TyperException) -> str:
    """Name the help of the command that was misused."""
    context = getattr(error, "ctx", None)
    words = context.command_path.split()[1:] if context is not None else []
    return f"see `{' '.join(['skill', *words, '--help'])}`"


INTERRUPTED = ("Interrupted", "interrupted", "what was finished is in the store; a training goes on with --resume", 130)


def _fail(kind: str, message: str, hint: str, code: int) -> NoReturn:
    if "--debug" in sys.argv and sys.exc_info()[0] is not None and code == 1:
        import traceback

        traceback.print_exc()
    flat, advice = line(message), line(typed.runnable(hint))
    if "--json" in sys.argv:
        print(json.dumps({"error": {"type": kind, "message": flat, "hint": advice}}))
    print(f"error: {flat}" + (f"\n hint: {advice}" if advice else ""), file=sys.stderr)
    sys.exit(code)
