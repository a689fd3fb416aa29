"""The page of one point: its figures in words, its pictures, its flags, what it was made from."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from threadpoolctl import threadpool_limits

from glint_aoa.errors import InputError
from glint_aoa.flags import REJECTING, Flag, describe
from glint_aoa.inertial.bias_coherence import BiasCoherence, bias_coherence
from glint_aoa.inertial.correct import correct
from glint_aoa.optical.measure import measure_stack
from glint_aoa.process import PointResult
from glint_aoa.records.acquisition import AcquisitionRecord
from glint_aoa.records.conditioning import prepared
from glint_aoa.records.fields import FieldStack
from glint_aoa.records.formats import channels_beside, open_acquisition, open_fields
from glint_aoa.records.recording import resolve_recording
from glint_aoa.report.cells import printed
from glint_aoa.report.figures import measured_field
from glint_aoa.report.pictures import FigureFiles, Picture, drawing, picture
from glint_aoa.report.point_figures import inertial_figure, optical_figure
from glint_aoa.report.recordings import InputFile, find_calibrations, find_recording
from glint_aoa.report.results_folder import MeasuredPoint, read_correction
from glint_aoa.setup import Setup

__all__ = ["Fact", "PageOptions", "PointPage", "flags_of", "point_page"]

_MOST_FIELDS = 240  # that are measured again for the picture of one
_ROWS = ("time_s", "angle_deg", "angle_std_deg", "raw_angle_deg", "flags")  # of a correction
_TOLD = ("title", "setup", "recording_notes", "calibration_doubts")  # elsewhere on the page


@dataclass(frozen=True)
class Fact:
    """A figure in words: what it is, how it is printed, and as the results have it."""

    what: str
    text: str
    exact: str = ""


@dataclass(frozen=True)
class PageOptions:
    """What all pages share: folders of results and recordings, and files of figures if wanted."""

    folder: Path
    points: Path | None = None
    files: FigureFiles | None = None


@dataclass
class PointPage:
    """What the page of a point shows.

    Attributes
    ----------
    number : int
        Of the point in the report.
    key : str
        Name of its files.
    facts : list of Fact
        Its results.
    flags : list of str
        Its flags in words, with the number of fields.
    pictures : list of Picture
        Those that could be drawn.
    lacks : list of str
        What is not shown, and how to get it.
    notes : list of str
        What recording and calibration had to say.
    inputs : list of InputFile
        What it was made from.
    settings : list of (str, str)
        How it was measured.
    excitation : str
        What the shaker did; empty where neither comparison nor recording says it.
    """

    number: int
    key: str
    facts: list[Fact]
    flags: list[str]
    pictures: list[Picture] = field(default_factory=list)
    lacks: list[str] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)
    inputs: list[InputFile] = field(default_factory=list)
    settings: list[tuple[str, str]] = field(default_factory=list)
    excitation: str = ""


def point_page(numbered: tuple[int, MeasuredPoint], *, options: PageOptions) -> PointPage:
    """Make the page of a point.

    Parameters
    ----------
    numbered : (int, MeasuredPoint)
        Its number, and its results.
    options : PageOptions
        What all pages share.

    Returns
    -------
    PointPage
        With all that could be found; what could not is said in its ``lacks``.

    Raises
    ------
    OutputError
        If a figure cannot be written.
    """
    number, point = numbered
    recording = find_recording(point, options.folder, options.points)
    page = PointPage(number, point.key, [], flags_of(point))
    page.excitation = point.error.get("excitation", "")
    page.inputs = [each for each in (recording,) if each is not None]
    page.inputs += find_calibrations(point, options.folder)
    page.notes = [
        note
        for key in ("recording_notes", "calibration_doubts")
        for note in str(point.attrs.get(key, "")).split("; ")
        if note
    ]
    page.settings = list(_settings(point.attrs))
    with drawing(), threadpool_limits(limits=1, user_api="blas"):
        _Drawer(point, page, options).draw(recording)
    page.facts[:0] = _facts(point, page.excitation)
    return page


def flags_of(point: MeasuredPoint) -> list[str]:
    """Say in words what is flagged of a point, and at how many fields."""
    each = point.values["flags"].astype(np.int64)
    mask = int(np.bitwise_or.reduce(each)) | int(point.log.get("flags") or 0)
    words = []
    for said in describe(mask):
        name, _, meaning = said.partition(": ")
        count = int(np.count_nonzero(each & int(Flag[name])))
        where = f" ({count} of {each.size} fields)" if count else ""
        words.append(f"{name}{where}: {meaning}")
    return words


@dataclass
class _Drawer:
    """Draws the pictures of a page, and says what cannot be drawn."""

    point: MeasuredPoint
    page: PointPage
    options: PageOptions

    def draw(self, recording: InputFile | None) -> None:
        self._optical()
        path = None if recording is None else recording.path
        setup = None
        if recording is None:
            self._lack("The field and the onboard sensor: the results do not name a recording")
        elif path is None:
            self._lack(f"The field and the onboard sensor: {recording.name} is {recording.state}")
        else:
            setup = self._setup()
        if path is not None and setup is not None:
            self._try("The field", self._field, path, setup)
        self._try("The onboard sensor", self._inertial, path, setup)

    def _optical(self) -> None:
        point = self.point
        count = point.values["flags"].size
        if not np.isfinite(point.values["angle_deg"]).any():
            self._lack("Angle and intercept: no field could be measured; its flags say why")
            return
        self._add(
            optical_figure(point.values, point.attrs, point.log),
            "optical",
            alt=f"Angle and intercept of {count} fields against time, and the amplitudes in them "
            f"against frequency; their figures are in the table above and in {point.name}.csv.",
            caption="Angle and intercept of each field, and what they are made of. Dashed: mean of "
            "the angle with its 95 % interval; noise that the fields state of themselves.",
        )

    def _field(self, path: Path, setup: Setup) -> None:
        point = self.point
        stack = _start_of(open_fields(path, setup.fields))
        self.page.excitation = self.page.excitation or str(stack.meta.get("excitation", ""))
        angles, how = measure_stack(stack, setup, resolve_recording(stack, setup))
        values = {name: each[: stack.n_fields] for name, each in point.values.items()}
        good = np.flatnonzero((values["flags"].astype(np.int64) & int(REJECTING)) == 0)
        number = int(good[0]) if good.size else 0
        result = PointResult(point.name, values, dict(point.attrs), {}, how, angles)
        self._add(
            measured_field(stack, result, number),
            "field",
            alt=f"Field {number} of the recording with the measured centres and the fitted line, "
            "a magnified part of it, and the distances of the centres from the line.",
            caption=f"Field {number}: the glint, the measured centres, the line fitted to them, "
            "and how far the centres lie off it.",
        )

    def _inertial(self, path: Path | None, setup: Setup | None) -> None:
        record, coherence = None, None
        if path is not None and setup is not None:
            record = self._record(path, setup)
            coherence = None if record is None else self._coherence(record, setup)
        if (corrected := self._corrected(record, setup)) is None:
            return
        rows, said = corrected
        self.page.facts += _inertial_facts(rows)
        held = (
            ""
            if coherence is None
            else f" Right: how far the package's output follows the squared velocity in "
            f"{coherence.plane} ({coherence.source}); 1 is fully."
        )
        self._add(
            inertial_figure(rows, coherence, optical=_optical_mean(self.point)),
            "inertial",
            alt="Angle of the onboard sensor against time, raw and corrected for vibration"
            + (", and coherence of its output with squared velocity." if held else "."),
            caption=f"Onboard sensor behind its low-pass, raw and corrected; {said}.{held}",
        )

    def _record(self, path: Path, setup: Setup) -> AcquisitionRecord | None:
        beside = channels_beside(path)
        if beside is not None:
            return prepared(open_acquisition(beside, setup.inertial))
        if self.point.correction is None:
            raise InputError(
                f"{path.name} has no acquisition channels in it or beside it; record them with the "
                "fields, or correct their record to the folder of the results"
            )
        return None

    def _corrected(
        self, record: AcquisitionRecord | None, setup: Setup | None
    ) -> tuple[Mapping[str, Any], str] | None:
        """Return rows of a correction and what made them: those of `correct`, else its own."""
        written = self.point.correction
        if written is not None:
            return read_correction(written), f"as correct wrote it to {written.name}"
        if record is None or setup is None:
            return None
        done = correct(record, setup.inertial)
        return {name: getattr(done, name) for name in _ROWS}, done.why

    def _coherence(self, record: AcquisitionRecord, setup: Setup) -> BiasCoherence | None:
        try:
            return bias_coherence(record, setup.inertial)
        except InputError as error:
            self._lack(f"The coherence: {error}")
            return None

    def _setup(self) -> Setup | None:
        attrs = self.point.attrs
        if "setup" not in attrs:
            self._lack(
                f"The field and the onboard sensor: {self.point.name}.nc, which holds the "
                "settings, is not there; process the point again"
            )
            return None
        beside = Path(str(attrs.get("calibration", ""))).parent
        try:
            return Setup.of_results(str(attrs["setup"]), Path(attrs.get("setup_folder", beside)))
        except InputError as error:
            self._lack(f"The field and the onboard sensor: {error}")
            return None

    def _try(self, what: str, draw: Any, *arguments: Any) -> None:
        try:
            draw(*arguments)
        except InputError as error:
            self._lack(f"{what}: {error}")

    def _add(self, figure: Any, name: str, *, alt: str, caption: str) -> None:
        stem = f"{self.point.key.replace('/', '-')}-{name}"
        files = self.options.files
        self.page.pictures.append(
            picture(figure, name, alt=alt, caption=caption, files=files, stem=stem)
        )

    def _lack(self, sentence: str) -> None:
        self.page.lacks.append(sentence.removesuffix(".") + ".")


def _start_of(stack: FieldStack) -> FieldStack:
    """Return the first fields of a long recording as a stack of their own."""
    if stack.n_fields <= _MOST_FIELDS:
        return stack
    times = None if stack.times_s is None else stack.times_s[:_MOST_FIELDS]
    start = FieldStack.from_array(
        stack.read(0, _MOST_FIELDS), stack.info, times_s=times, meta=stack.meta, path=stack.path
    )
    return start.restated(stack.info, times_s=times, white_level=stack.white_level)


def _optical_mean(point: MeasuredPoint) -> tuple[float, float, float] | None:
    time = point.values["time_s"]
    if not point.log.get("mean_angle_deg") or not np.isfinite(time).any():
        return None
    return float(np.nanmin(time)), float(np.nanmax(time)), float(point.log["mean_angle_deg"])


def _facts(point: MeasuredPoint, excitation: str) -> list[Fact]:
    log, error = point.log, point.error
    used = f"{log.get('n_used', '')} of {log.get('n_fields', '')}" if log else ""
    shown = [
        Fact("Run", str(point.attrs.get("run") or log.get("run", ""))),
        Fact("Point", str(point.attrs.get("point") or log.get("point", ""))),
        Fact("Trigger", str(point.attrs.get("trigger_time") or log.get("trigger_time", ""))),
        Fact("Excitation", excitation),
        _number("Peak-to-peak moment", error.get("moment_in_lb_pp"), ".0f", "in lbf"),
        Fact("Fields used", used, log.get("n_used", "")),
        _number("Mean angle", log.get("mean_angle_deg"), "+.4f", "deg"),
        _number(
            "95 % within",
            log.get("mean_angle_u95_deg"),
            ".4f",
            "deg",
            before="\N{PLUS-MINUS SIGN} ",
        ),
        _number("Std over fields", log.get("std_angle_deg"), ".4f", "deg"),
        Fact("Mean by", log.get("mean_method", "")),
        _number("Mean intercept", log.get("mean_intercept_mm"), ".4f", "mm"),
        _number("Its std over fields", log.get("std_intercept_mm"), ".4f", "mm"),
        _number("Error of video", error.get("video_error_deg"), "+.4f", "deg"),
        _number("Error of onboard, raw", error.get("inertial_error_deg"), "+.4f", "deg"),
        _number("Error of onboard, corrected", error.get("corrected_error_deg"), "+.4f", "deg"),
    ]
    return [fact for fact in shown if fact.text]


def _inertial_facts(rows: Mapping[str, Any]) -> list[Fact]:
    settled = (rows["flags"].astype(np.int64) & int(Flag.FILTER_SETTLING)) == 0
    settled = settled if settled.any() else ~settled
    means = {
        "Onboard mean, raw": rows["raw_angle_deg"][settled].mean(),
        "Onboard mean, corrected": rows["angle_deg"][settled].mean(),
    }
    facts = [_number(what, f"{value:.10g}", "+.4f", "deg") for what, value in means.items()]
    return [fact for fact in facts if fact.text]


def _number(what: str, cell: str | None, spec: str, unit: str, *, before: str = "") -> Fact:
    """Return a figure as printed; without words where the cell is empty."""
    text = printed(cell, spec)
    return Fact(what, f"{before}{text} {unit}" if text else "", cell or "")


def _settings(attrs: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
    for name, value in attrs.items():
        if name in _TOLD or name.endswith("_sha256") or name.startswith("setup"):
            continue
        if isinstance(value, np.ndarray):
            text = ", ".join(f"{float(each):.6g}" for each in value)
        else:
            text = f"{float(value):.6g}" if isinstance(value, float | np.floating) else str(value)
        if text:
            yield name, text
