"""The verb that runs a paper again."""

from pathlib import Path
from typing import Annotated, Literal

import tyro

from wrenchbed import study as studies
from wrenchbed.cli import console
from wrenchbed.cli.console import Json


def study(
    paper: tyro.conf.Positional[Literal["medrue", "ur5"]],
    /,
    out: Path | None = None,
    quick: Annotated[bool, tyro.conf.FlagCreatePairsOff] = False,
    robots: int | None = None,
    seed: int = 0,
    as_json: Json = False,
) -> None:
    """A paper's tables and figures on MuJoCo data, beside what it prints and what physics allows.

    A stopped study goes on where it stopped.

    Args:
        paper: medrue (Sensors 2016, 16, 798) or ur5 (installation error of a force sensor).
        out: Folder for tables (Markdown, HTML), figures (SVG) and results (Parquet).
        quick: A small version, a minute or two.
        robots: Random MedRUE robots (200, quick 8), or repetitions on the UR5 (20, quick 3).
        seed: Of everything random.
        as_json: Print the key results as JSON.
    """
    console.check_seed(seed)
    folder = Path("out") / f"study-{paper}" if out is None else out
    with console.progress(f"study {paper}", studies.steps(paper, quick, robots)) as tell:
        done = studies.run(paper, folder, quick=quick, robots=robots, seed=seed, tell=tell)
    console.answer(done.summary, as_json, "\n".join(done.lines))
