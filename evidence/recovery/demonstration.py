"""A run of the recovery: a cell with all services, faults of its own making, and the operator who puts it right."""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Final

import numpy as np

from dtwin.bus.messages import FAULT, Done, FaultRequest
from dtwin.emulation.faults import Fault, parse_fault
from dtwin.errors import CommunicationError, ParameterError
from dtwin.logs.log import Log
from dtwin.logs.reading import read_log
from dtwin.parameters import PERIOD
from dtwin.recovery.desk import CriticalFinding, DeadlinePassed, Desk, StoppedByController
from dtwin.recovery.measures import Measures
from dtwin.recovery.operator import Operator
from dtwin.run.settings import CellSettings, sequence_of
from dtwin.services.launch import CellOptions, launched
from dtwin.signals import EventKind
from evidence.recovery.cases import RecoveryCase, grown_friction
from evidence.recovery.expected import expected_of, kind_of, made_of
from evidence.recovery.headless import HeadlessCell
from evidence.recovery.healthy import healthy_run
from evidence.recovery.known import KnownArm, known_arm, recorded_arm
from evidence.recovery.outcome import Recovery, Story, judge

Played = Callable[[Desk, KnownArm, RecoveryCase], Story]
"""Makes the faults of a case and has them answered at a desk."""
LIMIT: Final = 60.0
"""s of plant time after the fault in which the arm has to have recovered"""
LONGEST: Final = 600.0
"""s of plant time in which the cell has to have shown what it can do while it is healthy"""
STANDS: Final = 10.0
"""s for which a stopped arm is watched"""
PUSH_AFTER: Final = 4.0
"""s by which a push begins later than other faults, late enough for the request to arrive before it"""
PUSH_LASTS: Final = 0.2
"""s"""


def parse_faults(texts: Sequence[str]) -> tuple[Fault, ...]:
    """Faults without their times, such as K2*=0.8, each text one or several with commas between them.

    Raises:
        FaultError: a text does not follow the grammar of faults.
    """
    return tuple(parse_fault(f"{text}@0") for joined in texts for text in joined.split(","))


def recover(
    options: CellOptions,
    case: RecoveryCase | None = None,
    progress: Callable[[float], None] = lambda time: None,
    known: KnownArm | None = None,
    played: Played | None = None,
    *,
    headless: bool = False,
) -> Recovery:
    """Starts a cell with all services, makes faults, and has them answered.

    Args:
        options: what the cell is run with; the healthy arm is known from its record, if it names one.
        case: what happens to the cell; grown friction, drawn with the seed of the cell, if None.
        progress: told the plant time, s.
        known: what is known of the healthy arm; identified first if None and without a record.
        played: makes the faults and has them answered; by the operator if None.
        headless: whether the cell is one process without services and pace, of an arm with a record.

    Raises:
        ParameterError: an arm without a record shall be without services.
        FaultError: there is no right answer to a fault.
        ModelError: the file of the record is none.
        IdentificationError: the model of the healthy arm cannot be identified.
        CommunicationError: the cell does not come up.
        KeyboardInterrupt: the cell was asked to stop.
    """
    generator = np.random.default_rng(np.random.SeedSequence(options.seed).spawn(3)[2])
    made = case or grown_friction(generator)
    for fault in made.faults:
        kind_of(fault)
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        recorded = None if options.commissioned is None else recorded_arm(options.commissioned)
        healthy = known or recorded or known_arm(options.settings(), folder, generator)
        log_file = options.log or folder / "run.parquet"
        complete = replace(
            healthy.used(replace(options, monitoring=True)),
            log=log_file,
            identification=True,
            store=folder / "identified",
            simulation=True,
            history=folder / "history.jsonl",
        )
        settings = complete.settings()
        arm, effects = made_of(settings.machine, settings.arm)
        via, control = sequence_of(settings).via, healthy.control(options)
        expected = expected_of(made.faults, arm, control, effects, via, healthy.record)

        def play(desk: Desk) -> Story:
            return (played or _played)(desk, healthy, made)

        if headless:
            story, log = _in_one_process(settings, healthy, folder, progress, play)
        else:
            story, log = _with_services(complete, log_file, progress, play)
    settings = replace(settings, duration=len(log) * PERIOD)
    same = healthy_run(settings, healthy.model, float("inf") if story.started is None else story.started)
    return judge(options.seed, made.faults, expected, story, log, same)


def _with_services(
    complete: CellOptions, log_file: Path, progress: Callable[[float], None], play: Callable[[Desk], Story]
) -> tuple[Story, Log]:
    """What happens in a cell with all services, and its log."""
    with launched(complete) as cell:
        cell.await_ready()
        story = play(Desk(cell.bus, lambda: cell.over, progress, LONGEST))
        if cell.stop.is_set():
            raise KeyboardInterrupt
    return story, read_log(log_file)


def _in_one_process(
    settings: CellSettings,
    healthy: KnownArm,
    folder: Path,
    progress: Callable[[float], None],
    play: Callable[[Desk], Story],
) -> tuple[Story, Log]:
    """What happens in a cell of one process, and its log."""
    if healthy.record is None:
        raise ParameterError("--headless: expected an arm with a record, as its model is identified by no service")
    cell = HeadlessCell(settings, healthy.record, folder)
    story = play(cell.desk(progress, LONGEST))
    return story, cell.log()


def _played(desk: Desk, healthy: KnownArm, case: RecoveryCase) -> Story:
    """Lets the cell work, makes faults, and has them answered until the time is over."""
    measures = Measures(desk, healthy.arm, healthy.record)
    operator = Operator(desk, measures)
    started = began = None
    try:
        started = measures.put_into_force()
        began = make_faults(desk, case)
        desk.end = began + LIMIT
        operator.watch()
        if desk.stopped:
            desk.pass_time(STANDS)
    except (CommunicationError, ParameterError, DeadlinePassed, CriticalFinding, StoppedByController) as error:
        operator.trouble = str(error)
    return Story(
        began,
        started,
        tuple(operator.findings),
        tuple(operator.steps),
        tuple(measures.offsets),
        operator.trouble,
        operator.cause.name,
    )


def make_faults(desk: Desk, case: RecoveryCase) -> float:
    """Once the healthy arm has delivered some boxes, makes faults as it sets out with the next one; when the first
    began, s."""
    for _ in range(case.deliveries):
        desk.await_event(EventKind.DELIVERED)
    picked = desk.await_event(EventKind.PICKED).time
    faults = [_timed(fault, picked + case.wait) for fault in case.faults]
    done = desk.bus.ask(FAULT, FaultRequest(tuple(map(str, faults))), Done)
    return max(done.time, min(fault.start for fault in faults))


def _timed(fault: Fault, start: float) -> Fault:
    """The fault as it begins at a plant time (s): a push is short and a little later, all others last."""
    if not fault.target.startswith("push"):
        return replace(fault, start=round(start, 2))
    start = round(start + PUSH_AFTER, 2)
    return replace(fault, start=start, end=round(start + PUSH_LASTS, 2))
