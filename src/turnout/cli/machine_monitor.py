"""The command `turnout machine monitor`: a throw as a monitoring system in service stores it."""

from pathlib import Path
from typing import Annotated

import typer

from turnout.cli.json_output import JsonOption, print_json
from turnout.cli.options import QuietOption, check_outputs

RunArgument = Annotated[
    Path, typer.Argument(metavar="RUN", help="Result of a throw whose drives are machines.")
]
TogetherOption = Annotated[
    list[str],
    typer.Option(
        "--together",
        metavar="NAME=DRIVES",
        help="One transformer around the leads of several drives: switch=1,2. Repeatable.",
    ),
]


def monitor_command(
    run: RunArgument,
    out: Annotated[
        Path, typer.Option("--out", "-o", metavar="FILE", help="File to write (.csv, .mat or .h5).")
    ],
    rate: Annotated[
        str, typer.Option("--rate", metavar="RATE", help="Values a second, usually 25 to 100 Hz.")
    ] = "50 Hz",
    together: TogetherOption = [],  # noqa: B006 - typer copies it
    current_step: Annotated[
        str, typer.Option("--current-step", metavar="CURRENT", help="Resolution; '0 A' for none.")
    ] = "0.01 A",
    as_json: JsonOption = False,
    quiet: QuietOption = False,
) -> None:
    """Sample currents (RMS) and powers (mean) of a throw over windows, in coarse steps.

    The file is a recording: `turnout import` shows it.
    """
    check_outputs({"--out": out}, {"--out": (".csv", ".mat", ".h5")})
    from turnout.measurement.chain.monitoring import (
        monitored,
        monitoring_of,
        monitoring_recording,
    )
    from turnout.measurement.formats.file_format import write_recording
    from turnout.throw.store import open_response

    chosen = monitoring_of(rate=rate, together=together, current_step=current_step)
    stored = monitored(open_response(run), chosen)
    recording = monitoring_recording(stored, source=f"monitoring of {run.name}, simulated")
    write_recording(recording, out)
    if as_json:
        found = [
            {"name": name, "unit": channel.unit, "largest": float(channel.values.max())}
            for name, channel in recording.channels.items()
        ]
        record = {"rate": chosen.rate, "samples": stored.sizes["time"], "channels": found}
        print_json("machine monitor", record, units={"rate": "1/s"}, written=[out])
        return
    if quiet:
        return
    typer.echo(f"{'sampled':<12}{stored.sizes['time']} values at {chosen.rate:g} Hz")
    for name, channel in recording.channels.items():
        typer.echo(f"{'':<12}{name}: at most {channel.values.max():g} {channel.unit}")
    typer.echo(f"{'written':<12}{out}")
