"""The site is built from the pages without a network, its links lead somewhere, and it loads nothing."""

import re
import socket
from pathlib import Path
from typing import Any, NoReturn

import pytest
from lxml import html

from dtwin.commands.table import COMMANDS
from dtwin.parameters import ROOT

pytest.importorskip("material", reason="needs the extra docs: scripts/docs installs it")
pytest.importorskip("mkdocstrings", reason="needs the extra docs: scripts/docs installs it")


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The built site; any warning ends the build, and so does any connection."""
    from mkdocs.commands.build import build
    from mkdocs.config import load_config

    def refuse(*_: Any) -> NoReturn:
        raise AssertionError("the build asks the network")

    folder = tmp_path_factory.mktemp("site")
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("NO_MKDOCS_2_WARNING", "1")
        patch.setattr(socket.socket, "connect", refuse)
        patch.setattr(socket, "getaddrinfo", refuse)
        build(load_config(str(ROOT / "mkdocs.yml"), site_dir=str(folder), strict=True))
    return folder


def pages(site: Path) -> dict[str, Any]:
    return {path.name: html.parse(str(path)).getroot() for path in site.glob("*.html")}


def test_every_page_is_there_with_a_title(site: Path) -> None:
    built = pages(site)
    assert {path.stem for path in (ROOT / "docs").glob("*.md")} | {"commands"} <= {Path(name).stem for name in built}
    for name, page in built.items():
        assert page.findtext(".//title"), name


def test_nothing_is_loaded_from_elsewhere(site: Path) -> None:
    """Links for people may lead elsewhere; scripts, styles, pictures and fonts do not."""
    for name, page in pages(site).items():
        loaded = [
            *page.xpath("//script/@src | //img/@src | //iframe/@src"),
            *page.xpath("//link[@rel!='canonical']/@href"),
        ]
        assert not [address for address in loaded if re.match(r"(https?:)?//", address)], name
    for style in site.rglob("*.css"):
        assert not re.search(r"(url\(|@import )[\"']?(https?:)?//", style.read_text()), style


def test_links_to_places_of_a_page_lead_there(site: Path) -> None:
    built = pages(site)
    places = {name: set(page.xpath("//@id")) for name, page in built.items()}
    for name, page in built.items():
        for address in page.xpath("//article//a/@href"):
            if re.match(r"[a-z]+:", address) or name == "404.html":
                continue
            file, _, place = address.partition("#")
            assert (site / file).exists(), f"{name}: {address}"
            assert not place or place in places[file or name], f"{name}: {address}"


def test_every_equation_is_drawn_and_none_is_left(site: Path) -> None:
    for name, page in pages(site).items():
        assert not page.xpath("//*[@class='arithmatex']"), name
        source = ROOT / "docs" / name.replace(".html", ".md")
        if source.exists():
            drawn = page.xpath("//div[@class='equation']/*[local-name()='svg']")
            assert len(drawn) == source.read_text().count("```math\n")
            assert all(each.get("aria-label") for each in drawn)
    # One line below the other: such an environment, when it is not known, comes out as one long line.
    (masses,) = pages(site)["dynamics.html"].xpath("//svg[contains(@aria-label, 'M_{11}')]")
    assert float(masses.get("height")) > 7 * 18


def test_the_reference_has_every_command_with_every_option(site: Path) -> None:
    page = pages(site)["commands.html"]
    titles = {" ".join(title.text_content().split()).rstrip("¶").strip() for title in page.xpath("//h3")}
    assert titles == {f"dtwin {name}" for name in COMMANDS}
    (options,) = page.xpath("//h3[@id='dtwin-run']/following-sibling::div[.//table][1]") or page.xpath(
        "//h3[@id='dtwin-run']/following-sibling::table[1]"
    )
    assert "--fault STR" in options.text_content()
    assert str(ROOT) not in page.text_content()


def test_the_api_has_every_public_name_with_its_arguments(site: Path) -> None:
    import dtwin

    page = pages(site)["api.html"]
    places = set(page.xpath("//@id"))
    for name in dtwin.__all__:
        assert f"dtwin.{name}" in places
    assert "cell to take what no other argument says from" in page.text_content()
