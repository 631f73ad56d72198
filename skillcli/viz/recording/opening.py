"""How a recording opens: which views there are, where they stand, and from where they look."""

from __future__ import annotations

import numpy as np
import rerun.blueprint as rrb

from skillcli.trajectories import Array
from skillcli.viz import motion
from skillcli.viz.recording.layout import curve_path, in_space, slug, spread
from skillcli.viz.scene import Scene

SERIES = ("distance", "reward", "success", "action_norm", "latent", "joint_speed")
MAX_LEGEND = 4  # a longer legend hides the plot; names are still shown under the mouse
_UNITS = {"distance": "m", "action_norm": "rad per step", "joint_speed": "rad/s"}


def _eye(points: Array, flat: bool) -> rrb.EyeControls3D:
    """Look at the points: from above when they lie in a plane, else from the front and the right of the robot."""
    low, high = points.min(axis=0), points.max(axis=0)
    center, reach = (low + high) / 2, float(np.linalg.norm(high - low)) or 1.0
    away = np.array([0.0, 0.0, 0.85]) if flat else np.array([0.66, -0.58, 0.44])
    return rrb.EyeControls3D(
        kind=rrb.Eye3DKind.Orbital,
        position=center + reach * away,
        look_target=center,
        eye_up=(0.0, 1.0, 0.0) if flat else (0.0, 0.0, 1.0),
    )


def blueprint(scene: Scene) -> rrb.Blueprint:
    """Space left and large; latent space, series and provenance to its right."""
    right = rrb.Vertical(_latent_view(scene), _series_tabs(scene), _notes(scene), row_shares=[3, 3, 2])
    return rrb.Blueprint(
        rrb.Horizontal(_space_views(scene), right, column_shares=[3, 2]),
        rrb.TimePanel(state="collapsed", timeline="sim_time", play_state="playing", loop_mode="all"),
        rrb.BlueprintPanel(state="collapsed"),
        rrb.SelectionPanel(state="collapsed"),
        auto_views=False,
        auto_layout=False,
    )


def _space_views(scene: Scene) -> rrb.View | rrb.Container:
    """One view, and in a transfer one more per domain."""
    eye = _eye(spread(scene), flat=scene.model is None)
    everything = rrb.Spatial3DView(origin="/world", name=scene.title, eye_controls=eye)
    if scene.kind != "transfer-eval":
        return everything
    single = [
        rrb.Spatial3DView(
            origin="/world",
            contents=["+ $origin/**", "- $origin/paths/**", f"+ $origin/paths/{slug(name)}/**"],
            name=name,
            eye_controls=eye,
        )
        for name in motion.domains(scene)
    ]
    return rrb.Tabs(everything, *single)


def _latent_view(scene: Scene) -> rrb.View:
    corners = np.concatenate([in_space(scene.means - scene.stds), in_space(scene.means + scene.stds), np.zeros((1, 3))])
    return rrb.Spatial3DView(origin="/latent", name="latent space", eye_controls=_eye(corners, flat=scene.means.shape[-1] < 3))


def _series_tabs(scene: Scene) -> rrb.Container:
    names = [name for name in SERIES if name != "joint_speed" or scene.trajectories.joint_position is not None]
    few = len(motion.played(scene)) <= MAX_LEGEND
    views = [
        rrb.TimeSeriesView(
            origin=f"/series/{name}",
            name=_series_title(scene, name),
            plot_legend=rrb.PlotLegend(rrb.Corner2D.RightTop, visible=few or name in ("latent", "joint_speed")),
        )
        for name in names
    ]
    return rrb.Tabs(*views)


def _series_title(scene: Scene, name: str) -> str:
    unit = "m per step" if name == "action_norm" and scene.task == "point" else _UNITS.get(name, "")
    return f"{name.replace('_', ' ')} [{unit}]" if unit else name


def _notes(scene: Scene) -> rrb.Container:
    """Provenance, and a view per learning curve; these need another timeline, which their names say."""
    provenance = rrb.TextDocumentView(origin="/provenance", name="provenance")
    groups: dict[str, list[str]] = {}
    for name in scene.curves:
        if name != "env_steps":
            groups.setdefault(name.split("/")[0].removesuffix("_rate"), []).append(f"/learning/{curve_path(name)}")
    views = [
        rrb.TimeSeriesView(origin="/learning", contents=paths, name=f"{name.replace('_', ' ')} (timeline: iteration)")
        for name, paths in groups.items()
    ]
    return rrb.Tabs(provenance, *views)
