"""The scene in the browser: robot, table, box and goals, drawn as a recording draws them, and the goal that can be dragged."""

from __future__ import annotations

import mujoco
import numpy as np
import viser

from skillcli.tasks.world import World
from skillcli.trajectories import Array
from skillcli.viz import kinematics
from skillcli.viz.palette import TARGET, latent_look, look, rgba
from skillcli.viz.play.session import PlaySession
from skillcli.viz.play.solids import solids
from skillcli.viz.play.state import Pose
from skillcli.viz.viewpoint import Viewpoint, viewpoint

ROBOT = "/robot"


class View:
    """Draws a session. Only `draw` and `refresh` of one thread change what moves.

    Args:
        server: shared by all browsers.
        session: what is drawn.
        map_ends: (P, 3) m, where the map's latents end; may be empty.
        map_latents: (P, d) those latents.
    """

    def __init__(self, server: viser.ViserServer, session: PlaySession, map_ends: Array, map_latents: Array) -> None:
        self._server, self._session = server, session
        self._bodies: dict[int, viser.FrameHandle] = {}
        self._model: mujoco.MjModel | None = None
        self._world: World | None = None
        self._drawn: Pose | None = None
        self._take_world(session.world)
        self.points = self._spread()
        self.extent = float(np.linalg.norm(np.ptp(self.points, axis=0))) or 1.0
        server.scene.configure_default_lights(enabled=True, cast_shadow=False)
        server.scene.world_axes.visible = False
        self._add_goals(map_ends, map_latents)
        self._now = server.scene.add_icosphere(
            "/now", radius=self.extent / 90, color=rgba(look(0).color)[:3], cast_shadow=False
        )
        self._add_target()

    @property
    def flat(self) -> bool:
        """Return whether everything lies in a plane: no engine simulates the task."""
        return self._model is None

    def look_from(self, further: Array) -> Viewpoint:
        """Let browsers look first at everything and at further points (n, 3) m; returns from where."""
        seen = viewpoint(np.concatenate([self.points, further]), self.flat, 0.8)
        camera = self._server.initial_camera
        camera.position, camera.look_at, camera.up = tuple(seen.position), tuple(seen.target), seen.up
        return seen

    def draw(self, pose: Pose) -> None:
        """Show a pose; one that is shown already costs nothing."""
        if self._session.world is not self._world:
            self._take_world(self._session.world)
            self._drawn = None
        if pose is self._drawn:
            return
        first, self._drawn = self._drawn is None, pose
        with self._server.atomic():
            self._now.position = tuple(pose.achieved_goal)
            if self._model is not None and pose.joint_position is not None:
                self._draw_bodies(self._model, pose, first)

    def refresh(self) -> None:
        """Show what changes rarely: colour of the held latent, the goal moved elsewhere."""
        library, goal = self._session.library, self._session.goal
        skill = np.flatnonzero((library.mean == self._session.latent).all(axis=1))
        shade = latent_look(int(skill[0]) if len(skill) else -1, self._session.latent, library.mean)
        if tuple(self._now.color) != rgba(shade.color)[:3]:
            self._now.color = rgba(shade.color)[:3]
        if not np.allclose(self._target.position, goal, atol=1e-6):
            self._target.position = tuple(goal)

    # --- the parts ------------------------------------------------------------------------------------------------------

    def _take_world(self, world: World) -> None:
        """Replace the robot by that of a world."""
        self._server.scene.remove_by_name(ROBOT)
        self._world, self._model, self._bodies = world, world.model(), {}
        if self._model is None:
            return
        scene = self._server.scene
        scene.add_frame(ROBOT, show_axes=False)
        for body, parts in solids(self._model).items():
            name = f"{ROBOT}/{body}-{kinematics.body_name(self._model, body)}"
            self._bodies[body] = scene.add_frame(name, show_axes=False)
            for place, part in enumerate(parts):
                red, green, blue, alpha = (float(value) for value in part.rgba)
                scene.add_mesh_simple(
                    f"{name}/{place}", part.vertices, part.faces, color=(red, green, blue),
                    opacity=None if alpha == 1 else alpha,
                    flat_shading=False, side="double", cast_shadow=False, receive_shadow=False,
                )  # fmt: skip

    def _draw_bodies(self, model: mujoco.MjModel, pose: Pose, first: bool) -> None:
        """Put the bodies where they are; those that never move only the first time."""
        assert pose.joint_position is not None and self._world is not None
        positions, quaternions = self._body_poses(model, pose)
        for body, frame in self._bodies.items():
            if first or kinematics.moves(model, body):
                frame.position = tuple(positions[0, body])
                frame.wxyz = tuple(np.roll(quaternions[0, body], 1))

    def _body_poses(self, model: mujoco.MjModel, pose: Pose) -> tuple[Array, Array]:
        """Return the poses of all bodies, see `kinematics.body_poses`; of one moment."""
        assert pose.joint_position is not None and self._world is not None
        robot = self._world.robot
        boxes = None if pose.object_poses is None else pose.object_poses[None]
        fingers = () if robot.hand is None else robot.hand.joints
        opened = None if pose.finger_position is None else pose.finger_position[None]
        return kinematics.body_poses(model, robot.names.joints, pose.joint_position[None], boxes, fingers, opened)

    def _spread(self) -> Array:
        """Return the points that must be visible, (n, 3) m: the arm, the goals, and what goes to them."""
        pose, goals = self._session.pose(), self._session.library.goals
        base = np.zeros((1, 3))
        if self._model is not None and pose.joint_position is not None and self._world is not None:
            joints, positions = self._world.robot.names.joints, self._body_poses(self._model, pose)[0][0]
            arm = [body for body in range(1, self._model.nbody) if kinematics.of_arm(self._model, joints, body)]
            base = positions[arm]
        return np.concatenate([goals, pose.achieved_goal[None], base])

    def _add_goals(self, map_ends: Array, map_latents: Array) -> None:
        """Add the trained goals with the names of their skills, and where the map's latents end."""
        library, scene = self._session.library, self._server.scene
        dot = max(library.recipe.task.tolerance / 6, self.extent / 250)
        for skill, (name, goal) in enumerate(zip(library.names, library.goals, strict=True)):
            color = rgba(look(skill).color)[:3]
            scene.add_icosphere(f"/goals/{skill}", radius=dot, color=color, position=tuple(goal), cast_shadow=False)
            scene.add_label(f"/goals/{skill}/name", f"skill {name}" if name.isdecimal() else name)
        if len(map_ends):
            scene.add_point_cloud(
                "/map", map_ends.astype(np.float32), map_colors(map_latents, library.mean), point_size=self.extent / 300
            )

    def _add_target(self) -> None:
        """Add the goal, with its tolerance, and the arrows to drag it."""
        session, scene = self._session, self._server.scene
        upright = len(session.library.recipe.task.goals[0]) == 3
        self._target = scene.add_transform_controls(
            "/goal", scale=self.extent / 7, active_axes=(True, True, upright), disable_rotations=True, depth_test=False,
            position=tuple(session.goal),
        )  # fmt: skip
        scene.add_icosphere(
            "/goal/tolerance", radius=session.status().tolerance, color=rgba(TARGET)[:3], opacity=0.35, cast_shadow=False
        )
        scene.add_label("/goal/name", "goal", anchor="bottom-left")

        @self._target.on_update
        async def _(_: viser.TransformControlsEvent) -> None:
            place = np.array(self._target.position)
            session.set_goal(place)


def map_colors(latents: Array, means: Array) -> Array:
    """Return a colour for each latent (P, d), mixed of the skills nearby: (P, 3) bytes."""
    found = [rgba(latent_look(-1, latent, means).color)[:3] for latent in latents]
    return np.array(found, dtype=np.uint8).reshape(-1, 3)
