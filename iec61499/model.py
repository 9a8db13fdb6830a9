"""IEC 61499-2 library elements as frozen data: what a .fbt, .sub or .sys file says, with the lines it says it on.

Nothing here runs. Names are kept as written; comments and coordinates are kept for export and for diagrams.
A `line` is 1-based, 0 for elements that no file declares (the standard blocks).
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Any, TypeAlias

from iec61499.errors import FunctionBlockError
from iec61499.literals import constant_missing, parse_literal
from iec61499.types import ArrayType, DataType, ElementaryType, bytes_of
from iec61499.types import GenericType as GenericType

VariableType: TypeAlias = DataType | GenericType


@dataclass(frozen=True, slots=True)
class EventPort:
    """An event port; `with_variables` are sampled (input) or published (output) when it occurs.

    Inputs of a type other than `Event` are what E_TRIG triggers.
    """

    name: str
    with_variables: tuple[str, ...] = ()
    comment: str = ""
    line: int = 0
    type: str = "Event"


@dataclass(frozen=True, slots=True)
class Variable:
    """A data port or internal variable; `initial` is the literal as written, "" for the type's default."""

    name: str
    type: VariableType
    initial: str = ""
    comment: str = ""
    line: int = 0
    constant: bool = False


@dataclass(frozen=True, slots=True)
class AdapterPort:
    """A plug or socket; the events and data of its type are ports of the block, called `NAME.PORT`."""

    name: str
    type: AdapterType
    is_plug: bool
    comment: str = ""
    line: int = 0


@dataclass(frozen=True, slots=True)
class Interface:
    """The ports of a block type; those of its adapters are among them.

    `in_outs` are the names of the VAR_IN_OUT variables, which are among the inputs and among the outputs.
    """

    event_inputs: tuple[EventPort, ...] = ()
    event_outputs: tuple[EventPort, ...] = ()
    inputs: tuple[Variable, ...] = ()
    outputs: tuple[Variable, ...] = ()
    adapters: tuple[AdapterPort, ...] = ()
    in_outs: tuple[str, ...] = ()

    def names(self) -> tuple[str, ...]:
        """All port names, in the order of declaration."""
        events = (event.name for event in (*self.event_inputs, *self.event_outputs))
        data = dict.fromkeys(variable.name for variable in (*self.inputs, *self.outputs))
        return (*events, *data)


@dataclass(frozen=True, slots=True)
class Source:
    """Structured Text and where it stands.

    `exact` tells that line n of the text is line `line` + n - 1 of the file; text in an XML attribute has all its
    lines on one line of the file.
    """

    text: str
    line: int = 0
    exact: bool = False


@dataclass(frozen=True, slots=True)
class Algorithm:
    """A named algorithm in Structured Text."""

    name: str
    source: Source
    comment: str = ""
    line: int = 0


@dataclass(frozen=True, slots=True)
class ECAction:
    """Run `algorithm`, then issue the event `output`; "" leaves that part out."""

    algorithm: str = ""
    output: str = ""
    line: int = 0


@dataclass(frozen=True, slots=True)
class ECState:
    """A state of an execution control chart."""

    name: str
    actions: tuple[ECAction, ...] = ()
    x: float = 0.0
    y: float = 0.0
    comment: str = ""
    line: int = 0


@dataclass(frozen=True, slots=True)
class ECTransition:
    """A transition of a chart; it fires on `event` ("": without one) if `guard` holds ("": always)."""

    source: str
    destination: str
    event: str = ""
    guard: str = ""
    x: float = 0.0
    y: float = 0.0
    comment: str = ""
    line: int = 0


@dataclass(frozen=True, slots=True)
class Version:
    """One VersionInfo entry."""

    version: str = ""
    author: str = ""
    date: str = ""
    organization: str = ""
    remarks: str = ""


@dataclass(frozen=True, slots=True)
class TypeHeader:
    """Name, origin and documentation, which every library element has."""

    name: str
    file: str = ""
    line: int = 0
    comment: str = ""
    standard: str = ""
    description: str = ""
    versions: tuple[Version, ...] = ()
    package: str = ""


@dataclass(frozen=True, slots=True)
class AdapterType:
    """An adapter type; its interface is that of a socket as the block that has it sees it from inside."""

    header: TypeHeader
    interface: Interface


@dataclass(frozen=True, slots=True)
class InnerBlock:
    """A block inside a basic or simple one, which lets it react by `NAME.EVENT(...)`."""

    name: str
    type: FBType
    comment: str = ""
    line: int = 0


@dataclass(frozen=True, slots=True)
class BasicFBType:
    """A block whose behaviour is an execution control chart; the first state is the initial one.

    `constants` are those of namespaces (`NAMESPACE::NAME`) that its text uses, `absent` the names of those that there
    are not, and why. The variables of the blocks inside it
    are among the internal ones, called `BLOCK.VARIABLE`.
    """

    header: TypeHeader
    interface: Interface
    internals: tuple[Variable, ...] = ()
    states: tuple[ECState, ...] = ()
    transitions: tuple[ECTransition, ...] = ()
    algorithms: tuple[Algorithm, ...] = ()
    constants: tuple[Variable, ...] = ()
    blocks: tuple[InnerBlock, ...] = ()
    absent: tuple[tuple[str, str], ...] = ()


@dataclass(frozen=True, slots=True)
class SimpleFBType:
    """A block without a chart: on an event input the actions of the state of that name run, and nothing else."""

    header: TypeHeader
    interface: Interface
    internals: tuple[Variable, ...] = ()
    states: tuple[ECState, ...] = ()
    algorithms: tuple[Algorithm, ...] = ()
    constants: tuple[Variable, ...] = ()
    blocks: tuple[InnerBlock, ...] = ()
    absent: tuple[tuple[str, str], ...] = ()


@dataclass(frozen=True, slots=True)
class Parameter:
    """A literal given to a data input."""

    name: str
    value: str
    comment: str = ""
    line: int = 0


@dataclass(frozen=True, slots=True)
class Block:
    """An instance of a block type in a network; `types` are those of generic ports that connections may not tell."""

    name: str
    type_name: str
    parameters: tuple[Parameter, ...] = ()
    x: float = 0.0
    y: float = 0.0
    comment: str = ""
    line: int = 0
    types: tuple[tuple[str, DataType], ...] = ()


@dataclass(frozen=True, slots=True)
class Connection:
    """A connection between two ports, each `BLOCK.PORT` or, for a port of the enclosing type, `PORT`."""

    source: str
    destination: str
    comment: str = ""
    line: int = 0


@dataclass(frozen=True, slots=True)
class FBNetwork:
    """Blocks, subapplications and the connections between them; `file` is where the lines are."""

    blocks: tuple[Block, ...] = ()
    subapplications: tuple[SubApplication, ...] = ()
    events: tuple[Connection, ...] = ()
    data: tuple[Connection, ...] = ()
    file: str = ""
    adapters: tuple[Connection, ...] = ()


@dataclass(frozen=True, slots=True)
class SubApplication:
    """An instance of the subapplication type `type_name`, or ("") one with an interface and network of its own."""

    name: str
    type_name: str = ""
    interface: Interface = field(default_factory=Interface)
    network: FBNetwork = field(default_factory=FBNetwork)
    parameters: tuple[Parameter, ...] = ()
    x: float = 0.0
    y: float = 0.0
    comment: str = ""
    line: int = 0


@dataclass(frozen=True, slots=True)
class CompositeFBType:
    """A block whose behaviour is a network."""

    header: TypeHeader
    interface: Interface
    network: FBNetwork = field(default_factory=FBNetwork)


@dataclass(frozen=True, slots=True)
class SubApplicationType:
    """A network that is laid into the network that uses it (it has no event queue entries of its own)."""

    header: TypeHeader
    interface: Interface
    network: FBNetwork = field(default_factory=FBNetwork)


@dataclass(frozen=True, slots=True)
class ServiceInterfaceFBType:
    """A block known by its interface only; what it does is up to the platform."""

    header: TypeHeader
    interface: Interface


FBType: TypeAlias = BasicFBType | SimpleFBType | CompositeFBType | ServiceInterfaceFBType
LibraryElement: TypeAlias = FBType | SubApplicationType


@dataclass(frozen=True, slots=True)
class ApplicationDeclaration:
    """A network that is independent of devices."""

    name: str
    network: FBNetwork
    comment: str = ""
    line: int = 0


@dataclass(frozen=True, slots=True)
class ResourceDeclaration:
    """A resource of a device and the blocks that only it has."""

    name: str
    type_name: str
    network: FBNetwork = field(default_factory=FBNetwork)
    parameters: tuple[Parameter, ...] = ()
    comment: str = ""
    line: int = 0


@dataclass(frozen=True, slots=True)
class DeviceDeclaration:
    """A device and its resources."""

    name: str
    type_name: str
    resources: tuple[ResourceDeclaration, ...] = ()
    parameters: tuple[Parameter, ...] = ()
    comment: str = ""
    line: int = 0


@dataclass(frozen=True, slots=True)
class Mapping:
    """`APPLICATION.BLOCK` runs on `DEVICE.RESOURCE` (or `DEVICE.RESOURCE.BLOCK`, as older tools write it)."""

    source: str
    destination: str
    line: int = 0


@dataclass(frozen=True, slots=True)
class System:
    """A system configuration.

    Attributes:
        inserted: which communication blocks its file does not have.
        left_out: which blocks and connections of its file no resource has.
    """

    header: TypeHeader
    applications: tuple[ApplicationDeclaration, ...] = ()
    devices: tuple[DeviceDeclaration, ...] = ()
    mappings: tuple[Mapping, ...] = ()
    inserted: tuple[str, ...] = ()
    left_out: tuple[str, ...] = ()


def initial_value(variable: Variable, file: str = "") -> Any:
    """The value a variable starts with; None for a generic type, which has no value yet.

    A single literal for an array, as older versions of 4diac IDE write it, is that of every element.

    Raises:
        FunctionBlockError: the initial value is no literal of the variable's type.
    """
    if isinstance(variable.type, GenericType):
        return None
    if not variable.initial:
        return variable.type.default
    if isinstance(variable.type, ArrayType) and not variable.initial.lstrip().startswith("["):
        element = replace(variable, type=variable.type.element)
        return [initial_value(element, file) for _ in range(variable.type.length)]
    return literal(variable.initial, variable.type, file, variable.line)


def literal(text: str, data_type: DataType, file: str = "", line: int = 0) -> Any:
    """The value of a literal in a file; text for a STRING or WSTRING may lack quotes, as older tools write it.

    Raises:
        FunctionBlockError: the text is no literal of that type; names file and line.
    """
    stripped = text.strip()
    if isinstance(data_type, ElementaryType) and data_type.kind == "string":
        bare = stripped.partition("#")[2] if stripped.upper().startswith(("STRING#", "WSTRING#")) else stripped
        if not (len(bare) > 1 and bare[0] == bare[-1] and bare[0] in "'\""):
            return bytes_of(bare) if data_type.name == "STRING" else bare
        quote = "'" if data_type.name == "STRING" else '"'
        stripped = quote + bare[1:-1] + quote
    try:
        return parse_literal(stripped, data_type, file, line)
    except FunctionBlockError as error:
        raise FunctionBlockError(error.message + constant_missing(stripped), file, line, error.column) from None
