"""`skill compose --method NAME`: a command whose options are those of the method."""

from __future__ import annotations

import inspect
from collections.abc import Sequence
from typing import Annotated, Any

import typer
from typer.core import TyperCommand

from skillcli.composition.registry import DEFAULT, METHODS, all_specs, method_spec
from skillcli.errors import UsageError

PANEL = "Options of the method"
SHARED = {"ensemble", "on", "seed"}  # options that several methods take, in the signature of the command
CHOSEN = "skill.method"  # where the context keeps the name of the method, None in the help of all
OWN = "skill.own_options"  # and what was given for the options that are its own, by name


class ByMethod(TyperCommand):
    """A command whose options depend on the value of --method."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """See click; refuses options that belong to another method."""
        named = _named(args)
        ctx.meta[CHOSEN] = method = named if named is not None or "--help" in args else DEFAULT
        if method is not None:
            refuse_strays(method, args)
        rest = super().parse_args(ctx, args)
        own = [option.name for option in method_spec(method).options] if method is not None else []
        ctx.meta[OWN] = {name: ctx.params.pop(name) for name in own}
        return rest

    def get_params(self, ctx: Any) -> list[Any]:
        """See click: those of every method, and those of the chosen one."""
        method = ctx.meta.get(CHOSEN)
        if method is None:
            return [param for param in super().get_params(ctx) if param.name not in SHARED]
        spec = method_spec(method)
        params = super().get_params(ctx)
        shared = [param for param in params if param.name in spec.shared_options]
        return [*(param for param in params if param.name not in SHARED), *own_params(method), *shared]

    def format_help(self, ctx: Any, formatter: Any) -> None:
        """See click; says which methods there are, or what the chosen one is."""
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
    """The options of a method that are its own, as click has them."""

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
    """Refuse an unknown method, and options that belong to others.

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


def _named(args: Sequence[str]) -> str | None:
    """The value of --method, None where it is not given."""
    for word, after in zip(args, [*args[1:], None], strict=False):  # no words, no pairs
        if word == "--method":
            return after
        if word.startswith("--method="):
            return word.partition("=")[2]
    return None


def option(text: str, **more: Any) -> Any:
    """An option that belongs to some methods only."""
    return typer.Option(help=text, rich_help_panel=PANEL, show_default=False, **more)
