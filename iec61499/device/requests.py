"""Carries out management requests to one resource, and those about types."""

from __future__ import annotations

from xml.sax.saxutils import quoteattr

from iec61499 import model
from iec61499.deploy.border import border_type
from iec61499.deploy.device_type import DeviceType, original_name
from iec61499.deploy.lua_export import export_type
from iec61499.device.managed_resource import ManagedResource
from iec61499.errors import FunctionBlockError
from iec61499.library import Library
from iec61499.management.protocol import (
    ANY,
    EVENT,
    EVENT_COUNT,
    Change,
    ManagedBlock,
    ManagedConnection,
    ManagedType,
    ManagementError,
    Request,
    RequestAction,
    Response,
    Subject,
    Watch,
    Window,
)
from iec61499.runtime.blocks import UNCHANGED
from iec61499.standard.catalogue import standard_names
from iec61499.types import ELEMENTARY, ArrayType


def execute(resource: ManagedResource, request: Request, library: Library) -> Response:
    """Carries out a request to a resource.

    Raises:
        ManagementError: the request is refused; carries the reason.
    """
    action, subject = request.action, request.subject
    if isinstance(subject, ManagedType):
        return answer_on_types(request, subject, library)
    if subject is None:
        resource.change_state(action)
        return Response(request.id)
    if resource.fixed and _changes(resource, action, subject):
        raise ManagementError("INVALID_OPERATION", f"{resource.name}: {request}: {UNCHANGED}")
    if action == "QUERY":
        if isinstance(subject, ManagedBlock):
            return Response(request.id, blocks=resource.blocks())
        return Response(request.id, connections=resource.connections())
    if isinstance(subject, ManagedConnection):
        return _connections(resource, request, subject)
    if isinstance(subject, Watch):
        return _watches(resource, request, subject)
    if isinstance(subject, Change):
        return _change(resource, request)
    if isinstance(subject, Window):
        raise ManagementError("INVALID_OBJECT", f"{request}: expected it over a connection")
    if action == "CREATE":
        resource.create_block(subject.name, subject.type_name)
    elif action == "DELETE":
        resource.delete_block(subject.name)
    elif action in ("START", "STOP", "KILL", "RESET"):
        resource.change_block_state(subject.name, action)
    else:
        raise ManagementError("INVALID_OBJECT", f"{action}: expected a connection")
    return Response(request.id)


def _changes(resource: ManagedResource, action: RequestAction, subject: Subject) -> bool:
    """Whether a request changes what runs, as what is forced and events that are counted do at every start."""
    if isinstance(subject, Watch):
        return action == "CREATE" and resource.is_event(subject.source)
    if isinstance(subject, ManagedConnection) and action in ("READ", "WRITE"):
        return bool(subject.force)
    return resource.runs() and action != "QUERY"


def _connections(resource: ManagedResource, request: Request, subject: ManagedConnection) -> Response:
    action, given = request.action, subject.source
    if action == "READ":
        return Response(request.id, value=resource.read(subject.source))
    if action == "WRITE" and subject.force:
        if subject.force == "true":
            resource.force(subject.destination, given)
        else:
            resource.release(subject.destination)
    elif action == "WRITE" and given.lower() == EVENT:
        resource.trigger(subject.destination)
    elif action == "WRITE" and given.lower() == EVENT_COUNT:
        resource.reset_count(subject.destination)
    elif action == "WRITE":
        resource.write(subject.destination, given)
    elif action == "CREATE":
        resource.connect(given, subject.destination)
    elif action == "DELETE":
        resource.disconnect(given, subject.destination)
    else:
        raise ManagementError("INVALID_OBJECT", f"{action}: expected a block")
    return Response(request.id)


def _change(resource: ManagedResource, request: Request) -> Response:
    try:
        if request.action == "CREATE":
            resource.begin_change()
        elif request.action == "DELETE":
            resource.forget_change()
        else:
            resource.commit_change()
    except ManagementError as error:
        return Response(request.id, error.reason, detail=str(error))
    return Response(request.id)


def _watches(resource: ManagedResource, request: Request, subject: Watch) -> Response:
    if request.action == "READ" and not subject.source:
        return Response(request.id, watches={resource.name: resource.watched()})
    if request.action == "CREATE" and subject.source:
        resource.watch(subject.source)
    elif request.action == "DELETE" and subject.source:
        resource.unwatch(subject.source)
    else:
        raise ManagementError("UNSUPPORTED_CMD", f"{request}: expected to CREATE or DELETE a watch or READ all")
    return Response(request.id)


def asks_for_much(request: Request, subject: ManagedType) -> bool:
    """Whether `answer_on_types` looks through folders or exports a type as Lua, which takes long."""
    if request.action == "QUERY":
        return subject.name == ANY
    return request.action == "CREATE" and original_name(subject.name) is not None


def answer_on_types(request: Request, subject: ManagedType, library: Library) -> Response:
    """Lists the types of a device, describes one, or makes one known.

    Raises:
        ManagementError: the request is refused; carries the reason.
    """
    if request.action == "QUERY" and subject.name == ANY:
        names = {
            "FBType": (*library.names(), *standard_names()),
            "AdapterType": library.files(".adp"),
            "DataType": (*ELEMENTARY, *library.files(".dtp")),
        }
        return Response(request.id, names=names[subject.tag])
    if request.action not in ("CREATE", "QUERY") or subject.tag != "FBType":
        raise ManagementError("UNSUPPORTED_CMD", f"{request.action} {subject.tag}: expected CREATE or QUERY FBType")
    try:
        found = library.find(subject.name)
    except FunctionBlockError as error:
        if request.action == "QUERY":
            return Response(request.id, "UNSUPPORTED_TYPE")
        _adopt(library, subject, error)
        return Response(request.id)
    if request.action == "CREATE":
        return Response(request.id)
    return Response(request.id, interface=_described(found))


def _described(found: model.LibraryElement) -> str:
    """A type with its interface, as FORTE describes it."""
    interface = found.interface
    parts = {
        "EventInputs": map(_event, interface.event_inputs),
        "EventOutputs": map(_event, interface.event_outputs),
        "InputVars": map(_variable, interface.inputs),
        "OutputVars": map(_variable, interface.outputs),
    }
    filled = ((tag, "".join(ports)) for tag, ports in parts.items())
    body = "".join(f"<{tag}>{ports}</{tag}>" for tag, ports in filled if ports)
    name = quoteattr(found.header.name)
    return f'<FBType Comment="generated" Name={name}><InterfaceList>{body}</InterfaceList></FBType>'


def _event(event: model.EventPort) -> str:
    variables = "".join(f"<With Var={quoteattr(name)}/>" for name in event.with_variables)
    return f"<Event Name={quoteattr(event.name)}>{variables}</Event>"


def _variable(variable: model.Variable) -> str:
    kind = variable.type
    size = f' ArraySize="{kind.length}"' if isinstance(kind, ArrayType) else ""
    element = kind.element if isinstance(kind, ArrayType) else kind
    return f"<VarDeclaration Name={quoteattr(variable.name)} Type={quoteattr(str(element))}{size}/>"


def _exported(original: model.LibraryElement, unknown: FunctionBlockError) -> DeviceType:
    """A type as it is deployed. Raises the error for one that never is."""
    if isinstance(original, model.CompositeFBType):
        original = border_type(original)
    if not isinstance(original, model.BasicFBType | model.SimpleFBType):
        raise unknown
    return export_type(original)


def _adopt(library: Library, subject: ManagedType, unknown: FunctionBlockError) -> None:
    """Makes an exported type known: its text is Lua, which only a FORTE runs, so the library must have its original.

    Raises:
        ManagementError: the library does not have the original, or exports it as another text.
    """
    name = original_name(subject.name)
    try:
        if name is None:
            raise unknown
        exported = _exported(library.find(name), unknown)
        if exported.name != subject.name:
            # its file has changed since it was read
            exported = _exported(library.fresh(name), unknown)
    except FunctionBlockError as error:
        raise ManagementError("UNSUPPORTED_TYPE", str(error)) from None
    if exported.name != subject.name:
        problem = f"type {subject.name} is not what this device's {name} is as Lua, {exported.name}"
        raise ManagementError("UNSUPPORTED_TYPE", f"{problem}: expected the same library on both sides")
    library.add(exported.block)
