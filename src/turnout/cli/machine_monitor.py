"""The command `turnout machine monitor`: a throw as a monitoring system in service stores it."""

from pathlib import Path
from typing import Annotated

from turnout.cli.options import QuietOption, argument, check_outputs, option
from turnout.cli.output import JsonOption, Output

RunArgument = Annotated[Path, argument("RUN", "Result of a throw whose drives are machines.")]
TogetherOption = Annotated[
    list[str],
    option(
        "--together NAME=DRIVES",
        "One transformer around the leads of several drives: switch=1,2. Repeatable.",
    ),
]


def monitor_command(
    run: RunArgument,
    out: Annotated[Path, option("--out -o FILE", "File to write (.csv, .mat or .h5).")],
    rate: Annotated[str, option("--rate RATE", "Values a second, usually 25 to 100 Hz.")] = "50 Hz",
    together: TogetherOption = [],  # noqa: B006 - typer copies it
    current_step: Annotated[
        str, option("--current-step CURRENT", "Resolution; '0 A' for none.")
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
    output, size = Output("machine monitor", as_json=as_json, quiet=quiet), stored.sizes["time"]
    output.show(f"{size} values at {chosen.rate:g} Hz", heading="sampled")
    found = [
        {"name": name, "unit": channel.unit, "largest": float(channel.values.max())}
        for name, channel in recording.channels.items()
    ]
    output.rows("", (f"{row['name']}: at most {row['largest']:g} {row['unit']}" for row in found))
    output.wrote(out)
    if as_json:
        record = {"rate": chosen.rate, "samples": size, "channels": found}
        output.json(record, units={"rate": "1/s"})
