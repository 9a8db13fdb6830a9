"""The cell of another arm as one of a line's stations."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache
from typing import Final

from dtwin.bus.line.plant import JointSettings
from dtwin.emulation.chain.faults import parse_chain_fault
from dtwin.emulation.chain.machine import NOMINAL
from dtwin.errors import ModelError, ParameterError
from dtwin.line.line import StationPlan
from dtwin.parameters import PERIOD
from dtwin.run.arm_cell import ArmCell, arm_cell_of
from dtwin.run.chain import ChainSettings
from dtwin.simulation.chain.checks import tuning_problem

_ANY: Final = 60.0
"""A duration: a station runs as long as its line."""


def arm_cell(plan: StationPlan) -> ArmCell | None:
    """The cell of a station with another arm than the thesis's; None for any other station.

    Raises:
        ModelError: its file cannot be read.
    """
    return None if plan.cell_file is None else arm_cell_of(plan.cell_file)


def chain_settings(plan: StationPlan, cell: ArmCell) -> ChainSettings:
    """What the arm of a station is and does.

    Args:
        plan: the station.
        cell: its cell.

    Raises:
        DtwinError: the arm, its machine, its task or a fault cannot be used.
    """
    if cell.sort is None:
        raise ModelError(f"{plan.cell_file}: expected a sorting task (sort) of a cell that is a station")
    machine = cell.machine if plan.machine is None else plan.machine
    return replace(cell, machine=machine, faults=(*cell.faults, *plan.faults)).settings(_ANY, plan.seed)


def believed_chain_settings(plan: StationPlan, cell: ArmCell) -> ChainSettings:
    """The same as a twin of the station knows it: the arm of the data sheet, with the friction that blocks expect.

    What machine it really is, and its faults, only the plant knows.
    """
    believed = replace(cell, machine=NOMINAL, faults=())
    return chain_settings(replace(plan, machine=None, faults=(), seed=0), believed)


@lru_cache(maxsize=64)
def believed_arm(plan: StationPlan) -> ChainSettings | None:
    """What the twins of a line know of the arm of a station; None for the thesis's arm. Raises DtwinError."""
    cell = arm_cell(plan)
    return None if cell is None else believed_chain_settings(plan, cell)


def check_joint_settings(settings: ChainSettings, wished: JointSettings) -> None:
    """Checks settings that are to take the place of those of a cell.

    Args:
        settings: what its arm is and does.
        wished: the settings.

    Raises:
        ParameterError: its blocks must not have them; the message says which value and why.
    """
    if problem := tuning_problem(settings.arm, settings.poses, wished.tuning):
        raise ParameterError(f"tuning: {problem}")
    if problem := wished.adjustment.problem(settings.arm):
        raise ParameterError(problem)


def check_chain_station(plan: StationPlan, cell: ArmCell, heaviest: float) -> tuple[str, ...]:
    """The names of the places of a station whose arm can work in a line.

    Args:
        plan: the station.
        cell: its cell.
        heaviest: mass of the heaviest box of the line, kg.

    Raises:
        DtwinError: it cannot.
    """
    settings = chain_settings(plan, cell)
    task, arm = settings.sorting, settings.arm
    assert task is not None
    ticks = PERIOD / arm.period
    if ticks < 1.0 or abs(ticks - round(ticks)) > 1e-9:
        raise ParameterError(f"{cell.arm}: period: expected {PERIOD} s or a whole part of it, got {arm.period:g} s")
    most = min(task.mass[1], arm.most_load)
    if heaviest > most:
        raise ParameterError(f"source.mass: expected at most {most:g} kg, which {cell.arm} can carry in {cell.sort}")
    for fault in plan.faults:
        parse_chain_fault(fault, len(arm))
    return tuple(task.places)
