"""The initial layout of a recording: its views, their places, and the viewpoints."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import rerun.blueprint as rrb

from skillcli.kinds import COMPOSE, EMBED_MEANS, EXECUTION, PLAY, PRETRAIN, TRANSFER_EVAL, ByKind
from skillcli.trajectories import Array
from skillcli.viz import motion
from skillcli.viz.recording.entities import curve_path, in_space, slug, spread
from skillcli.viz.scene import Runs, Scene
from skillcli.viz.viewpoint import viewpoint

SERIES = ("distance", "latent", "reward", "success", "action_norm", "joint_speed", "violations")
FIRST_CURVES = ("success", "final_distance", "return", "reward", "kl")
TITLES = {"reward": "terms of the reward, per episode"}  # of views whose curves do not say it
LATENT_BACK = 1.5  # the latent view is wide and low: all of it is visible only from further back
MAX_LEGEND = 4  # a longer legend hides the plot; the viewer still shows names under the mouse
LAYOUTS: ByKind[Callable[[Scene], rrb.Container]] = ByKind("recording")
_UNITS = {"distance": "m", "action_norm": "rad per step", "joint_speed": "rad/s"}


def _eye(points: Array, flat: bool, back: float = 1.0) -> rrb.EyeControls3D:
    """Look at the points: from above if they lie in a plane, else from the front and the right of the robot."""
    view = viewpoint(points, flat, back)
    return rrb.EyeControls3D(
        kind=rrb.Eye3DKind.Orbital,
        position=view.position,
        look_target=view.target,
        eye_up=view.up,
    )


def blueprint(scene: Scene) -> rrb.Blueprint:
    """Lay out the views of an artifact's kind: skills, the latent space, the plan, or two robots side by side."""
    return rrb.Blueprint(
        LAYOUTS.of(scene.kind)(scene),
        rrb.TimePanel(state="collapsed", timeline="sim_time", play_state="playing", loop_mode="all"),
        rrb.BlueprintPanel(state="collapsed"),
        rrb.SelectionPanel(state="collapsed"),
        auto_views=False,
        auto_layout=False,
    )


@LAYOUTS.register(PRETRAIN)
def _trained(scene: Scene) -> rrb.Container:
    """Show skills in space beside their latents; learning curves are behind a tab, because they have another timeline."""
    right = rrb.Vertical(_latent_view(scene), rrb.Tabs(*_series(scene)), _notes(scene), row_shares=[3, 3, 2])
    skills = rrb.Horizontal(_space_view(scene), right, column_shares=[3, 2], name="skills")
    if not (curves := _curve_views(scene)):
        return skills
    return rrb.Tabs(skills, rrb.Grid(*curves, name="learning (choose the timeline iteration below)"))


@LAYOUTS.register(EMBED_MEANS)
def _embedded(scene: Scene) -> rrb.Container:
    """Show the latent space large, and the motion of each latent beside it."""
    left = rrb.Vertical(_latent_view(scene), rrb.Tabs(*_series(scene)), row_shares=[2, 1])
    right = rrb.Vertical(_space_view(scene), _notes(scene), row_shares=[2, 1])
    return rrb.Horizontal(left, right)


@LAYOUTS.register(COMPOSE, PLAY)
def _composed(scene: Scene) -> rrb.Container:
    """Show the plan in space, in the latent space and over time."""
    first, *others = _series(scene)
    right = rrb.Vertical(_latent_view(scene), rrb.Tabs(first, *others[1:]), others[0], _notes(scene), row_shares=[3, 2, 2, 2])
    return rrb.Horizontal(_space_view(scene), right, column_shares=[3, 2])


@LAYOUTS.register(TRANSFER_EVAL, EXECUTION)
def _transferred(scene: Scene) -> rrb.Container:
    """Show source and target at the same time; below them their distances, the latent, and the robot's parameters."""
    paths = [_space_view(scene, "all paths"), *(_space_view(scene, name, slug(name)) for name in motion.domains(scene))]
    robots = [rrb.Tabs(_target_view(scene), *paths)]
    if scene.source is not None:
        robots.insert(0, rrb.Tabs(_source_view(scene)))
    below = rrb.Horizontal(rrb.Tabs(*_series(scene)), _latent_view(scene), _notes(scene), column_shares=[3, 2, 3])
    return rrb.Vertical(rrb.Horizontal(*robots), below, row_shares=[3, 2])


def _space_view(scene: Scene, name: str = "", folder: str = "") -> rrb.View:
    """Show everything in space; with a folder only the paths in it."""
    hidden = ["- $origin/executed/**", "- $origin/planned/**"]
    if folder:
        hidden += ["- $origin/paths/**", f"+ $origin/paths/{folder}/**"]
    eye = _eye(spread(scene), flat=scene.model is None)
    return rrb.Spatial3DView(origin="/world", contents=["+ $origin/**", *hidden], name=name or scene.title, eye_controls=eye)


def _target_view(scene: Scene) -> rrb.View:
    """Show the playing episode on its robot, its path beside the planned one."""
    contents = ["+ $origin/**", "- $origin/paths/**"]
    eye = _eye(spread(scene), flat=scene.model is None)
    robot = f"{scene.other_robot}{'' if scene.drawn else ', not drawn'}; " if scene.other_robot else ""
    return rrb.Spatial3DView(
        origin="/world", contents=contents, name=f"target ({robot}white: the planned path)", eye_controls=eye
    )


def _source_view(scene: Scene) -> rrb.View:
    """Show the same commands in the simulation in which they were planned."""
    contents = ["+ $origin/**", "+ /world/goals/**", "+ /world/waypoints/**"]
    eye = _eye(spread(scene), flat=scene.model is None)
    return rrb.Spatial3DView(origin="/source", contents=contents, name="source (as planned)", eye_controls=eye)


def _latent_view(scene: Scene) -> rrb.View:
    """Show the latent space, from above if it has two components: in a 2-D view y would point down."""
    size = scene.means.shape[-1]
    corners = np.concatenate([in_space(scene.means - scene.stds), in_space(scene.means + scene.stds), np.zeros((1, 3))])
    name = "latent space" + (f" (the first 3 of {size} components)" if size > 3 else "")
    return rrb.Spatial3DView(origin="/latent", name=name, eye_controls=_eye(corners, flat=size < 3, back=LATENT_BACK))


def _series(scene: Scene) -> list[rrb.View]:
    """Return one view per quantity that changes over control steps, in the order of `SERIES`."""
    data = scene.trajectories
    absent = {"joint_speed": data.joint_position is None, "violations": data.violated is None}
    names = [name for name in SERIES if not absent.get(name)]
    few = len(motion.played(scene)) <= MAX_LEGEND
    return [
        rrb.TimeSeriesView(
            origin=f"/series/{name}",
            name=_series_title(scene, name),
            plot_legend=rrb.PlotLegend(rrb.Corner2D.RightTop, visible=few or name in ("latent", "joint_speed", "violations")),
        )
        for name in names
    ]


def _series_title(scene: Scene, name: str) -> str:
    unit = scene.figure_settings.action_unit if name == "action_norm" else _UNITS.get(name, "")
    return f"{name.replace('_', ' ')} [{unit}]" if unit else name


def _notes(scene: Scene) -> rrb.Container:
    """Show the origin, and the facts about the playing episode; in a transfer the episode first."""
    provenance = rrb.TextDocumentView(origin="/provenance", name="provenance")
    episode = rrb.TextDocumentView(origin="/episode", name="episode")
    return rrb.Tabs(*((episode, provenance) if scene.runs is Runs.DOMAINS else (provenance, episode)))


def _curve_views(scene: Scene) -> list[rrb.View]:
    """Return a view per learning curve, those of all skills in one."""
    groups: dict[str, list[str]] = {}
    for name in sorted(scene.curves, key=lambda name: not name.startswith(FIRST_CURVES)):
        if name != "env_steps":
            groups.setdefault(name.split("/")[0].removesuffix("_rate"), []).append(f"/learning/{curve_path(name)}")
    return [
        rrb.TimeSeriesView(origin="/learning", contents=paths, name=TITLES.get(name, name.replace("_", " ")))
        for name, paths in groups.items()
    ]
