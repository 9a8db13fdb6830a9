"""IEC 61499 function blocks: libraries and systems as 4diac IDE writes them, and a runtime that executes them.

`library.Library` finds block types and reads systems, `mapping.resource_network` says what runs on a resource of a
system, `runtime.resource.Resource` runs it, and `device.embedded.EmbeddedDevice` serves it in real time.
Imports go from below to above: types, model, mapping and st; files; standard; library; runtime; net; management;
deploy and inspection; device.
"""

__version__ = "0.1.0"
