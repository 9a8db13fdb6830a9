"""Options that may be left out, as people see them: without the parser's own words for `X | None`."""

from __future__ import annotations

import types
from typing import Any, Final, Union, get_args, get_origin

from tyro.constructors import ConstructorRegistry, PrimitiveConstructorSpec, PrimitiveTypeInfo

NONE: Final = "None"
"""Takes back the default of such an option where it has one."""
NOTHING: Final = "unset"
"""How the default of such an option is shown."""

registry: Final = ConstructorRegistry()
"""Knows how the parser reads an option that is None where it is not given: as if it had to be given."""


@registry.primitive_rule
def _optional(info: PrimitiveTypeInfo) -> PrimitiveConstructorSpec[Any] | None:
    kinds = get_args(info.type)
    if get_origin(info.type) not in (Union, types.UnionType) or len(kinds) != 2 or type(None) not in kinds:
        return None
    (kind,) = (kind for kind in kinds if kind is not type(None))
    inner = ConstructorRegistry.get_primitive_spec(PrimitiveTypeInfo.make(kind, info.markers))
    if not isinstance(inner, PrimitiveConstructorSpec):
        return None
    return PrimitiveConstructorSpec(
        nargs=inner.nargs,
        metavar=inner.metavar,
        instance_from_str=lambda words: None if words == [NONE] else inner.instance_from_str(words),
        is_instance=lambda value: value is None or inner.is_instance(value),
        str_from_instance=lambda value: [NOTHING] if value is None else inner.str_from_instance(value),
        choices=inner.choices,
    )
