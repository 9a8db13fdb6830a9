"""Runs exported Lua chunks as 4diac FORTE does: a block whose variables and events are reached through `fb`."""

from __future__ import annotations

import math
from typing import Any, Final

import lupa.lua51
import lupa.lua54
import lupa.luajit21

from iec61499 import model
from iec61499.deploy.device_type import DeviceType
from iec61499.types import ArrayType

INTERPRETERS: Final = {"Lua 5.1": lupa.lua51, "Lua 5.4": lupa.lua54, "LuaJIT 2.1": lupa.luajit21}
_INPUT, _OUTPUT, _INTERNAL = 1 << 25, 1 << 26, 1 << 28
_BLOCK: Final = """
local values, issue = ...
local fb = {}
local function read(_, key)
  local value = values[key]
  if type(value) ~= "table" then return value end
  local copy = {}
  for i, v in ipairs(value) do copy[i] = v end
  return copy
end
return setmetatable(fb, {__index = read, __newindex = function(_, key, value)
  if value == nil then error("nil stored at " .. key) end
  values[key] = value
end, __call = function(_, event) issue(event) end})
"""


class LuaBench:
    """A block of an exported type; the chunk's lists are checked against the interface they are made from."""

    def __init__(self, exported: DeviceType, interpreter: str = "Lua 5.4") -> None:
        self._lua = INTERPRETERS[interpreter].LuaRuntime(encoding="latin-1")
        chunk = self._lua.execute(exported.text)
        block = exported.block
        self.events: list[str] = []
        self._types: dict[str, Any] = {}
        self._keys: dict[str, int] = {}
        self._values = self._lua.table_from({0: 0})
        internals = chunk.internalVarsInformation
        spec = chunk.interfaceSpec
        groups = (
            (_INPUT, block.interface.inputs, spec.numDIs, spec.DINames, spec.DIDataTypeNames),
            (_OUTPUT, block.interface.outputs, spec.numDOs, spec.DONames, spec.DODataTypeNames),
            (
                _INTERNAL,
                block.internals,
                internals.numIntVars,
                internals.intVarsNames,
                internals.intVarsDataTypeNames,
            ),
        )
        for base, variables, count, names, types in groups:
            assert count == len(variables)
            assert list(names.values()) == [variable.name for variable in variables]
            assert list(types.values()) == [part for variable in variables for part in _type_names(variable.type)]
            for number, variable in enumerate(variables):
                self._keys[variable.name] = base + number
                self._types[variable.name] = variable.type
                assert not isinstance(variable.type, model.GenericType)
                self[variable.name] = variable.type.default
        for events, variables, names, withs, places in (
            (block.interface.event_inputs, block.interface.inputs, spec.EINames, spec.EIWith, spec.EIWithIndexes),
            (block.interface.event_outputs, block.interface.outputs, spec.EONames, spec.EOWith, spec.EOWithIndexes),
        ):
            assert list(names.values()) == [event.name for event in events]
            listed = list(withs.values())
            for event, place in zip(events, places.values(), strict=True):
                found = listed[place : listed.index(255, place)] if place >= 0 else []
                assert [variables[number].name for number in found] == list(event.with_variables)
        self._inputs = [event.name for event in block.interface.event_inputs]
        outputs = [event.name for event in block.interface.event_outputs]
        self._block = self._lua.execute(_BLOCK, self._values, lambda number: self.events.append(outputs[int(number)]))
        self._chart = chunk.ECC
        # reals as text, since lupa makes integers of whole numbers and loses the sign of zero
        self._digits = self._lua.eval('function(t, k) return string.format("%.17g", t[k]) end')

    def fire(self, event: str, **inputs: Any) -> list[str]:
        """Sets inputs, delivers an event, and gives the events that come out."""
        for name, value in inputs.items():
            self[name] = value
        self.events.clear()
        self._chart(self._block, self._inputs.index(event))
        return list(self.events)

    @property
    def state(self) -> int:
        """The number of the chart's state."""
        return int(self._values[0])

    def __setitem__(self, name: str, value: Any) -> None:
        self._values[self._keys[name]] = self._lua.table_from(value) if isinstance(value, list) else value

    def __getitem__(self, name: str) -> Any:
        return self._value(self._values, self._keys[name], self._types[name])

    def _value(self, table: Any, key: int, data_type: Any) -> Any:
        if isinstance(data_type, ArrayType):
            return [self._value(table[key], i, data_type.element) for i in range(1, data_type.length + 1)]
        if data_type.kind == "real":
            return float(self._digits(table, key))
        return data_type.wrap(int(table[key])) if data_type.kind in ("signed", "unsigned", "bits") else table[key]


def _type_names(data_type: Any) -> list[Any]:
    if isinstance(data_type, ArrayType):
        return ["ARRAY", data_type.length, str(data_type.element)]
    return [str(data_type)]


def same(one: Any, other: Any) -> bool:
    """Equality to the last bit, any NaN being equal to any other."""
    if isinstance(one, list) and isinstance(other, list):
        return len(one) == len(other) and all(map(same, one, other))
    if isinstance(one, float) and isinstance(other, float):
        return (math.isnan(one) and math.isnan(other)) or (one, math.copysign(1, one)) == (
            other,
            math.copysign(1, other),
        )
    return bool(one == other)
