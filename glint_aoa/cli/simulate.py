"""``glint-aoa simulate``: a whole test from one file."""

from enum import StrEnum
from typing import Annotated

import typer

from glint_aoa.cli._common import Json, Out, Overwrite, bar, print_json

__all__ = ["RendererChoice", "simulate"]


class RendererChoice(StrEnum):
    """Renderers by name."""

    AUTO = "auto"
    RAYTRACE = "raytrace"
    PYRENDER = "pyrender"


def simulate(
    campaign: Annotated[
        str, typer.Argument(help="paper, demo, or a campaign file (TOML).", show_default=False)
    ],
    out: Out,
    renderer: Annotated[
        RendererChoice, typer.Option(help="auto takes the built-in one.")
    ] = RendererChoice.AUTO,
    seed: Annotated[int, typer.Option(min=0, help="The same seed gives the same bits.")] = 0,
    jobs: Annotated[int, typer.Option(min=1, help="Processes.")] = 1,
    overwrite: Overwrite = False,
    as_json: Json = False,
) -> None:
    """Simulate a test: fields, acquisition channels and the truth, as HDF5 points.

    Example: glint-aoa simulate demo --out points --jobs 2
    """
    from render_sim.campaign import load_campaign, simulate_campaign

    plan = load_campaign(campaign)
    written = []
    with bar(len(plan.points)) as advance:
        for path in simulate_campaign(
            plan, out, renderer=renderer.value, seed=seed, jobs=jobs, overwrite=overwrite
        ):
            written.append(path)
            advance(1, path.stem)
    if as_json:
        print_json({"points": written})
    else:
        typer.echo(f"Wrote {len(written)} points to {out}")
