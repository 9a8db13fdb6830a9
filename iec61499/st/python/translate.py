"""Checked algorithms to Python functions over local variables.

Real arithmetic is bare Python arithmetic. Where it could raise although C gives an infinity or a NaN, a second,
exact version of the body exists and takes over when the fast one raises: nothing is stored before the end, so
it starts from the same values. BOOL operators short-circuit, which the standard leaves open. Integers wrap
where a value is stored, compared, divided or converted; between them only + - * happen, which commute with
wrapping.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

from iec61499.errors import FunctionBlockError
from iec61499.st import typed
from iec61499.st.dataflow import accesses
from iec61499.st.fragment import Fragment, bounds, is_integral
from iec61499.st.python import helpers
from iec61499.st.python.expressions import SUM, PythonExpressions, python_name, reaction_name, where
from iec61499.types import BOOL, ElementaryType

CONDITION_GLOBALS: Final[dict[str, Any]] = {**helpers.COMMON, **helpers.EXACT}
"""What the expressions of `compile_condition` may name beside the instance."""

_INDENT: Final = "    "


@dataclass(frozen=True, slots=True)
class PythonCode:
    """The body of a function over local variables named by `python_name`.

    Attributes:
        lines: the fast version; with exact_lines it may raise ZeroDivisionError, OverflowError or ValueError.
        exact_lines: the version that never raises those; None when the fast one does not either.
        reads: names, as declared, of the variables to load before.
        writes: names, as declared, of the variables to store after.
        modified_arrays: names of the arrays to load as copies.
        globals: what the lines call, by name.
        exact_globals: what the exact lines call, by name.
        returns: whether the lines contain `return`, with the stores before it.
    """

    lines: tuple[str, ...]
    exact_lines: tuple[str, ...] | None
    reads: tuple[str, ...]
    writes: tuple[str, ...]
    modified_arrays: frozenset[str]
    globals: dict[str, Any]
    exact_globals: dict[str, Any]
    returns: bool


def python_source(checked: typed.CheckedAlgorithm, self_name: str = "s") -> PythonCode:
    """Generates the body; `self_name` names the instance that a RETURN stores to."""
    access = accesses(checked)
    fast = _PythonGenerator(checked, self_name, exact=False)
    lines = fast.algorithm(checked.body)
    exact = _PythonGenerator(checked, self_name, exact=True)
    return PythonCode(
        lines=lines,
        exact_lines=exact.algorithm(checked.body) if fast.raises else None,
        reads=access.reads,
        writes=access.writes,
        modified_arrays=access.modified_arrays,
        globals=_select(fast.used, helpers.FAST),
        exact_globals=_select(exact.used, helpers.EXACT),
        returns=any(isinstance(node, typed.Return) for node in typed.walk(checked.body)),
    )


@dataclass(frozen=True, slots=True)
class Written:
    """An algorithm as Python, of which `define_algorithm` makes a function.

    Attributes:
        lines: the statements of the function.
        uses: names of the helpers that they call.
        exact_lines: those that take over where the others raise; None when these never do.
        exact_uses: names of the helpers that the exact ones call.
        direct: whether the block's variables stay attributes of the instance, since blocks inside react on the way.
    """

    lines: tuple[str, ...]
    uses: tuple[str, ...]
    exact_lines: tuple[str, ...] | None = None
    exact_uses: tuple[str, ...] = ()
    direct: bool = False


def write_algorithm(checked: typed.CheckedAlgorithm) -> Written:
    """Writes the function that `compile_algorithm` makes."""
    if typed.invokes(checked.body):
        direct = _PythonGenerator(checked, "_s", exact=True, direct=True)
        return Written(tuple(direct.algorithm(checked.body)), tuple(sorted(direct.used)), direct=True)
    code = python_source(checked, "_s")
    loads = [f"{python_name(n)} = {_load(f'_s.{python_name(n)}', n in code.modified_arrays)}" for n in code.reads]
    stores = list(_stores(code.writes, "_s"))
    if code.exact_lines is None:
        return Written((*loads, *code.lines, *stores), tuple(code.globals))
    lines = (
        "try:",
        *_indented([*loads, *code.lines]),
        "except (ZeroDivisionError, OverflowError, ValueError):",
        f"{_INDENT}return _exact(_s)",
        *stores,
    )
    return Written(lines, tuple(code.globals), (*loads, *code.exact_lines, *stores), tuple(code.exact_globals))


def define_algorithm(
    written: Written, name: str, reactions: Mapping[str, Any] | None = None
) -> Callable[[Any], None]:
    """The function that `compile_algorithm` makes, of what was written."""
    if written.direct:
        return _define(name, written.lines, {**_select(written.uses, helpers.EXACT), **(reactions or {})})
    names = _select(written.uses, helpers.FAST)
    if written.exact_lines is not None:
        names["_exact"] = _define(f"{name} (exact)", written.exact_lines, _select(written.exact_uses, helpers.EXACT))
    return _define(name, written.lines, names)


def compile_algorithm(
    checked: typed.CheckedAlgorithm, name: str, reactions: Mapping[str, Any] | None = None
) -> Callable[[Any], None]:
    """A function that runs the algorithm on an instance whose attributes (`python_name`) are the variables.

    The name, such as `TYPE.ALGORITHM`, is what tracebacks and profiles show. Arrays are replaced, never changed in
    place. When blocks inside react on the way, `reactions` has their functions under their `reaction_name`.

    Raises:
        FunctionBlockError: the call of the function meets an index out of range, or a loop finds no iteration left in
            `resource__.iterations` of the instance.
    """
    return define_algorithm(write_algorithm(checked), name, reactions)


def compile_condition(checked: typed.Expression, self_name: str = "s") -> str:
    """A Python expression over `s.NAME` and CONDITION_GLOBALS with the results of C."""
    expressions = PythonExpressions(lambda name: f"{self_name}.{python_name(name)}", exact=True, instance=self_name)
    text = expressions.text(checked)
    try:
        compile(text, "<condition>", "eval")
    except (SyntaxError, RecursionError, MemoryError):
        raise FunctionBlockError("condition is nested too deeply: split it", *checked.at) from None
    return text


def _select(used: Iterable[str], functions: dict[str, Any]) -> dict[str, Any]:
    return {name: functions[name] if name in functions else helpers.COMMON[name] for name in sorted(used)}


def _load(source: str, modified: bool) -> str:
    return f"_copy({source})" if modified else source


def _stores(names: Iterable[str], self_name: str) -> Iterable[str]:
    return (f"{self_name}.{python_name(name)} = {python_name(name)}" for name in names)


def _indented(lines: Iterable[str]) -> list[str]:
    return [_INDENT + line for line in lines]


def _define(name: str, lines: Sequence[str], names: dict[str, Any]) -> Callable[[Any], None]:
    source = "\n".join(["def run(_s):", *_indented(lines or ["pass"])]) + "\n"
    namespace = {**names, "_copy": helpers.copy}
    try:
        exec(compile(source, f"<{name}>", "exec"), namespace)
    except (SyntaxError, RecursionError, MemoryError):
        raise FunctionBlockError(f"algorithm {name} is nested too deeply: split it") from None
    function: Callable[[Any], None] = namespace["run"]
    function.__name__ = name
    return function


class _PythonGenerator:
    """Statements of one version of one algorithm.

    With `direct` the block's variables are attributes of the instance and not loaded into local ones: blocks inside
    see what is stored before they react.
    """

    def __init__(self, checked: typed.CheckedAlgorithm, self_name: str, exact: bool, direct: bool = False) -> None:
        self._writes = () if direct else accesses(checked).writes
        self._temporaries = checked.temporaries
        self._self = self_name
        self._direct = direct
        self._expressions = PythonExpressions(self._name, exact, self_name)
        self._repeat_flags: list[bool] = []

    def _name(self, name: str) -> str:
        local = python_name(name)
        return f"{self._self}.{local}" if self._direct and name not in self._temporaries else local

    @property
    def raises(self) -> bool:
        return self._expressions.raises

    @property
    def used(self) -> set[str]:
        return self._expressions.used

    def algorithm(self, body: typed.Body) -> tuple[str, ...]:
        lines = [line for statement in body for line in self._statement(statement)]
        if any(isinstance(node, (typed.For, typed.While, typed.Repeat)) for node in typed.walk(body)):
            # all loops of an event chain draw from one budget, which costs nothing a bare loop would not
            lines.insert(0, f"_ticks = {self._self}.resource__.iterations")
        return tuple(lines)

    def _body(self, body: typed.Body) -> list[str]:
        lines = [line for statement in body for line in self._statement(statement)]
        return _indented(lines or ["pass"])

    def _statement(self, node: typed.Statement) -> list[str]:
        match node:
            case typed.Store():
                return self._store(node)
            case typed.Invoke(name=name, event=event):
                return [f"{reaction_name(name, event)}({self._self})"]
            case typed.If(branches=branches, otherwise=otherwise):
                conditions = [(self._expressions.text(branch.condition), branch.body) for branch in branches]
                return self._branches(conditions, otherwise)
            case typed.Case():
                return self._case(node)
            case typed.For():
                return self._for(node)
            case typed.While(condition=condition, body=body):
                stop = self._negated(condition)
                return self._loop(node, [f"if {stop}: break", *self._plain(body)])
            case typed.Repeat():
                return self._repeat(node)
            case typed.Exit():
                return ["break"]
            case typed.Continue():
                return ["continue"]
            case typed.Return():
                return [*_stores(self._writes, self._self), "return"]

    def _plain(self, body: typed.Body) -> list[str]:
        return [line for statement in body for line in self._statement(statement)]

    def _negated(self, condition: typed.Expression) -> str:
        return self._expressions.text(typed.Unary(condition.at, BOOL, "NOT", condition))

    def _store(self, node: typed.Store) -> list[str]:
        target = self._name(node.name)
        if node.indices:
            own = [f"{target} = {self._expressions.helper('_copy')}({target})"] if self._direct else []
            place = target + self._expressions.subscripts(node.indices, node.arrays)
            return [*own, f"{place} = {self._own_value(node.value)}"]
        if not isinstance(node.type, ElementaryType):
            return [f"{target} = {self._own_value(node.value)}"]
        return self._assign(target, self._expressions.raw(node.value), node.type)

    def _own_value(self, node: typed.Expression) -> str:
        """The value for a place of its own: of an array or structure a copy, as an assignment makes no reference."""
        text = self._expressions.text(node)
        if isinstance(node.type, ElementaryType) or isinstance(node, typed.Const):
            return text
        return f"{self._expressions.helper('_copy')}({text})"

    def _assign(self, target: str, value: Fragment, data_type: ElementaryType) -> list[str]:
        """The assignment; a value at most one period outside of the range is moved back by a comparison."""
        low, high = bounds(data_type)
        period = 1 << data_type.bits
        if not is_integral(data_type) or value.low < low - period or value.high > high + period:
            return [f"{target} = {self._expressions.wrap(value, data_type).text}"]
        lines = [f"{target} = {value.text}"]
        if value.high > high:
            lines.append(f"if {target} > {high}: {target} -= {period}")
        if value.low < low:
            lines.append(f"if {target} < {low}: {target} += {period}")
        return lines

    def _branches(self, branches: Iterable[tuple[str, typed.Body]], otherwise: typed.Body) -> list[str]:
        lines: list[str] = []
        for condition, body in branches:
            lines += [f"{'el' * bool(lines)}if {condition}:", *self._body(body)]
        if not lines:
            return self._plain(otherwise)
        return [*lines, "else:", *self._body(otherwise)] if otherwise else lines

    def _case(self, node: typed.Case) -> list[str]:
        if isinstance(node.selector, typed.Load):
            selector, lines = self._name(node.selector.name), []
        else:
            selector = self._expressions.temporary()
            lines = [f"{selector} = {self._expressions.text(node.selector)}"]
        branches = [(_matches(selector, branch.labels), branch.body) for branch in node.branches]
        return lines + self._branches(branches, node.otherwise)

    def _for(self, node: typed.For) -> list[str]:
        expressions = self._expressions
        counter = self._name(node.name)
        start, stop = expressions.value(node.start), expressions.value(node.stop)
        values = expressions.temporary()
        if isinstance(node.step, typed.Const):
            beyond = f"{stop.at_least(SUM)} {'+' if node.step.value > 0 else '-'} 1"
            step = "" if node.step.value == 1 else f", {node.step.value}"
            lines = [f"{values} = range({start.text}, {beyond}{step})"]
            after = Fragment(
                f"{values}.start + len({values}) * {node.step.value}",
                SUM,
                min(start.low, stop.low + node.step.value),
                max(start.high, stop.high + node.step.value),
            )
        else:
            call = f"{expressions.helper('_for_range')}({start.text}, {stop.text}, {expressions.text(node.step)}"
            lines = [f"{values} = {call}, {where(node)})"]
            after = Fragment(f"{values}.start + len({values}) * {values}.step", SUM, -(1 << 65), 1 << 65)
        outer = expressions.known.get(node.name)
        expressions.known[node.name] = min(start.low, stop.low), max(start.high, stop.high)
        body = self._body(node.body)
        del expressions.known[node.name]
        if outer is not None:
            expressions.known[node.name] = outer
        ended = f"{expressions.helper('_ended')}(_ticks, {where(node)})"
        end = [ended, *self._assign(counter, after, node.type)]
        return [*lines, f"for {counter}, _ in zip({values}, _ticks):", *body, "else:", *_indented(end)]

    def _repeat(self, node: typed.Repeat) -> list[str]:
        condition = self._expressions.text(node.condition)
        if not typed.continues(node.body):
            return self._loop(node, [*self._plain(node.body), f"if {condition}: break"])
        # CONTINUE goes on with the condition, which therefore opens every round but the first
        again = self._expressions.temporary()
        test = [f"if {again} and ({condition}): break", f"{again} = True"]
        return [f"{again} = False", *self._loop(node, [*test, *self._plain(node.body)])]

    def _loop(self, node: typed.Statement, body: list[str]) -> list[str]:
        endless = f"{self._expressions.helper('_endless')}({where(node)})"
        return ["for _ in _ticks:", *_indented(body), "else:", _INDENT + endless]


def _matches(selector: str, labels: tuple[tuple[int, int], ...]) -> str:
    singles = [str(low) for low, high in labels if low == high]
    tests = [f"{low} <= {selector} <= {high}" for low, high in labels if low != high]
    if len(singles) == 1:
        tests.insert(0, f"{selector} == {singles[0]}")
    elif singles:
        tests.insert(0, f"{selector} in ({', '.join(singles)})")
    return " or ".join(tests)
