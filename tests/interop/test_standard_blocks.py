"""The standard blocks on a real 4diac FORTE and on the embedded runtime: equal but for the table of departures.

FORTE_CASES in the environment is how many cases of the F_ blocks are compared, and sets how many events go through
the E_ blocks; 6000 takes about 20 s.
"""

from __future__ import annotations

import os
import random
from collections.abc import Iterator
from itertools import islice
from pathlib import Path

import pytest

from iec61499.management.client import ManagementClient
from iec61499.management.protocol import ManagedType
from tests.support.forte import FORTE, NO_FORTE, forte
from tests.support.forte_cases import Questioner, function_groups, same
from tests.support.forte_events import EVENT_BLOCKS, EventBench, expected_readings
from tests.support.waiting import connected

pytestmark = pytest.mark.skipif(not FORTE, reason=NO_FORTE)
CASES = int(os.environ.get("FORTE_CASES", "300"))
BATCH = 50


@pytest.fixture
def client(tmp_path: Path) -> Iterator[ManagementClient]:
    with forte(tmp_path) as address, connected(lambda: ManagementClient(address)) as client:
        yield client


def test_function_blocks(client: ManagementClient) -> None:
    known = client.demand("", "QUERY", ManagedType("*")).names or ()
    groups = function_groups(random.Random(1), CASES, known)
    wrong, count = [], 0
    while batch := list(islice(groups, BATCH)):
        answers = Questioner(client, f"R{count}").outputs(batch)
        count += len(answers)
        pairs = [(case, value) for group in batch for case, value in zip(group.cases, group.expected, strict=True)]
        for (case, value), answer in zip(pairs, answers, strict=True):
            if not same(answer, value):
                wrong.append(f"{case}: FORTE {answer!r}, here {value!r}")
    assert count == CASES
    assert not wrong


@pytest.mark.parametrize("name", EVENT_BLOCKS)
def test_event_blocks(client: ManagementClient, name: str) -> None:
    rng = random.Random(name)
    bench = EventBench.of(name)
    steps = [bench.step(rng) for _ in range(max(CASES // 60, 20))]
    assert bench.readings(client, steps) == expected_readings(bench, steps)
