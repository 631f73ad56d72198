"""Draw docs/terminal.svg: `skill pretrain` on a terminal, half-way through a real training and when it is done.

python -m tests.picture_terminal [RECIPE]
"""

from __future__ import annotations

import io
import sys
from pathlib import Path
from tempfile import TemporaryDirectory

from rich.console import Console

from skillcli.cli import progress_view, tables
from skillcli.progress import Progress
from skillcli.recipe import load_recipe
from skillcli.stages.pretrain import pretrain
from skillcli.store import Store

WIDTH = 84
PLACE = Path(__file__).parents[1] / "docs" / "terminal.svg"


def picture(recipe: str, place: Path) -> None:
    """Train the recipe into a folder that is thrown away, and write the picture."""
    resolved, clock = load_recipe(recipe), progress_view.Clock()
    kept: list[tuple[Progress, str]] = []
    with TemporaryDirectory() as folder:
        artifact = pretrain(
            Store(Path(folder)), resolved, 0, resolved.name, f"skill pretrain {recipe}",
            on_progress=lambda progress: kept.append((progress, clock.left(progress))),
        )  # fmt: skip
    console = Console(record=True, width=WIDTH, file=io.StringIO(), force_terminal=True)
    console.print(f"[bold]$ skill pretrain {recipe}[/]", highlight=False)
    console.print(progress_view.panel(*kept[len(kept) // 2]))
    console.print("[dim]… and when it is done:[/]", highlight=False)
    console.print(tables.pretrain(artifact), highlight=False)
    console.save_svg(str(place), title="skill")


if __name__ == "__main__":
    picture(sys.argv[1] if len(sys.argv) > 1 else "point", PLACE)
