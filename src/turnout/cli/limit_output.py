"""Printed and written results of `turnout limit`."""

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING

import typer

from turnout.cli.output import Output

if TYPE_CHECKING:
    import xarray as xr

    from turnout.detection.limit.what_if import Repeat

LENGTHS = dict.fromkeys(
    (
        *("x", "touch_floor", "largest_size", "a90", "a90_low", "a90_high"),
        *("gap_limit", "revealed_gap"),
        *(name + end for name in ("gain", "gain_worst") for end in ("", "_low", "_high")),
        *("known_a90", "known_a90_low", "known_a90_high"),
    ),
    "m",
)
BANDS = {
    f"a90_{band}{end}": "m"
    for band in ("low", "middle", "high")
    for end in ("", "_interval_low", "_interval_high")
}


def write_bands(
    found: "xr.Dataset", output: Output, *, out: Path | None, plot: Path | None
) -> None:
    """Write files first, then print."""
    from turnout.detection.conditions import SIMULATED
    from turnout.detection.limit.bands import band_rows

    output.dataset(out, found)
    if plot is not None:
        from turnout.figures.limit import plot_bands

        output.figure(plot, lambda: plot_bands(found))
    rows = band_rows(found)
    if output.as_json:
        record = {"panels": found["panel"].to_numpy().tolist(), "bands": rows}
        output.json(record, units=LENGTHS | BANDS)
    elif not output.silent:
        typer.echo(
            f"a90 [mm] of the bound over {found.sizes['panel']} panels; in brackets the 95 % "
            f"interval over {found.attrs['states']} drawn states; {SIMULATED}\n"
            f"{'place':<12}{'5 %':>24}{'middle':>24}{'95 %':>24}"
        )
        for row in rows:
            cells = [_with_ends(row, f"a90_{band}") for band in ("low", "middle", "high")]
            typer.echo(f"{row['place']:<12}" + "".join(f"{cell:>24}" for cell in cells))


def _with_ends(row: "Mapping[str, float | str | None]", name: str) -> str:
    """Return a length and its interval in millimetres."""
    low, high = (_millimetres(row[f"{name}_interval_{end}"]) for end in ("low", "high"))
    return f"{_millimetres(row[name])} ({low} ... {high})"


def write_map(
    found: "xr.Dataset",
    advice: "tuple[xr.Dataset, Repeat] | None",
    output: Output,
    *,
    out: Path | None,
    plot: Path | None,
) -> None:
    """Write files first, then print."""
    from turnout.detection.limit.end_positions import end_rows
    from turnout.detection.limit.known_place_map import known_rows
    from turnout.detection.limit.limit_map import rows_of
    from turnout.detection.limit.what_if import gain_rows

    output.dataset(out, found)
    if plot is not None:
        from turnout.figures.limit import plot_limit

        output.figure(plot, lambda: plot_limit(found))
    if output.as_json:
        record = {
            "conditions": found.attrs,
            "places": rows_of(found),
            "known_place": known_rows(found) if "known_pod" in found else None,
            "end_positions": end_rows(found) if "end_pod" in found else None,
            "measures": gain_rows(advice[0]) if advice else None,
            "second_throw": advice[1] if advice else None,
        }
        output.json(record, units=LENGTHS)
    elif not output.silent:
        _print(found)
        if "known_pod" in found:
            _print_known(known_rows(found), draws=int(found.attrs["known_draws"]))
        if "end_pod" in found:
            _print_ends(end_rows(found))
        if advice:
            _print_advice(gain_rows(advice[0]), advice[1])


def _print(found: "xr.Dataset") -> None:
    from turnout.detection.conditions import SIMULATED
    from turnout.detection.limit.limit_map import rows_of

    said = found.attrs
    typer.echo(
        f"{said['quantities'].capitalize()} of the drives: smallest size that the bound detects "
        f"in 90 % of {said['states']} states "
        f"(discrepancy {100 * said['discrepancy']:g} %, {said['history']} sound throws known, "
        f"false-alarm rate {said['false_alarm_rate']:g}, objects: {said['object_kind']}); "
        f"optimistic: place and size are known; {SIMULATED}"
    )
    channels = [str(name) for name in found["channel"].to_numpy()]
    others = "".join(f"{name + ' alone':>16}" for name in channels[1:])
    typer.echo(f"{'place':<12}{'x [m]':>7}{'touch floor':>13}{'a90 [mm]':>10}{'95 %':>15}{others}")
    for row in rows_of(found):
        cells = [_millimetres(row[name]) for name in ("a90", "a90_low", "a90_high")]
        more = "".join(f"{_millimetres(row[f'a90, {name}']):>16}" for name in channels[1:])
        typer.echo(
            f"{row['place']:<12}{row['x']:>7.2f}{_millimetres(row['touch_floor']):>13}"
            f"{cells[0]:>10}{cells[1] + ' ... ' + cells[2]:>15}{more}"
        )


def _millimetres(value: object) -> str:
    return f"{1e3 * value:.1f}" if isinstance(value, float) else "beyond"


def _print_known(rows: "list[dict[str, float | str | None]]", *, draws: int) -> None:
    typer.echo(
        f"\nif the place is known, size and state not ({draws} sound throws drawn): the limit lies "
        "between the two"
    )
    typer.echo(f"{'place':<12}{'a90 [mm]':>10}{'95 %':>15}")
    for row in rows:
        cells = [_millimetres(row[f"known_a90{end}"]) for end in ("", "_low", "_high")]
        typer.echo(f"{row['place']:<12}{cells[0]:>10}{cells[1] + ' ... ' + cells[2]:>15}")


def _print_ends(rows: "list[Mapping[str, float | str | None]]") -> None:
    typer.echo(
        f"\nend position: {'at':<10}{'limit [mm]':>11}{'shown at limit':>16}"
        f"{'shown in 90 % from [mm]':>25}  by"
    )
    for row in rows:
        limit, share = row["gap_limit"], row["end_pod_at_limit"]
        assert isinstance(limit, float)
        assert isinstance(share, float)
        typer.echo(
            f"{'':<14}{row['position']:<10}{1e3 * limit:>11.1f}{100 * share:>14.1f} %"
            f"{_millimetres(row['revealed_gap']):>25}  {row['channel']}"
        )


def _print_advice(rows: "list[Mapping[str, float | str]]", repeat: "Repeat") -> None:
    typer.echo(
        f"\n{'measure':<26}{'gain of a90 [mm]':>17}{'95 %':>16}{'worst place [mm]':>18}{'95 %':>16}"
        "  meaning"
    )
    for row in rows:
        text = f"{row['measure']:<26}"
        for name, width in (("gain", 17), ("gain_worst", 18)):
            value, low, high = (1e3 * float(row[name + end]) for end in ("", "_low", "_high"))
            text += f"{value:>{width}.2f}{f'{low:.2f} ... {high:.2f}':>16}"
        typer.echo(f"{text}  {row['note']}")
    typer.echo(
        f"false alarms a switch and year: {repeat.once_a_year:.3g}; {repeat.twice_a_year:.2g} if a "
        f"second throw must confirm (correlation {repeat.correlation:.2f}: independent throws "
        "would square the rate)"
    )
