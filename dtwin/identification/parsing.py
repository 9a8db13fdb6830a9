"""Parses what an operator types into the settings of an estimation."""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import Final

from dtwin.errors import ParameterError
from dtwin.identification.estimation.estimate import EstimationSettings, Loss
from dtwin.identification.estimation.friction import START_COULOMB
from dtwin.identification.estimation.problem import START, Prior
from dtwin.parameters import PARAMETER_NAMES, ArmParameters, symbol_of

SYMBOLS: Final = ("K", "m", "I", "l", "c", "D", "mu")


def free_names(text: str) -> tuple[str, ...]:
    """The parameter names in a text such as `K,I,m2` or `all`.

    Raises:
        ParameterError: a part of the text is neither a symbol nor a name.
    """
    names: list[str] = []
    for part in filter(None, re.split(r"[,\s]+", "K,m,I,l,c,D" if text == "all" else text)):
        if part in SYMBOLS:
            names += [f"{part}{joint}" for joint in (1, 2, 3)]
        elif part in PARAMETER_NAMES:
            names.append(part)
        else:
            raise ParameterError(
                f"--free {part}: expected all, a symbol of {', '.join(SYMBOLS)}, or a name such as m2"
            )
    if not names:
        raise ParameterError("--free: expected at least one parameter")
    return tuple(dict.fromkeys(names))


def prior(text: str) -> tuple[str, Prior]:
    """The name and the prior in a text such as `m2=0.116+-0.001`.

    Raises:
        ParameterError: the text is not of that form, or a number is out of range.
    """
    name, _, rest = text.partition("=")
    mean, _, deviation = rest.partition("+-")
    try:
        numbers = float(mean), float(deviation)
    except ValueError:
        raise ParameterError(f"--prior {text}: expected NAME=MEAN+-DEVIATION, such as m2=0.116+-0.001") from None
    return name, Prior(*numbers)


def settings_for(
    free: str,
    known: ArmParameters | None = None,
    priors: Sequence[str] = (),
    loss: Loss = "adaptive",
    seed: int = 0,
) -> EstimationSettings:
    """Settings that estimate the parameters in a text from the usual start values.

    Args:
        free: names of the parameters to estimate, in the form that `free_names` reads.
        known: values of the parameters that are not estimated; those of the data sheet when None.
        priors: prior knowledge of parameters, each in the form that `prior` reads.
        loss: loss function of the estimation.
        seed: number of the random generator of further starting points.

    Raises:
        ParameterError: a text cannot be read.
    """
    names = free_names(free)
    starts = {name: START_COULOMB if symbol_of(name) == "mu" else START.get(name) for name in names}
    arm = (known or ArmParameters()).with_values(starts)
    return EstimationSettings(names, arm, priors=dict(map(prior, priors)), loss=loss, seed=seed)
