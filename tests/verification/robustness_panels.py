"""Small random panels as TOML texts: one or two prismatic rails, one to six drives, any movement.

A rail is 6 to 14 m long, so that a run takes a tenth of a second. What the library panels cannot
be turned into by overrides is drawn here: numbers of drives, rails, feet and movements, shapes of
movements, rails without a stock rail, elastic laws as tables.
"""

import itertools
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from tests.verification.robustness_scenarios import Chooser

HEAD = """schema_version = 1
name = "small"
gravity = "9.81 m/s^2"
instrumented_rail = "a"
[material]
youngs_modulus = "210 GPa"
poisson_ratio = 0.3
density = "7850 kg/m^3"
[damping]
ratio = {damping}
frequencies = ["2 Hz", "12 Hz"]
[discretisation]
element_length = "{element} m"
superelement_cutoff = "{cutoff} Hz"
[section.plain]
x = "0 m"
area = "{area} cm^2"
second_moment_vertical = "{vertical} cm^4"
second_moment_lateral = "{lateral} cm^4"
product_moment = "{product} cm^4"
torsion_constant = "200 cm^4"
shear_factor_vertical = 0.5
shear_factor_lateral = 0.6
centroid_height = "45 mm"
centroid_offset = "{offset} mm"
shear_centre_height = "30 mm"
[object_defaults]
rail = "a"
height = "100 mm"
stiffness = "40 kN/mm"
[lock]
rule = "{lock}"
gap_limit = "5 mm"
"""


def small_panel(choose: "Chooser") -> str:
    """Draw the text of a panel file."""
    length = _round(choose, 6.0, 14.0)
    rails = ("a", "b")[: choose.integer(1, 2)]
    starts = _pick(choose, ("closed", "open"))
    parts = [_head(choose)]
    strokes = _round(choose, 0.02, 0.15)
    drawn = {name: _rail(choose, name, length=length, opening=strokes) for name in rails}
    parts += [*drawn.values(), _stock_rails(choose, drawn, length)]
    parts.append(_supports(choose, length))
    drives = choose.integer(1, 6)
    parts.append(_drives(choose, rails, count=drives, length=length, stroke=strokes))
    if len(rails) == 2:
        count = choose.integer(0, 3)
        parts += [_link(choose, number, length) for number in range(1, count + 1)]
    parts.append(_schedule(choose, starts, drives))
    text = "\n".join(parts)
    if all("stock_rail_gap" in rail for rail in drawn.values()):
        return text
    return text.replace('rule = "raw gap"', 'rule = "no slip"')


def _pick(choose: "Chooser", options: tuple[str, ...]) -> str:
    return options[choose.integer(0, len(options) - 1)]


def _round(choose: "Chooser", low: float, high: float) -> float:
    return min(max(float(f"{choose.number(low, high):.3g}"), low), high)


def _decades(choose: "Chooser", centre: float, *, to_each_side: float = 3.0) -> str:
    return f"{centre * 10 ** choose.number(-to_each_side, to_each_side):.3g}"


def _head(choose: "Chooser") -> str:
    product = _round(choose, -100.0, 100.0)
    return HEAD.format(
        damping=_pick(choose, ("0.02", "0.0", "0.1")),
        element=_pick(choose, ("0.3", "0.6", "0.15")),
        cutoff=_pick(choose, ("600", "300", "2000")),
        area=_pick(choose, ("60", "93")),
        vertical=_pick(choose, ("800", "1700")),
        lateral=_pick(choose, ("300", "700")),
        product=_pick(choose, ("0", str(product))),
        offset=_pick(choose, ("0", "-8", "8")),
        lock=_pick(choose, ("no slip", "raw gap")),
    )


def _rail(choose: "Chooser", name: str, *, length: float, opening: float) -> str:
    stress_free = _pick(choose, ("closed", "open"))
    text = f"""[rail.{name}]
closes = "{"+y" if name == "a" else "-y"}"
stress_free = "{stress_free}"
end = "{length} m"
heel = "{_pick(choose, ("clamped", "free"))}"
section = "plain"
independent_shape = true
axis = "{_pick(choose, ("foot", "centroid"))}"
"""
    if choose.integer(0, 5) == 5:
        return text  # no stock rail
    if stress_free == "closed":
        return text + 'stock_rail_gap = "0 m"\n'
    return text + (
        f'[rail.{name}.stock_rail_gap]\nx = ["0 m", "{0.7 * length!r} m"]\n'
        f'value = ["{opening!r} m", "1 mm"]\n'
    )


def _stock_rails(choose: "Chooser", rails: dict[str, str], length: float) -> str:
    """Let some of the stock rails bend, on fastenings from soft to stiff."""
    facing = [n for n, text in rails.items() if "stock_rail_gap" in text]
    chosen = [name for name in facing if choose.integer(0, 2) == 2]
    if not chosen:
        return ""
    spacing = float(_pick(choose, ("0.6", "1.2")))
    text = "".join(f'[stock_rail.of_{name}]\nfaces = "{name}"\n' for name in chosen)
    return (
        text
        + f"""[stock_rail]
start = "-1 m"
end = "{length!r} m"
ends = "{_pick(choose, ("clamped", "free"))}"
section = "plain"
foot_height = "{_pick(choose, ("-38", "0"))} mm"
[stock_fastening]
x = {{ start = "-0.9 m", step = "{spacing!r} m", count = {int((length + 0.9) / spacing)} }}
stiffness_x = "2e7 N/m"
stiffness_y = "{_decades(choose, 5e7, to_each_side=2.0)} N/m"
stiffness_z = "{_decades(choose, 1e8, to_each_side=2.0)} N/m"
stiffness_roll = "{_decades(choose, 2e5, to_each_side=2.0)} N m/rad"
damping_y = "{_pick(choose, ("10", "0"))} kN s/m"
"""
    )


def _supports(choose: "Chooser", length: float) -> str:
    chairs = choose.integer(1, int(0.8 * length / 0.6))
    stops = choose.integer(1, int(0.6 * length / 0.6))
    feet = _pick(choose, ('["-60 mm", "60 mm"]', '["0 mm"]', '["-70 mm", "0 mm", "50 mm"]'))
    return f"""[chair]
x = {{ start = "0.1 m", step = "0.6 m", count = {chairs} }}
foot_offsets = {feet}
normal_stiffness = "{_decades(choose, 1e7)} N/m"
friction_coefficient = 0.4
stick_stiffness = "{_decades(choose, 5e6)} N/m"
damping = "{_pick(choose, ("3.75", "0", "30"))} kN s/m"
[fastening]
x = ["{0.85 * length!r} m", "{0.92 * length!r} m", "{0.98 * length!r} m"]
stiffness_x = "2e7 N/m"
stiffness_y = "{_decades(choose, 5e7, to_each_side=2.0)} N/m"
stiffness_z = "{_decades(choose, 1e8, to_each_side=2.0)} N/m"
stiffness_roll = "2e5 N m/rad"
stiffness_yaw = "1e5 N m/rad"
damping_y = "{_pick(choose, ("10", "0"))} kN s/m"
[stop]
x = {{ start = "0 m", step = "0.6 m", count = {stops} }}
height = "{_pick(choose, ("100", "0"))} mm"
stiffness = "{_decades(choose, 2e8)} N/m"
clearance = "{_pick(choose, ("0", "2"))} mm"
[sensor.TKK1]
rail = "a"
x = "{0.3 * length!r} m"
height = "100 mm"
limit = "13 mm"
[sleeper]
x = {{ start = "0.6 m", step = "0.6 m", count = {chairs} }}
"""


def _drives(
    choose: "Chooser", rails: tuple[str, ...], *, count: int, length: float, stroke: float
) -> str:
    """Place drives from the toe on; the stroke falls off towards the heel."""
    texts = []
    for number in range(1, count + 1):
        x = round(0.7 * length * (number - choose.number(0.1, 0.9)) / count, 3)
        stiffness = float(_decades(choose, 1e6))
        own = round(max(stroke * (1 - x / length), 0.005), 5)
        texts.append(f"""[drive.{number}]
rail = "{_pick(choose, rails)}"
x = "{x!r} m"
height = "{_pick(choose, ("20", "0", "80"))} mm"
stroke = "{own!r} m"
over_travel_open = "{_pick(choose, ("0", "2", "-2"))} mm"
over_travel_closed = "{_pick(choose, ("0", "3", "-1"))} mm"
stiffness = "{stiffness!r} N/m"
saturation_force = "{_round(choose, 1.0, 20.0)} kN"
saturated_stiffness = "{min(stiffness, float(_pick(choose, ("1e3", "0", "1e5"))))!r} N/m"
""")
        if choose.integer(0, 9) == 9:
            texts.append(
                'extension = ["-20 mm", "-4 mm", "4 mm", "20 mm"]\n'
                'force = ["-7 kN", "-5 kN", "5 kN", "7 kN"]\n'
            )
    return "".join(texts)


def _link(choose: "Chooser", number: int, length: float) -> str:
    return f"""[link.{number}]
rails = ["a", "b"]
x = "{round(0.2 * number * length, 3)!r} m"
height = "20 mm"
stiffness = "{_decades(choose, 5e7)} N/m"
"""


def _schedule(choose: "Chooser", starts: str, drives: int) -> str:
    """Move up to four times; rests between may have no length."""
    texts, time = [], float(_pick(choose, ("0.1", "0")))
    ways = itertools.cycle(("open", "closed") if starts == "closed" else ("closed", "open"))
    for number, way in zip(range(choose.integer(0, 4)), ways, strict=False):
        duration = _round(choose, 0.2, 1.0)
        extra = float(_pick(choose, ("0", "0.1", "-0.05")))
        shape = _pick(choose, ("raised cosine", "smoothstep", "linear", "table"))
        text = f"""[movement.m{number}]
start = "{round(time, 6)!r} s"
duration = "{duration!r} s"
to = "{way}"
shape = "{shape}"
extra_time = {{ {choose.integer(1, drives)} = "{extra!r} s" }}
"""
        if shape == "raised cosine":
            text += f'ramp = "{_pick(choose, ("0.05", "0"))} s"\n'
        if shape == "table":
            text += f'table_time = ["0 s", "{duration / 3!r} s", "{duration!r} s"]\n'
            text += "table_fraction = [0.0, 0.6, 1.0]\n"
        texts.append(text)
        time += duration + max(extra, 0.0) + float(_pick(choose, ("0", "0.2")))
    end = round(time + float(_pick(choose, ("0.2", "0"))), 6)
    texts.append(f'[schedule]\nstarts = "{starts}"\nend = "{max(end, 0.1)!r} s"\n')
    return "".join(texts)
