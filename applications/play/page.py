"""The page: the twin on its table, what pulls it, and what can be changed of it."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, get_args

import numpy as np

from applications.play.drawn import Behind, Drawn
from applications.play.loop import Loop
from applications.play.pictures import camera_of, picture
from applications.play.pulls import Pulls
from applications.twin import Twin
from physreal_core.array_types import Array, Float
from physreal_core.effects import EFFECTS
from physreal_core.geometry.mesh import Mesh
from physreal_core.playing import Session
from physreal_core.playing.log import Hand

HELP = """Drag the body to **pull** it; hold Shift while dragging to **pin** what you took where you let go of it.
Drag beside it to turn the view. The force of a pull is cut at five times the weight."""
_TABLE = 5.0
"""Side of the table that is drawn, in sizes of the body."""
_BESIDE = 1.4
"""Sizes of the body by which the twin without its effects stands beside it."""
_PULL, _PIN, _GREY, _BALL = (230, 60, 50), (60, 110, 230), (150, 158, 170), (240, 180, 60)


@dataclass
class _Drag:
    """A drag of one viewer: whether what is taken stays where it is let go of, and the handle, None until the loop has taken it."""

    pinned: bool
    handle: int | None = None


class Page:
    """What the browser shows of a twin, on a viser server.

    Args:
        server: viser's.
        twin: what is played with.
        sessions: with its effects, and one without them where both are compared.
        folder: gets a capture per pull; None for none.
        ends: sessions with the models at the ends of an interval, which do the same and are not shown; their forces are told.
    """

    def __init__(
        self, server: Any, twin: Twin, sessions: list[Session], folder: Path | None, ends: Sequence[Session] = ()
    ) -> None:
        self._server, self._twin, self._pulls, self._ends = server, twin, Pulls(twin, folder), list(ends)
        self.loop = Loop([*sessions, *ends], self._show, self._tell, self._leave)
        self._shown = list(sessions)
        self._drags: dict[tuple[int, str], _Drag] = {}
        self._balls: list[Any] = []
        self._hand: Any = None
        self._asides = [np.array([number * _BESIDE * self._size, 0.0, 0.0]) for number in range(len(sessions))]
        self._scene()
        self._controls()
        self._bodies = [Drawn(server, twin, number, aside) for number, aside in enumerate(self._asides)]
        self._bodies[0].on_drag(self._dragged)
        self._splatted: list[Drawn | Behind] = list(self._bodies)
        if twin.backdrop is not None:
            self._splatted.append(Behind(server, twin, self._bodies[0].pictured))
        server.on_client_connect(self._look)
        self._show()

    @property
    def _session(self) -> Session:
        return self.loop.sessions[0]

    @property
    def _size(self) -> float:
        """Longest side of the object's box in frame 0 [m]."""
        return float(np.ptp(self._twin.mesh.vertices, axis=0).max())

    def close(self) -> None:
        """Ends the loop; what is still pulled is written."""
        self.loop.stop()
        self._leave()

    def _leave(self) -> None:
        """Writes what is still pulled: a session that begins anew forgets it."""
        for path in self._pulls.close(self._session):
            self._tell(f"wrote {path}")

    # --- what the user does -------------------------------------------------------------------------------------

    async def _dragged(self, event: Any) -> None:
        """Start, movement and end of a drag; in order, for viser awaits one after the other."""
        key = event.client_id, event.modifier or ""
        if event.phase == "start":
            self._drags[key] = _Drag(pinned=event.modifier == "shift")
            place = np.array(event.start_position)
            self.loop.do(lambda session, drag=self._drags[key]: setattr(drag, "handle", session.take(place)))
        drag = self._drags.get(key)
        if drag is None:
            return
        ended, target = event.phase == "end", np.array(event.end_position)
        if ended:
            del self._drags[key]

        def follow(session: Session) -> None:
            if drag.handle not in session.handles:
                return
            session.move(drag.handle, target)
            if ended and not drag.pinned:
                session.release(drag.handle)

        self.loop.do(follow)

    def _change(self, **what: Any) -> None:
        def change(session: Session) -> None:
            changes = replace(session.changes, **what)
            if session in self._shown[1:]:  # without effects, so none of theirs can be changed
                changes = replace(changes, effects={})
            session.change(changes)

        self.loop.do(change)

    def _change_effect(self, name: str, coefficient: str, value: float) -> None:
        own = {key: dict(values) for key, values in self._session.changes.effects.items()}
        own.setdefault(name, {})[coefficient] = value
        self._change(effects=own)

    def _jump(self, film: int) -> None:
        """To a filmed frame: back to the start, and on until the hand is there."""

        def go_on(session: Session) -> None:
            while session.film < film:
                session.step()

        self._reset()
        self.loop.do(go_on)

    def _reset(self) -> None:
        self.loop.begin_anew()
        if self._hand is not None:
            self._hand.value = "filmed"

    def _let_go(self) -> None:
        self.loop.do(lambda session: [session.release(handle) for handle in session.handles])

    # --- what is shown ------------------------------------------------------------------------------------------

    def _scene(self) -> None:
        server, ground = self._server, self._twin.model.simulation.get("ground_height", 0.0)
        server.scene.set_up_direction("+z")
        if ground is not None and self._twin.backdrop is None:  # it would cut through the backdrop's own
            x, y, _ = self._twin.mesh.vertices.mean(0)
            side = _TABLE * self._size
            thick = 0.02 * side
            server.scene.add_box(
                "/table", dimensions=(side, side, thick), color=_GREY, position=(x, y, ground - thick / 2)
            )
        if self._twin.scene is not None:
            self._solids(self._twin.scene.mesh)
        self._lines = server.scene.add_line_segments(
            "/pulls",
            points=np.zeros((1, 2, 3), np.float32),
            colors=np.zeros((1, 2, 3), np.uint8),
            thickness=4.0,
            thickness_units="screen",
        )

    def _solids(self, mesh: Mesh) -> None:
        """What stands around each body."""
        colour = tuple((255 * mesh.colours.mean(0)).astype(int).tolist())
        for number, aside in enumerate(self._asides):
            self._server.scene.add_mesh_simple(
                f"/solids_{number}",
                vertices=mesh.vertices.astype(np.float32),
                faces=mesh.faces.astype(np.uint32),
                color=colour,
                flat_shading=True,
                side="double",
                position=tuple(aside),
            )

    def _controls(self) -> None:
        gui, session, model = self._server.gui, self._session, self._twin.model
        gui.add_markdown(HELP)
        self._rate, self._said = gui.add_markdown(""), gui.add_markdown("")
        running = gui.add_checkbox("time goes on", True)
        running.on_update(lambda _: self.loop.go(running.value))
        speed = gui.add_slider("speed", min=0.1, max=1.0, step=0.1, initial_value=1.0)
        speed.on_update(lambda _: setattr(self.loop.pace, "speed", float(speed.value)))
        gui.add_button("from the start").on_click(lambda _: self._reset())
        gui.add_button("let go of all").on_click(lambda _: self._let_go())
        if self._twin.problem.grip is not None or self._twin.problem.tool is not None:
            self._hand = gui.add_dropdown("filmed hand", get_args(Hand), initial_value="filmed")
            self._hand.on_update(lambda _: self.loop.do(lambda s, word=self._hand.value: s.let_hand(word)))
            film = gui.add_slider("filmed frame", min=0, max=max(1, session.frames_filmed - 1), step=1, initial_value=0)
            film.on_update(lambda event: event.client is not None and self._jump(int(film.value)))
        if session.radius is not None:
            self._ball_controls(session.radius)
        with gui.add_folder("model"):
            self._slider("stiffness, times the fitted", 0.2, 5.0, 1.0, lambda v: self._change(stiffness=v))
            fitted = float(model.fields["friction_coefficient"])
            self._slider("friction", 0.0, 1.5, fitted, lambda v: self._change(friction=v))
            self._slider("brake [1/s]", 0.0, 20.0, 0.0, lambda v: self._change(brake=v))
            for record in model.effects:
                self._effect(record)
        self._forces = gui.add_checkbox("forces", True)
        shades = ("as filmed", "stretch") if session.thin else ("as filmed", "stretch", "stress")
        self._shade = gui.add_dropdown("colour", shades, initial_value="as filmed")

    def _ball_controls(self, radius: float) -> None:
        """A box to have the ball, and three arrows to lead it."""
        scene, mesh = self._server.scene, self._twin.mesh
        start = mesh.vertices.mean(0) + [0.0, -(0.5 * float(np.ptp(mesh.vertices[:, 1])) + 2.0 * radius), radius]
        shown = {"radius": radius, "color": _BALL, "position": tuple(start), "visible": False}
        count = len(self._shown)
        self._balls = [scene.add_icosphere(f"/ball_{n}", **shown) for n in range(count)]
        arrows = scene.add_transform_controls(
            "/ball_arrows", scale=4.0 * radius, disable_rotations=True, position=tuple(start), visible=False
        )
        box = self._server.gui.add_checkbox("ball", False)

        def place(_: Any) -> None:
            point = start if box.value else None
            arrows.position, arrows.visible = tuple(start), box.value
            self.loop.do(lambda session: session.place_ball(point))

        box.on_update(place)

        def lead(_: Any) -> None:
            target = np.array(arrows.position)
            self.loop.do(lambda session: session.move_ball(target))

        arrows.on_update(lead)

    def _effect(self, record: dict[str, Any]) -> None:
        """A slider per amplitude of an effect, from its absence to twice what was found."""
        for coefficient in EFFECTS[record["name"]].coefficients:
            if coefficient.kind != "amplitude":
                continue
            found, name = record["values"][coefficient.name], record["name"]
            low, high = sorted((coefficient.dormant, coefficient.dormant + 2.0 * (found - coefficient.dormant)))
            low, high = max(low, coefficient.lower), min(high, coefficient.upper)
            interval = record.get("intervals", {}).get(coefficient.name)
            told = "" if interval is None else f", found {found:.3g} ({interval[0]:.3g} to {interval[1]:.3g})"
            label = f"{name}: {coefficient.name} [{coefficient.unit}]{told}"
            if high > low:
                self._slider(
                    label, low, high, found, lambda v, n=name, c=coefficient.name: self._change_effect(n, c, v)
                )

    def _slider(self, label: str, low: float, high: float, value: float, changed: Callable[[float], None]) -> None:
        step = (high - low) / 100.0
        slider = self._server.gui.add_slider(
            label, min=low, max=high, step=step, initial_value=min(max(value, low), high)
        )
        slider.on_update(lambda _: changed(float(slider.value)))

    def _show(self) -> None:
        for body, session in zip(self._bodies, self._shown, strict=True):
            body.draw(session, self._shade.value)
        for ball, session, aside in zip(self._balls, self._shown, self._asides, strict=False):
            ball.visible = session.ball is not None
            if session.ball is not None:
                ball.position = tuple(session.ball + aside)
        for path in self._pulls.follow(self._session):
            self._tell(f"wrote {path}")
        if self._bodies[0].pictured:
            for client in self._server.get_clients().values():
                self._send_picture(client)
        self._draw_pulls()
        self._rate.content = self._numbers()

    def _send_picture(self, client: Any) -> None:
        """To a viewer, of all bodies and the backdrop."""
        camera = camera_of(client.camera)
        parts = [np.concatenate(part) for part in zip(*(one.now for one in self._splatted), strict=True)]
        centres, covariances, colours = parts
        opacities = np.concatenate([one.opacities for one in self._splatted])
        image, depth = picture(centres, covariances, colours, opacities, camera)
        client.scene.set_background_image(image, format="jpeg", jpeg_quality=80, depth=depth)

    def _numbers(self) -> str:
        session, pace = self._session, self.loop.pace
        newtons = [self._force(lambda own, handle=handle: own.pull(handle).force) for handle in session.handles]
        hand = f"; hand {self._force(Session.hand_force)}" if self._twin.problem.grip is not None else ""
        pulls = f"; pulls {', '.join(newtons)}" if newtons else ""
        return f"frame {session.frame}, {pace.rate:.0f} a second; weight {session.weight:.2f} N{hand}{pulls}"

    def _force(self, of: Callable[[Session], Float[Array, " 3"]]) -> str:
        """Of a session [N], and between which values it lies in the models at the ends."""
        here, *ends = (float(np.linalg.norm(of(session))) for session in (self._session, *self._ends))
        return f"{here:.2f} N" + (f" ({min(here, *ends):.2f} to {max(here, *ends):.2f})" if ends else "")

    def _draw_pulls(self) -> None:
        """A line from each taken place to where it is wanted, red; blue where it is pinned."""
        session = self._session
        pulls = [session.pull(handle) for handle in session.handles]
        self._lines.visible = bool(pulls) and self._forces.value
        if pulls:
            dragged = {drag.handle for drag in self._drags.values()}
            inks = [_PULL if handle in dragged else _PIN for handle in session.handles]
            self._lines.points = np.array([(pull.place, pull.target) for pull in pulls], np.float32)
            self._lines.colors = np.repeat(np.array(inks, np.uint8)[:, None], 2, axis=1)

    def _tell(self, sentence: str) -> None:
        print(sentence, flush=True)
        self._said.content = sentence

    def _look(self, client: Any) -> None:
        """A new viewer begins at the filmed camera, or before the object."""
        camera = self._twin.camera
        middle = self._twin.mesh.vertices.mean(0)
        if camera is None:
            way = self._twin.problem.controllers.reshape(-1, 3).cpu().double().numpy()
            middle = 0.5 * (middle + (way.mean(0) if len(way) else middle))
            client.camera.position = middle + self._size * np.array([0.6, -3.0, 1.0])
            client.camera.look_at = middle + self._size * np.array([0.6, 0.0, 0.0])
            return
        T = camera.T_world_camera.cpu().double().numpy()
        client.camera.position = T[:3, 3]
        client.camera.look_at = T[:3, 3] + T[:3, 2] * float((middle - T[:3, 3]) @ T[:3, 2])
        client.camera.fov = 2.0 * float(np.arctan(camera.height / (2.0 * float(camera.K[1, 1]))))
