"""Options as people see them: the command's own ones first, without the parser's words for `X | None`."""

from __future__ import annotations

import types
from dataclasses import replace
from inspect import get_annotations
from typing import Annotated, Any, Final, Union, get_args, get_origin

from tyro.conf import arg
from tyro.constructors import (
    ConstructorRegistry,
    PrimitiveConstructorSpec,
    PrimitiveTypeInfo,
    StructConstructorSpec,
    StructFieldSpec,
    StructTypeInfo,
)

from dtwin.lengths import in_full

NONE: Final = "None"
"""Takes back the default of such an option where it has one."""
_SEEN: Final = object()
"""Marks options whose fields the parser has been asked for."""

registry: Final = ConstructorRegistry()
"""Knows how the parser reads an option that is None where it is not given: as if it had to be given."""


@registry.primitive_rule
def _optional(info: PrimitiveTypeInfo) -> PrimitiveConstructorSpec[Any] | None:
    kinds = get_args(info.type)
    if get_origin(info.type) not in (Union, types.UnionType) or len(kinds) != 2 or type(None) not in kinds:
        return None
    kind = in_full(next(kind for kind in kinds if kind is not type(None)))
    inner = ConstructorRegistry.get_primitive_spec(PrimitiveTypeInfo.make(kind, info.markers))
    if not isinstance(inner, PrimitiveConstructorSpec):
        return None
    return PrimitiveConstructorSpec(
        nargs=inner.nargs,
        metavar=inner.metavar,
        instance_from_str=lambda words: None if words == [NONE] else inner.instance_from_str(words),
        is_instance=lambda value: value is None or inner.is_instance(value),
        str_from_instance=lambda value: [NONE] if value is None else inner.str_from_instance(value),
        choices=inner.choices,
    )


def _without_default(field: StructFieldSpec) -> StructFieldSpec:
    silent: Any = Annotated[field.type, arg(help_behavior_hint="")]
    return replace(field, type=silent)


@registry.struct_rule
def _as_shown(info: StructTypeInfo) -> StructConstructorSpec | None:
    """Options in the order in which people read them, without a word about a default where there is none.

    What a command declares itself comes before what it shares with others.
    """
    if _SEEN in info.markers:
        return None
    found = ConstructorRegistry.get_struct_spec(replace(info, markers=(*info.markers, _SEEN)))
    if not isinstance(found, StructConstructorSpec):
        return None
    shown = [_without_default(field) if field.default is None else field for field in found.fields]
    bases = list(enumerate(getattr(info.type, "__mro__", ())))
    place = {name: rank for rank, base in reversed(bases) for name in get_annotations(base)}
    return replace(found, fields=tuple(sorted(shown, key=lambda field: place.get(field.name, 0))))
