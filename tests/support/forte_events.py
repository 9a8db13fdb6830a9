"""Random events through the event blocks, on a 4diac FORTE and on the embedded runtime."""

from __future__ import annotations

import random
from dataclasses import dataclass
from functools import partial
from itertools import pairwise
from typing import Final

from iec61499 import model
from iec61499.library import Library
from iec61499.literals import format_literal, parse_literal
from iec61499.management.client import ManagementClient
from iec61499.runtime.resource import Resource
from iec61499.standard.catalogue import find_standard
from iec61499.types import ElementaryType
from tests.support.forte_cases import printed
from tests.support.waiting import until

EVENT_BLOCKS: Final = (
    *("E_SWITCH", "E_SELECT", "E_PERMIT", "E_REND", "E_SR", "E_RS", "E_D_FF", "E_T_FF", "E_R_TRIG", "E_F_TRIG"),
    *("E_CTU", "E_CTD", "E_CTUD", "E_SPLIT", "E_MERGE", "E_DEMUX"),
)
"""Those that need no clock."""
_RELAYS: Final = ("RELAY1", "RELAY2", "RELAY3", "RELAY4")
"""Counters one behind the other: what has come through all of them is behind what was triggered before."""


@dataclass(frozen=True, slots=True)
class Step:
    """Values of inputs by name, and the event that comes then."""

    values: dict[str, str]
    event: str


@dataclass(frozen=True, slots=True)
class EventBench:
    """An event block with a counter at every event output.

    Attributes:
        name: the type of the block, which is called B.
        interface: its ports.
    """

    name: str
    interface: model.Interface

    @classmethod
    def of(cls, name: str) -> EventBench:
        block = find_standard(name)
        assert block is not None
        return cls(name, block.interface)

    def step(self, rng: random.Random) -> Step:
        """Some inputs get other values, and one of the events comes."""
        values = {}
        for variable in self.interface.inputs:
            assert isinstance(variable.type, ElementaryType)
            value = rng.random() < 0.5 if variable.type.kind == "bool" else rng.randint(0, 5)
            if rng.random() < 0.7:
                values[variable.name] = format_literal(value, variable.type)
        return Step(values, rng.choice(self.interface.event_inputs).name)

    def split(self, event: str) -> str:
        """The block that sends an event to the block, then one to the relays."""
        return f"TO_{event}"

    def network(self) -> model.FBNetwork:
        """The block and its counters."""
        # one event comes from outside in every step: a FORTE may lose the second one of two in a row
        splits = {self.split(event.name): event.name for event in self.interface.event_inputs}
        counters = [(f"C{number}", event.name) for number, event in enumerate(self.interface.event_outputs)]
        names = [*(name for name, _ in counters), *_RELAYS]
        blocks = (model.Block("B", self.name), *(model.Block(name, "E_CTU") for name in names))
        blocks += tuple(model.Block(name, "E_SPLIT") for name in splits)
        wires = [model.Connection(f"{name}.EO1", f"B.{event}") for name, event in splits.items()]
        wires += [model.Connection(f"{name}.EO2", f"{_RELAYS[0]}.CU") for name in splits]
        wires += [model.Connection(f"B.{event}", f"{name}.CU") for name, event in counters]
        wires += [model.Connection(f"{a}.CUO", f"{b}.CU") for a, b in pairwise(_RELAYS)]
        return model.FBNetwork(blocks, (), tuple(wires))

    def outputs(self) -> list[str]:
        """What is read after every step: the data outputs, and how often every event output has come."""
        counters = [f"C{number}.CV" for number in range(len(self.interface.event_outputs))]
        return [*(f"B.{variable.name}" for variable in self.interface.outputs), *counters]

    def readings(self, client: ManagementClient, steps: list[Step]) -> list[list[str]]:
        """What a device prints after every step."""
        resource, network, readings = "EVENTS", self.network(), []
        client.create_block("", resource, "EMB_RES")
        for block in network.blocks:
            client.create_block(resource, block.name, block.type_name)
        for wire in network.events:
            client.connect(resource, wire.source, wire.destination)
        client.start(resource)
        for count, step in enumerate(steps, 1):
            for name, literal in step.values.items():
                client.write(resource, f"B.{name}", literal)
            client.trigger(resource, f"{self.split(step.event)}.EI")
            passed = f"{_RELAYS[-1]}.CV"
            until(partial(_reads, client, resource, passed, str(count)), "the event has been dealt with")
            readings.append([client.read(resource, output) for output in self.outputs()])
        return readings


def _reads(client: ManagementClient, resource: str, name: str, expected: str) -> bool:
    return client.read(resource, name) == expected


def expected_readings(bench: EventBench, steps: list[Step]) -> list[list[str]]:
    """What the embedded runtime has after every step, as FORTE prints it."""
    resource, readings = Resource(bench.network(), Library()), []
    for step in steps:
        for name, literal in step.values.items():
            resource.write(f"B.{name}", parse_literal(literal, resource.variable_type(f"B.{name}")))
        resource.trigger(f"{bench.split(step.event)}.EI")
        resource.run_until_idle()
        values = []
        for output in bench.outputs():
            kind = resource.variable_type(output)
            assert isinstance(kind, ElementaryType)
            values.append(printed(resource.read(output), kind))
        readings.append(values)
    return readings
