"""``glint-aoa simulate``: a whole test from one file."""

from enum import StrEnum
from typing import Annotated

import typer

from glint_aoa.cli._common import (
    Jobs,
    Json,
    Out,
    Overwrite,
    Resume,
    bar,
    check_folder,
    check_new_files,
    print_json,
)

__all__ = ["RendererChoice", "RendererOption", "simulate"]


class RendererChoice(StrEnum):
    """Renderers by name."""

    AUTO = "auto"
    RAYTRACE = "raytrace"
    PYRENDER = "pyrender"


RendererOption = Annotated[
    RendererChoice,
    typer.Option(help="auto takes the built-in one, raytrace; pyrender needs OpenGL."),
]


_CAMPAIGNS = ("paper", "demo")


def _campaigns_like(incomplete: str) -> list[str]:
    """Return the built-in campaigns that a word may become, for the shell's completion."""
    return [name for name in _CAMPAIGNS if name.startswith(incomplete)]


def simulate(
    campaign: Annotated[
        str,
        typer.Argument(
            metavar="CAMPAIGN",
            help="paper, the paper's whole test; demo, a part of it; or a campaign file (TOML).",
            show_default=False,
            autocompletion=_campaigns_like,
        ),
    ],
    out: Out,
    renderer: RendererOption = RendererChoice.AUTO,
    seed: Annotated[
        int, typer.Option(min=0, metavar="N", help="The same seed gives the same bits.")
    ] = 0,
    jobs: Jobs = 1,
    resume: Resume = False,
    overwrite: Overwrite = False,
    as_json: Json = False,
) -> None:
    """Simulate a test: fields, channels and the truth.

    Writes <point>.h5 for each point of the campaign.

    \b
    Example: glint-aoa simulate demo --out points --jobs 2
    """
    from render_sim.campaign import load_campaign, simulate_campaign

    plan = load_campaign(campaign)
    check_folder(out)
    files = (out / f"{point.name}.h5" for point in plan.points)
    check_new_files(files, overwrite=overwrite or resume)
    written = []
    with bar(len(plan.points)) as advance:
        for path in simulate_campaign(
            plan,
            out,
            renderer=renderer.value,
            seed=seed,
            jobs=jobs,
            overwrite=overwrite,
            resume=resume,
        ):
            written.append(path)
            advance(1, path.stem)
    if as_json:
        print_json({"points": written})
    else:
        typer.echo(f"Wrote {len(written)} points to {out}")
