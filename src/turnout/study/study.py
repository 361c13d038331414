"""A study: every throw of it by its number, and all inputs that determine their results."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from turnout.core.json_files import to_plain
from turnout.core.provenance import content_hash
from turnout.core.scheme import Scheme
from turnout.panel.foreign_object import ForeignObject
from turnout.panel.load import LoadedPanel
from turnout.study.design import Design
from turnout.study.random_inputs import RandomField, TemperatureLaw
from turnout.study.sampling import FIELDS, SCENARIOS
from turnout.study.scenario import Output, Rule, Scenario, Value, split_into_chains
from turnout.study.seeds import generators, seed_words
from turnout.study.variable import (
    CAUSE,
    LABEL,
    LABELS,
    OBJECT_KEYS,
    RECORDER_KEYS,
    TEMPERATURE_KEY,
    Variable,
    apply_factors,
    foreign_objects,
    format_value,
    recorder_of,
    set_items,
)

DIGEST_FIELDS = ("scheme", "output", "design", "variables", "fields", "law", "rule", "split")
"""Fields that determine the results of a study, besides panel and seed."""


@dataclass(frozen=True, kw_only=True)
class Study:
    """Many throws of one panel, each by its number.

    Attributes
    ----------
    name, description : str
        Free texts that results are labelled with.
    panel : LoadedPanel
        Base panel, with the values that the study sets in every throw.
    scheme : Scheme
        Step [s], cut-off [Hz] and tolerances of every throw.
    output : Output
        Channels, times and features that are stored.
    seed : int
        Seed of all random draws.
    design : Design
        Values of the variables.
    variables : mapping of str to Variable
        By name, in the order of the design.
    fields : tuple of RandomField
        Values that scatter along the switch, drawn again in each state.
    law : TemperatureLaw, optional
        Effect of the temperature on the panel.
    rule : Rule, optional
        Condition that ends a chain of throws, such as a slip.
    split : tuple of str
        Variables whose equal values stay together when data are split; without any it is the
        drawn state.
    remarks : tuple of str
        Hints for its author, such as a calibration of another panel.
    """

    name: str
    description: str
    panel: LoadedPanel
    scheme: Scheme
    output: Output
    seed: int
    design: Design
    variables: Mapping[str, Variable]
    fields: tuple[RandomField, ...]
    law: TemperatureLaw | None
    rule: Rule | None
    split: tuple[str, ...]
    remarks: tuple[str, ...] = ()

    @cached_property
    def digest(self) -> str:
        """Content hash of all that determines the results but the version of the program."""
        content = {name: getattr(self, name) for name in DIGEST_FIELDS}
        content |= {"panel": self.panel.hash, "seed": self.seed}
        plain = to_plain(content)
        if not self.design.holdings:  # as studies were before states could be drawn again
            del plain["design"]["holdings"]
        return content_hash(plain)

    @property
    def count(self) -> int:
        """Scenarios in all; a rule may leave some of them out."""
        return self.design.count

    @property
    def chains(self) -> Sequence[range]:
        """Numbers of scenarios that are thrown one after the other, until the rule stops them."""
        length = len(self.design.axes[-1].rows) if self.rule else 1
        return split_into_chains(self.count, length=length)

    @property
    def units(self) -> dict[str, str]:
        """SI unit of each input of a scenario; empty for plain numbers and texts."""
        found = {name: variable.units for name, variable in self.variables.items()}
        for field in self.fields:
            found |= {f"{field.name}.mean": "", f"{field.name}.deviation": ""}
        return found | (dict.fromkeys(LABELS, "") if self._is_labelled else {})

    @property
    def _is_labelled(self) -> bool:
        """True if throws are labelled with cause, place and size: if a cause is named."""
        keys = {variable.key for variable in self.variables.values()}
        return bool(keys & {"object.kind", *LABELS})

    def scenario(self, index: int) -> Scenario:
        """Return a scenario by its number, the same whatever was requested before.

        Parameters
        ----------
        index : int
            Number of the scenario, from 0 to `count` - 1.

        Raises
        ------
        IndexError
            When there is none of that number.
        """
        return self.scenarios_of([index])[0]

    def scenarios_of(self, indices: Sequence[int]) -> list[Scenario]:
        """Return the `scenario` of each of some numbers; together they take less time."""
        count = self.count
        for index in indices:
            if not 0 <= index < count:
                message = f"scenario {index}: the study has {count}, counted from 0"
                raise IndexError(message)
        of_each = [self.design.state_index(index) for index in indices]
        states = list(dict.fromkeys(of_each))
        drawn = dict(zip(states, self.design.drawn_states(states), strict=True))
        fields = dict(zip(states, self._drawn_fields(states), strict=True))
        words = seed_words([self.seed, SCENARIOS], indices, count=1)[:, 0]
        seeds = (words >> np.uint64(1)).tolist()  # 63 bits, so that each fits a signed integer
        return [
            self._scenario(index, state, drawn[state], fields[state], seed)
            for index, state, seed in zip(indices, of_each, seeds, strict=True)
        ]

    def _scenario(
        self,
        index: int,
        state: int,
        values: Mapping[str, Value],
        fields: Sequence["_DrawnField"],
        seed: int,
    ) -> Scenario:
        """Return a scenario of a state with the values drawn for it."""
        axis_values = self.design.axis_values(index)
        inputs: dict[str, Value] = {**axis_values, **values}
        by_key = {self.variables[name].key: value for name, value in inputs.items()}
        objects = foreign_objects(by_key)
        if not objects:
            # What is not there has no size, whatever was drawn for it.
            sizes = (name for name in inputs if self.variables[name].key == "object.size")
            inputs |= dict.fromkeys(sizes, 0.0)
        if self._is_labelled:
            inputs = _labels(by_key, objects) | inputs
        for field in fields:
            inputs[f"{field.name}.mean"] = field.mean
            inputs[f"{field.name}.deviation"] = field.deviation
        return Scenario(
            index=index,
            name=self._name(index, state=state, axis_values=axis_values),
            overrides=self._overrides(inputs, fields),
            foreign_objects=objects,
            recorder=recorder_of(by_key),
            inputs=inputs,
            condition=self._condition(inputs, state),
            seed=seed,
        )

    def scenarios(self) -> Iterator[Scenario]:
        """Yield all scenarios in the order of their numbers."""
        return (self.scenario(index) for index in range(self.count))

    def _drawn_fields(self, states: Sequence[int]) -> list[list["_DrawnField"]]:
        """Return all fields of each of some states."""
        found: list[list[_DrawnField]] = [[] for _ in states]
        for number, field in enumerate(self.fields):
            drawn = field.drawn(generators([self.seed, FIELDS, number], states))
            mean, deviation = drawn.mean(axis=1).tolist(), drawn.std(axis=1).tolist()
            for own, *rest in zip(found, drawn.tolist(), mean, deviation, strict=True):
                own.append(_DrawnField(field.name, *rest))
        return found

    def _name(self, index: int, *, state: int, axis_values: Mapping[str, Value]) -> str:
        parts = [f"state {state}"] if self.design.states > 1 else []
        parts += [format_value(self.variables[name], value) for name, value in axis_values.items()]
        return ", ".join(parts) or f"throw {index}"

    def _condition(self, inputs: Mapping[str, Value], state: int) -> str:
        if not self.split:
            return f"state {state}"
        return ", ".join(format_value(self.variables[name], inputs[name]) for name in self.split)

    def _overrides(
        self, inputs: Mapping[str, Value], fields: Sequence["_DrawnField"]
    ) -> dict[str, Value]:
        """Return the changes of a scenario: values first, then their factors."""
        values: dict[str, Value] = {}
        factors: list[tuple[str, float]] = []
        for name, variable in self.variables.items():
            special = variable.key in OBJECT_KEYS or variable.key in RECORDER_KEYS
            if special or variable.key.startswith(LABEL):
                continue
            if variable.key == TEMPERATURE_KEY:
                law = self.law or TemperatureLaw()
                factors.append((law.key, law.factor(float(inputs[name]))))
            elif variable.factor:
                factors.append((variable.key, float(inputs[name])))
            else:
                values[variable.key] = inputs[name]
        for field, drawn in zip(self.fields, fields, strict=True):
            members = zip(field.keys, drawn.values, strict=True)
            if field.factor:
                factors += members
            else:
                values |= members
        return apply_factors(self.panel, set_items(self.panel, values), factors)


class _DrawnField(NamedTuple):
    """A field of a state: its values by member, their mean and standard deviation."""

    name: str
    values: list[float]
    mean: float
    deviation: float


def _labels(by_key: Mapping[str, Value], objects: Sequence[ForeignObject]) -> dict[str, Value]:
    """Return cause, place and size of the fault: the object, or the labels of the study."""
    said = {key: by_key.get(key, "") for key in LABELS}
    said[CAUSE] = said[CAUSE] or "none"
    if not objects:
        return said
    item = objects[0]
    found: dict[str, Value] = dict(zip(LABELS, (item.kind, item.at, ""), strict=True))
    return found | {LABELS[-1]: f"{1e3 * float(item.size):.3g} mm"}
