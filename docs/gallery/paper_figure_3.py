"""A drive rod as a free body, the bending strain that the rail's force gives, and the way back.

Rail at A, motor at B, gauges in the section below the attachment: the moment there is force times
height. The rod is an assumption, a round bar of 40 mm and 60 mm of height: none is published.
"""

import matplotlib.pyplot as plt
import numpy as np

import turnout

HEIGHT, MODULUS, YOUNG = 60e-3, 6.28e-6, 210e9  # h [m], section modulus [m^3], E [N/m^2]
panel = turnout.load_panel("uic60-760-1-15")
begin = panel.movement["return"].start
throw = turnout.simulate(panel, foreign_object=turnout.ForeignObject(0.013, at="drive 1"))
force = throw["drive_force"].sel(drive="1", time=slice(begin, begin + 4.0))
strain = force * HEIGHT / (MODULUS * YOUNG)  # M2 = 0 at the motor, so M = R h
noise = np.random.default_rng(3).normal(0.0, 1e-6, strain.shape)  # 1 um/m
measured = turnout.filtered(strain + noise) * MODULUS * YOUNG / HEIGHT

figure, (body, bending, back) = plt.subplots(
    1, 3, figsize=(12, 3.8), width_ratios=[1.1, 1, 1], layout="constrained"
)
body.plot([0, 3], [0, 0], color="0.35", linewidth=9, solid_capstyle="butt")
body.plot([0.25, 0.25], [0, 1], color="0.35", linewidth=9, solid_capstyle="butt")
arrow = {"arrowstyle": "-|>", "linewidth": 1.6}
for tip, tail, text, place in (
    ((0.25, 1.0), (-0.75, 1.0), "$R_{1H}$", (-0.7, 1.08)),
    ((0.25, 1.05), (0.25, 1.65), "$R_{1V}$", (0.32, 1.5)),
    ((3.0, 0.0), (3.9, 0.0), "$R_{2H}$", (3.4, 0.08)),
    ((3.0, -0.05), (3.0, -0.65), "$R_{2V}$", (3.07, -0.6)),
):
    body.annotate("", xy=tip, xytext=tail, arrowprops=arrow)
    body.text(*place, text, fontsize=11)
body.annotate("", xy=(0.75, 0.0), xytext=(0.75, 1.0), arrowprops={"arrowstyle": "<->"})
body.text(0.82, 0.45, "h", fontsize=11)
body.plot([0.42, 0.42], [0.12, -0.12], color="tab:red", linewidth=3)
body.text(0.5, -0.42, "gauges: $M = R_{1H} h$", color="tab:red", fontsize=10)
body.text(-0.02, 1.08, "A", fontsize=11, ha="right")
body.text(2.75, 0.15, "B, $M_2 = 0$", fontsize=11, ha="right")
body.set(xlim=(-1, 4.2), ylim=(-0.9, 1.8), title="Free body of a rod")
body.set_axis_off()
time = force["time"].values - begin
bending.plot(time, 1e6 * strain.values)
bending.set(xlabel="Time from the onset [s]", ylabel="Bending strain [um/m]",
            title="13 mm at Drive 1")  # fmt: skip
back.plot(time, 1e-3 * measured.values, color="black", label="from the strain (virtual)")
back.plot(time, 1e-3 * turnout.filtered(force).values, "--", label="model")
back.plot(time, 1e-3 * (measured - turnout.filtered(force)).values, color="tab:red",
          linewidth=1, label="difference")  # fmt: skip
back.set(xlabel="Time from the onset [s]", ylabel="Force on the rail [kN]",
         title="Back to force, 0.1 s mean")  # fmt: skip
back.legend(frameon=False, fontsize=9)
figure.savefig("paper_figure_3.png", dpi=110)

at_slip = 6e3 * HEIGHT / (MODULUS * YOUNG)
assert abs(at_slip - 273e-6) < 1e-6, f"{at_slip} of strain at 6 kN"
assert float(abs(measured - turnout.filtered(force)).max()) < 50.0
