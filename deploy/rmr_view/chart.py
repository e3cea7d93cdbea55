"""A figure as data: what is drawn, without how.

An experiment writes its figure into its JSON file under `figure`; `rmr plot` reads that alone and needs to know nothing
of the experiment. A figure is a row of panels; a panel has axes and series; a series has points (x, y), each perhaps
with an interval [low, high]. A limit that is null does not exist (too few values) and is not drawn.

Whoever writes such a file may err: everything is checked before anything is drawn, and told with its place.
"""

from pathlib import Path
from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator

POINTS_MAX = 100_000
"""Points of one series at most: more than a figure can show, in a file of some megabytes."""
SERIES_MAX = 40
PROBLEMS_MAX = 5
"""Errors of one file that are shown at most."""
OCTETS_MAX = 64 << 20
"""Size of a data file at most."""

NUMBER_MAX = 1e100
"""Greatest absolute value: beyond it the axes overflow."""

Number = Annotated[float, Field(ge=-NUMBER_MAX, le=NUMBER_MAX, allow_inf_nan=False)]
Text = Annotated[str, Field(max_length=2_000)]
Numbers = Annotated[list[Number], Field(max_length=POINTS_MAX)]
Limits = Annotated[list[Number | None], Field(max_length=POINTS_MAX)]


class ChartError(Exception):
    """A file holds no figure that can be drawn; says why."""


class FigurePart(BaseModel):
    """Any part of a figure; unknown keys are mistakes."""

    model_config = ConfigDict(extra="forbid", frozen=True)


class Series(FigurePart):
    """Points of one kind."""

    label: Text
    kind: Literal["line", "points", "bars", "stack"] = "line"
    """Of several `bars` those of one x stand side by side; series of kind `stack` stand upon those before them."""
    x: Numbers
    y: Numbers
    low: Limits | None = None
    high: Limits | None = None
    group: Text | None = None
    """Stacks of different groups stand side by side."""

    @model_validator(mode="after")
    def _as_long(self) -> "Series":
        lengths = {len(each) for each in (self.x, self.y, self.low, self.high) if each is not None}
        if len(lengths) > 1:
            raise ValueError("x, y, low and high differ in length")
        if (self.low is None) != (self.high is None):
            raise ValueError("low and high go together")
        return self


class ReferenceLine(FigurePart):
    """A level drawn across a panel: a target, a limit."""

    y: Number
    label: Text


class Tick(FigurePart):
    """A place on the x axis that has a name."""

    at: Number
    label: Text


class Panel(FigurePart):
    """Axes and what is drawn on them."""

    title: Text = ""
    x: Text
    """What the axis shows, with its unit."""
    y: Text
    series: Annotated[list[Series], Field(min_length=1, max_length=SERIES_MAX)]
    lines: Annotated[list[ReferenceLine], Field(max_length=SERIES_MAX)] = []
    ticks: Annotated[list[Tick], Field(max_length=SERIES_MAX)] = []
    """Names on the x axis in place of numbers."""
    x_log: bool = False
    y_log: bool = False
    y_from: Number | None = None
    """Where the y axis begins; none: where the data do, or at 0 with bars."""


class Figure(FigurePart):
    """All of a figure."""

    title: Text
    note: Text = ""
    """What stands below it: of how many runs, and what the bars are."""
    # More cannot be told apart.
    panels: Annotated[list[Panel], Field(min_length=1, max_length=12)]


class FigureFile(BaseModel):
    """A data file; of its keys only the figure matters here."""

    figure: Figure | None = None


def figures_in(folder: Path) -> dict[str, Path]:
    """Return the data files in `folder` by the names that they have as figures, in alphabetical order."""
    return {path.stem: path for path in sorted(folder.glob("*.json")) if path.is_file()}


def read(path: Path) -> Figure:
    """Return the figure of a data file.

    Raises ChartError with what is wrong, OSError when the file cannot be read.
    """
    if path.stat().st_size > OCTETS_MAX:
        raise ChartError(f"{path}: larger than {OCTETS_MAX >> 20} MiB")
    try:
        figure = FigureFile.model_validate_json(path.read_bytes()).figure
    except ValidationError as error:
        problems = error.errors(include_url=False, include_input=False, include_context=False)
        lines = [f"{path}: {_place(problem['loc'])}{problem['msg']}" for problem in problems[:PROBLEMS_MAX]]
        more = len(problems) - PROBLEMS_MAX
        raise ChartError("\n".join([*lines, *([f"and {more} more"] if more > 0 else [])])) from error
    if figure is None:
        raise ChartError(f"{path}: there is no figure in it: its key `figure` is missing")
    return figure


def _place(parts: tuple[int | str, ...]) -> str:
    return ".".join(map(str, parts)) + ": " if parts else ""
