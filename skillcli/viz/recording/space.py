"""Objects in space: goals, paths, the bodies of the robot."""

from __future__ import annotations

import numpy as np
import rerun as rr

from skillcli.trajectories import Array
from skillcli.viz import kinematics, motion
from skillcli.viz.meshes import Detail, Mesh, meshes
from skillcli.viz.palette import TARGET_IN_VIEWER, rgba
from skillcli.viz.recording.clock import Clock
from skillcli.viz.recording.entities import called, extent, group, key, skill_colors, slug
from skillcli.viz.scene import Scene

TOLERANCE_ALPHA = 64  # of 255
MANY = 6  # waypoints; beyond it labels are numbers alone


def log_goals(stream: rr.RecordingStream, scene: Scene) -> None:
    """Log the trained goals, and the waypoints; those to be reached have their tolerance around them."""
    composed = len(scene.waypoints) > 0
    colors = [rgba(color) for color in skill_colors(scene)]
    dot, around = scene.tolerance / 6, None if composed else scene.tolerance
    _log_spheres(stream, "world/goals", scene.goals, called(scene), colors, dot, around)
    if composed:
        centers, names = _numbered(scene.waypoints)
        white = [rgba(TARGET_IN_VIEWER)] * len(names)
        _log_spheres(stream, "world/waypoints", centers, names, white, dot, scene.tolerance)


def _numbered(waypoints: Array) -> tuple[Array, list[str]]:
    """Return distinct places among the waypoints, and their labels: a route may visit one place twice."""
    places, which = np.unique(waypoints, axis=0, return_inverse=True)
    orders = [np.flatnonzero(which.ravel() == place) + 1 for place in range(len(places))]
    word = "waypoint " if len(places) <= MANY else ""
    return places, [word + ", ".join(map(str, order)) for order in orders]


def _log_spheres(
    stream: rr.RecordingStream,
    entity: str,
    centers: Array,
    names: list[str],
    colors: list[tuple[int, int, int, int]],
    dot: float,
    tolerance: float | None,
) -> None:
    """Log labelled points of radius `dot` (m); with a tolerance (m) each inside a translucent sphere."""
    if not len(centers):
        return
    stream.log(f"{entity}/centers", rr.Points3D(centers, radii=dot, colors=colors), static=True)
    # a label has the colour of its point, and dark ones are unreadable on the viewer's background
    written = rr.Points3D(centers, radii=0, colors=rgba(TARGET_IN_VIEWER), labels=names, show_labels=True)
    stream.log(f"{entity}/names", written, static=True)
    if tolerance is None:
        return
    spheres = rr.Ellipsoids3D(
        centers=centers,
        half_sizes=np.full((len(centers), 3), tolerance),
        colors=[(*color[:3], TOLERANCE_ALPHA) for color in colors],
        fill_mode=rr.components.FillMode.Solid,
    )
    stream.log(f"{entity}/tolerance", spheres, static=True)


def log_paths(stream: rr.RecordingStream, scene: Scene) -> None:
    """Log every episode's path, split where the skill changes.

    A played episode is an entity of its own. The others of its skill or domain are one thin entity together: hundreds of
    entities would make the file large and the viewer's list useless.
    """
    shown, width = motion.played(scene), extent(scene) / 500
    for episode in shown:
        entity = f"world/paths/{group(scene, episode)}/{key(scene, episode)}"
        stream.log(entity, _strips(scene, [episode], width, 1.0), static=True)
        if scene.trajectories.object_pose is not None and scene.trajectories.gripper_position is not None:
            stream.log(f"{entity}/gripper", _strips(scene, [episode], width / 3, 0.7, hand=True), static=True)
    rest: dict[str, list[int]] = {}
    for episode in sorted(set(range(scene.trajectories.episodes)) - set(shown)):
        rest.setdefault(group(scene, episode), []).append(episode)
    for folder, episodes in rest.items():
        stream.log(f"world/paths/{folder}/others", _strips(scene, episodes, width / 3, 0.5), static=True)


def log_comparison(stream: rr.RecordingStream, scene: Scene, clock: Clock) -> None:
    """Log the executed and the planned path of a transfer's played episode; the next episode replaces both."""
    sent = motion.sent(scene)
    if sent is None:
        return
    width, index = extent(scene) / 300, int(scene.episode_source[clock.episode])
    stream.set_time("step", sequence=clock.first_step)
    stream.set_time("sim_time", duration=clock.start)
    stream.log("world/executed", _strips(scene, [clock.episode], width, 1.0))
    stream.log("source/path", _strips(sent, [index], width, 1.0))
    planned = rr.LineStrips3D([motion.path(sent, index)], colors=rgba(TARGET_IN_VIEWER, 0.8), radii=width / 2)
    stream.log("world/planned", planned)
    stream.reset_time()


def _strips(scene: Scene, episodes: list[int], radius: float, alpha: float, hand: bool = False) -> rr.LineStrips3D:
    """Make paths of the achieved goal, or of the gripper, split and coloured by skill."""
    strips, colors = [], []
    for episode in episodes:
        moved = motion.path(scene, episode)
        if hand and scene.trajectories.gripper_position is not None:
            moved = scene.trajectories.gripper_position[episode]
        for part in motion.pieces(scene, episode):
            strips.append(moved[part.start : part.stop + 1])
            colors.append(rgba(motion.piece_look(scene, episode, part).color, alpha))
    return rr.LineStrips3D(strips, colors=colors, radii=radius)


def log_model(stream: rr.RecordingStream, scene: Scene, clocks: list[Clock], detail: Detail) -> None:
    """Log the bodies' shapes once, and their poses over the played episodes; in a transfer also those of the source."""
    sent = motion.sent(scene)
    roots = {"world": scene} if sent is None else {"world": scene, "source": sent}
    looks = {played.model: (kinematics.shapes(played.model), meshes(played.model, detail)) for played in roots.values()}
    for root, played in roots.items():
        primitives, surfaces = looks[played.model]
        visible = sorted({*primitives, *surfaces})
        if not played.drawn:  # this arm has other shapes
            visible = [body for body in visible if not kinematics.of_arm(played.model, played.joints, body)]
        for body in visible:
            _log_body(stream, _body_entity(played, root, body), primitives.get(body, []), surfaces.get(body, []))
        for clock in clocks:
            episode = clock.episode if played is scene else int(scene.episode_source[clock.episode])
            rows = rest_after(np.arange(int(scene.trajectories.length[clock.episode]) + 1), played, episode)
            _log_poses(stream, played, root, episode, rows, clock, visible)


def _log_body(stream: rr.RecordingStream, entity: str, primitives: list[kinematics.Shape], surfaces: list[Mesh]) -> None:
    """Log what a body looks like: one batch for each form of its primitives, and each of its meshes."""
    for form in sorted({shape.form for shape in primitives}):
        archetype = _shape_archetype(form, [shape for shape in primitives if shape.form == form])
        stream.log(f"{entity}/{form}", archetype, static=True)
    for mesh in surfaces:
        archetype = rr.Mesh3D(
            vertex_positions=mesh.vertices,
            vertex_normals=mesh.normals,  # without them the viewer does not shade
            triangle_indices=mesh.faces,
            albedo_factor=_bytes(mesh.rgba),
        )
        stream.log(f"{entity}/mesh/{slug(mesh.name)}", archetype, static=True)


def _bytes(rgba: Array) -> Array:
    """Return colours in 0..1 as bytes."""
    return np.round(255 * rgba).astype(np.uint8)


def rest_after(rows: Array, scene: Scene, episode: int) -> Array:
    """Return rows of an episode; beyond its end its last state is repeated."""
    found: Array = np.minimum(rows, int(scene.trajectories.length[episode]))
    return found


def _log_poses(
    stream: rr.RecordingStream, scene: Scene, root: str, episode: int, rows: Array, clock: Clock, bodies: list[int]
) -> None:
    """Log poses of the bodies in these rows of an episode, on the first rows of the clock."""
    data = scene.trajectories
    assert data.joint_position is not None  # checked by the caller
    boxes = None if data.object_poses is None else data.object_poses[episode, rows]
    opened = None if data.finger_position is None else data.finger_position[episode, rows]
    positions, quaternions = kinematics.body_poses(
        scene.model, scene.joints, data.joint_position[episode, rows], boxes, scene.fingers, opened
    )
    for body in bodies:
        entity = _body_entity(scene, root, body)
        if kinematics.moves(scene.model, body):
            columns = rr.Transform3D.columns(translation=positions[:, body], quaternion=quaternions[:, body])
            stream.send_columns(entity, clock.columns(slice(0, len(rows))), columns)
        elif clock.first_step == 0:
            pose = rr.Transform3D(translation=positions[0, body], quaternion=rr.Quaternion(xyzw=quaternions[0, body]))
            stream.log(entity, pose, static=True)


def _body_entity(scene: Scene, root: str, body: int) -> str:
    return f"{root}/model/{slug(kinematics.body_name(scene.model, body))}"


def _shape_archetype(form: str, shapes: list[kinematics.Shape]) -> rr.AsComponents:
    """Make one batch from shapes of one form in the frame of their body."""
    size = np.array([shape.size for shape in shapes])  # (n, 3)
    position = np.array([shape.position for shape in shapes])  # (n, 3)
    quaternion = np.array([shape.quaternion for shape in shapes])  # (n, 4)
    colors = _bytes(np.array([shape.rgba for shape in shapes]))
    radii, lengths, solid = size[:, 0], 2 * size[:, 1], rr.components.FillMode.Solid
    if form == "box":
        return rr.Boxes3D(half_sizes=size, centers=position, quaternions=quaternion, colors=colors, fill_mode=solid)
    if form == "ellipsoid":
        return rr.Ellipsoids3D(half_sizes=size, centers=position, quaternions=quaternion, colors=colors, fill_mode=solid)
    if form == "cylinder":
        return rr.Cylinders3D(
            lengths=lengths, radii=radii, centers=position, quaternions=quaternion, colors=colors, fill_mode=solid
        )
    # rerun's capsules begin at their origin and extend along z, MuJoCo's are centred on it
    start = position - size[:, 1:2] * kinematics.z_axis(quaternion)
    return rr.Capsules3D(
        lengths=lengths, radii=radii, translations=start, quaternions=quaternion, colors=colors, fill_mode=solid
    )
