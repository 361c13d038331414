"""A comparison of drive laws in words."""

from turnout.study.discrepancy.compare import DECISIVE, LawComparison
from turnout.study.discrepancy.laws import level_key


def law_lines(found: LawComparison) -> list[str]:
    """Return a comparison as lines for the screen, the verdict first."""
    best, plain = found.best, found.plain
    lines = [f"drive {found.drive}: the data want the law '{best.name}': {best.text}"]
    if best is plain:
        lines[0] += "; no other law is decisively better"
    else:
        gain = plain.schwarz - best.schwarz
        lines[0] += f"; the bilinear law is rejected (BIC {gain:.0f} higher)"
    level = best.values[level_key(found.drive)]
    share = best.scatter.get(level_key(found.drive))
    excess = 100.0 * (level / found.nominal - 1.0)
    side = "above" if excess > 0 else "below"
    lines.append(
        f"  slips at {level / 1e3:.2f} kN, {abs(excess):.1f} % {side} the stated "
        f"{found.nominal / 1e3:g} kN"
        + (f", scattering by {100 * share:.1f} % from throw to throw" if share else "")
    )
    for item in found.results:
        extra = ", ".join(f"{n} = {v:.3g}" for n, v in item.values.items() if "." not in n)
        mark = "rejected" if item in found.rejected else ("chosen" if item is best else "possible")
        if item.slight:
            mark = "no more than the bilinear law"
        lines.append(
            f"  {item.name:<44} AICc {item.akaike - best.akaike:+8.1f}  "
            f"BIC {item.schwarz - best.schwarz:+8.1f}  {mark}{'  ' + extra if extra else ''}"
        )
    lines.append(
        f"  from {len(found.movements)} movements worth {found.samples:.0f} independent samples; "
        f"decisive from a difference of {DECISIVE:g} on"
    )
    return lines
