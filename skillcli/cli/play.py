"""The command that plays a library by hand in the browser: play."""

from __future__ import annotations

from concurrent.futures import Future, ThreadPoolExecutor
from importlib.util import find_spec
from typing import TYPE_CHECKING, Annotated

import typer

from skillcli.cli import complete, typed
from skillcli.cli.session import Session
from skillcli.cli.stages import MADE_FROM, Name, Seed, checked
from skillcli.errors import SkillError
from skillcli.plaintext import line

if TYPE_CHECKING:
    from skillcli.store import Artifact


def register(app: typer.Typer) -> None:
    """Add the command to the app."""
    app.command(rich_help_panel="Look")(play)


def play(
    context: typer.Context,
    source: Annotated[str | None, typer.Argument(metavar="[ID]", help=MADE_FROM, autocompletion=complete.ids)] = None,
    port: Annotated[
        int | None, typer.Option("--port", help="Port to serve on; by default the first free one from 8080.", min=1, max=65535)
    ] = None,
    seed: Seed = 0,
    name: Name = None,
) -> None:
    """Play a library in the browser: hold skills and latents, drag a goal, plan, change the robot, record. Ctrl-C ends it."""
    session: Session = context.obj
    from skillcli.kinds import PLAY

    usual, *others = PLAY.made_from
    found = session.pick(source, usual, *others)
    if find_spec("viser") is None:
        raise SkillError("play needs viser, which is not installed", "pip install 'skillcli[play]'")
    folder, store = checked(name), session.store
    store.check_writable(folder or found.name)
    from skillcli.evaluation.library import open_library
    from skillcli.stages.play import store_take
    from skillcli.stopping import stoppable
    from skillcli.viz.play.loop import Rate
    from skillcli.viz.play.serve import serve
    from skillcli.viz.play.session import PlaySession
    from skillcli.viz.play.take import Take

    artifact = store.read(found)
    library = open_library(store, artifact)
    stored: list[Future[Artifact]] = []

    def write(take: Take) -> Artifact:
        try:
            written = store_take(store, found, library, take, session.command, folder, seed)
        except SkillError as error:
            played.say(f"not stored: {error.message}")
            raise
        played.say(f"stored as {written.id}")
        return written

    def ready(url: str) -> None:
        shown = f"{found} plays at {url} (this machine only; all browsers share one arm). Ctrl-C ends it."
        session.result({"id": str(found), "url": url}, shown)

    with ThreadPoolExecutor(1) as writer:  # a disk must not make the arm wait
        played = PlaySession(library, lambda take: stored.append(writer.submit(write, take)), seed)
        with stoppable() as stop:
            arrays = artifact.arrays
            places = (arrays["map/end"], arrays["map/latent"]) if "map/end" in arrays else None
            serve(played, f"skill play {found}", port, places, ready, lambda: stop.requested, Rate())
    _told(session, stored)


def _told(session: Session, stored: list[Future[Artifact]]) -> None:
    """Say what was recorded.

    Raises:
        StoreError: a take could not be stored.
    """
    from skillcli.cli.tables import table_of

    written = [future.result() for future in stored if future.exception() is None]
    if not session.json:
        for artifact in written:
            session.err.print(table_of(artifact))
    ids = [str(artifact.id) for artifact in written]
    said = f"recorded: {', '.join(ids)}; `skill viz {ids[-1]} --open` shows it" if ids else "nothing was recorded"
    session.err.print(line(typed.runnable(said)), soft_wrap=True)
    for future in stored:
        future.result()
