"""XML of block types: entities, size and depth are limited, and any bytes give an element or an error."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from dtwin.errors import FunctionBlockError
from iec61499.files.block_types import read_type, type_from_xml
from iec61499.files.xml import MAXIMUM_DEPTH, MAXIMUM_SIZE, parse_xml

REFUSED = re.compile("entit|not well-formed|deeper than 64")
BOMB = '<!DOCTYPE x [<!ENTITY a "ha"><!ENTITY b "&a;&a;&a;&a;&a;&a;&a;&a;">]><FBType Name="&b;"/>'
EXTERNAL = '<!DOCTYPE x [<!ENTITY a SYSTEM "file:///etc/hostname">]><FBType Name="A"><X>&a;</X></FBType>'
PARAMETER = '<!DOCTYPE x [<!ENTITY % p SYSTEM "file:///etc/hostname"> %p;]><FBType Name="A"/>'
LAUGHS = (
    "<!DOCTYPE l ["
    + "".join(f'<!ENTITY l{i + 1} "{f"&l{i};" * 10}">' for i in range(9))
    + '<!ENTITY l0 "lol">]><FBType Name="A">&l9;</FBType>'
)


@pytest.mark.parametrize("text", [BOMB, EXTERNAL, PARAMETER, LAUGHS])
def test_entities_are_refused(text: str) -> None:
    with pytest.raises(FunctionBlockError, match=REFUSED):
        parse_xml(text.encode(), "x.fbt")


def test_a_missing_or_remote_dtd_is_not_loaded(tmp_path: Path) -> None:
    text = f'<!DOCTYPE FBType SYSTEM "file://{tmp_path}/missing.dtd"><FBType Name="A"/>'
    assert parse_xml(text.encode(), "x.fbt").get("Name") == "A"
    with pytest.raises(FunctionBlockError, match=REFUSED):
        parse_xml(f'<!DOCTYPE A SYSTEM "file://{tmp_path}/x.dtd"><A>&e;</A>'.encode(), "x.fbt")


def test_size_and_depth_are_limited(tmp_path: Path) -> None:
    path = tmp_path / "BIG.fbt"
    path.write_bytes(b"<FBType>" + b" " * MAXIMUM_SIZE + b"</FBType>")
    with pytest.raises(FunctionBlockError, match=f"larger than {MAXIMUM_SIZE} bytes"):
        read_type(path)
    deepest = "<a>" * MAXIMUM_DEPTH + "</a>" * MAXIMUM_DEPTH
    assert parse_xml(deepest.encode(), "x").tag == "a"
    for depth in (MAXIMUM_DEPTH + 1, 100_000):
        with pytest.raises(FunctionBlockError, match=REFUSED):
            parse_xml(("<a>" * depth + "</a>" * depth).encode(), "x")


@given(st.binary(max_size=200))
def test_any_bytes_give_an_element_or_an_error(data: bytes) -> None:
    with pytest.raises(FunctionBlockError):
        type_from_xml(parse_xml(data, "x.fbt"))
