"""The tables of what the monitor makes of effects and faults around the plant, and what was asked beside them.

Run by `scripts/outside --watched`, with a folder that keeps the records of commissioned arms, minutes of healthy work
with each effect, number of processes, a word that the names of all that is tried have, the number of the generators,
and `sheet` if no arm is commissioned and only healthy work is watched, with the data sheet's model alone.
"""

import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Final, TypeGuard

from dtwin.campaign.spread import Workforce, spread
from dtwin.identification.machine.record import MachineRecord, read_record, write_record
from dtwin.monitoring.estimation.belief import commissioned
from dtwin.monitoring.verdict import Finding
from tests.outside.table import EFFECTS, FAULTS, NAMES
from tests.outside.watched import WatchedEffect, WatchedFault, Work, commission, data_sheet, watch_effect, watch_fault

SOON: Final = 2.0
"""Motion within which a fault shall be noticed once it can be seen, s."""
SURE: Final = 0.95
"""Confidence above which a wrong name is wrong for sure."""
SHEET_MINUTES: Final = 20.0
"""Healthy work, at most, that is watched with the data sheet's model, minutes."""
_SEEDS: Final = 7, 3
"""Numbers of the generators of healthy work and its effects, and of faults, if nothing else is asked for."""
_HEALTHY: Final = Work("nothing", 1)
_EFFECTS: Final = (
    *("what", "grade", "hours", "not commissioned", "false alarms"),
    *("data sheet: not commissioned", "false alarms"),
)
_FAULTS: Final = ("what", "seen s", "noticed s", "called first", "is", "later", "wrong for sure", "consequences")


class _Keeper:
    """Commissions arms, and keeps their records in a folder."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder

    def __call__(self, item: Work) -> MachineRecord | str:
        path = self._folder / f"{item.what.replace(' ', '_').replace('/', '_')}-{item.seed}.json"
        if path.exists():
            return read_record(path)
        found = commission(item)
        if isinstance(found, MachineRecord):
            write_record(found, path)
        return found


def verdict(name: str, found: Finding | None) -> str:
    """What a finding is for a fault of the table: right, among those that it names, unknown, nothing, or wrong."""
    if found is None:
        return "nothing"
    if found.parameter in NAMES[name]:
        return "unknown" if found.fault.kind == "unknown" else "right"
    if found.fault.kind == "unknown":
        return "unknown"
    return "among" if set(found.others) & set(NAMES[name]) else "wrong"


def wrong(name: str, findings: Sequence[Finding]) -> list[Finding]:
    """Those of some findings that name what has not happened."""
    return [found for found in findings if verdict(name, found) == "wrong"]


def surely(findings: Sequence[Finding]) -> list[Finding]:
    """Those of some findings that are sure, and not said to be perhaps a consequence of another one."""
    return [found for found in findings if found.confidence > SURE and not found.follows]


def _later(one: WatchedFault) -> list[Finding]:
    """What came after the first finding, whether that was acknowledged or not."""
    return [*one.findings[1:], *one.again[1:]]


def _row(*values: object) -> str:
    return f"| {' | '.join(map(str, values))} |"


def _head(columns: Sequence[str]) -> str:
    return f"{_row(*columns)}\n{'|---' * len(columns)}|"


def _effect_rows(keeper: _Keeper | None, minutes: float, workforce: Workforce, word: str, seed: int) -> None:
    works = [Work(name, seed, seed) for name in EFFECTS if word in name]
    records = spread(keeper, works, workforce) if keeper else ["-"] * len(works)
    known = [
        (work, commissioned(found), minutes) for work, found in zip(works, records, strict=True) if _usable(found)
    ]
    strange = [(work, data_sheet(), min(minutes, SHEET_MINUTES)) for work in works]
    seen = iter(spread(watch_effect, known, workforce))
    sheet = spread(watch_effect, strange, workforce)
    own: list[WatchedEffect] = []
    print(f"\nEffects, {minutes:g} minutes each, {strange[0][2]:g} with the data sheet\n\n{_head(_EFFECTS)}")
    for work, found, other in zip(works, records, sheet, strict=True):
        grade = found.grade if isinstance(found, MachineRecord) else "unusable" if keeper else "-"
        told = next(seen) if _usable(found) else None
        own += [told] if told else []
        known_as = (f"{told.hours:.2f}", told.misfits, len(told.alarms)) if told else ("-", "-", "-")
        print(_row(work.what, grade, *known_as, other.misfits, len(other.alarms)))
    hours, alarms = sum(one.hours for one in own), sum(len(one.alarms) + one.misfits for one in own)
    rows = (
        (
            "at most 2 false alarms in 40 arm-days, commissioned; not commissioned is one",
            f"{alarms} in {hours / 24.0:.2f} arm-days",
        ),
        (
            'at most one "not commissioned" each, with the data sheet',
            f"at most {max(one.misfits for one in sheet)} each; {sum(len(one.alarms) for one in sheet)} false alarms"
            f" in {sum(one.hours for one in sheet) / 24.0:.2f} arm-days",
        ),
    )
    _asked(rows)
    said = [text for one in own for text in one.alarms]
    print("\n".join(["", *(f"- {text}" for text in said)]), flush=True)


def _usable(found: MachineRecord | str) -> TypeGuard[MachineRecord]:
    return isinstance(found, MachineRecord) and found.grade != "unusable"


def _fault_rows(keeper: _Keeper, workforce: Workforce, word: str, seed: int) -> None:
    record = keeper(_HEALTHY)
    assert isinstance(record, MachineRecord)
    belief = commissioned(record)
    jobs = [(Work(name, seed, seed), belief) for name in FAULTS if word in name]
    print(f"\nFaults, of an arm that was commissioned without them\n\n{_head(_FAULTS)}")
    outcomes = spread(watch_fault, jobs, workforce)
    for one in outcomes:
        first, later = next(iter(one.findings), None), _later(one)
        sure = surely(wrong(one.name, [*one.findings, *one.again[1:]]))
        others = wrong(one.name, later)
        called = f"{first.parameter} {100 * first.confidence:.0f} %" if first else "-"
        seen = "-" if one.seen is None else f"{one.seen:.2f}"
        noticed = "-" if one.after is None else f"{one.after:.2f}"
        told = f"{sum(bool(found.follows) for found in others)} of {len(others)}" if others else "-"
        print(_row(one.name, seen, noticed, called, verdict(one.name, first), len(later), len(sure), told))
    _asked(_fault_totals(outcomes))


def _fault_totals(outcomes: Sequence[WatchedFault]) -> list[tuple[str, str]]:
    visible = [one for one in outcomes if one.seen is not None]
    soon = sum(one.after is not None and one.after <= SOON for one in visible)
    first = sum(len(surely(wrong(one.name, one.findings[:1]))) for one in outcomes)
    later = [(one.name, found) for one in outcomes for found in _later(one)]
    sure = sum(len(surely(wrong(name, [found]))) for name, found in later)
    others = [found for name, found in later if wrong(name, [found])]
    told = sum(bool(found.follows) for found in others)
    kinds = [verdict(one.name, next(iter(one.findings), None)) for one in outcomes]
    names = ", ".join(f"{kinds.count(kind)} {kind}" for kind in ("right", "among", "unknown", "nothing", "wrong"))
    return [
        (f"90 % noticed within {SOON:g} s of motion once they can be seen", f"{soon} of {len(visible)}"),
        ("at most 1 % of first findings wrong for sure", f"{first} of {len(outcomes)}; {names}"),
        ("at most 1 % of later findings wrong for sure", f"{sure} of {len(later)}"),
        ("90 % of consequences told as such", f"{told} of {len(others)}"),
    ]


def _asked(rows: Sequence[tuple[str, str]]) -> None:
    print("\n| asked | measured |\n|---|---|\n" + "\n".join(_row(*row) for row in rows), flush=True)


def main(
    folder: str, minutes: float = 60.0, workers: int = 2, word: str = "", seed: int | None = None, models: str = ""
) -> None:
    """Prints the tables."""
    place, workforce = Path(folder), Workforce(workers)
    place.mkdir(parents=True, exist_ok=True)
    keeper = None if models == "sheet" else _Keeper(place)
    healthy, faulty = _SEEDS if seed is None else (seed, seed)
    if keeper and any(word in name for name in FAULTS):
        _fault_rows(keeper, workforce, word, faulty)
    if any(word in name for name in EFFECTS):
        _effect_rows(keeper, minutes, workforce, word, healthy)


if __name__ == "__main__":
    main(*(kind(text) for kind, text in zip((str, float, int, str, int, str), sys.argv[1:], strict=False)))
