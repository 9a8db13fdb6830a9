"""Random generators: their numbers, and their states as text, which bring back what follows to the bit."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING

from dtwin.errors import ParameterError
from dtwin.signals import LARGEST_COUNT

if TYPE_CHECKING:
    import numpy as np


def check_seed(seed: int) -> None:
    """Checks the number of random generators.

    Raises:
        ParameterError: it is out of range.
    """
    if not 0 <= seed <= LARGEST_COUNT:
        raise ParameterError(f"seed: expected a whole number from 0 to {LARGEST_COUNT} (2^63 - 1), got {seed}")


def generator_state(generator: np.random.Generator) -> str:
    """The state of a generator as a JSON object, whose whole numbers have up to 128 bits."""
    return json.dumps(generator.bit_generator.state)


def set_generator_state(generator: np.random.Generator, state: str) -> None:
    """Brings a generator of the same kind to a state that `generator_state` gave."""
    generator.bit_generator.state = json.loads(state)
