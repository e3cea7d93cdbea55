"""The command ``rmr up LAB``: its options alone, so that ``--help`` costs little; `perform` does the work."""

import sys
from pathlib import Path

import click

from rmr import __version__
from rmr.base.streams import SEED_MAX
from rmr_world.provided_labs import missing, resolve


def _existing(ctx: click.Context, param: click.Parameter, lab: Path) -> Path:
    """Return `lab` if it is a path that exists or a provided lab."""
    if not resolve(lab).exists():
        raise click.BadParameter(missing(lab), ctx, param)
    return lab


@click.command(context_settings={"help_option_names": ["-h", "--help"]})
@click.argument("lab", type=click.Path(path_type=Path), callback=_existing)
@click.option("--robots", type=click.IntRange(min=1), metavar="N", help="The first N robots of the lab only.")
@click.option("--seed", type=click.IntRange(0, SEED_MAX), metavar="S", help="In place of the lab's seed.")
@click.option(
    "--actions", type=click.Path(path_type=Path), metavar="FILE.py", help="Handlers of the program's actions."
)
@click.option("--json", "as_json", is_flag=True, help="The report on standard output, all else on standard error.")
@click.option("--strict", is_flag=True, help="Exit code 4 when a deadline was missed or robots touched.")
@click.option("--run", "folder", type=click.Path(path_type=Path), metavar="DIR", help="The run folder: new or empty.")
@click.option("--timeout", type=click.FloatRange(0, min_open=True), metavar="SECONDS", help="Wall time at most.")
@click.option("--processes", type=click.IntRange(min=1), metavar="N", help="Spread the robots over N processes only.")
@click.option("--keep-going", is_flag=True, help="Go on without a robot that died; the exit code is 1 all the same.")
@click.version_option(__version__, prog_name="rmr-up")
def command(
    lab: Path,
    robots: int | None,
    seed: int | None,
    actions: Path | None,
    as_json: bool,
    strict: bool,
    folder: Path | None,
    timeout: float | None,
    processes: int | None,
    keep_going: bool,
) -> None:
    """Start LAB, a folder, its lab.yaml or a provided lab, as processes: a world and one process for each robot.

    Waits until all are ready, runs until every robot holds the lab's finish fact, prints a table and leaves a
    run folder with report.json and logs. Ctrl-C stops in order, twice at once. Other users of the machine can neither
    use the bus of the run, which has a secret (the file secret in the run folder), nor read the folder.
    """
    from rmr_deploy.lab_run import Wishes, perform  # noqa: PLC0415 - the compiler loads only where a lab is run

    sys.exit(
        perform(
            Wishes(
                lab=lab,
                robots=robots,
                seed=seed,
                actions=actions,
                as_json=as_json,
                strict=strict,
                folder=folder,
                timeout_s=timeout,
                processes=processes,
                keep_going=keep_going,
            )
        )
    )
