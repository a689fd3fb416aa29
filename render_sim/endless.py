"""A point of a campaign filmed without end, block by block: what a live camera would give."""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from glint_aoa.errors import InputError
from render_sim.campaign import Campaign, Point, point_motion, point_scene
from render_sim.campaign_file import scene_of
from render_sim.film import Film, film
from render_sim.renderer import make_renderer
from render_sim.scene import Recorder, Scene

__all__ = ["endless_film", "live_point", "live_scene"]

_SUB_EXPOSURES = 2  # of a millisecond, in which the model moves by less than a thousandth of a line


def live_point(campaign: Campaign, name: str | None = None) -> Point:
    """Return a point of a campaign by its name, or the first with the shaker on.

    Raises
    ------
    InputError
        If there is none of that name.
    """
    if name is None:
        shaken = (point for point in campaign.points if point.series is not None)
        return next(shaken, campaign.points[0])
    named = [point for point in campaign.points if point.name == name]
    if not named:
        raise InputError(
            f"campaign {campaign.name} has no point {name}; its first is {campaign.points[0].name}"
        )
    return named[0]


def live_scene(campaign: Campaign, point: Point) -> Scene:
    """Return the scene of a point, its recorder without drift or faults at certain fields.

    Raises
    ------
    InputError
        If it does not state rate and exposure of the fields.
    """
    scene = point_scene(point, scene_of(campaign))
    if scene.fields.rate is None or scene.fields.exposure is None:
        raise InputError(
            f"campaign {campaign.name}: its scene states no rate or exposure of fields"
        )
    faultless = Recorder(
        line_jitter=scene.recorder.line_jitter,
        line_time_s=scene.recorder.line_time_s,
        dead_columns=scene.recorder.dead_columns,
    )
    return replace(scene, recorder=faultless)


def endless_film(
    campaign: Campaign, point: Point, *, block: int = 8, seed: int = 0
) -> Iterator[Film]:
    """Film a point on and on, its motion carried beyond its end.

    Parameters
    ----------
    campaign : Campaign
        The campaign.
    point : Point
        One of its points.
    block : int
        Fields rendered at a time; even, so that each block begins with the same parity.
    seed : int
        Of motion and noise; the same seed gives the same fields.

    Yields
    ------
    Film
        The next fields, with their truth.
    """
    scene = live_scene(campaign, point)
    renderer = make_renderer(scene)
    motion = point_motion(campaign, point, scene=scene, seed=seed).motion
    rng = np.random.default_rng([seed, *point.name.encode()])
    rate = scene.fields.rate or 0.0
    first = 0
    while True:
        yield film(
            scene,
            motion,
            block,
            renderer=renderer,
            rng=rng,
            start_s=first / rate,
            sub_exposures=_SUB_EXPOSURES,
        )
        first += block
