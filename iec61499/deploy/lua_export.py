"""Basic and simple blocks as Lua chunks, which a 4diac FORTE with Lua types takes as block types at run time.

A chunk returns a table with the interface, the internal variables and `ECC(fb, id)`, which FORTE calls for every
event after it has sampled the inputs. `fb[0]` is the chart's state, `fb[33554432 + i]` data input i,
`fb[67108864 + i]` output i, `fb[268435456 + i]` internal variable i, and `fb(i)` issues event output i. Each such
access is a call into FORTE, so an algorithm loads what it reads into locals and stores what it wrote at its end.

A chunk cannot give initial values: every variable starts with the default of its type. FORTE keeps the code of
a type it knows by name, so the name of an exported type ends with a digest of its text.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import replace
from typing import Final

from iec61499 import model
from iec61499.deploy.device_type import Algorithmic, DeviceType, digested
from iec61499.errors import FunctionBlockError
from iec61499.management.protocol import REQUEST_LIMIT, ManagedType, Request
from iec61499.runtime.chart import CHAIN_LIMIT
from iec61499.runtime.checker import BlockChecker
from iec61499.st import typed
from iec61499.st.dataflow import accesses
from iec61499.st.lua.helpers import lua_helpers
from iec61499.st.lua.translate import LuaSource, lua_condition, lua_source
from iec61499.types import ArrayType, ElementaryType, StructType

_INPUT, _OUTPUT, _INTERNAL = 1 << 25, 1 << 26, 1 << 28
PORT_LIMIT: Final = 255
"""Most events, inputs, outputs or internal variables of a type; FORTE ends its lists with 255."""
LOCAL_LIMIT: Final = 180
"""Most variables that one algorithm may use; Lua has 200 locals a function, and loops need some."""


def export_type(block: Algorithmic) -> DeviceType:
    """The block as a Lua type.

    Raises:
        FunctionBlockError: an algorithm or condition is wrong or beyond Lua, the block has more ports than FORTE
            counts, or the request that creates the type is longer than FORTE takes; names file and line, or the size.
    """
    text = _Export(block).text()
    name = digested(block, text)
    size = len(Request("999999", "CREATE", ManagedType(name, text)).xml().encode())
    if size > REQUEST_LIMIT:
        raise FunctionBlockError(
            f"{block.header.name} takes a request of {size} bytes as Lua: expected at most {REQUEST_LIMIT}, "
            "as 4diac FORTE hangs on longer ones; divide the block",
            block.header.file,
            block.header.line,
        )
    return DeviceType(name, text, _as_deployed(block, name))


def _as_deployed(block: Algorithmic, name: str) -> Algorithmic:
    def bare(variables: Iterable[model.Variable]) -> tuple[model.Variable, ...]:
        return tuple(replace(variable, initial="") for variable in variables)

    ports = block.interface
    interface = replace(ports, inputs=bare(ports.inputs), outputs=bare(ports.outputs))
    return replace(
        block, header=replace(block.header, name=name), interface=interface, internals=bare(block.internals)
    )


class _Export:
    def __init__(self, block: Algorithmic) -> None:
        self._block = block
        self._keys: dict[str, int] = {}
        self._short: dict[str, str] = {}
        self._checker = BlockChecker(block)
        self._helpers: set[str] = set()
        self._outputs = {event.name: number for number, event in enumerate(block.interface.event_outputs)}
        self._functions = {algorithm.name: f"A{number}" for number, algorithm in enumerate(block.algorithms)}
        interface = block.interface
        for adapter in interface.adapters:
            raise FunctionBlockError(
                f"adapter {adapter.name} of {block.header.name} is not available in Lua: expected events and data",
                block.header.file,
                adapter.line,
            )
        for name in interface.in_outs:
            raise FunctionBlockError(
                f"VAR_IN_OUT {name} of {block.header.name} is not available in Lua: expected an input and an output",
                block.header.file,
                next(v.line for v in interface.inputs if v.name == name),
            )
        for inner in block.blocks:
            raise FunctionBlockError(
                f"block {inner.name} inside {block.header.name} is not available in Lua: expected it beside",
                block.header.file,
                inner.line,
            )
        groups = (
            (_INPUT, "i", interface.inputs),
            (_OUTPUT, "o", interface.outputs),
            (_INTERNAL, "n", block.internals),
        )
        for base, letter, variables in groups:
            self._limit(variables)
            for number, variable in enumerate(variables):
                self._keys[variable.name] = base + number
                self._short[variable.name] = f"{letter}{number}"
        self._limit(interface.event_inputs)
        self._limit(interface.event_outputs)

    def _limit(self, ports: tuple[model.Variable, ...] | tuple[model.EventPort, ...]) -> None:
        if len(ports) > PORT_LIMIT:
            raise FunctionBlockError(
                f"{self._block.header.name} has {len(ports)} ports of one kind: expected at most {PORT_LIMIT} in Lua",
                self._block.header.file,
                ports[PORT_LIMIT].line,
            )

    def text(self) -> str:
        block = self._block
        algorithms = "".join(self._algorithm(algorithm) for algorithm in block.algorithms)
        chart = self._chart(block) if isinstance(block, model.BasicFBType) else self._simple(block)
        return (
            lua_helpers(self._helpers)
            + algorithms
            + f"local function ECC(fb,id)\n{chart}end\n"
            + f"return {{ECC=ECC,\n{self._interface()},\n{self._internals()}}}\n"
        )

    def _place(self, name: str) -> str:
        return f"fb[{self._keys[name]}]"

    def _use(self, source: LuaSource) -> str:
        self._helpers |= source.helpers
        return source.body

    def _algorithm(self, algorithm: model.Algorithm) -> str:
        checked = self._checker.algorithm(algorithm)
        head = f"local function {self._functions[algorithm.name]}(fb)\n"
        if all(_is_copy(statement, checked) for statement in checked.body):
            return head + "".join(self._copy(statement) for statement in checked.body) + "end\n"
        used = accesses(checked)
        names = (*used.reads, *(name for name in used.writes if name not in used.reads))
        if len(names) + len(checked.temporaries) > LOCAL_LIMIT:
            raise FunctionBlockError(
                f"algorithm {algorithm.name} uses {len(names) + len(checked.temporaries)} variables: "
                f"expected at most {LOCAL_LIMIT}, as Lua has 200 locals",
                self._block.header.file,
                algorithm.line,
            )
        load = ""
        if names:
            values = ",".join(self._place(name) for name in used.reads)
            load = f"local {','.join(self._short[name] for name in names)}{'=' * bool(values)}{values}\n"
        stores = "".join(f"{self._place(name)}={self._short[name]}\n" for name in used.writes)
        return head + load + self._use(lua_source(checked, self._short.__getitem__)) + stores + "end\n"

    def _copy(self, statement: typed.Statement) -> str:
        assert isinstance(statement, typed.Store)
        assert isinstance(statement.value, typed.Load)
        return f"{self._place(statement.name)}={self._place(statement.value.name)}\n"

    def _actions(self, actions: Iterable[model.ECAction]) -> str:
        """Statements for the actions of a state."""
        lines = []
        for action in actions:
            if action.algorithm:
                lines.append(f"{self._functions[action.algorithm]}(fb)\n")
            if action.output:
                lines.append(f"fb({self._outputs[action.output]})\n")
        return "".join(lines)

    def _simple(self, block: model.SimpleFBType) -> str:
        states = {state.name: state for state in block.states}
        events = [event.name for event in block.interface.event_inputs]
        bodies = {number: self._actions(states[e].actions) for number, e in enumerate(events) if e in states}
        return _switch("id", bodies)

    def _chart(self, block: model.BasicFBType) -> str:
        """Tries the transitions of the state, with the event first, then without; enters a state, and again."""
        numbers = {state.name: number for number, state in enumerate(block.states)}
        choices = {number: self._leave(block, name, numbers) for name, number in numbers.items()}
        entries = {number: self._actions(state.actions) for number, state in enumerate(block.states)}
        count = check = ""
        if _can_run_on(block.transitions):
            count = "local n=0\n"
            message = f'"{block.header.name}: more than {CHAIN_LIMIT} transitions without an event"'
            check = f"n=n+1\nif n>{CHAIN_LIMIT} then error({message},0) end\n"
        return (
            f"local s=fb[0]\n{count}while true do\nlocal t\n{_switch('s', choices)}if not t then break end\n"
            f"s=t\nid=-1\n{check}{_switch('s', entries)}end\nfb[0]=s\n"
        )

    def _leave(self, block: model.BasicFBType, state: str, numbers: Mapping[str, int]) -> str:
        """Sets t to the state that the first transition that fires leads to."""
        events = {event.name: number for number, event in enumerate(block.interface.event_inputs)}
        branches: list[str] = []
        for transition in block.transitions:
            if transition.source != state:
                continue
            conditions = [f"id=={events[transition.event]}"] if transition.event else []
            if transition.guard:
                guard = self._use(lua_condition(self._checker.guard(transition), self._place))
                conditions.append(f"({guard})")
            go = f"t={numbers[transition.destination]}\n"
            if not conditions:
                branches.append(f"else\n{go}" if branches else go)
                return "".join(branches) + ("end\n" if len(branches) > 1 else "")
            branches.append(f"{'else' * bool(branches)}if {' and '.join(conditions)} then\n{go}")
        return "".join(branches) + ("end\n" if branches else "")

    def _interface(self) -> str:
        interface = self._block.interface
        inputs = {variable.name: number for number, variable in enumerate(interface.inputs)}
        outputs = {variable.name: number for number, variable in enumerate(interface.outputs)}
        parts = (
            _events("EI", interface.event_inputs, inputs),
            _events("EO", interface.event_outputs, outputs),
            self._variables("numDIs", "DINames", "DIDataTypeNames", interface.inputs),
            self._variables("numDOs", "DONames", "DODataTypeNames", interface.outputs),
        )
        return f"interfaceSpec={{{','.join(parts)},numAdapters=0,adapterInstanceDefinition={{}}}}"

    def _internals(self) -> str:
        variables = self._variables("numIntVars", "intVarsNames", "intVarsDataTypeNames", self._block.internals)
        return f"internalVarsInformation={{{variables}}}"

    def _variables(self, count: str, names: str, types: str, variables: Iterable[model.Variable]) -> str:
        variables = tuple(variables)
        named = ",".join(f'"{variable.name}"' for variable in variables)
        typed_ = ",".join(self._type(variable) for variable in variables)
        return f"{count}={len(variables)},{names}={{{named}}},{types}={{{typed_}}}"

    def _type(self, variable: model.Variable) -> str:
        data_type: model.VariableType = variable.type
        if isinstance(data_type, StructType):
            raise FunctionBlockError(
                f"variable {variable.name}: structure {data_type} is no type for Lua: expected elementary types",
                self._block.header.file,
                variable.line,
            )
        if isinstance(data_type, ElementaryType) and data_type.kind == "enum":
            raise FunctionBlockError(
                f"variable {variable.name}: enumeration {data_type} is no type on 4diac FORTE: expected a UINT",
                self._block.header.file,
                variable.line,
            )
        if isinstance(data_type, ElementaryType):
            return f'"{data_type.name}"'
        assert isinstance(data_type, ArrayType)
        if not isinstance(data_type.element, ElementaryType):
            raise FunctionBlockError(
                f"variable {variable.name}: an array of arrays is no type for Lua: expected one dimension",
                self._block.header.file,
                variable.line,
            )
        return f'"ARRAY",{data_type.length},"{data_type.element}"'


def _is_copy(statement: typed.Statement, checked: typed.CheckedAlgorithm) -> bool:
    """Whether a variable of the block becomes another one of its own type."""
    if not isinstance(statement, typed.Store) or not isinstance(statement.value, typed.Load) or statement.indices:
        return False
    names = statement.name, statement.value.name
    return statement.type == statement.value.type and not any(name in checked.temporaries for name in names)


def _switch(selector: str, bodies: Mapping[int, str]) -> str:
    """`if selector==0 then ... elseif ... end`; empty bodies are left out."""
    branches = [f"if {selector}=={number} then\n{body}" for number, body in bodies.items() if body]
    return "else".join(branches) + ("end\n" if branches else "")


def _can_run_on(transitions: Iterable[model.ECTransition]) -> bool:
    """Whether transitions without an event lead in a circle."""
    following: dict[str, set[str]] = {}
    for transition in transitions:
        if not transition.event:
            following.setdefault(transition.source, set()).add(transition.destination)
    for start in following:
        reached: set[str] = set()
        ahead = {start}
        while ahead:
            ahead = {after for state in ahead for after in following.get(state, ())} - reached
            reached |= ahead
        if start in reached:
            return True
    return False


def _events(prefix: str, events: tuple[model.EventPort, ...], variables: Mapping[str, int]) -> str:
    """`EIWith` lists the variables of every event that has some, then 255; `EIWithIndexes` has where lists begin."""
    names, places = [], []
    listed: list[int] = []
    for event in events:
        names.append(f'"{event.name}"')
        places.append(len(listed) if event.with_variables else -1)
        if event.with_variables:
            listed += [*(variables[name] for name in event.with_variables), PORT_LIMIT]
    return (
        f"num{prefix}s={len(events)},{prefix}Names={{{','.join(names)}}},"
        f"{prefix}With={{{','.join(map(str, listed))}}},{prefix}WithIndexes={{{','.join(map(str, places))}}}"
    )
