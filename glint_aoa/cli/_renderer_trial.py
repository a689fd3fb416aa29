"""Does a renderer work here: it draws a small scene in a process of its own, which may crash."""

import multiprocessing
import signal
import time
from dataclasses import dataclass
from multiprocessing.connection import Connection

__all__ = ["RENDERERS", "RendererTrial", "try_renderer"]

RENDERERS = ("raytrace", "pyrender")
_LINES = 24  # around the paper's glint at zero pitch
_FIRST_LINE = 132
_LEAST = 50.0  # grey levels by which the glint stands out
_PATIENCE_S = 180.0  # the first use may compile


@dataclass(frozen=True)
class RendererTrial:
    """What came of a renderer.

    Attributes
    ----------
    name : str
        Its name.
    seconds : float or None
        How long an image of 752 x 24 pixels took, once all was loaded [s]; None if none came.
    problem : str or None
        Why none came, in one sentence.
    """

    name: str
    seconds: float | None
    problem: str | None

    @property
    def works(self) -> bool:
        """Whether it drew the glint."""
        return self.problem is None


def try_renderer(name: str) -> RendererTrial:
    """Draw a small scene; a crash or a hang of the graphics driver is told, not shared.

    Parameters
    ----------
    name : str
        One of `RENDERERS`.
    """
    fresh = multiprocessing.get_context("spawn")
    here, there = fresh.Pipe(duplex=False)
    process = fresh.Process(target=_draw, args=(name, there), daemon=True)
    process.start()
    there.close()
    try:
        seconds, problem = here.recv() if here.poll(_PATIENCE_S) else (None, _slow())
    except EOFError:  # it ended without a word
        process.join()
        seconds, problem = None, _ended(process.exitcode or 0)
    process.kill()
    process.join()
    return RendererTrial(name, seconds, problem)


def _draw(name: str, answer: Connection) -> None:
    """Draw the scene twice, and tell how long the second time took or what was wrong."""
    try:
        answer.send((_timed(name), None))
    except Exception as error:
        answer.send((None, str(error) or type(error).__name__))


def _timed(name: str) -> float:
    import numpy as np

    from glint_aoa.errors import MissingLibraryError
    from render_sim.motion import StaticMotion
    from render_sim.renderer import make_renderer
    from render_sim.scene import paper_scene

    scene = paper_scene().with_window(_FIRST_LINE, _LINES)
    renderer = make_renderer(scene, name)  # type: ignore[arg-type]
    pose = StaticMotion(scene, 0.0).pose(np.zeros(1))
    renderer.radiance(pose)
    start = time.perf_counter()
    image = renderer.radiance(pose)[0]
    seconds = time.perf_counter() - start
    if not np.all(np.ptp(image, axis=0) > _LEAST):
        raise MissingLibraryError("the picture that it drew shows no glint; use another renderer")
    return seconds


def _slow() -> str:
    return f"it drew nothing in {_PATIENCE_S:.0f} s; use another renderer"


def _ended(code: int) -> str:
    cause = signal.Signals(-code).name if code < 0 else f"exit code {code}"
    return f"it crashed ({cause}); update the graphics driver, or use another renderer"
