"""Records every event of a resource with its data."""

from __future__ import annotations

import json
from collections.abc import Callable
from typing import Any, Final

from dtwin.iec61499 import model
from dtwin.iec61499.runtime.operation import QueueEntry
from dtwin.iec61499.st.python.expressions import python_name
from dtwin.iec61499.trace.ctf import TEXT, Field, Record, TraceWriter
from dtwin.iec61499.types import ArrayType, DataType

STATE: Final = "state"
"""The kind of event that holds the variables of a block when the trace begins."""
WRITTEN: Final = "written"
"""The kind of event that holds a value which was written from outside."""
CHART: Final = "ECC"
"""The field that holds the number of the state of a chart."""
PACKET: Final = 500
"""Records after which a packet is written."""
_NAMES: Final = {
    "BYTE": "usint_t",
    "WORD": "uint_t",
    "DWORD": "udint_t",
    "LWORD": "ulint_t",
    **dict.fromkeys(("TIME", "LTIME"), "lint_t"),
}


class Recorder:
    """An observer that writes a trace.

    An event at an input is recorded when the block has been executed, with the inputs that came with it and the state
    of the chart; one that a service interface block issues before its receivers have it, with the outputs.

    Args:
        writer: writes the trace.
    """

    def __init__(self, writer: TraceWriter) -> None:
        self._writer = writer
        self._records: list[Record] = []
        text = (Field("name", TEXT), Field("value", TEXT))
        self._state = writer.kind(STATE, text)
        self._written = writer.kind(WRITTEN, text)

    def begin(self, time: int, states: dict[str, dict[str, Any]]) -> None:
        """Records the variables of all blocks, by the name of the block."""
        for name, values in states.items():
            self._records.append((self._state.number, time, name, json.dumps(values)))

    def delivering(self, block: Any, kind: model.FBType, event: str, deliver: QueueEntry) -> QueueEntry:
        port = next(port for port in kind.interface.event_inputs if port.name == event)
        inputs = tuple(v for v in kind.interface.inputs if v.name in port.with_variables)
        return self._recording(block, kind, event, inputs, deliver)

    def issued(self, block: Any, kind: model.FBType, event: str) -> QueueEntry | None:
        if not isinstance(kind, model.ServiceInterfaceFBType):
            return None
        port = next(port for port in kind.interface.event_outputs if port.name == event)
        outputs = tuple(v for v in kind.interface.outputs if v.name in port.with_variables)
        return self._recording(block, kind, event, outputs, self._flush_when_full)

    def written(self, time: int, name: str, value: Any) -> None:
        self._records.append((self._written.number, time, name, json.dumps(value)))

    def flush(self) -> None:
        """Writes what has not been written yet."""
        self._writer.write(self._records)
        self._records.clear()

    def _flush_when_full(self) -> None:
        if len(self._records) > PACKET:
            self.flush()

    def _recording(
        self,
        block: Any,
        kind: model.FBType,
        event: str,
        variables: tuple[model.Variable, ...],
        deliver: QueueEntry,
    ) -> QueueEntry:
        fields, values = layout(variables)
        if isinstance(kind, model.BasicFBType):
            fields, values = (*fields, Field(CHART, "uint_t")), f"{values}b.state__, "
        number = self._writer.kind(f"{block.name__}.{event}", fields).number
        return recording(number, values, block, deliver, self._records.append)


def layout(variables: tuple[model.Variable, ...]) -> tuple[tuple[Field, ...], str]:
    """The fields of variables, and the Python text of their values at the instance `b`, each with a comma."""
    fields, values = [], ""
    for variable in variables:
        assert not isinstance(variable.type, model.GenericType)
        field, is_plain = _field(variable.name, variable.type)
        fields.append(field)
        text = f"b.{python_name(variable.name)}"
        values += f"{'*' * (field.count != 1)}{text}, " if is_plain else f"repr({text}), "
    return tuple(fields), values


def recording(
    number: int, values: str, block: Any, deliver: QueueEntry, append: Callable[[Record], None]
) -> QueueEntry:
    """What calls `deliver`, then appends the record, also when `deliver` fails."""
    space = {"deliver": deliver, "append": append, "b": block, "r": block.resource__}
    lines = ["def recorded():", "    try:", "        deliver()", "    finally:"]
    exec("\n".join([*lines, f"        append(({number}, r.time, {values}))"]), space)
    recorded: QueueEntry = space["recorded"]
    return recorded


def _field(name: str, kind: DataType) -> tuple[Field, bool]:
    """The field of a variable, and whether it holds the values themselves and not their text."""
    if isinstance(kind, ArrayType):
        element, is_plain = _field(name, kind.element)
        if isinstance(kind.element, ArrayType) or not is_plain or kind.length == 1:
            return Field(name, TEXT), False
        return Field(name, element.kind, kind.length), True
    meaning = getattr(kind, "kind", "")
    if meaning == "string":
        return Field(name, TEXT), True
    if meaning in ("bool", "signed", "unsigned", "bits", "real", "time"):
        return Field(name, _NAMES.get(kind.name, f"{kind.name.lower()}_t")), True
    return Field(name, TEXT), False
