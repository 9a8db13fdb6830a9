"""Findings and the rules that make them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final, Literal, get_args

Level = Literal["error", "warning", "info", "off"]
LEVELS: Final[tuple[Level, ...]] = get_args(Level)


@dataclass(frozen=True, slots=True)
class Rule:
    """A rule.

    Attributes:
        name: what settings and suppressions call it.
        level: how grave a finding is, unless settings say otherwise.
        text: what it finds, in a sentence.
    """

    name: str
    level: Level
    text: str


@dataclass(frozen=True, slots=True, order=True)
class Finding:
    """What a rule has found; line and column count from 1, 0 where they are unknown."""

    file: str
    line: int
    column: int
    rule: str
    message: str

    def __str__(self) -> str:
        position = ":".join(str(part) for part in (self.file, self.line, self.column) if part)
        return f"{position}: {self.message}" if position else self.message


INVALID: Final = "invalid"
UNSUPPORTED: Final = "not-supported"
DEPARTURE: Final = "forte-departs"
REASONLESS: Final = "suppression-without-reason"
UNUSED_SUPPRESSION: Final = "unused-suppression"

_RULES: Final = (
    Rule(INVALID, "error", "The file is wrong: schema, types, connections, Structured Text. It cannot run."),
    Rule(UNSUPPORTED, "error", "The file uses what is right elsewhere and is not supported here. It cannot run."),
    Rule("names-differ-in-case", "warning", "An event and a variable have names that differ in case alone."),
    Rule("mapped-nowhere", "warning", "A block or connection of a system that no resource has: it never runs."),
    Rule("start-in-application", "warning", "An application connects START, which each resource has for itself."),
    Rule("no-such-service", "warning", "A block, or its type, is a service that this device does not have."),
    Rule("no-such-protocol", "warning", "The ID of a communication block names a protocol that cannot run here."),
    Rule(DEPARTURE, "warning", "A block that may compute something else on 4diac FORTE."),
    Rule("unused-variable", "warning", "An internal or temporary variable that nothing reads or writes."),
    Rule("never-read", "info", "An internal variable that is written, but never read."),
    Rule("never-written", "warning", "An internal variable without an initial value that is only read."),
    Rule("unused-input", "info", "A data input that no algorithm or condition reads."),
    Rule("output-never-written", "warning", "A data output without an initial value that no algorithm writes."),
    Rule("constant-without-value", "warning", "A constant without an initial value."),
    Rule("unused-algorithm", "warning", "An algorithm that no state executes."),
    Rule("not-sampled", "warning", "A data input in no WITH of an event input: it never gets a value."),
    Rule("not-published", "warning", "A data output in no WITH of an event output: others never see what it gets."),
    Rule("reserved-name", "warning", "A name that is a keyword of IEC 61131-3."),
    Rule("unreachable-state", "warning", "A state that no transition leads to from the initial one."),
    Rule("stuck-state", "info", "A state that no transition leaves: the block reacts to nothing any more."),
    Rule("transition-never-fires", "warning", "A transition behind one that fires whenever it could."),
    Rule("condition-is-constant", "warning", "A condition that is always TRUE or always FALSE."),
    Rule("endless-chart", "error", "States that lead to one another without an event, whatever the variables are."),
    Rule(
        "ignored-event",
        "warning",
        "An event input that does nothing: nothing waits for it or is sampled by it.",
    ),
    Rule("event-never-issued", "warning", "An event output that no state issues."),
    Rule("duplicate-case-label", "warning", "A label of CASE that an earlier one has already taken."),
    Rule("unreachable-code", "warning", "Statements behind RETURN, EXIT or CONTINUE."),
    Rule("no-effect", "warning", "A variable that is assigned to itself."),
    Rule("narrow-arithmetic", "info", "A sum, difference or product that may overflow before it is widened."),
    Rule("real-equality", "info", "Real numbers compared by = or <>."),
    Rule("duplicate-connection", "warning", "A connection of data that is drawn twice."),
    Rule("never-triggered", "warning", "A block of a network whose event inputs are all unconnected."),
    Rule("event-loop", "info", "Events that lead back to where they came from, past no block that waits."),
    Rule(REASONLESS, "error", "A suppression that does not say why."),
    Rule(UNUSED_SUPPRESSION, "warning", "A suppression of what is not found."),
)
RULES: Final = {rule.name: rule for rule in _RULES}
"""All rules, by their names."""
