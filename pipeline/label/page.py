"""The page itself, built of NiceGUI's elements. What it shows and does stands in the modules beside it."""

from fastapi import HTTPException, Response
from nicegui import app, background_tasks, events, run, ui

from physreal_core.errors import InputError
from pipeline.clicks import clicks_in, write_clicks
from pipeline.label.clip import Clip
from pipeline.label.drawing import clicks_svg, preview_svg, sheet_svg
from pipeline.label.editing import Editing
from pipeline.label.pictures import Sheet, outline_path, picture, sheet_picture
from pipeline.label.plot import plot_options
from pipeline.label.preview import Preview
from pipeline.label.running import Runner, progress_of
from pipeline.products.masks import ROLES, Role

FASTEST = 10.0
"""Pictures a second that the page asks for at most."""
NO_STORE = {"Cache-Control": "no-store"}


class Shared:
    """What all open pages have in common: the clip, the network, the run, which goes on if its page is closed.

    Attributes:
        version: counts what the stage found.
        lines: of the last run.
        succeeded: whether it did; None before its end.
    """

    def __init__(self, clip: Clip) -> None:
        self.clip, self.version = clip, 0
        self.preview, self.runner = Preview(clip), Runner(clip.project, clip.sequence)
        self.lines: list[str] = []
        self.succeeded: bool | None = None

    async def run_again(self) -> None:
        """Run the stage, and show what it found."""
        self.lines, self.succeeded = [], None
        try:
            succeeded = await self.runner.run(self.lines.append)
        except (InputError, OSError) as error:
            self.lines.append(str(error))
            succeeded = False
        await run.io_bound(self.clip.reload)
        self.succeeded = succeeded
        self.version += 1


def build(clip: Clip) -> None:
    """Register the page and its pictures with NiceGUI; they are served once `ui.run` is called."""
    shared = Shared(clip)
    app.on_shutdown(shared.runner.stop)

    @app.get("/frame/{t}.jpg")
    def frame(t: int, masks: bool = True, tracks: bool = True) -> Response:
        if not 0 <= t < len(clip):
            raise HTTPException(404, f"frames are 0 to {len(clip) - 1}")
        return Response(picture(clip, t, masks=masks, tracks=tracks), media_type="image/jpeg", headers=NO_STORE)

    @app.get("/sheet.jpg")
    def sheet() -> Response:
        return Response(sheet_picture(clip, Sheet.of(clip)), media_type="image/jpeg", headers=NO_STORE)

    @ui.page("/", title=f"{clip.sequence} - physreal label")
    def page() -> None:
        Page(shared)


class Page:
    """One open page: which frame it shows, which clicks were made on it."""

    def __init__(self, shared: Shared) -> None:
        self.shared, self.clip = shared, shared.clip
        self.t, self.role, self.label = 0, "object", 1
        self.masks = self.tracks = True
        self.previews: dict[tuple[int, Role], str] = {}
        self.editing = Editing(clicks_in(self.clip.capture))
        self.sheet = Sheet.of(self.clip)
        self.version, self.lines_shown = shared.version, 0
        self._header()
        with ui.row(wrap=False).classes("w-full"):
            with ui.column().classes("w-1/2"):
                self._frame()
            with ui.column().classes("w-1/2"):
                self._overview()
        ui.keyboard(on_key=self._key)
        ui.timer(0.5, self._follow_run)
        ui.timer(0.1, lambda: run.io_bound(shared.preview.open), once=True)
        self.show(0)

    # --- what there is ----------------------------------------------------------------------------------------------

    def _header(self) -> None:
        with ui.row().classes("w-full items-center"):
            ui.label(self.clip.sequence).classes("text-h5")
            self.state = ui.label().classes("label-state text-grey-8")

    def _frame(self) -> None:
        with ui.row().classes("items-center"):
            names = {"object": "object", "controller": "hand"}
            ui.toggle(names, value="object", on_change=lambda e: setattr(self, "role", e.value)).classes("label-thing")
            signs = {1: "this", 0: "not this"}
            ui.toggle(signs, value=1, on_change=lambda e: setattr(self, "label", e.value)).classes("label-sign")
            ui.checkbox("masks", value=True, on_change=lambda e: self._layer("masks", e.value))
            ui.checkbox("tracks", value=True, on_change=lambda e: self._layer("tracks", e.value))
        self.image = ui.interactive_image(on_mouse=self._click, events=["mousedown"], cross=True, sanitize=False)
        self.image.classes("label-image w-full")
        with ui.row(wrap=False).classes("w-full items-center"):
            self.play = ui.button(icon="play_arrow", on_click=self._play).props("flat dense")
            last = len(self.clip) - 1
            self.slider = ui.slider(min=0, max=last, value=0, on_change=lambda e: self.show(int(e.value)))
            self.number = ui.label().classes("w-24")
        with ui.row():
            ui.button("undo", on_click=self._undo).classes("label-undo").props("outline")
            ui.button("remove clicks here", on_click=self._clear).classes("label-clear").props("outline")
            self.save_button = ui.button("save", on_click=self._save).classes("label-save")
            self.run_button = ui.button("save and run again", on_click=self._run).classes("label-run")
            self.stop_button = ui.button("stop", on_click=self.shared.runner.stop).props("outline color=red")
        self.note = ui.label().classes("label-note text-grey-8")
        self.timer = ui.timer(1 / min(FASTEST, self.clip.capture.fps), self._next, active=False)

    def _overview(self) -> None:
        self.thumbnails = ui.interactive_image(
            on_mouse=lambda e: self.go(self.sheet.frame_at(e.image_x, e.image_y)), events=["mousedown"], sanitize=False
        ).classes("label-sheet w-full")
        self.plot = ui.echart({"series": []}, on_point_click=lambda e: self.go(int(e.value[0]))).classes("w-full h-48")
        with ui.row().classes("items-center"):
            ui.button("next to look at", on_click=self._next_suspect).props("outline dense").classes("label-next")
            self.why = ui.label().classes("label-why")
        self.warnings = ui.column().classes("gap-0")
        self.progress = ui.linear_progress(value=0, show_value=False).classes("w-full")
        self.log = ui.log(max_lines=200).classes("label-log w-full h-32")
        self.progress.visible = self.log.visible = self.stop_button.visible = False
        self._fill()

    # --- showing ----------------------------------------------------------------------------------------------------

    def go(self, t: int) -> None:
        """Show a frame, with the slider there."""
        self.slider.set_value(t)

    def show(self, t: int) -> None:
        """Show a frame."""
        self.t = t
        layers = f"masks={self.masks}&tracks={self.tracks}".lower()
        self.image.set_source(f"/frame/{t}.jpg?{layers}&v={self.shared.version}")
        self.number.set_text(f"{t} of {len(self.clip) - 1}")
        self._marks()

    def _fill(self) -> None:
        """All that changes with a run."""
        found = self.clip.found
        self.state.set_text(self.clip.state)
        self.thumbnails.set_source(f"/sheet.jpg?v={self.shared.version}")
        self.warnings.clear()
        with self.warnings:
            for sentence in found.warnings if found else []:
                ui.label(f"warning: {sentence}").classes("text-red-8")
        self._marks()

    @property
    def suspects(self) -> dict[int, list[str]]:
        """Frame → why to look at it."""
        return self.clip.found.suspects if self.clip.found else {}

    def _marks(self) -> None:
        scale = max(self.clip.size) / 120
        parts = [preview_svg(path, role, scale) for (t, role), path in self.previews.items() if t == self.t]
        parts += [clicks_svg(self.editing.at(self.t, role), role, scale) for role in ROLES]
        self.image.set_content("".join(parts))
        clicked = self.editing.frames()
        self.thumbnails.set_content(sheet_svg(self.sheet, self.t, self.suspects, clicked))
        curves = self.clip.found.curves if self.clip.found else None
        self.plot.options.clear()
        self.plot.options.update(plot_options(curves, self.suspects, self.t))
        self.plot.update()
        reasons = "; ".join(self.suspects.get(self.t, []))
        self.why.set_text(f"frame {self.t}: {reasons}" if reasons else f"{len(self.suspects)} frames to look at")
        unsaved = len(self.editing.edits)
        frames = f"clicks in frames {', '.join(map(str, clicked))}" if clicked else "no clicks yet"
        self.note.set_text(f"{frames}; {unsaved} changes not saved" if unsaved else f"{frames}; all saved")

    def _layer(self, name: str, shown: bool) -> None:
        setattr(self, name, shown)
        self.show(self.t)

    def _follow_run(self) -> None:
        """What the run has printed since, and what it found once it has ended; another page may have begun it."""
        lines, running = self.shared.lines, self.shared.runner.running
        if len(lines) < self.lines_shown:
            self.log.clear()
            self.lines_shown = 0
        for line in lines[self.lines_shown :]:
            self.log.push(line)
            if (done := progress_of(line)) is not None:
                self.progress.set_value(done)
        self.lines_shown = len(lines)
        self.progress.visible = self.stop_button.visible = running
        self.log.visible = bool(lines)
        self.run_button.enabled = not running
        if self.version != self.shared.version:
            self.version = self.shared.version
            self.previews.clear()
            self._fill()
            self.show(self.t)
            self._say_end()

    def _say_end(self) -> None:
        if self.shared.succeeded:
            ui.notify("done", type="positive")
        else:
            told = "the run did not end well; its last lines say why"
            ui.notify(told, type="negative", timeout=0, close_button="close")

    # --- moving -----------------------------------------------------------------------------------------------------

    def _play(self) -> None:
        self.timer.active = not self.timer.active
        self.play.set_icon("pause" if self.timer.active else "play_arrow")

    def _next(self) -> None:
        self.go((self.t + 1) % len(self.clip))

    def _next_suspect(self) -> None:
        later = [t for t in self.suspects if t > self.t] or list(self.suspects)
        if later:
            self.go(later[0])

    def _key(self, event: events.KeyEventArguments) -> None:
        if not event.action.keydown:
            return
        if event.key.arrow_left or event.key.arrow_right:
            self.go(min(max(self.t + (1 if event.key.arrow_right else -1), 0), len(self.clip) - 1))
        elif event.key == "z":
            self._undo()
        elif event.key == "n":
            self._next_suspect()

    # --- clicking ---------------------------------------------------------------------------------------------------

    async def _click(self, event: events.MouseEventArguments) -> None:
        width, height = self.clip.size
        point = min(max(event.image_x - 0.5, 0.0), width - 1.0), min(max(event.image_y - 0.5, 0.0), height - 1.0)
        t, role = self.t, self.role
        self.editing.add(t, role, point, 0 if event.shift else self.label)
        self._marks()
        await self._preview(t, role)

    async def _preview(self, t: int, role: Role) -> None:
        clicks = self.editing.at(t, role)
        self.previews.pop((t, role), None)
        mask = await run.io_bound(self.shared.preview.mask, t, role, clicks)
        if self.editing.at(t, role) == clicks and mask is not None:
            self.previews[t, role] = outline_path(mask)
        self._marks()
        if self.shared.preview.why_not:
            self.note.set_text(f"no preview: {self.shared.preview.why_not}")

    async def _undo(self) -> None:
        t = self.editing.undo()
        if t is not None:
            self.go(t)
            for role in ROLES:
                await self._preview(t, role)

    def _clear(self) -> None:
        self.editing.clear(self.t)
        for role in ROLES:
            self.previews.pop((self.t, role), None)
        self._marks()

    # --- saving and running -----------------------------------------------------------------------------------------

    async def _save(self) -> bool:
        edits = dict(self.editing.edits)
        try:
            if edits:
                capture = await run.io_bound(write_clicks, self.clip.project, self.clip.sequence, edits)
                self.editing.done(clicks_in(capture), edits)
        except (InputError, OSError) as error:
            ui.notify(str(error), type="negative", multi_line=True, timeout=0, close_button="close")
            return False
        self._marks()
        ui.notify("saved in capture.json" if edits else "nothing new to save", type="positive")
        return True

    async def _run(self) -> None:
        if not self.shared.runner.running and await self._save():
            self.progress.set_value(0)
            background_tasks.create(self.shared.run_again())
