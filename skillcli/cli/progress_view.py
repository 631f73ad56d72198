"""Show progress: as lines, as a live panel in the terminal, or as scalars for TensorBoard."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

from skillcli.errors import SkillError

if TYPE_CHECKING:  # imported only if needed: `skill --help` must be instant
    from rich.console import Console, RenderableType
    from rich.text import Text

    from skillcli.progress import OnProgress, Progress

PLAIN_SECONDS = 10.0  # between progress lines without a terminal
WHOLE_BAR, BAR = 40, 6  # characters of the bar of the whole work, and of a skill's
NAME = 12  # characters of a skill's name


@contextmanager
def live(console: Console) -> Iterator[OnProgress]:
    """Show a panel that is redrawn in place and removed at the end."""
    from rich.live import Live

    clock = Clock()
    with Live(console=console, refresh_per_second=8, transient=True) as shown:
        yield lambda progress: shown.update(panel(progress, clock.left(progress)))


def plain(console: Console) -> OnProgress:
    """Print a line every few seconds, for pipes and files."""
    clock, last = Clock(), time.monotonic()

    def on_progress(progress: Progress) -> None:
        nonlocal last
        left, now = clock.left(progress), time.monotonic()
        if now - last >= PLAIN_SECONDS:
            last = now
            told = [*standing(progress, left), *speed(progress), *overall(progress)]
            console.print(" · ".join(told), highlight=False, markup=False, soft_wrap=True)

    return on_progress


class Clock:
    """Estimates the time left of a stage; a resumed stage does not count its earlier part.

    Between two units of work the estimate counts down, at most to the expected end of the unit. So it does not rise only
    because a unit takes long.
    """

    def __init__(self) -> None:
        self._stage, self._began, self._first = "", 0.0, 0
        self._done, self._moved = 0, 0.0  # units of work at the last change, and its time

    def left(self, progress: Progress) -> str:
        """Return minutes and seconds left, "?" while unknown."""
        now = time.monotonic()
        if progress.stage != self._stage:
            self._stage, self._began, self._first = progress.stage, now, progress.done
            self._done, self._moved = progress.done, now
        if progress.done != self._done:
            self._done, self._moved = progress.done, now
        done = progress.done - self._first
        if done <= 0:
            return "?"
        each = (self._moved - self._began) / done
        seconds = max(0, round(each * (progress.total - progress.done) - min(each, now - self._moved)))
        return f"{seconds // 60}:{seconds % 60:02d}"


def standing(progress: Progress, left: str) -> list[str]:
    """Describe how much is done, and the time left."""
    return [f"{progress.stage} {progress.done}/{progress.total} {progress.unit}", f"{left} left"]


def speed(progress: Progress) -> list[str]:
    """Describe the speed and its share of the bare engine; nothing if it was not measured."""
    rate = [f"{progress.rate:,.0f} steps/s"] if progress.rate else []
    return rate + ([f"{progress.physics_share:.0%} of raw physics"] if progress.physics_share is not None else [])


def overall(progress: Progress) -> list[str]:
    """Describe the success over all skills, and the stage's note."""
    mean = [f"success {sum(progress.success.values()) / len(progress.success):.0%}"] if progress.success else []
    return mean + ([progress.note] if progress.note else [])


def panel(progress: Progress, left: str) -> RenderableType:
    """Show progress as a bar, with the success of each skill as a small bar below, in as many columns as fit."""
    from rich.columns import Columns
    from rich.console import Group
    from rich.text import Text

    lines = [standing(progress, left), speed(progress), overall(progress)]
    head = [Text(" · ".join(parts), overflow="ellipsis", no_wrap=True) for parts in lines if parts]
    width = min(NAME, max(map(len, progress.success), default=0))
    skills = Columns([skill_bar(name, share, width) for name, share in progress.success.items()], padding=(0, 3))
    return Group(head[0], _bar(progress.done / progress.total, WHOLE_BAR, "cyan"), *head[1:], skills)


def skill_bar(name: str, share: float, width: int) -> Text:
    """Show a name in `width` characters, a bar and a number, readable without colours."""
    from rich.text import Text

    style = "green" if share >= 0.95 else "yellow" if share >= 0.5 else "red"
    short = name if len(name) <= width else f"{name[: width - 1]}…"
    text = Text(f"{short:<{width}} ", no_wrap=True)
    return text.append(_bar(share, BAR, style)).append(f" {share:4.0%}", style)


def _bar(share: float, width: int, style: str) -> Text:
    from rich.text import Text

    filled = round(width * share)
    return Text("━" * filled, style, no_wrap=True).append("╌" * (width - filled), "dim")


@contextmanager
def tensorboard(folder: Path, on_progress: OnProgress) -> Iterator[OnProgress]:
    """Also write every point of the learning curves below `folder`, over control steps.

    A resumed training writes a second file beside the first, and its steps continue.

    Raises:
        SkillError: the package is not installed, or the folder cannot be written.
    """
    try:
        from tensorboard.summary import Writer
    except ImportError as error:
        raise SkillError("--tensorboard: the package is not installed", "pip install 'skillcli[tensorboard]'") from error
    try:
        folder.mkdir(parents=True, exist_ok=True)
        writer = Writer(str(folder))
    except OSError as error:
        raise SkillError(f"--tensorboard: cannot write {folder}: {error.strerror or error}", "choose another folder") from error

    def both(progress: Progress) -> None:
        for name, value in progress.scalars.items():
            if name != "env_steps":
                writer.add_scalar(name, value, int(progress.scalars["env_steps"]))
        on_progress(progress)

    try:
        yield both
    finally:
        writer.close()
