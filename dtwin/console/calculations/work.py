"""The process of a job: reads its task from standard input, says how far it is and the result on standard output."""

from __future__ import annotations

import math
import sys
from itertools import pairwise
from pathlib import Path
from typing import Any, Final

import msgspec
import numpy as np

from dtwin.campaign.spread import Workforce
from dtwin.console.calculations.tasks import Candidate, Compare, Excited, Optimise, Recall, Simulate, Work
from dtwin.controller.settings import ControlSettings
from dtwin.errors import DtwinError, ParameterError
from dtwin.identification.data import Experiment
from dtwin.identification.held_out import compare
from dtwin.identification.store import ModelStore
from dtwin.parameters import PARAMETER_NAMES, ArmParameters
from dtwin.simulation.checks import MOTIONS
from dtwin.simulation.figures import Array, triple
from dtwin.simulation.objective import CandidateScore, Objective, scenarios_for
from dtwin.simulation.optimise import optimise
from dtwin.simulation.places import parse_goal, parse_start
from dtwin.simulation.whatif import MotionCase, Simulator

EVERY: Final = 2
"""Number of samples of which one is drawn."""
HELD: Final = 5
"""Number of samples for which a signal holds its voltages at least."""
PIECE: Final = 50
"""Least number of samples of a piece of motion that a model is compared with."""
NOISE: Final = 0.001
"""Standard deviation of the encoder noise in a search, rad, as for `dtwin optimise`."""
BOXES: Final = (0.19, 0.21)
"""Least and greatest mass of a box in a search, kg, as for `dtwin optimise`."""


def main() -> int:
    """Does one task; an error is said, too."""
    try:
        work = msgspec.json.decode(sys.stdin.buffer.readline(), type=Work)
        say(result=_done(work))
    except DtwinError as error:
        say(error=str(error))
    return 0


def say(**words: Any) -> None:
    """Writes one line."""
    sys.stdout.buffer.write(msgspec.json.encode(words) + b"\n")
    sys.stdout.buffer.flush()


def _done(work: Work) -> dict[str, Any]:
    task = work.task
    if isinstance(task, Simulate):
        return _simulated(task, work)
    if isinstance(task, Optimise):
        return _optimised(task, work)
    if isinstance(task, Compare):
        return _compared(work)
    return _recalled(task, work)


def _arm(work: Work, reference: str | None) -> ArmParameters:
    return work.model if reference is None else ModelStore(Path(work.store)).load(reference).arm


def _settings(work: Work, candidate: Candidate) -> ControlSettings:
    model = _arm(work, candidate.model)
    return ControlSettings(candidate.target_time, candidate.gains, work.law, model, work.box)


def _simulated(task: Simulate, work: Work) -> dict[str, Any]:
    arm = _arm(work, task.arm)
    start = parse_start(task.start, arm)
    goal = parse_goal(task.goal, arm, start)
    simulator = Simulator()
    found = []
    for number, candidate in enumerate(task.candidates, 1):
        case = MotionCase(goal, _settings(work, candidate), start, arm=arm, payload=task.payload)
        outcome = simulator.run(case)
        found.append(
            {
                "name": candidate.name,
                "time": outcome.time[::EVERY].round(4).tolist(),
                "theta": _columns(outcome.theta),
                "path": _columns(outcome.path),
                "volts": _columns(outcome.volts),
                "figures": outcome.figures,
            }
        )
        say(done=number, of=len(task.candidates))
    return {"motions": found}


def _columns(values: Array) -> list[list[float]]:
    return values[::EVERY, :3].T.round(5).tolist()


def _optimised(task: Optimise, work: Work) -> dict[str, Any]:
    arm = _arm(work, task.arm)
    objective = Objective(
        base=ControlSettings(task.target_time, task.gains, work.law, arm, work.box),
        scenarios=scenarios_for(MOTIONS, arm, BOXES, (), NOISE),
        weights={"time": 1.0, "tracking": task.tracking},
    )

    def between(done: int, best: float) -> None:
        say(done=done, of=task.candidates, best=best if math.isfinite(best) and best < 100 else None)

    found = optimise(
        objective, (task.fastest, task.slowest), candidates=task.candidates, workforce=Workforce(1), between=between
    )
    usable = [each for each in found.scores if not each.broken]
    return {
        "best": found.best,
        "reference": found.reference,
        "broken": found.best.broken,
        "points": [_point(each) for each in usable],
        "front": [{**_point(each), "gains": each.gains, "target_time": each.target_time} for each in _front(found)],
        "judged": len(found.scores),
        "seconds": found.seconds,
    }


def _front(found: Any) -> list[CandidateScore]:
    front: list[CandidateScore] = found.front("time", "tracking") if not found.best.broken else []
    return front


def _point(score: CandidateScore) -> dict[str, float]:
    return {"time": score.terms["time"], "tracking": score.terms["tracking"]}


def _compared(work: Work) -> dict[str, Any]:
    excited = work.excited
    if excited is None or not excited.numbers:
        raise ParameterError("no excited motion was heard; the console must run while the arm is excited")
    experiments = excited_experiments(excited)
    measured = np.concatenate([experiment.measured for experiment in experiments])
    proposed = {name: value for name, value in excited.proposed.items() if name in PARAMETER_NAMES}
    found = {"measured": measured.T.round(5).tolist()}
    for name, arm in (("before", work.model), ("proposed", work.model.with_values(proposed))):
        predicted = compare(experiments, arm, np.zeros(3))
        found[name] = predicted.predicted.T.round(5).tolist()
        found[f"{name}_fit"] = list(triple(predicted.fit))
    return found


def excited_experiments(excited: Excited) -> list[Experiment]:
    """The pieces of the last signal in which no sample is missing, each of at least PIECE samples.

    Raises:
        ParameterError: there is no signal, or no such piece of it.
    """
    numbers, theta, volts = (np.array(column) for column in (excited.numbers, excited.theta, excited.volts))
    signal = find_signal(volts)
    edges = [signal.start, *(np.flatnonzero(np.diff(numbers[signal]) != 1) + signal.start + 1).tolist(), signal.stop]
    pieces = [slice(first, last) for first, last in pairwise(edges) if last - first >= PIECE]
    if not pieces:
        raise ParameterError(f"no {PIECE} samples of the signal came without a gap; excite the arm again")
    return [Experiment(theta[piece], volts[piece]) for piece in pieces]


def find_signal(volts: Array) -> slice:
    """Where the last 3-2-1-1 signal is among voltages, (N, 3), V.

    A signal holds its voltages for many samples, on both sides of zero, which no controller does.

    Raises:
        ParameterError: there is none.
    """
    steps = np.flatnonzero((np.diff(volts, axis=0) != 0.0).any(axis=1)) + 1
    edges = [0, *steps.tolist(), len(volts)]
    held = [(first, last) for first, last in pairwise(edges) if last - first >= HELD]
    runs: list[list[int]] = []
    for first, last in held:
        if runs and first - runs[-1][1] < HELD:
            runs[-1][1] = last
        else:
            runs.append([first, last])
    for first, last in reversed(runs):
        part = volts[first:last]
        if ((part.max(axis=0) > 0.0) & (part.min(axis=0) < 0.0)).sum() >= 2:
            return slice(first, last)
    raise ParameterError("no signal was heard; the console must run while the arm is excited")


def _recalled(task: Recall, work: Work) -> dict[str, Any]:
    from dtwin.console.calculations.recall import recall  # loads what reads logs, which the other tasks do not need

    return recall(Path(work.recordings) if work.recordings else None, task)


if __name__ == "__main__":
    sys.exit(main())
