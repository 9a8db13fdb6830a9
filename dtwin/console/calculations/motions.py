"""Motions of the cell that are simulated, and searches of settings for them."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any, Final

from dtwin.campaign.spread import Workforce
from dtwin.console.calculations.said import say
from dtwin.console.calculations.tasks import Candidate, Optimise, Simulate, Work
from dtwin.controller.settings import ControlSettings
from dtwin.identification.store import ModelStore
from dtwin.parameters import ArmParameters
from dtwin.simulation.checks import motions_of
from dtwin.simulation.figures import Array
from dtwin.simulation.objective import CandidateScore, Objective, scenarios_for
from dtwin.simulation.optimise import optimise
from dtwin.simulation.places import parse_goal, parse_start
from dtwin.simulation.whatif import MotionCase, Simulator

EVERY: Final = 2
"""Number of samples of which one is drawn."""
NOISE: Final = 0.001
"""Standard deviation of the encoder noise in a search, rad, as for `dtwin optimise`."""


def simulated(task: Simulate, work: Work) -> dict[str, Any]:
    """The motion with every candidate."""
    arm = _arm(work, task.arm)
    start = parse_start(task.start, arm, work.cell)
    goal = parse_goal(task.goal, arm, start, work.cell)
    simulator = Simulator(task=work.cell)
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


def optimised(task: Optimise, work: Work) -> dict[str, Any]:
    """The best settings, those that nothing beats, and what became of all."""
    arm, boxes = _arm(work, task.arm), work.cell.boxes
    objective = Objective(
        base=ControlSettings(task.target_time, task.gains, work.law, arm, work.box),
        scenarios=scenarios_for(motions_of(work.cell), arm, (boxes.lightest, boxes.heaviest), (), NOISE),
        weights={"time": 1.0, "tracking": task.tracking},
        task=work.cell,
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


def _arm(work: Work, reference: str | None) -> ArmParameters:
    return work.model if reference is None else ModelStore(Path(work.store)).load(reference).arm


def _settings(work: Work, candidate: Candidate) -> ControlSettings:
    model = _arm(work, candidate.model)
    return ControlSettings(candidate.target_time, candidate.gains, work.law, model, work.box)


def _columns(values: Array) -> list[list[float]]:
    return values[::EVERY, :3].T.round(5).tolist()


def _front(found: Any) -> list[CandidateScore]:
    front: list[CandidateScore] = found.front("time", "tracking") if not found.best.broken else []
    return front


def _point(score: CandidateScore) -> dict[str, float]:
    return {"time": score.terms["time"], "tracking": score.terms["tracking"]}
