"""What a cell that is up is asked for when its settings shall change: values, or files that hold some."""

from __future__ import annotations

import logging
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from dtwin.api.arguments import AnyPath, Texts, pairs
from dtwin.controller.proposed import SavedTuning, read_tuning
from dtwin.identification.store import STORE, ModelStore, open_model
from dtwin.parameters import ArmParameters, CellJoints, Gains, Law

log = logging.getLogger(__name__)


def wished_tuning(
    gains: Gains | AnyPath | None,
    given: Mapping[str, CellJoints | None],
    now: Gains,
    law: Law | None,
    target_time: float | None,
) -> dict[str, Any]:
    """The gains and the target time that shall be in force, and the law that the gains are of, as far as given.

    Args:
        gains: gains, or the file in which `dtwin optimise` has saved some; None for those in force.
        given: values that take the place of others, by the name of the gain.
        now: the gains in force.
        law: law that the gains are of; None for that of the file.
        target_time: target time, s; None for that of the file.

    Raises:
        ModelError: the file cannot be read.
        ParameterError: a gain is out of range.
    """
    changed = {name: value for name, value in given.items() if value is not None}
    wished: dict[str, Any] = {"law": law, "target_time": target_time}
    if gains is not None or changed:
        if gains is None or isinstance(gains, Gains):
            saved = SavedTuning(gains=gains or now)
        else:
            saved = read_tuning(Path(gains))
        wished["gains"] = replace(saved.gains, **changed)
        wished["law"] = law or saved.law
        wished["target_time"] = saved.target_time if target_time is None else target_time
    return {name: value for name, value in wished.items() if value is not None}


def known_arm(model: ArmParameters | AnyPath | None, store: AnyPath | None) -> ArmParameters | None:
    """The arm of an identified model; a model that is in doubt is told in the log.

    Args:
        model: the arm itself, a file that ends in .json, or NAME or NAME@REVISION in the store; None for none.
        store: folder of the kept models; None for `identified`.

    Raises:
        ModelError: there is no such model, or it cannot be read.
    """
    if model is None or isinstance(model, ArmParameters):
        return model
    found = open_model(str(model), ModelStore(STORE if store is None else Path(store)))
    if doubts := found.validity.doubts:
        log.warning("dtwin: model %s is in doubt: %s", model, doubts)
    return found.arm


def wished_model(
    model: ArmParameters | None, values: Texts | Mapping[str, float], now: ArmParameters
) -> ArmParameters | None:
    """The model that shall be in force: `model`, or the one in force, with other values; None where none is given.

    Raises:
        ParameterError: a value has another form or is out of range.
    """
    changed = pairs(values)
    return (model or now).with_values(changed) if changed else model
