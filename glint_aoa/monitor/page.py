"""One open page: its parts, and how they follow the folder and the live session."""

import asyncio
import math
from collections.abc import Callable
from dataclasses import dataclass
from datetime import datetime
from importlib.resources import files

from bokeh.document import Document
from bokeh.models import (
    Button,
    Div,
    InlineStyleSheet,
    RadioButtonGroup,
    TextInput,
)
from jinja2 import Template

from glint_aoa.errors import GlintError
from glint_aoa.monitor.details import PointDetails
from glint_aoa.monitor.live_client import LiveClient, LiveView
from glint_aoa.monitor.marks import Controls
from glint_aoa.monitor.plots import FieldPlot, SpectraPlot, StripPlot
from glint_aoa.monitor.watch import PointRow
from glint_aoa.monitor.words import (
    cell,
    flag_chips,
    headline,
    live_headline,
    named_flags,
    notice,
    onboard_table,
    points_table,
)
from glint_aoa.monitor.worker import PointWorker

__all__ = ["Page", "Shared"]

_EVERY_MS = 500
_MOST_REFUSED = 3  # newer points that are told of beside the one that is shown
_NEVER = object()
_FOLDER = files("glint_aoa.monitor")


@dataclass(frozen=True)
class Shared:
    """What all open pages share.

    Attributes
    ----------
    title : str
        Name of the folder, for the head of the page.
    points : PointWorker
        The points.
    controls : Controls
        What the buttons do.
    live : LiveClient or None
        The live session.
    """

    title: str
    points: PointWorker
    controls: Controls
    live: LiveClient | None


class Page:
    """The page of one browser.

    Parameters
    ----------
    document : Document
        Bokeh's document of the session; the parts become its roots.
    shared : Shared
        Where all that is shown comes from.
    """

    def __init__(self, document: Document, shared: Shared) -> None:
        self._document, self._shared = document, shared
        css = InlineStyleSheet(css=_FOLDER.joinpath("parts.css").read_text("utf-8"))
        names = ("status", "headline", "flags", "message", "onboard", "points")
        self._parts = [
            Div(name=name, css_classes=[name], stylesheets=[css], sizing_mode="stretch_width")
            for name in names
        ]
        self._status, self._headline, self._flags, self._message, self._onboard, self._points = (
            self._parts
        )
        self._field, self._strip = FieldPlot(), StripPlot()
        self._spectra = [SpectraPlot("moment"), SpectraPlot("acceleration")]
        self._choice = TextInput(name="choice", visible=False)  # written by the page's script
        self._rows: list[PointRow] = []
        self._version = -1
        self._listed: tuple[int, str | None] = (-1, None)
        self._drawn: object = _NEVER
        self._drawn_below: object = _NEVER
        views = ["Live", "Newest point", "Chosen point"]
        self._views = views if shared.live is not None else views[1:]
        self._view = RadioButtonGroup(name="view", labels=self._views, active=0, stylesheets=[css])
        self._trigger = _button("trigger", "Trigger a point", shared.controls.trigger, self, css)
        self._shaker = _button("shaker", "Mark shaker off", shared.controls.shaker_off, self, css)
        self._show_document()

    def update(self) -> None:
        """Show what is new."""
        version = self._shared.points.watch.version
        if version != self._version:
            self._version = version
            self._rows = self._shared.points.watch.rows()
        row = self._shown_row()
        live = self._shared.live.view() if self._shared.live is not None else None
        is_live = live is not None and self._views[self._view.active or 0] == "Live"
        shown = None if is_live or row is None else row.name
        if (version, shown) != self._listed:
            self._listed = (version, shown)
            _set(self._points, points_table(self._rows, shown))
        if live is not None and is_live:
            _set(self._headline, live_headline(live))
            newest = live.newest
            _set(self._flags, flag_chips(named_flags(newest.flags)) if newest else "")
            self._draw_live(live)
        else:
            self._show_point(row)
        self._show_background(row)
        self._show_status()

    async def press(self, button: Button, action: Callable[[], str]) -> None:
        """Do what a button says, away from the event loop, and say what came of it."""
        button.disabled = True
        try:
            said = await asyncio.get_running_loop().run_in_executor(None, action)
            _set(self._message, notice([said], "good"))
        except GlintError as error:
            _set(self._message, notice([str(error)]))
        finally:
            button.disabled = False

    def _show_document(self) -> None:
        spectra = [plot.figure for plot in self._spectra]
        plots = [self._field.figure, self._strip.figure, *spectra]
        inputs = [self._view, self._trigger, self._shaker, self._choice]
        for root in (*self._parts, *inputs, *plots):
            self._document.add_root(root)
        self._document.title = f"{self._shared.title} - glint-aoa monitor"
        self._document.template = Template(_FOLDER.joinpath("page.html").read_text("utf-8"))
        self._document.template_variables["folder"] = self._shared.title
        self._choice.on_change("value", self._choose)
        self._view.on_change("active", self._turn)
        self._document.add_periodic_callback(self.update, _EVERY_MS)
        self.update()

    def _choose(self, _attr: str, _old: str, new: str) -> None:
        """Show the point whose row of the table was clicked."""
        if new:
            self._view.active = self._views.index("Chosen point")
            self.update()

    def _turn(self, _attr: str, _old: object, _new: object) -> None:
        self._drawn = _NEVER
        self.update()

    def _shown_row(self) -> PointRow | None:
        """Return the point to show: the chosen one, else the newest, with results if any has."""
        if self._views[self._view.active or 0] == "Chosen point" and self._choice.value:
            return next((row for row in self._rows if row.name == self._choice.value), None)
        measured = [row for row in self._rows if row.log]
        shown = measured or self._rows
        return shown[-1] if shown else None

    def _show_point(self, row: PointRow | None) -> None:
        _set(self._headline, headline(row))
        details = None if row is None or not row.log else self._shared.points.details(row.name)
        told = self._refused_since(row)
        if isinstance(details, str):
            told.append(details)
        chips = flag_chips(int(row.log["flags"])) if row is not None and row.log else ""
        _set(self._flags, chips + notice(told))
        drawn = details if isinstance(details, PointDetails) else None
        if self._drawn is not drawn:
            self._drawn = drawn
            mean = cell(row.log, "mean_angle_deg") if row is not None else math.nan
            self._field.show(drawn.picture if drawn else None)
            self._strip.show_point(drawn, mean)

    def _refused_since(self, row: PointRow | None) -> list[str]:
        """Return why the point cannot be used, and newer ones that are not shown instead."""
        names = [each.name for each in self._rows]
        since = names.index(row.name) if row is not None else 0
        is_chosen = self._views[self._view.active or 0] == "Chosen point"
        rows = self._rows[since : since + 1] if is_chosen else self._rows[since:]
        return [
            each.sentence if each.name in each.sentence else f"{each.name}: {each.sentence}"
            for each in rows[-_MOST_REFUSED:]
            if each.sentence
        ]

    def _draw_live(self, live: LiveView) -> None:
        if self._drawn is not live:
            self._drawn = live
            self._field.show(live.picture)
            self._strip.show_live(live.readings)

    def _show_background(self, row: PointRow | None) -> None:
        """Show the onboard sensor and spectra: of the point shown, in live view of the newest."""
        details = None if row is None or not row.log else self._shared.points.details(row.name)
        found = details if isinstance(details, PointDetails) else None
        notes = notice(found.notes, "doubt") if found else ""
        if details is not None or row is None or not row.log:
            _set(self._onboard, onboard_table(found.onboard if found else None, row) + notes)
        else:
            _set(self._onboard, '<p class="quiet">Channels are being read.</p>')
        if self._drawn_below is not found:
            self._drawn_below = found
            for plot in self._spectra:
                plot.show(row.name if row and found else "", found.spectra if found else ())

    def _show_status(self) -> None:
        shared = self._shared
        measured = sum(bool(row.log) for row in self._rows)
        words = [f"<span>{measured} of {len(self._rows)} points measured</span>"]
        if shared.points.watch.problem:
            words.append(notice([shared.points.watch.problem]))
        if shared.live is not None:
            words.append(_live_status(shared.live))
        words.append(f"<span>as of <b>{datetime.now().astimezone():%H:%M:%S}</b></span>")
        _set(self._status, f'<div class="status">{"".join(words)}</div>')


def _button(
    name: str, label: str, action: Callable[[], str], page: Page, css: InlineStyleSheet
) -> Button:
    button = Button(name=name, label=label, stylesheets=[css], css_classes=[name])

    async def press() -> None:
        await page.press(button, action)

    button.on_click(lambda: page._document.add_next_tick_callback(press))
    return button


def _live_status(live: LiveClient) -> str:
    view = live.view()
    if view.problem:
        return notice([view.problem])
    rate, lost = (view.state.get(name) for name in ("rate_hz", "lost"))
    rate_words = f"{rate:.4g} Hz" if isinstance(rate, int | float) else "no rate"
    is_whole = not isinstance(lost, int) or lost == 0
    point = "recording a point" if view.state.get("point") else "armed"
    armed = point if view.state.get("armed") or view.state.get("point") else "not armed"
    shaker = ", shaker off" if view.state.get("shaker_off") else ""
    lost_words = f"{lost} fields lost" if isinstance(lost, int) else "losses unknown"
    state = "good" if is_whole else "bad"
    return f'<span class="live {state}">● live, {rate_words}, {lost_words}, {armed}{shaker}</span>'


def _set(part: Div, text: str) -> None:
    if part.text != text:
        part.text = text
