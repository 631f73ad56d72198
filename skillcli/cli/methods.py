"""`skill compose --method NAME`: a command whose options depend on the method."""

from __future__ import annotations

import inspect
from collections.abc import Sequence
from typing import Annotated, Any

import typer
from typer.core import TyperCommand

from skillcli.composition.registry import DEFAULT, METHODS, all_specs, method_spec, split_method
from skillcli.errors import UsageError

PANEL = "Options of the method"
SHARED = {"ensemble", "on", "seed"}  # options of several methods, in the signature of the command
CHOSEN = "skill.method"  # key in the context for the name of the method, None in the general help
OWN = "skill.own_options"  # key for the values of the method's own options, by name


class ByMethod(TyperCommand):
    """A command whose options depend on the value of --method."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """See click; refuse options of another method."""
        args = _expanded(args)
        named = _named(args)
        ctx.meta[CHOSEN] = method = named if named is not None or "--help" in args else DEFAULT
        if method is not None:
            refuse_strays(method, args)
        rest = super().parse_args(ctx, args)
        own = [option.name for option in method_spec(method).options] if method is not None else []
        ctx.meta[OWN] = {name: ctx.params.pop(name) for name in own}
        return rest

    def get_params(self, ctx: Any) -> list[Any]:
        """See click: return the options of every method and of the chosen one."""
        method = ctx.meta.get(CHOSEN)
        if method is None:
            return [param for param in super().get_params(ctx) if param.name not in SHARED]
        spec = method_spec(method)
        params = super().get_params(ctx)
        shared = [param for param in params if param.name in spec.shared_options]
        return [*(param for param in params if param.name not in SHARED), *own_params(method), *shared]

    def format_help(self, ctx: Any, formatter: Any) -> None:
        """See click; list the methods, or describe the chosen one."""
        method, before = ctx.meta.get(CHOSEN), self.help
        if method is None:
            listed = "\n\n".join(f"[bold]{name}[/]: {entry.about}" for name, entry in METHODS.items())
            self.help = f"{before}\n\n`--method NAME --help` shows what a method takes. Methods:\n\n{listed}"
        else:
            about = METHODS[method].about
            self.help = f"{before}\n\n[bold]{method}[/]: {about}. More to set: --set {method}.KEY=VALUE."
        try:
            super().format_help(ctx, formatter)
        finally:
            self.help = before


def own_params(method: str) -> list[Any]:
    """Make the method's own options for click."""

    def declared(**_: Any) -> None: ...

    declared.__signature__ = inspect.Signature([  # type: ignore[attr-defined]
        inspect.Parameter(
            each.name,
            inspect.Parameter.KEYWORD_ONLY,
            default=None,
            annotation=Annotated[each.type | None, option(each.help, metavar=each.metavar)],
        )
        for each in method_spec(method).options
    ])  # fmt: skip
    app = typer.Typer(add_completion=False)
    app.command()(declared)
    return list(typer.main.get_command(app).params)


def refuse_strays(method: str, args: Sequence[str]) -> None:
    """Refuse an unknown method, and options of other methods.

    Raises:
        UsageError: there is one.
    """
    own = method_spec(method).option_names
    for word in args:
        option = word.partition("=")[0].removeprefix("--")
        if not word.startswith("--") or option in own:
            continue
        owners = [name for name, spec in all_specs().items() if option in spec.option_names]
        if owners:
            taken = ", ".join(f"--{name}" for name in own)
            raise UsageError(
                f"--{option} belongs to --method {' or '.join(owners)}, not to {method}", f"{method} takes {taken}"
            )


def _expanded(args: Sequence[str]) -> list[str]:
    """Write `--method NAME:VALUE` as `--method NAME` and the option that the value sets."""
    named = _named(args)
    if named is None or ":" not in named:
        return list(args)
    method, given = split_method(named)
    words = [word.replace(named, method, 1) if word in (named, f"--method={named}") else word for word in args]
    return [*words, *(word for option, value in given.items() for word in (f"--{option}", value))]


def _named(args: Sequence[str]) -> str | None:
    """Return the value of --method, None if it is not given."""
    for word, after in zip(args, [*args[1:], None], strict=False):  # no words, no pairs
        if word == "--method":
            return after
        if word.startswith("--method="):
            return word.partition("=")[2]
    return None


def option(text: str, **more: Any) -> Any:
    """Make an option that only some methods have."""
    return typer.Option(help=text, rich_help_panel=PANEL, show_default=False, **more)
