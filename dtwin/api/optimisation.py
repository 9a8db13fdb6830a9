"""The search for settings of the controller on the twin."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Final

import numpy as np

from dtwin.api.arguments import AnyPath, Texts, checked, texts
from dtwin.api.identification import Identified
from dtwin.api.monitoring import model_of
from dtwin.campaign.spread import Workforce
from dtwin.controller.settings import APPLICATION_LAW, ControlSettings, usual_gains
from dtwin.errors import ParameterError
from dtwin.identification.model import IdentifiedModel
from dtwin.identification.store import STORE
from dtwin.parameters import ArmParameters, Gains, Law
from dtwin.run.cell_file import cell_of
from dtwin.simulation import optimise as search
from dtwin.simulation.checks import Motion, motions_of
from dtwin.simulation.objective import Limits, Objective, possible_arms, scenarios_for
from dtwin.simulation.places import angles_of
from dtwin.task import DEFAULT_TASK, PICKUP_NAME, Task

_LIMITS: Final = Limits()


@checked
def optimise(
    *,
    cost: Mapping[str, float] | None = None,
    motion: Texts = (),
    target_time: tuple[float, float] = (0.5, 4.0),
    in_use: float = 2.0,
    law: Law = APPLICATION_LAW,
    gains: Gains | None = None,
    model: Identified | str | Path | None = None,
    store: AnyPath = STORE,
    arms: int = 2,
    box: tuple[float, float] | None = None,
    noise: float = 0.001,
    saturated: float = _LIMITS.saturated,
    overshoot: float = _LIMITS.overshoot,
    tracking: float = _LIMITS.tracking,
    voltage: float = _LIMITS.voltage,
    candidates: int = 1000,
    workers: int | None = 1,
    scheduler: str | None = None,
    seed: int = 0,
    cell_file: AnyPath | None = None,
    between: Callable[[int, float], None] = lambda done, best: None,
) -> search.Optimum:
    """Searches gains and target time of least cost on the twin, under limits, as `dtwin optimise` does.

    Args:
        cost: weights of the terms of the cost: time, tracking, energy and voltage; None for `{"time": 1.0}`.
        motion: motions FROM:TO that count, such as `"pickup:red"`; none for all that the cell makes.
        target_time: shortest and longest target time of the search, s; equal ones keep the target time.
        in_use: target time in use, s.
        law: control law: cascade, computed_torque or row_sum.
        gains: gains in use; None for the usual ones of the law.
        model: identified model, whose covariance says what arms are possible; None for the data sheet's arm alone.
        store: folder of the kept models.
        arms: number of possible arms, drawn from the covariance, that must keep the limits too.
        box: least and largest mass of a carried box, kg; None for those of the cell.
        noise: standard deviation of the encoder noise, rad.
        saturated: largest share of the samples of a motion that may have a voltage at its limit.
        overshoot: largest distance that a joint may go beyond its target, rad.
        tracking: largest distance of a joint from its path, rad.
        voltage: largest voltage of a motor, V.
        candidates: number of settings to judge.
        workers: number of processes that share the work; None for one for each core, which a script must guard by
            `if __name__ == "__main__"`.
        scheduler: address of a Dask scheduler whose workers share the work instead, such as `"tcp://127.0.0.1:8786"`.
        seed: number of the random generator of the search; equal numbers give equal settings.
        cell_file: cell whose motions count, a file or a name of the folder cells; None for the usual one.
        between: called after every generation with the number of candidates judged and the least cost.

    Raises:
        ParameterError: an argument is unknown, of another kind or out of range.
        ModelError: there is no such model.
    """
    found = None if model is None else model_of(model, store)
    objective = objective_of(
        ControlSettings(in_use, gains or usual_gains(law), law),
        cost or {"time": 1.0},
        texts(motion),
        DEFAULT_TASK if cell_file is None else cell_of(str(cell_file)).task,
        box,
        noise,
        Limits(saturated, overshoot, tracking, voltage),
        judging_arms(found, arms, seed),
    )
    return search.optimise(
        objective,
        target_time,
        candidates=candidates,
        workforce=Workforce(workers if scheduler is None else None, scheduler),
        seed=seed,
        between=between,
    )


def objective_of(
    base: ControlSettings,
    cost: Mapping[str, float],
    motions: tuple[str, ...],
    task: Task,
    box: tuple[float, float] | None,
    noise: float,
    limits: Limits,
    arms: tuple[ArmParameters, ...],
) -> Objective:
    """What a search minimises.

    Args:
        base: settings in use, whose model and mass of a box follow from the other arguments.
        cost: weights of the terms by name.
        motions: motions FROM:TO that count; none for all of the task.
        task: task of the cell.
        box: least and largest mass of a box, kg; None for those of the task.
        noise: standard deviation of the encoder noise, rad.
        limits: limits to keep.
        arms: the arm that is expected, and others that must keep the limits.

    Raises:
        ParameterError: a motion, weight or mass is wrong.
    """
    low, high = (task.boxes.lightest, task.boxes.heaviest) if box is None else box
    arm, *others = arms
    chosen = tuple(_motion(text, task) for text in motions) or motions_of(task)
    return Objective(
        base=replace(base, model=arm, payload=(low + high) / 2),
        scenarios=scenarios_for(chosen, arm, (low, high), others, noise),
        weights=dict(cost),
        limits=limits,
        task=task,
    )


def judging_arms(model: IdentifiedModel | None, count: int, seed: int) -> tuple[ArmParameters, ...]:
    """The arm that a search expects, first, and so many other ones that are as possible.

    Args:
        model: identified model, whose covariance says what is possible; None for the data sheet's arm alone.
        count: number of the other ones.
        seed: number of their random generator.
    """
    if model is None:
        return (ArmParameters(),)
    matrix = np.array(model.covariance.matrix)
    others = possible_arms(model.arm, model.covariance.names, matrix, count, np.random.default_rng(seed))
    return (model.arm, *others)


def _motion(text: str, task: Task) -> Motion:
    start, colon, goal = text.partition(":")
    if not colon:
        raise ParameterError(f"`motion` {text}: expected FROM:TO, e.g. pickup:red")
    angles_of(start, task), angles_of(goal, task)
    return Motion(start, goal, start == PICKUP_NAME and goal in task.colours)
