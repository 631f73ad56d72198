"""A pad over the first two latent dimensions, in the scene beside the robot: click or drag, and that latent is held.

It is a board in the scene, not a figure in the panel: of everything that viser shows only things in the scene send where they
were clicked and dragged; its images and figures send nothing.
"""

from __future__ import annotations

import mujoco
import numpy as np
import viser

from skillcli.trajectories import Array
from skillcli.viz.palette import TARGET, look, rgba
from skillcli.viz.play.session import PlaySession
from skillcli.viz.play.view import View, map_colors

BOARD = (236, 239, 241)
SIZE = 0.5  # of the extent of the scene
ARC = 48  # corners of an ellipse


class Pad:
    """The board. Its frame has x to the right, y up and z towards whoever looks.

    Args:
        server: shared by all browsers.
        session: what is driven.
        view: beside which it stands.
        map_latents: (P, d) latents of the map; may be empty.
    """

    def __init__(self, server: viser.ViserServer, session: PlaySession, view: View, map_latents: Array) -> None:
        self._server, self._session = server, session
        low, high = session.bounds[:, :2]
        self._middle, span = (low + high) / 2, high - low
        self._scale = SIZE * view.extent / float(span.max())  # m of the board in one unit of the latent space
        self._size = self._scale * span
        self.axes = _axes(view.flat)  # (3, 3) rows: right, up, normal
        seen_from = view.points
        center = (seen_from.min(axis=0) + seen_from.max(axis=0)) / 2
        self.center = center - self.axes[0] * (0.5 * view.extent + 0.5 * self._size[0])
        self._layer = view.extent / 800  # m between what lies on the board
        self._shown = np.full(2, np.nan)
        self._build(view.extent, map_latents)

    @property
    def corners(self) -> Array:
        """Return its corners, (4, 3) m."""
        half = self._size / 2 * np.array([[-1, -1], [-1, 1], [1, -1], [1, 1]])
        found: Array = self.center + half @ self.axes[:2]
        return found

    def refresh(self) -> None:
        """Put the marker where the present latent is."""
        latent = self._session.latent[:2]
        if not np.array_equal(latent, self._shown):
            self._shown = latent
            self._marker.position = self._local(latent, 3)

    def _build(self, extent: float, map_latents: Array) -> None:
        scene, library, thick = self._server.scene, self._session.library, extent / 400
        turn = np.empty(4)
        mujoco.mju_mat2Quat(turn, self.axes.T.ravel())
        scene.add_frame("/pad", show_axes=False, position=tuple(self.center), wxyz=turn)
        rim = 0.06 * float(self._size.max())
        board = scene.add_box(
            "/pad/board", color=BOARD, dimensions=(self._size[0] + rim, self._size[1] + rim, thick), position=(0, 0, -thick),
            cast_shadow=False, receive_shadow=False,
        )  # fmt: skip
        if len(map_latents):
            points = np.array([self._local(latent[:2], 1) for latent in map_latents], dtype=np.float32)
            scene.add_point_cloud("/pad/map", points, map_colors(map_latents, library.mean), point_size=extent / 250)
        segments, colors = self._ellipses()
        scene.add_line_segments("/pad/one_sigma", segments, colors, thickness=2.0, thickness_units="screen")
        for skill, (name, mean) in enumerate(zip(library.names, library.mean, strict=True)):
            color = rgba(look(skill).color)[:3]
            where = self._local(mean[:2], 2)
            scene.add_icosphere(f"/pad/means/{skill}", radius=extent / 110, color=color, position=where, cast_shadow=False)
            scene.add_label(f"/pad/means/{skill}/name", name)
        scene.add_label("/pad/title", "latent 1 → and 2 ↑: click or drag", position=(0, self._size[1] / 2 + rim, 0),
                        anchor="bottom-center")  # fmt: skip
        self._marker = scene.add_icosphere("/pad/now", radius=extent / 80, color=rgba(TARGET)[:3], cast_shadow=False)
        self.refresh()

        @board.on_click
        async def _(event: viser.SceneNodePointerEvent[viser.BoxHandle]) -> None:
            self._choose(np.array(event.ray_origin), np.array(event.ray_direction))

        @board.on_drag("left")
        async def _(event: viser.SceneNodeDragEvent[viser.BoxHandle]) -> None:
            eye = np.array(event.client.camera.position)
            self._choose(eye, np.array(event.end_position) - eye)

    def _choose(self, origin: Array, direction: Array) -> None:
        """Hold the latent where a ray meets the board; the other dimensions stay."""
        across = float(direction @ self.axes[2])
        if abs(across) < 1e-9:  # along the board
            return
        hit = origin + direction * float((self.center - origin) @ self.axes[2]) / across - self.center
        latent = self._session.latent
        latent[:2] = self._middle + self.axes[:2] @ hit / self._scale
        self._session.hold_latent(latent)

    def _local(self, latent: Array, layer: int) -> tuple[float, float, float]:
        """Return where a latent (2,) is on the board, above it by some layers."""
        x, y = (latent - self._middle) * self._scale
        return float(x), float(y), layer * self._layer

    def _ellipses(self) -> tuple[Array, Array]:
        """Return the one-sigma ellipse of every skill as line segments, (n, 2, 3) m, and their colours (n, 2, 3)."""
        angle = np.linspace(0, 2 * np.pi, ARC + 1)
        circle = np.stack([np.cos(angle), np.sin(angle)], axis=1)
        segments, colors = [], []
        for skill, (mean, std) in enumerate(zip(self._session.library.mean, self._session.library.std, strict=True)):
            ring = np.array([self._local(place, 2) for place in mean[:2] + std[:2] * circle])
            segments.append(np.stack([ring[:-1], ring[1:]], axis=1))
            colors.append(np.broadcast_to(rgba(look(skill).color)[:3], (ARC, 2, 3)))
        return np.concatenate(segments).astype(np.float32), np.concatenate(colors).astype(np.uint8)


def _axes(flat: bool) -> Array:
    """Return right, up and normal of a board that faces where browsers look from first, (3, 3)."""
    if flat:
        return np.eye(3)
    normal = np.array([0.66, -0.58, 0.44])
    normal /= np.linalg.norm(normal)
    right = np.cross([0.0, 0.0, 1.0], normal)
    right /= np.linalg.norm(right)
    return np.stack([right, np.cross(normal, right), normal])
