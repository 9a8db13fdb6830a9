"""Blocks that are known by their interface only say that they do nothing."""

from __future__ import annotations

from pathlib import Path

import pytest

from dtwin.errors import FunctionBlockError
from iec61499.inspection import inspect
from iec61499.library import Library
from iec61499.runtime.resource import Resource
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
    found = inspect(tmp_path / "Sensor.fbt", library)
    assert found.problems == ()
    assert "Sensor is an interface only, a service that this device does not have" in found.warnings[0]


def test_one_that_cannot_answer_does_not_run(tmp_path: Path) -> None:
    text = SENSOR.replace("QO", "Q").replace("STATUS", "TEXT")
    (tmp_path / "Sensor.fbt").write_text(text)
    with pytest.raises(FunctionBlockError, match="has an interface but no behaviour"):
        Resource(network("S: Sensor"), Library([tmp_path]))


def test_one_that_has_a_status_answers_with_it(tmp_path: Path) -> None:
    (tmp_path / "Sensor.fbt").write_text(SENSOR.replace('Name="QO"', 'Name="Q"').replace('Var="QO"', 'Var="Q"'))
    library = Library([tmp_path])
    resource = Resource(network("S: Sensor; A: E_CTU", "S.CNF -> A.CU"), library)
    resource.trigger("S.REQ")
    resource.run_until_idle()
    assert (resource.read("S.STATUS"), resource.read("S.Q"), resource.read("A.CV")) == ("NOT_SUPPORTED", False, 1)


def test_hardware_of_a_system_is_in_the_remarks_of_its_check(tmp_path: Path) -> None:
    (tmp_path / "io.sys").write_text(
        '<System Name="io"><Device Name="D" Type="PC"><Resource Name="R" Type="EMB_RES"><FBNetwork>'
        '<FB Name="LAMP" Type="QX"/></FBNetwork></Resource></Device></System>'
    )
    found = inspect(tmp_path / "io.sys", Library([tmp_path]))
    assert found.problems == ()
    (remark,) = found.warnings
    assert "io.sys:1: LAMP is a QX, a service that this device does not have" in remark


def test_data_of_a_service_may_be_named_that_it_does_not_have(tmp_path: Path) -> None:
    text = SENSOR.replace('<Event Name="REQ"/>', '<Event Name="REQ"><With Var="NONE"/></Event>')
    (tmp_path / "Sensor.fbt").write_text(text)
    resource = Resource(network("S: Sensor"), Library([tmp_path]))
    resource.trigger("S.REQ")
    resource.run_until_idle()
    assert resource.read("S.STATUS") == "NOT_SUPPORTED"


def test_a_service_that_is_here_passes_the_check(tmp_path: Path) -> None:
    (tmp_path / "E_CYCLE.fbt").write_text(
        '<FBType Name="E_CYCLE"><InterfaceList><EventInputs><Event Name="START"/></EventInputs></InterfaceList>'
        "</FBType>"
    )
    assert inspect(tmp_path / "E_CYCLE.fbt", Library([tmp_path])).problems == ()
