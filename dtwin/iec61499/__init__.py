"""IEC 61499 function blocks: libraries and systems as 4diac IDE writes them, and a runtime that executes them.

`library.Library` finds block types and reads systems, `mapping.resource_network` says what runs on a resource of a
system, and `runtime.Resource` runs it.
"""
