"""`skill compose --method NAME`: what each method is, and which options are its own."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import typer
from typer.core import TyperCommand

from skillcli.errors import UsageError

PANEL = "Options of the method"

ABOUT = {
    "search": "goals in order, over the means (and half-way latents): shortest plan first, A*, or greedy",
    "interpolate": "hold one skill, blend into the next, hold it; with a calibration of the latents between all pairs",
    "sequence": "a plan written by hand, such as 3,4,8,7 or 3:1.0,3~4:1.0,4:1.0",
    "ddpg": "a composer that learns off-policy which latent to choose, over all latents or a discrete set",
    "ppo": "the same with the on-policy learner",
    "mpc": "sampled sequences of latents, replanned for every segment; plans faster than the robot moves",
}
OPTIONS = {
    "search": ("heuristic", "weight", "ensemble", "on", "seed"),
    "interpolate": ("skills", "hold", "blend"),
    "sequence": ("plan", "seconds"),
    "ddpg": ("seed", "iterations", "latents", "on"),
    "ppo": ("seed", "iterations", "on"),
    "mpc": ("seed", "lookahead", "ensemble", "on"),
}
MORE = {  # what to try where a waypoint is missed
    "search": "try --set search.budget=50000 or search.interpolated=true",
    "interpolate": "hold longer with --hold and --blend",
    "sequence": "give its entries more time, or let --method search find a plan",
    "ddpg": "try more --iterations, or another --seed",
    "ppo": "try more --iterations, or another --seed",
    "mpc": "look further ahead with --lookahead, or try --set mpc.samples=200",
}
SPECIAL = {name for names in OPTIONS.values() for name in names}
HEURISTICS: Mapping[str, Sequence[str]] = {
    "none": ("search.weight=0",),
    "distance": ("search.approach_speed=0",),
    "approach": ("search.approach_speed=1.0",),
}

# Time on the target is what a plan made there costs: one node at a time, greedily, over the means, and no finer than needed.
ON_TARGET = (
    "search.batch=1", "search.weight=1000", "search.interpolated=false", "search.grid=0", "search.goal_tolerance=0.035",
)  # fmt: skip


class ByMethod(TyperCommand):
    """A command whose options depend on the value of --method."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """See click; refuses options that belong to another method."""
        named = _named(args)
        ctx.meta["method"] = named if named is not None or "--help" in args else "search"
        if ctx.meta["method"] is not None:
            refuse_strays(ctx.meta["method"], args)
        return super().parse_args(ctx, args)

    def get_params(self, ctx: Any) -> list[Any]:
        """See click: those of every method, and those of the chosen one."""
        own = OPTIONS.get(ctx.meta.get("method") or "", ())
        return [param for param in super().get_params(ctx) if param.name not in SPECIAL or param.name in own]

    def format_help(self, ctx: Any, formatter: Any) -> None:
        """See click; says which methods there are, or what the chosen one is."""
        method, before = ctx.meta.get("method"), self.help
        if method is None:
            listed = "\n\n".join(f"[bold]{name}[/]: {about}" for name, about in ABOUT.items())
            self.help = f"{before}\n\n`--method NAME --help` shows what a method takes. Methods:\n\n{listed}"
        else:
            self.help = f"{before}\n\n[bold]{method}[/]: {ABOUT[method]}. More to set: --set {method}.KEY=VALUE."
        try:
            super().format_help(ctx, formatter)
        finally:
            self.help = before


def refuse_strays(method: str, args: Sequence[str]) -> None:
    """Refuse an unknown method, and options that belong to others.

    Raises:
        UsageError: there is one.
    """
    if method not in OPTIONS:
        raise UsageError(f"no method {method!r}", f"methods: {', '.join(OPTIONS)}")
    for word in args:
        option = word.partition("=")[0].removeprefix("--")
        if word.startswith("--") and option in SPECIAL and option not in OPTIONS[method]:
            owners = " or ".join(name for name, options in OPTIONS.items() if option in options)
            own = ", ".join(f"--{name}" for name in OPTIONS[method])
            raise UsageError(f"--{option} belongs to --method {owners}, not to {method}", f"{method} takes {own}")


def settings(method: str, options: Mapping[str, Any]) -> list[str]:
    """The options of a method as recipe settings, `ddpg.iterations=50` say; what is None was not given.

    Raises:
        UsageError: an unknown heuristic, or a plan in a file that cannot be read.
    """
    found: list[str] = []
    for name in OPTIONS[method]:
        value = options[name]
        if value is None or name in ("seed", "on"):
            continue
        if name == "ensemble":
            found.append(f"compose.ensemble={value}")
            continue
        if name == "heuristic":
            if value not in HEURISTICS:
                raise UsageError(f"no heuristic {value!r}", f"heuristics: {', '.join(HEURISTICS)}")
            found += HEURISTICS[value]
        else:
            found.append(f"{method}.{name}={json.dumps(plan_text(value) if name == 'plan' else value)}")
    return found


def plan_text(plan: str) -> str:
    """A plan as typed, or what is in the file that is named.

    Raises:
        UsageError: it looks like a file and cannot be read.
    """
    path = Path(plan)
    if not ("/" in plan or path.suffix in (".txt", ".plan") or (len(plan) < 256 and path.is_file())):
        return plan
    try:
        return path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        reason = error.strerror if isinstance(error, OSError) else "it is no text"
        raise UsageError(
            f"plan file {plan!r} cannot be read: {reason}", "a plan is text, such as 3:1.0,3~4:1.0,4:1.0"
        ) from None


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
