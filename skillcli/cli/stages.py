"""Commands that make artifacts: pretrain, embed-means, compose, transfer-eval, run and demo."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from skillcli.cli import complete, progress_view, typed
from skillcli.cli.methods import OWN, ByMethod, option
from skillcli.cli.played import played_plans
from skillcli.cli.session import Session
from skillcli.composition.registry import DEFAULT, METHODS, method_spec
from skillcli.errors import Interrupted, UsageError

if TYPE_CHECKING:
    from skillcli.store import Artifact

Set = Annotated[
    list[str] | None,
    typer.Option("--set", help="Replace one value of the recipe, such as training.iterations=20.", metavar="KEY=VALUE"),
]
Name = Annotated[str | None, typer.Option("--name", help="First part of the new id.", metavar="NAME")]
Seed = Annotated[int, typer.Option("--seed", help="Seed of everything random.", min=0, max=2**63 - 1)]
MADE_FROM = "Id, NAME/STAGE or a unique prefix; by default the newest that fits."


def register(app: typer.Typer) -> None:
    """Add the commands to the app."""
    panel = "Stages"
    app.command(rich_help_panel=panel)(pretrain)
    app.command(rich_help_panel=panel)(embed_means)
    app.command(rich_help_panel=panel, cls=ByMethod)(compose)
    app.command(rich_help_panel=panel)(transfer_eval)
    app.command("run", rich_help_panel="Whole chain")(run)
    app.command(rich_help_panel="Whole chain")(demo)


def payload(artifact: Artifact) -> dict[str, Any]:
    """Return the JSON result of a stage: id and results."""
    return {
        "id": str(artifact.id),
        "recipe": artifact.recipe_name,
        "seed": artifact.seed,
        **artifact.results,
        **artifact.measured,
    }


def pretrain(
    context: typer.Context,
    recipe: Annotated[str, typer.Argument(help="Recipe by name, or a .toml file.")] = "reach",
    seed: Seed = 0,
    name: Name = None,
    robot: Annotated[
        str | None,
        typer.Option("--robot", help="Train on this arm: a name of `skill robots`, or a robot file.", metavar="NAME|FILE"),
    ] = None,
    overrides: Set = None,
    resume: Annotated[bool, typer.Option("--resume", help="Continue the same training after an interruption.")] = False,
    threads: Annotated[
        int, typer.Option("--threads", help="Threads of the physics, 0 for all cores; same results.", min=0, max=1024)
    ] = 0,
    tensorboard: Annotated[
        Path | None, typer.Option("--tensorboard", help="Also write the learning curves there for TensorBoard.", metavar="DIR")
    ] = None,
) -> None:
    """Train policy and skill embedding together in simulation (stage 1)."""
    from skillcli.api.work import train
    from skillcli.evaluation.inputs import pretrain_inputs
    from skillcli.kinds import PRETRAIN
    from skillcli.recipe import load_recipe
    from skillcli.tasks.world import World

    session: Session = context.obj
    resolved = load_recipe(recipe, overrides or (), robot)
    folder = checked(name) or resolved.name
    inputs = pretrain_inputs(resolved, World.of(resolved), seed) if resume else ""
    if resume and not session.store.checkpoint_path(folder, PRETRAIN.name, inputs).exists():
        session.say("there is no interrupted training with this recipe, seed and name: starting a new one")
    with ExitStack() as opened:
        on_progress = opened.enter_context(session.progress())
        if tensorboard:
            on_progress = opened.enter_context(progress_view.tensorboard(tensorboard, on_progress))
        trained = train(
            resolved, seed=seed, name=folder, store=session.store, resume=resume, threads=threads,
            command=session.command, on_progress=on_progress,
        )  # fmt: skip
    _done(session, trained.artifact, f"skill embed-means {trained.id}")


def embed_means(
    context: typer.Context,
    source: Annotated[str | None, typer.Argument(metavar="[ID]", help=MADE_FROM, autocompletion=complete.ids)] = None,
    name: Name = None,
) -> None:
    """Compute the mean latent of each skill, measure how well the skills are separated, and run each mean."""
    session: Session = context.obj
    from skillcli.kinds import EMBED_MEANS

    found = session.pick(source, *EMBED_MEANS.made_from)
    from skillcli.stages.embed_means import embed_means as stage

    with _whole(EMBED_MEANS.name):
        artifact = stage(session.store, found, session.command, checked(name))
    _done(session, artifact, f"skill compose {artifact.id} --method {DEFAULT}")


def compose(
    context: typer.Context,
    source: Annotated[str | None, typer.Argument(metavar="[ID]", help=MADE_FROM, autocompletion=complete.ids)] = None,
    method: Annotated[str, typer.Option("--method", help=f"Method: {', '.join(METHODS)}.", metavar="NAME")] = DEFAULT,
    task: Annotated[str, typer.Option("--task", help="A named composition, see `skill tasks`.", metavar="NAME")] = "",
    goal: Annotated[
        list[str] | None,
        typer.Option("--goal", help="Goal, m (push: displacement of the box); several are met in order.", metavar="X,Y[,Z]"),
    ] = None,
    name: Name = None,
    overrides: Set = None,
    seed: Annotated[int, option("Seed of everything random, 0 by default.", min=0, max=2**63 - 1)] = 0,
    ensemble: Annotated[
        int | None, option("Robots that try every latent at once; a plan must work on all.", min=0, metavar="N")
    ] = None,
    on: Annotated[str, option("Plan on one robot drawn from this domain, see `skill domains`.", metavar="DOMAIN")] = "",
) -> None:
    """Compose frozen skills in the latent space into a task that was never trained (stage 2)."""
    session: Session = context.obj
    goals = [_numbers(text) for text in goal or ()]
    spec = method_spec(method)
    from skillcli.kinds import COMPOSE

    found = session.pick(source, *COMPOSE.made_from)
    context.meta[OWN] |= played_plans(session, found, spec, context.meta[OWN])
    chosen = spec.overrides(context.meta[OWN]) + ([] if ensemble is None else [f"compose.ensemble={ensemble}"])
    if on and ensemble:
        raise UsageError("--on plans on one target, --ensemble on several robots", "leave one of them out")
    from skillcli.cli.tables import where
    from skillcli.evaluation.consistency import stored_recipe
    from skillcli.evaluation.request import Request, in_its_scene
    from skillcli.stages.compose import compose as stage

    chosen = [*(spec.overrides_on_target if on else ()), *(overrides or ()), *chosen]
    recipe = in_its_scene(stored_recipe(session.store.read(found), chosen), task, goals)
    request = Request.of(recipe, task, goals, method)
    with _whole(COMPOSE.name), session.progress() as on_progress:
        artifact = stage(session.store, found, recipe, request, method, session.command, checked(name), on_progress, seed, on)
    planned = COMPOSE.results_of(artifact)
    for note in planned.notes or ():
        session.say(note, "yellow")
    if not planned.waypoints_met:
        session.say(f"the plan does not meet every waypoint: {spec.hint}", "yellow")
    for violation in planned.broken:
        session.say(f"the plan violates a safety limit, so it has failed: {where(violation)}", "yellow")
    if planned.broken:
        session.say(f"`skill viz {artifact.id} --open` shows it; plan without that skill, or with another --method or --goal")
    _done(session, artifact, f"skill transfer-eval {artifact.id}")


def transfer_eval(
    context: typer.Context,
    source: Annotated[str | None, typer.Argument(metavar="[ID]", help=MADE_FROM, autocompletion=complete.ids)] = None,
    domain: Annotated[
        list[str] | None, typer.Option("--domain", help="Target domain, see `skill domains`, or a file.", metavar="NAME|FILE")
    ] = None,
    episodes: Annotated[int | None, typer.Option("--episodes", help="Per domain.", min=1, max=10_000)] = None,
    replan: Annotated[
        bool, typer.Option("--replan", help="After every segment, measure the state of the target and plan again from there.")
    ] = False,
    robot: Annotated[
        Path | None, typer.Option("--robot", help="Robot file of another robot to run on (docs/robots.md).", metavar="FILE")
    ] = None,
    sensitivity: Annotated[
        bool, typer.Option("--sensitivity", help="Also run every domain with each of its parameters alone.")
    ] = False,
    seed: Seed = 0,
    name: Name = None,
    overrides: Set = None,
) -> None:
    """Run a composition, or bare skills, on robots that differ from the simulation (stage 3)."""
    session: Session = context.obj
    from skillcli.kinds import TRANSFER_EVAL

    usual, *others = TRANSFER_EVAL.made_from
    found = session.pick(source, usual, *(others if source else ()))
    from skillcli.api.work import evaluate

    other = None
    if robot is not None:
        from skillcli.evaluation.consistency import stored_recipe
        from skillcli.robots.robot import load_robot, load_target

        other = load_target(robot, load_robot(stored_recipe(session.store.read(found)).robot))
        for note in other.notes:
            session.say(f"{robot}: {note}")
    with _whole(TRANSFER_EVAL.name), session.progress() as on_progress:
        evaluated = evaluate(
            str(found), domain or (), episodes=episodes, replan=replan, robot=other, settings=overrides or (),
            sensitivity=sensitivity, seed=seed, name=checked(name), store=session.store,
            command=session.command, on_progress=on_progress,
        )  # fmt: skip
    then = f"skill viz {evaluated.id} --open   # the worst domain first, and in it the worst episode"
    _done(session, evaluated.artifact, then)


def run(
    context: typer.Context,
    recipe: Annotated[str, typer.Argument(help="Recipe by name, or a .toml file.")],
    seed: Seed = 0,
    name: Name = None,
    overrides: Set = None,
) -> None:
    """Run a recipe from training to transfer; finished stages with unchanged inputs are reused."""
    _chain(context.obj, recipe, seed, name, overrides)


def demo(
    context: typer.Context,
    seed: Seed = 0,
) -> None:
    """Run the main example on the Sawyer: train, compose, transfer; write a recording, figures and a table."""
    from skillcli.recipe import load_recipe

    session: Session = context.obj
    recipe = load_recipe("reach")
    began, training = time.monotonic(), recipe.training
    steps = training.iterations * training.simulations * recipe.task.horizon
    session.say(
        f"to come: {steps:,} control steps of training, a plan, transfer to other robots, figures; all in {session.root}/demo"
    )
    _chain(session, "reach", seed, "demo", None)
    session.say(f"total time {time.monotonic() - began:.0f} s")


def _chain(session: Session, recipe: str, seed: int, name: str | None, overrides: list[str] | None) -> None:
    from skillcli.cli.tables import table_of
    from skillcli.kinds import COMPOSE
    from skillcli.recipe import load_recipe
    from skillcli.stages.chain import run_chain
    from skillcli.viz.visualise import draw, record

    resolved = load_recipe(recipe, overrides or ())
    folder = checked(name) or resolved.name
    reports: dict[str, Any] = {}
    with session.progress() as on_progress:
        for link in run_chain(session.store, resolved, seed, folder, session.command, on_progress):
            if link.reused:
                session.say(f"{link.artifact.id}: unchanged, reused")
            reports[link.artifact.kind] = {**payload(link.artifact), "reused": link.reused}
            if not session.json:
                session.result({}, table_of(link.artifact))
    store, pictures = session.store, []
    for kind, found in reports.items():
        path = session.root / folder / f"{kind}.png"
        draw(store, store.resolve(found["id"]), path)
        pictures.append(str(path))
    plan = reports[COMPOSE.name]["id"]
    recording = session.root / folder / f"{COMPOSE.name}.rrd"
    record(store, store.resolve(plan), recording)
    session.result(
        {**reports, "png": pictures, "rrd": str(recording)},
        f"figures: {', '.join(pictures)}",
        typed.runnable(f"recording: {recording} (open it with `skill viz {plan} --open`)"),
    )


def checked(name: str | None) -> str | None:
    """Return the first part of a new id if it is valid.

    Raises:
        UsageError: it is not.
    """
    from skillcli.errors import StoreError
    from skillcli.store.ids import check_name

    if name is not None:
        try:
            check_name(name)
        except StoreError as error:
            raise UsageError(f"--name {name!r} cannot be part of an id", error.hint) from None
    return name


def _numbers(text: str) -> list[float]:
    try:
        return [float(part) for part in text.split(",")]
    except ValueError:
        hint = "for example --goal 0.6,0.0,0.2 for reach, --goal 0.1,-0.1 for push"
        raise UsageError(f"--goal {text!r}: expected numbers in metres", hint) from None


@contextmanager
def _whole(stage: str) -> Iterator[None]:
    """Report an interrupted stage that leaves no result."""
    try:
        yield
    except KeyboardInterrupt:
        hint = "its inputs are in the store; run the same command again"
        raise Interrupted(f"interrupted: nothing of this {stage} was kept", hint) from None


def _done(session: Session, artifact: Artifact, then: str) -> None:
    """Print the result of a finished stage, and propose the next command."""
    from rich.text import Text

    from skillcli.cli.tables import table_of

    proposed = Text(typed.runnable(f"next: {then}"), "dim")
    session.result(payload(artifact), table_of(artifact), proposed)
