"""Requests and responses of the management protocol as text."""

from __future__ import annotations

from typing import get_args

import pytest
from hypothesis import given
from hypothesis import strategies as st

from dtwin.errors import CommunicationError
from iec61499.management.protocol import (
    ManagedBlock,
    ManagedConnection,
    ManagedType,
    ManagementError,
    Reason,
    Request,
    RequestAction,
    Response,
    Watch,
    Watched,
    parse_request,
    parse_response,
    request_id,
)
from tests.support.iec61499.requests import names, subjects


@given(st.builds(Request, names, st.sampled_from(get_args(RequestAction)), subjects))
def test_a_printed_request_reads_back(request_: Request) -> None:
    assert parse_request(request_.xml()) == request_


@pytest.mark.parametrize(
    ("request_", "text"),
    [
        (
            Request("1", "CREATE", ManagedBlock("R", "EMB_RES")),
            '<Request ID="1" Action="CREATE"><FB Name="R" Type="EMB_RES" /></Request>',
        ),
        (
            Request("2", "WRITE", ManagedConnection("'a<b'", "S.ID")),
            '<Request ID="2" Action="WRITE"><Connection Source="&apos;a&lt;b&apos;" Destination="S.ID" /></Request>',
        ),
        (
            Request("3", "CREATE", ManagedType("X", "a > b")),
            '<Request ID="3" Action="CREATE"><FBType Name="X">a &gt; b</FBType></Request>',
        ),
        (Request("4", "START"), '<Request ID="4" Action="START"/>'),
        (
            Request("5", "CREATE", Watch("A.X")),
            '<Request ID="5" Action="CREATE"><Watch Source="A.X" Destination="*" /></Request>',
        ),
        (Request("6", "READ", Watch()), '<Request ID="6" Action="READ"><Watches/></Request>'),
    ],
)
def test_requests_look_as_4diac_writes_them(request_: Request, text: str) -> None:
    assert request_.xml() == text


@pytest.mark.parametrize("reason", get_args(Reason))
def test_every_reason_reads_back(reason: Reason) -> None:
    assert parse_response(Response("7", reason).xml()) == Response("7", reason)


@pytest.mark.parametrize(
    "response",
    [
        Response("1"),
        Response("1", value="it's <3"),
        Response("1", blocks=(ManagedBlock("START", "E_RESTART"), ManagedBlock("A", "E_SR"))),
        Response("1", connections=(ManagedConnection("A.EO", "B.EI"),)),
        Response("1", names=("E_SR", "F_ADD")),
        Response("1", watches={}),
        Response(
            "1",
            watches={
                "R": {"A.B.X": Watched("1.5", True), "A.Y": Watched("it's <3"), "A.E": Watched("3", is_event=True)}
            },
        ),
    ],
)
def test_every_response_reads_back(response: Response) -> None:
    assert parse_response(response.xml()) == response


@pytest.mark.parametrize(
    ("text", "response"),
    [
        ('<Response ID="1" />', Response("1")),
        ('<Response ID="3">\n  \n</Response>', Response("3")),
        ('<Response ID="4" Reason="BAD_PARAMS">\n  \n</Response>', Response("4", "BAD_PARAMS")),
        (
            '<Response ID="5">\n  <Connection Source="D.D" Destination="T#1.500ms" />\n</Response>',
            Response("5", value="T#1.500ms"),
        ),
        (
            '<Response ID="6">\n  <FBList>\n    <FB name="R" type="EMB_RES"/>\n  </FBList>\n</Response>',
            Response("6", blocks=(ManagedBlock("R", "EMB_RES"),)),
        ),
        (
            '<Response ID="9">\n  <Watches>\n    <Resource name="R"><FB name="P.Q"><Port name="X"><Data value="0.5" '
            'forced="false"/></Port><Port name="Y"><Data value="TRUE" forced="false"/></Port></FB></Resource>\n  '
            "</Watches>\n</Response>",
            Response("9", watches={"R": {"P.Q.X": Watched("0.5"), "P.Q.Y": Watched("TRUE")}}),
        ),
        ('<Response ID="9">\n  <Watches>\n    \n  </Watches>\n</Response>', Response("9", watches={})),
    ],
)
def test_responses_of_a_forte(text: str, response: Response) -> None:
    assert parse_response(text) == response


ENTITIES = '<!DOCTYPE Request [<!ENTITY a "b">%s]><Request ID="1" Action="START">&a;</Request>'
LAUGHS = "".join(f'<!ENTITY a{i + 1} "{f"&a{i};" * 10}">' for i in range(9)).replace("&a0;", "&a;")


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("", "INVALID_OBJECT"),
        ("<Request", "INVALID_OBJECT"),
        ("\0\0\0", "INVALID_OBJECT"),
        ('<Reques ID="1" Action="START"/>', "UNSUPPORTED_CMD"),
        ('<Request ID="1" Action="EXPLODE"/>', "UNSUPPORTED_CMD"),
        ('<Request ID="1" Action="CREATE"/>', "INVALID_OBJECT"),
        ('<Request ID="1" Action="CREATE"><Foo/></Request>', "INVALID_OBJECT"),
        ('<Request ID="1" Action="START"><FB/><FB/></Request>', "INVALID_OBJECT"),
        ('<Request ID="1" Action="START">' + "<FB>" * 100 + "</FB>" * 100 + "</Request>", "INVALID_OBJECT"),
        (ENTITIES % "", "INVALID_OBJECT"),
        (ENTITIES % LAUGHS, "INVALID_OBJECT"),
        (ENTITIES % '<!ENTITY f SYSTEM "file:///etc/passwd">', "INVALID_OBJECT"),
        ('<!DOCTYPE Request [<!ENTITY a "b">]><Request ID="&a;" Action="START"/>', "INVALID_OBJECT"),
        ('<!DOCTYPE Request SYSTEM "http://localhost:1/x.dtd"><Request ID="1" Action="START"/>', None),
    ],
)
def test_bad_requests_have_the_reason_a_forte_gives(text: str, reason: str | None) -> None:
    if reason is None:
        # an external subset is never loaded: what remains is the request
        assert parse_request(text) == Request("1", "START")
        return
    with pytest.raises(ManagementError) as caught:
        parse_request(text)
    assert caught.value.reason == reason
    assert "\n" not in str(caught.value)


@given(st.text(max_size=60))
def test_arbitrary_text_is_a_request_or_a_named_error(text: str) -> None:
    for parse, error in ((parse_request, ManagementError), (parse_response, CommunicationError)):
        with pytest.raises(error):
            parse(text.replace("Re", ""))
    assert len(request_id(text)) <= 100


@pytest.mark.parametrize(
    "text", ["", "<x/>", '<Response ID="1" Reason="MOOD"/>', '<!DOCTYPE a [<!ENTITY b "c">]><Response ID="&b;"/>']
)
def test_bad_responses(text: str) -> None:
    with pytest.raises(CommunicationError):
        parse_response(text)


def test_the_id_of_a_broken_request_is_found() -> None:
    assert request_id('<Request ID="12" Action="EXPLODE"') == "12"
    assert request_id("<Request ID=12>") == ""
