"""A service that this device does not have: a block that is known by its interface only, such as one of hardware.

Where its ports are those of IEC 61499-1, 6.1.3 (INIT and INITO, or REQ and CNF, with QO or STATUS), it answers with
QO = FALSE and says so in STATUS; so an application around it runs as on a device whose hardware does not answer.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Final

from iec61499 import model
from iec61499.runtime.service_interface import ServiceBehaviour
from iec61499.st.python.expressions import wiring_name

STATUS: Final = "NOT_SUPPORTED"
_ANSWERS: Final = {"INIT": ("INITO",), "REQ": ("CNF",), "RSP": ("IND",), "START": ("STARTO",), "STOP": ("STOPO",)}


def behaviour(block: model.ServiceInterfaceFBType) -> ServiceBehaviour | None:
    """The behaviour of such a block; None if it cannot say that it has none."""
    if not says_absent(block):
        return None
    outputs = {event.name for event in block.interface.event_outputs}
    answer = _answer(block)
    handlers = {
        event.name: _refusal([a for a in _ANSWERS.get(event.name, ()) if a in outputs], answer)
        for event in block.interface.event_inputs
    }
    return ServiceBehaviour(handlers)


def says_absent(block: model.ServiceInterfaceFBType) -> bool:
    """Whether the block's ports can say that there is no such service."""
    interface = block.interface
    inputs = {event.name for event in interface.event_inputs}
    outputs = {event.name for event in interface.event_outputs}
    answers = any(event in inputs and outputs & set(answer) for event, answer in _ANSWERS.items())
    return answers and bool(_answer(block))


def _answer(block: model.ServiceInterfaceFBType) -> dict[str, Any]:
    """The values of the outputs that say so."""
    kinds = {variable.name: getattr(variable.type, "kind", "") for variable in block.interface.outputs}
    said: dict[str, Any] = {"QO": False} if "QO" in kinds else {}
    return said | ({"STATUS": STATUS} if kinds.get("STATUS") == "string" else {})


def _refusal(answers: list[str], said: dict[str, Any]) -> Callable[[Any], None]:
    targets = [wiring_name(answer) for answer in answers]

    def refuse(s: Any) -> None:
        for name, value in said.items():
            setattr(s, name, value)
        for target in targets:
            s.extend__(getattr(s, target))

    return refuse
