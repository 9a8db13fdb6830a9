"""The last error that a service tells: what went wrong while it came up is over once it is ready."""

import logging

from dtwin.bus.messages import STATUS, Status
from dtwin.bus.opening import open_peer
from dtwin.bus.session import Bus
from dtwin.services.service import Link, Service
from tests.support.ports import free_port
from tests.support.waiting import until


def test_what_went_wrong_before_a_service_was_ready_does_not_stay_its_last_error() -> None:
    meet = f"tcp/127.0.0.1:{free_port()}"
    told: dict[str, str] = {}

    def take(status: Status) -> None:
        told[status.state] = status.last_error

    with Bus(open_peer(meet)) as bus, Service("simulation", Link(meet=meet)) as service:
        bus.subscribe(STATUS, Status, take, "simulation")
        logging.getLogger("dtwin").warning("the bridge does\nnot answer yet")

        def reported(state: str) -> bool:
            service.report("starting" if state == "starting" else "running")
            return state in told

        until(lambda: reported("starting"), "the status while it comes up")
        assert told["starting"] == "the bridge does not answer yet"
        service.ready()
        until(lambda: reported("running"), "the status of a service that is well")
        assert told["running"] == ""
        logging.getLogger("dtwin").warning("what is wrong now counts")
        until(lambda: reported("running") and told["running"] == "what is wrong now counts", "it is told")
