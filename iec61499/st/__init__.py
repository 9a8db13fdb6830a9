"""Structured Text (IEC 61131-3, clause 7.3): parser, checker, printer, and compilers to Python and Lua."""
