"""Random programs on a real 4diac FORTE, deployed as Lua, leave what the oracle says.

FORTE_CASES in the environment is how many are drawn; those that end with an error are left out.
"""

from __future__ import annotations

import math
import os
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

from iec61499 import model
from iec61499.deploy.build import deploy
from iec61499.deploy.plan import plan_deployment
from iec61499.library import Library
from iec61499.literals import format_literal
from iec61499.management.client import ManagementClient
from iec61499.st.parser import parse_algorithm
from iec61499.types import STRING, ArrayType, DataType, ElementaryType
from tests.support.forte import FORTE, NO_FORTE, forte
from tests.support.iec61499.st_oracle import Fault, left_by
from tests.support.iec61499.st_oracle_functions import Unsaid
from tests.support.iec61499.st_random import Program, program
from tests.support.waiting import connected, until

pytestmark = pytest.mark.skipif(not FORTE, reason=NO_FORTE)
CASES = int(os.environ.get("FORTE_CASES", "60"))
BATCH = 20
"""Programs of one resource."""
WRONG = "WRONG"
"""The output that lists what has another value."""


@dataclass(frozen=True)
class Case:
    """A program and what it leaves."""

    seed: int
    program: Program
    left: dict[str, Any]


@pytest.fixture
def client(tmp_path: Path) -> Iterator[ManagementClient]:
    with forte(tmp_path) as address, connected(lambda: ManagementClient(address)) as client:
        yield client


def cases(seeds: Sequence[int]) -> list[Case]:
    found = []
    for seed in seeds:
        made = program(seed, lua=True)
        try:
            left = left_by(parse_algorithm(made.text), made.types, made.values)
        except (Fault, Unsaid):
            continue
        if all(_is_finite(value) for value in made.values.values()):
            found.append(Case(seed, made, left))
    return found


def _is_finite(value: Any) -> bool:
    """Whether a start value has a literal."""
    if isinstance(value, list):
        return all(_is_finite(item) for item in value)
    return not isinstance(value, float) or math.isfinite(value)


def block(case: Case) -> model.SimpleFBType:
    """A block that starts with the program's values, runs it, and tells whether it leaves what it shall."""
    types, values = case.program.types, case.program.values
    starts = "".join(_start(name, kind, values[name]) for name, kind in types.items() if name in values)
    tests = "".join(_test(name, kind, case.left[name]) for name, kind in types.items())
    outputs = (*(model.Variable(name, kind) for name, kind in types.items()), model.Variable(WRONG, STRING))
    ports = model.Interface((model.EventPort("REQ"),), (model.EventPort("CNF", (*types, WRONG)),), (), outputs)
    texts = {"REQ": starts + case.program.text, "TEST": f"{WRONG} := '';\n{tests}"}
    algorithms = tuple(model.Algorithm(name, model.Source(text)) for name, text in texts.items())
    state = model.ECState("REQ", (model.ECAction("REQ", ""), model.ECAction("TEST", "CNF")))
    return model.SimpleFBType(model.TypeHeader(f"CASE{case.seed}"), ports, (), (state,), algorithms)


def _start(name: str, kind: DataType, value: Any) -> str:
    if isinstance(kind, ArrayType):
        return "".join(_start(f"{name}[{kind.lower + k}]", kind.element, item) for k, item in enumerate(value))
    assert isinstance(kind, ElementaryType)
    return f"{name} := {format_literal(value, kind)};\n"


def _test(name: str, kind: DataType, value: Any) -> str:
    """Statements that note the variable if it has another value."""
    if isinstance(kind, ArrayType):
        return "".join(_test(f"{name}[{kind.lower + k}]", kind.element, item) for k, item in enumerate(value))
    assert isinstance(kind, ElementaryType)
    if isinstance(value, float) and not math.isfinite(value):
        sign = "<" if value < 0 else ">"
        right = f"{name} <> {name}" if math.isnan(value) else f"({name} = {name} + {name}) AND ({name} {sign} 0.0)"
    else:
        literal = format_literal(value, kind)
        right = f"{name} = {literal if kind.kind == 'string' else f'{kind}#{literal}'}"
    return f"IF NOT ({right}) THEN {WRONG} := CONCAT({WRONG}, '{name} '); END_IF;\n"


def differences(client: ManagementClient, resource: str, made: Sequence[Case]) -> list[str]:
    """Lets the programs run in a resource of their own; what they leave otherwise."""
    library = Library()
    for case in made:
        library.add(block(case))
    blocks = [model.Block(f"B{k}", f"CASE{case.seed}") for k, case in enumerate(made)]
    events = [("START.COLD", f"B{k}.REQ") for k in range(len(made))]
    events += [(f"B{k}.CNF", "COUNT.CU") for k in range(len(made))]
    wires = tuple(model.Connection(*ends) for ends in events)
    extra = (model.Block("START", "E_RESTART"), model.Block("COUNT", "E_CTU"))
    deploy(client, plan_deployment(resource, model.FBNetwork((*extra, *blocks), (), wires), library))
    until(lambda: client.read(resource, "COUNT.CV") == str(len(made)), "all programs have run")
    wrong = []
    for k, case in enumerate(made):
        for name in client.read(resource, f"B{k}.{WRONG}").split():
            variable = name.partition("[")[0]
            answer = client.read(resource, f"B{k}.{variable}")
            wrong.append(f"seed {case.seed}: {name}: {answer}, expected {case.left[variable]}\n{case.program.text}")
    client.kill(resource)
    return wrong


def test_programs_on_forte_leave_what_the_oracle_says(client: ManagementClient) -> None:
    wrong, count = [], 0
    for first in range(0, CASES, BATCH):
        made = cases(range(first, min(first + BATCH, CASES)))
        count += len(made)
        wrong += differences(client, f"R{first}", made)
    assert not wrong, "\n".join(wrong)
    assert count > CASES / 2
