"""`dtwin sbom`: what is installed, as a software bill of materials."""

from __future__ import annotations

import importlib.metadata
import sys
import uuid
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Final

import tyro
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

from dtwin.errors import DtwinError, choices
from dtwin.files import ensure_writable, replacing

if TYPE_CHECKING:
    from cyclonedx.model.bom import Bom
    from cyclonedx.model.component import Component, ComponentType
    from cyclonedx.model.license import License

Distribution = importlib.metadata.Distribution
_NAME: Final = "dtwin"
_CLASSIFIER: Final = "License :: "


@dataclass(frozen=True)
class Sbom:
    """Write a software bill of materials: dtwin and all that it needs as installed here, in CycloneDX 1.6 JSON.

    Equal installations give equal bytes. It needs the extra sbom.
    """

    out: Annotated[Path | None, tyro.conf.Positional] = None
    """File to write, *.cdx.json; standard output if not given."""
    extra: tuple[str, ...] = ()
    """Extra of dtwin whose distributions count, too, such as console; repeatable."""

    def execute(self) -> int:
        if self.out is not None:
            ensure_writable(self.out, ".json")
        text = bill(self.extra)
        if self.out is None:
            sys.stdout.write(text)
            return 0
        with replacing(self.out) as temporary:
            temporary.write_text(text, encoding="utf-8")
        return 0


def bill(extras: Iterable[str] = ()) -> str:
    """The bill of materials as JSON.

    Args:
        extras: extras of dtwin whose distributions count, too.

    Raises:
        DtwinError: dtwin or something that it needs is not installed, there is no extra of a name, or the extra sbom
            is missing.
    """
    try:
        from cyclonedx.output.json import JsonV1Dot6
    except ImportError:
        raise DtwinError("a bill of materials needs the extra sbom: pip install 'dtwin[sbom]'") from None
    text: str = JsonV1Dot6(_bom(installed(extras))).output_as_string(indent=2)
    return text + "\n"


def installed(extras: Iterable[str] = ()) -> dict[str, tuple[Distribution, frozenset[str]]]:
    """Distributions by their normalised names, dtwin first, each with the names of those that it needs itself.

    Raises:
        DtwinError: as `bill` does.
    """
    wanted = frozenset(extras)
    provided = _find(_NAME, _NAME).metadata.get_all("Provides-Extra") or []
    for extra in wanted - set(provided):
        raise DtwinError(f"--extra: expected {choices(provided)}, got {extra}")
    found: dict[str, tuple[Distribution, frozenset[str]]] = {}
    asked: dict[str, frozenset[str]] = {}
    waiting = [(_NAME, wanted, _NAME)]
    while waiting:
        name, chosen, needed_by = waiting.pop(0)
        if name in asked and chosen <= asked[name]:
            continue
        asked[name] = chosen | asked.get(name, frozenset())
        distribution = _find(name, needed_by)
        needs = list(_needs(distribution, asked[name]))
        found[name] = distribution, frozenset(each for each, _ in needs) - {name}
        waiting += [(each, options, name) for each, options in needs]
    return found


def _find(name: str, needed_by: str) -> Distribution:
    try:
        return importlib.metadata.distribution(name)
    except importlib.metadata.PackageNotFoundError:
        asked = "" if name == needed_by else f", which {needed_by} needs"
        raise DtwinError(
            f"{name}{asked}: expected it to be installed; pip check tells what else is missing"
        ) from None


def _needs(distribution: Distribution, extras: frozenset[str]) -> Iterator[tuple[str, frozenset[str]]]:
    """What a distribution needs here, with the extras that it asks for."""
    for line in distribution.requires or ():
        asked = Requirement(line)
        if asked.marker is None or any(asked.marker.evaluate({"extra": extra}) for extra in ("", *extras)):
            yield canonicalize_name(asked.name), frozenset(asked.extras)


def _bom(found: Mapping[str, tuple[Distribution, frozenset[str]]]) -> Bom:
    from cyclonedx.model.bom import Bom
    from cyclonedx.model.component import ComponentType

    components = {
        name: _component(each, ComponentType.APPLICATION if name == _NAME else ComponentType.LIBRARY)
        for name, (each, _) in found.items()
    }
    bom = Bom(components=[each for name, each in components.items() if name != _NAME])
    bom.metadata.component = components[_NAME]
    # The library wants a time and a random number, which would make two bills of one installation differ.
    bom.metadata.timestamp = datetime.fromtimestamp(0, UTC)
    bom.serial_number = uuid.uuid5(
        uuid.NAMESPACE_URL, " ".join(sorted(str(each.purl) for each in components.values()))
    )
    for name, (_, needs) in found.items():
        bom.register_dependency(components[name], [components[each] for each in sorted(needs)])
    return bom


def _component(distribution: Distribution, kind: ComponentType) -> Component:
    from cyclonedx.model.component import Component
    from packageurl import PackageURL

    name, version = distribution.metadata["Name"], distribution.version
    purl = PackageURL("pypi", name=canonicalize_name(name), version=version)
    return Component(
        name=name,
        version=version,
        type=kind,
        description=distribution.metadata["Summary"],
        purl=purl,
        bom_ref=str(purl),
        licenses=_licences(distribution),
    )


def _licences(distribution: Distribution) -> list[License]:
    """What a distribution says of its licence: an expression, or the names of its classifiers."""
    from cyclonedx.contrib.license.factories import LicenseFactory
    from cyclonedx.model import AttachedText

    make, said = LicenseFactory(), distribution.metadata
    if "License-Expression" in said:
        return [make.make_from_string(said["License-Expression"])]
    if names := [line.split(" :: ")[-1] for line in said.get_all("Classifier") or () if line.startswith(_CLASSIFIER)]:
        return [make.make_with_name(name) for name in names]
    licence = said["License"].strip() if "License" in said else ""
    if "\n" in licence:  # the whole text of it, whose first line is its name
        return [make.make_with_name(licence.partition("\n")[0], text=AttachedText(content=licence))]
    return [make.make_from_string(licence)] if licence else []
