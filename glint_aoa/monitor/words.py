"""What the page says in words and numbers, as HTML; whatever a file or session said is escaped."""

import math
from collections.abc import Iterable, Mapping, Sequence
from datetime import datetime
from html import escape

from glint_aoa.coverage import coverage_factor
from glint_aoa.flags import REJECTING, Flag, describe
from glint_aoa.monitor.details import Onboard
from glint_aoa.monitor.live_client import LiveView
from glint_aoa.monitor.watch import PointRow, PointStatus

__all__ = [
    "flag_chips",
    "headline",
    "live_headline",
    "named_flags",
    "notice",
    "onboard_table",
    "points_table",
]

_GOOD, _DOUBT, _BAD, _BUSY = "good", "doubt", "bad", "busy"
MOST_ROWS = 300
"""Of the table of points; more would be slow to draw."""

_MINUS, _DASH = "\N{MINUS SIGN}", "\N{EN DASH}"
_SIGNS = {_GOOD: "✓", _DOUBT: "▲", _BAD: "✕", _BUSY: "…"}


def number(value: float, spec: str) -> str:
    """Format a number; a dash stands for what was not measured."""
    return format(value, spec).replace("-", _MINUS) if math.isfinite(value) else _DASH


def cell(log: Mapping[str, str], name: str) -> float:
    """Return a number of the log's row; NaN where it is empty."""
    text = log.get(name, "")
    return float(text) if text else math.nan


def points_table(rows: Sequence[PointRow], chosen: str | None) -> str:
    """Return the table of points, newest first."""
    heads = ("Point", "Time", "Fields", "Mean [deg]", "95 % [deg]", "Std [deg]", "State")
    head = "".join(f"<th>{each}</th>" for each in heads)
    body = "".join(
        _table_row(row, is_chosen=row.name == chosen) for row in rows[: -MOST_ROWS - 1 : -1]
    )
    more = len(rows) - MOST_ROWS
    rest = f'<p class="quiet">{more} older points: see the CSV.</p>' if more > 0 else ""
    return (
        f'<table class="points"><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table>{rest}'
    )


def _table_row(row: PointRow, *, is_chosen: bool) -> str:
    log = row.log
    name = escape(row.name, quote=True)
    cells = [
        log.get("trigger_time", "").partition("T")[2][:8],
        f"{log['n_used']}/{log['n_fields']}" if log else "",
        number(cell(log, "mean_angle_deg"), "+.4f"),
        number(cell(log, "mean_angle_u95_deg"), ".4f"),
        number(cell(log, "std_angle_deg"), ".4f"),
    ]
    numbers = "".join(f"<td>{escape(each)}</td>" for each in cells)
    return (
        f'<tr data-point="{name}" tabindex="0"{" class=chosen" if is_chosen else ""}>'
        f"<th>{escape(log.get('point') or row.name)}</th>{numbers}<td>{_state_chip(row)}</td></tr>"
    )


def _state_chip(row: PointRow) -> str:
    if row.status is PointStatus.BROKEN:
        state, words = _BAD, escape(row.sentence)
    elif row.status is not PointStatus.MEASURED:
        state = _BUSY
        words = escape(f"{row.status.value}{': ' if row.sentence else ''}{row.sentence}")
    else:
        state, words = _point_state(row.log), _flag_words(int(row.log["flags"]))
    return f'<span class="state {state}">{_SIGNS[state]} {words}</span>'


def _flag_words(mask: int) -> str:
    """Return flags in a line: names, and meanings that a narrow table leaves out."""
    parts = (words.partition(": ") for words in describe(mask))
    return (
        "; ".join(
            f'{name}<span class="meaning">: {escape(meaning)}</span>' for name, _, meaning in parts
        )
        or "good"
    )


def _point_state(log: Mapping[str, str]) -> str:
    """Say how a point is to be seen: it is bad only if most of its fields are."""
    mask = int(log["flags"])
    if int(log["n_used"]) == 0 or mask & int(Flag.FEW_FIELDS):
        return _BAD
    return _DOUBT if mask else _GOOD


def headline(row: PointRow | None) -> str:
    """Return the big numbers of a point."""
    if row is None:
        return _big("No point yet", math.nan, "", math.nan, "points appear as they are recorded")
    name = row.log.get("point") or row.name
    if row.status is not PointStatus.MEASURED:
        return _big(name, math.nan, "", math.nan, row.status.value)
    log = row.log
    below = [f"{log['n_used']} of {log['n_fields']} fields used"]
    if log["trigger_time"]:
        below.append(f"triggered {_moment(log['trigger_time'])}")
    u95 = f"± {number(cell(log, 'mean_angle_u95_deg'), '.4f')} deg (95 %)"
    mean, std = cell(log, "mean_angle_deg"), cell(log, "std_angle_deg")
    return _big(f"Mean of {name}", mean, u95, std, " · ".join(below))


def live_headline(view: LiveView) -> str:
    """Return the big numbers of a live session: of its point, or of its newest field."""
    mean, std, count = view.mean()
    newest = view.newest
    now = ""
    if newest is not None:
        now = f"now {number(newest.angle_deg, '+.4f')} ± {number(newest.u95_deg, '.4f')} deg (95 %)"
    if count:
        point = view.state.get("point")
        title = f"Mean of {point}, running" if point else "Mean of the last point"
        return _big(title, mean, now, std, f"{count} fields")
    angle = math.nan if newest is None else newest.angle_deg
    return _big("Angle of the newest field", angle, now, math.nan, "no point has been taken yet")


def flag_chips(mask: int) -> str:
    """Return flags as coloured chips with their meanings in words."""
    if not mask:
        return _chip(_GOOD, "no flags", "")
    return "".join(
        _chip(_state(int(Flag[name])), name, meaning)
        for name, _, meaning in (words.partition(": ") for words in describe(mask))
    )


def named_flags(names: Iterable[str]) -> int:
    """Return the bit mask of flags by name; names that are not known are left out."""
    mask = 0
    for name in names:
        if name in Flag.__members__:
            mask |= int(Flag[name])
    return mask


def notice(sentences: Iterable[str], state: str = _BAD) -> str:
    """Return sentences as a coloured note; nothing for none."""
    return "".join(
        f'<p class="notice {state}">{_SIGNS[state]} {escape(each)}</p>' for each in sentences
    )


def onboard_table(onboard: Onboard | None, row: PointRow | None) -> str:
    """Return the optical mean beside the onboard sensor's, raw and corrected."""
    if onboard is None or row is None or not row.log:
        return '<p class="quiet">No onboard sensor with this point.</p>'
    optical = cell(row.log, "mean_angle_deg")
    lines = [
        ("optical", "optical", optical, f"± {number(cell(row.log, 'mean_angle_u95_deg'), '.4f')}"),
        ("raw", "onboard, raw", onboard.raw_mean_deg, ""),
        (
            "corrected",
            "onboard, corrected",
            onboard.corrected_mean_deg,
            f"± {number(coverage_factor() * onboard.corrected_std_deg, '.4f')}",
        ),
    ]
    body = "".join(
        f'<tr class="{kind}"><th>{label}</th><td>{number(mean, "+.4f")}</td><td>{u95}</td>'
        f"<td>{'' if kind == 'optical' else number(mean - optical, '+.4f')}</td></tr>"
        for kind, label, mean, u95 in lines
    )
    name = escape(row.log.get("point") or row.name)
    head = (
        f"<tr><th>{name}</th><th>mean [deg]</th><th>95 % [deg]</th><th>less optical [deg]</th></tr>"
    )
    why = f'<p class="quiet">{escape(onboard.why)}</p>'
    return f'<table class="onboard">{head}{body}</table>{why}'


def _moment(iso: str) -> str:
    """Return an ISO 8601 time to the second, as it is read aloud."""
    moment = datetime.fromisoformat(iso)
    zone = moment.tzname() or ""
    return f"{moment:%Y-%m-%d %H:%M:%S} {zone}".strip()


def _big(title: str, mean: float, u95: str, std: float, below: str) -> str:
    return (
        f'<div class="title">{escape(title)}</div>'
        f'<div class="mean"><span class="value">{number(mean, "+.4f")}</span>'
        f'<span class="unit">deg</span></div>'
        f'<div class="u95">{escape(u95) or "&nbsp;"}</div>'
        f'<div class="std"><span class="label">standard deviation</span>'
        f'<span class="value">{number(std, ".4f")}</span><span class="unit">deg</span></div>'
        f'<div class="below">{escape(below)}</div>'
    )


def _state(mask: int) -> str:
    if not mask:
        return _GOOD
    return _BAD if mask & int(REJECTING) else _DOUBT


def _chip(state: str, name: str, meaning: str) -> str:
    words = f'<span class="meaning">{escape(meaning)}</span>' if meaning else ""
    return f'<div class="chip {state}"><b>{_SIGNS[state]} {escape(name)}</b>{words}</div>'
