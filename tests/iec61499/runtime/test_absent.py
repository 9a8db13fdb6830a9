"""Blocks that are known by their interface only say that they do nothing."""

from __future__ import annotations

from pathlib import Path

import pytest

from dtwin.errors import FunctionBlockError
from dtwin.iec61499.inspection import inspect
from dtwin.iec61499.library import Library
from dtwin.iec61499.runtime.resource import Resource
from tests.support.iec61499.networks import network

SENSOR = """<FBType Name="Sensor"><InterfaceList>
<EventInputs><Event Name="INIT"><With Var="QI"/></Event><Event Name="REQ"/></EventInputs>
<EventOutputs><Event Name="INITO"><With Var="QO"/><With Var="STATUS"/></Event>
<Event Name="CNF"><With Var="QO"/></Event></EventOutputs>
<InputVars><VarDeclaration Name="QI" Type="BOOL"/></InputVars>
<OutputVars><VarDeclaration Name="QO" Type="BOOL"/><VarDeclaration Name="STATUS" Type="STRING"/></OutputVars>
</InterfaceList></FBType>"""


def test_a_missing_service_answers_no(tmp_path: Path) -> None:
    (tmp_path / "Sensor.fbt").write_text(SENSOR)
    library = Library([tmp_path])
    made = network(
        "START: E_RESTART; S: Sensor; A: E_CTU; B: E_CTU",
        "START.COLD -> S.INIT; S.INITO -> S.REQ; S.INITO -> A.CU; S.CNF -> B.CU",
        parameters={"S.QI": "TRUE"},
    )
    resource = Resource(made, library)
    resource.start()
    assert (resource.read("S.QO"), resource.read("S.STATUS")) == (False, "NOT_SUPPORTED")
    assert (resource.read("A.CV"), resource.read("B.CV")) == (1, 1)
    (problem,) = inspect(tmp_path / "Sensor.fbt", library).problems
    assert "Sensor is an interface only, a service that this device does not have" in str(problem)


def test_one_that_cannot_answer_does_not_run(tmp_path: Path) -> None:
    text = SENSOR.replace('Name="QO"', 'Name="Q"').replace('Var="QO"', 'Var="Q"')
    (tmp_path / "Sensor.fbt").write_text(text)
    with pytest.raises(FunctionBlockError, match="has an interface but no behaviour"):
        Resource(network("S: Sensor"), Library([tmp_path]))


def test_a_service_that_is_here_passes_the_check(tmp_path: Path) -> None:
    (tmp_path / "E_CYCLE.fbt").write_text(
        '<FBType Name="E_CYCLE"><InterfaceList><EventInputs><Event Name="START"/></EventInputs></InterfaceList>'
        "</FBType>"
    )
    assert inspect(tmp_path / "E_CYCLE.fbt", Library([tmp_path])).problems == ()
