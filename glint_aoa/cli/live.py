"""``glint-aoa live``: fields as they come, measured at once."""

import contextlib
import os
import re
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from glint_aoa.cli._common import Json, Out, SetupFile, check_folder, number, print_json

if TYPE_CHECKING:
    from glint_aoa.live.outputs import Output
    from glint_aoa.live.session import PointLength, Session, State

__all__ = ["live"]

_LENGTH = re.compile(r"(?P<count>\d+)|(?P<seconds>\d+(?:\.\d*)?|\.\d+) ?s")


def live(
    source: Annotated[
        str,
        typer.Argument(
            metavar="SOURCE",
            help="Camera (0, /dev/video0 or a URL), folder in which pictures or files of fields "
            "appear, recording to play at its rate, or sim:CAMPAIGN[:POINT].",
            show_default=False,
        ),
    ],
    out: Out = Path("live"),
    setup: SetupFile = Path("glint-aoa.toml"),
    pre: Annotated[
        str, typer.Option(metavar="N|SECONDS", help='Fields before the trigger, or "0.5 s".')
    ] = "30",
    post: Annotated[
        str, typer.Option(metavar="N|SECONDS", help='Fields from the trigger on, or "0.5 s".')
    ] = "30",
    trigger_file: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="Trigger when FILE appears; its first line names it."),
    ] = None,
    learn_from: Annotated[
        Path | None,
        typer.Option(
            metavar="POINT", help="Learn the glint from a recording instead of the first second."
        ),
    ] = None,
    relearn: Annotated[
        float,
        typer.Option(min=0, metavar="SECONDS", help="Learn the glint anew so often; 0 for never."),
    ] = 5.0,
    realtime: Annotated[
        bool,
        typer.Option("--realtime", help="Ask for real-time priority, where the system allows it."),
    ] = False,
    temperature: Annotated[
        float | None,
        typer.Option(min=0, metavar="KELVIN", help="Tunnel temperature, for the pitch sweep."),
    ] = None,
    run: Annotated[str, typer.Option(metavar="NAME", help="Run that the points are of.")] = "live",
    udp: Annotated[
        str | None,
        typer.Option(metavar="HOST:PORT", help="Send readings as JSON datagrams."),
    ] = None,
    epics: Annotated[
        str | None,
        typer.Option(metavar="PREFIX", help="Serve PREFIX:angle, :u95, :intercept by PVAccess."),
    ] = None,
    u95_limit: Annotated[
        float,
        typer.Option(min=0, metavar="DEG", help="Uncertainty that is a minor EPICS alarm."),
    ] = 0.01,
    http: Annotated[
        int | None,
        typer.Option(min=0, max=65535, metavar="PORT", help="Serve state, readings and trigger."),
    ] = None,
    listen: Annotated[
        str,
        typer.Option(metavar="ADDRESS", help="IP address of --http; 0.0.0.0 for all networks."),
    ] = "127.0.0.1",
    token: Annotated[
        str | None,
        typer.Option(
            envvar="GLINT_AOA_TOKEN",
            metavar="TOKEN",
            help="What requests to --http must show; made up if not given, unless on localhost.",
        ),
    ] = None,
    readings: Annotated[
        bool | None,
        typer.Option(
            "--readings/--no-readings",
            help="Print readings on stdout, one JSON object a line.",
            show_default="if stdout is no terminal",
        ),
    ] = None,
    as_json: Json = False,
) -> None:
    """Measure fields as they come; record points when triggered.

    A point is triggered by the space bar, SIGUSR1, --trigger-file or --http; with the fields before
    the trigger it is written to <out>/<point>.h5, for process. Ctrl-C or q ends the session.

    \b
    Example: glint-aoa live 0 --setup glint-aoa.toml --out run-07 --http 8765 > readings.jsonl
    """
    from glint_aoa.cli._live_sources import open_source
    from glint_aoa.live.control import Control
    from glint_aoa.live.session import Session
    from glint_aoa.live.triggers import FileTrigger, KeyTrigger, stop_signals
    from glint_aoa.process import load_sweep
    from glint_aoa.records._files import make_folder
    from glint_aoa.records.formats import open_fields
    from glint_aoa.setup import load_setup

    settings = load_setup(setup)
    sweep = load_sweep(settings)
    length = _length_of(pre, post)
    check_folder(out)
    console = _Console()
    teacher = None if learn_from is None else open_fields(learn_from, settings.fields)
    told: dict[str, str | float | int] = {"run": run}
    if temperature is not None:
        told["tunnel_temperature_K"] = temperature
    with contextlib.ExitStack() as stack:
        opened = open_source(source, settings, console.say)
        stack.callback(opened.close)
        make_folder(out)
        outputs: list[Output] = []
        warm = opened.meta.get("tunnel_temperature_K")
        session = Session(
            opened,
            settings,
            out,
            length=length,
            sweep=sweep,
            temperature_k=float(warm) if temperature is None and warm else temperature,
            teacher=teacher,
            relearn_s=relearn,
            realtime=realtime,
            outputs=outputs,
            meta=told,
            tell=console.say,
        )
        if http is not None:
            control = stack.enter_context(Control(session, http, address=listen, token=token))
            console.say(f"listening on {control.url}")
        wanted = (not sys.stdout.isatty() and not as_json) if readings is None else readings
        outputs += _outputs(session, console, wanted, udp, epics, u95_limit, lonely=http is None)
        stack.enter_context(stop_signals(session, console.say))
        stack.enter_context(KeyTrigger(session, console.say))
        if trigger_file is not None:
            stack.enter_context(FileTrigger(session, trigger_file, console.say))
        console.say(f"{opened.name}: waiting for the first fields")
        state = session.run(lambda: console.show(session))
    _sum_up(state, outputs, console, as_json=as_json)


def _length_of(pre: str, post: str) -> "Callable[[float], PointLength]":
    """Return what makes numbers of fields of the two options, once the rate is known."""
    from glint_aoa.errors import InputError
    from glint_aoa.live.session import PointLength

    def counted(name: str, text: str, rate_hz: float, least: int) -> int:
        found = _LENGTH.fullmatch(text.strip())
        if found is None:
            raise InputError(f'--{name} {text}: expected a number of fields, or seconds as "0.5 s"')
        count = int(found["count"]) if found["count"] else round(float(found["seconds"]) * rate_hz)
        if count < least:
            raise InputError(f"--{name} {text}: comes to {count} fields; give at least {least}")
        return count

    def at(rate_hz: float) -> "PointLength":
        return PointLength(counted("pre", pre, rate_hz, 0), counted("post", post, rate_hz, 1))

    at(1e9)  # what is wrong is wrong at any rate
    return at


def _outputs(
    session: "Session",
    console: "_Console",
    readings: bool,
    udp: str | None,
    epics: str | None,
    u95_limit: float,
    *,
    lonely: bool,
) -> "Iterator[Output]":
    from glint_aoa.live.outputs import LineSender, Output, UdpSender

    if readings:
        # Without another way out, nobody is left to measure for once the reader of stdout leaves.
        alone = lonely and udp is None and epics is None
        gone = session.stop if alone else None
        sender = LineSender(os.dup(sys.stdout.fileno()))
        yield Output(sender, tell=console.say, gone=gone)
    if udp is not None:
        yield Output(UdpSender(udp), tell=console.say)
    if epics is not None:
        from glint_aoa.live.outputs.epics import EpicsSender

        yield Output(EpicsSender(epics, u95_limit_deg=u95_limit), tell=console.say)


class _Console:
    """Sentences on stderr, and on a terminal a line below them that says how it goes."""

    def __init__(self) -> None:
        self._is_terminal = sys.stderr.isatty()
        self._next = 0.0
        self._line = ""

    def say(self, sentence: str) -> None:
        """Print a sentence above the line."""
        clear = f"\r{' ' * len(self._line)}\r" if self._line else ""
        sys.stderr.write(f"{clear}{sentence}\n{self._line}")
        sys.stderr.flush()

    def show(self, session: "Session") -> None:
        """Show how it goes, once a second."""
        now = time.monotonic()
        if not self._is_terminal or now < self._next:
            return
        self._next = now + 1.0
        before, self._line = len(self._line), _state_line(session.state())
        sys.stderr.write(f"\r{self._line.ljust(before)}")
        sys.stderr.flush()

    def end(self) -> None:
        """Leave the line."""
        if self._line:
            sys.stderr.write("\n")
            self._line = ""


def _state_line(state: "State") -> str:
    reading = state.reading
    angle = "learning the glint" if state.learning else "no glint"
    if reading is not None and reading.angle_deg == reading.angle_deg:
        angle = f"{reading.angle_deg:.4f} deg +/- {reading.u95_deg:.4f}"
    flags = " ".join(reading.flag_names) if reading is not None else ""
    what = f"recording {state.point}" if state.point else "space: trigger, s: shaker off, q: end"
    return f"{angle}  {state.fields} fields, {state.lost} lost  {what}  {flags}"[:110].rstrip()


def _sum_up(state: "State", outputs: "list[Output]", console: _Console, *, as_json: bool) -> None:
    console.end()
    middle, high, most = state.latency_ms
    if as_json:
        print_json(
            {
                "fields": state.fields,
                "lost": state.lost,
                "latency_ms": {"p50": middle, "p99": high, "max": most},
                "dropped": {each.name: each.dropped for each in outputs},
            }
        )
    console.say(
        f"{state.fields} fields, {state.lost} lost; from arrival to angle {number(middle, '.2f')} "
        f"ms in the middle, {number(high, '.2f')} ms at 99 %, {number(most, '.2f')} ms at most"
    )
    for each in outputs:
        if each.dropped:
            console.say(
                f"{each.name}: {each.dropped} readings were dropped, its reader was too slow"
            )
