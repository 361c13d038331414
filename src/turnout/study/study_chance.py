"""What a study leaves to chance: fields, correlations, draws, and what temperature does."""

import math

from turnout.files.problems import choices, nearest, show_value
from turnout.files.units import (
    LENGTH,
    TEMPERATURE,
    TEMPERATURE_COEFFICIENT,
    Dimension,
    parse_quantity,
)
from turnout.study.random_field import RandomField
from turnout.study.study_records import StudyRecord
from turnout.study.study_variables import Found, read_field_law
from turnout.study.temperature import TemperatureLaw
from turnout.study.variable import TEMPERATURE_KEY, kind_of, values_at

MOST_SCENARIOS = 10_000_000


def read_quantity(found: Found, where: str, value: object, dimension: Dimension) -> float | None:
    """Read a quantity; None where it is none, which is noted."""
    try:
        return parse_quantity(value, dimension)
    except ValueError as error:
        found.note(where, f" = {show_value(value)}: {error}")
        return None


def read_fields(found: Found, record: StudyRecord) -> list[RandomField]:
    """Read the random fields of a study."""
    fields_read: list[RandomField] = []
    for number, item in enumerate(record.field, 1):
        where = f"field {number} ({item.key})"
        read = read_field_law(found, item, where=where)
        length = read_quantity(
            found, f"{where}.correlation_length", item.correlation_length, LENGTH
        )
        if length is not None and not length > 0:
            found.note(f"{where}.correlation_length", ": must be more than 0")
        if read is None or length is None or not length > 0:
            continue
        variable, law = read
        if variable.name in {*found.variables, *(known.name for known in fields_read)}:
            text = f': something named "{variable.name}" is there already; give it another `name`'
            found.note(where, text)
            continue
        family, _, below = item.key.partition(".")
        members = getattr(found.panel, family, {})
        if not isinstance(members, dict) or below.split(".")[0] in members or not members:
            found.note(where, ": a field goes over a family, such as chair.friction_coefficient")
            continue
        placed = {name: getattr(member, "x", None) for name, member in members.items()}
        if not all(isinstance(x, float) for x in placed.values()):
            found.note(where, f": the members of {family} have no places along the switch")
            continue
        fields_read.append(
            RandomField(
                name=variable.name,
                key=item.key,
                members=tuple(placed),
                x=tuple(float(str(x)) for x in placed.values()),
                distribution=law,
                correlation_length=length,
                correlation=item.correlation,
                factor=item.factor,
            )
        )
    return fields_read


def read_law_of_temperature(found: Found, record: StudyRecord) -> TemperatureLaw | None:
    """Read what temperature does; needed where it varies."""
    given = record.temperature_law
    varies = any(item.key == TEMPERATURE_KEY for item in found.variables.values())
    if given is None:
        if varies:
            text = ": temperature varies, so say what it does in a table [temperature_law]"
            found.note("temperature_law", text)
        return None
    where = "temperature_law"
    if not varies:
        found.note(where, ': needs a variable with key = "temperature"')
    try:
        if not values_at(found.panel, given.key) or kind_of(found.panel, given.key) is str:
            found.note(where, f'.key = "{given.key}": has nothing that could be multiplied')
    except (ValueError, KeyError, AttributeError, TypeError):
        found.note(where, f'.key = "{given.key}": matches nothing in this panel')
    linear = given.reference is not None and given.coefficient is not None
    table = given.temperature is not None and given.factor is not None
    if linear == table:
        found.note(where, ": needs either reference and coefficient, or temperature and factor")
        return None
    if linear:
        reference = read_quantity(found, f"{where}.reference", given.reference, TEMPERATURE)
        slope = read_quantity(
            found, f"{where}.coefficient", given.coefficient, TEMPERATURE_COEFFICIENT
        )
        if reference is None or slope is None:
            return None
        return TemperatureLaw(key=given.key, reference=reference, coefficient=slope)
    read = [
        read_quantity(found, f"{where}.temperature", t, TEMPERATURE)
        for t in given.temperature or []
    ]
    temperatures = [item for item in read if item is not None]
    factors = [float(item) for item in given.factor or []]
    if any(a >= b for a, b in zip(temperatures, temperatures[1:], strict=False)):
        found.note(f"{where}.temperature", ": must rise")
    if len(read) != len(factors):
        found.note(f"{where}.factor", f": has {len(factors)} values for {len(read)} temperatures")
    return TemperatureLaw(key=given.key, temperatures=tuple(temperatures), factors=tuple(factors))


def sampling_faults(method: str, count: int, drawn: int, with_fields: bool) -> list[str]:
    """Say what is wrong with method and count of the draws."""
    where, faults = f"sampling.count = {count}", []
    if count < 1:
        faults.append(f"{where}: must be at least 1, or there is no scenario")
    elif method in ("sobol", "saltelli") and count & (count - 1):
        near = 1 << round(math.log2(count))
        faults.append(f"{where}: must be a power of 2 for '{method}'; near is {near}")
    if count > MOST_SCENARIOS:
        faults.append(f"{where}: at most {MOST_SCENARIOS}")
    if method == "saltelli" and with_fields:
        faults.append(
            'sampling.method = "saltelli": fields are chance of their own; leave them out'
        )
    if method != "random" and not drawn:
        faults.append(f"sampling.method = \"{method}\": no variable is drawn; use 'random'")
    return faults


def read_pairs(found: Found, record: StudyRecord, names: list[str]) -> list[tuple[str, str, float]]:
    """Read which drawn variables go together: two names and their rank correlation."""
    pairs: list[tuple[str, str, float]] = []
    for number, item in enumerate(record.correlation, 1):
        where = f"correlation {number}.between"
        unknown = [name for name in item.between if name not in names]
        for name in unknown:
            text = f": is no drawn variable{nearest(name, names)}; there are {choices(names)}"
            found.note(where, f' = "{name}"{text}')
        first, second = item.between
        if first == second:
            found.note(where, f' = "{first}": twice the same')
        elif any({first, second} == {a, b} for a, b, _ in pairs):
            found.note(where, f': "{first}" and "{second}" are there already')
        elif not unknown:
            pairs.append((first, second, item.rank_correlation))
    return pairs
