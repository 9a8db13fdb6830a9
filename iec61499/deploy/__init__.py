"""Builds a system on a device: the plan, block types as Lua, the requests."""
