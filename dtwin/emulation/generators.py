"""States of random generators as text, so that what follows from a generator can be brought back to the bit."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import numpy as np


def generator_state(generator: np.random.Generator) -> str:
    """The state of a generator as a JSON object, whose whole numbers have up to 128 bits."""
    return json.dumps(generator.bit_generator.state)


def set_generator_state(generator: np.random.Generator, state: str) -> None:
    """Brings a generator of the same kind to a state that `generator_state` gave."""
    generator.bit_generator.state = json.loads(state)
