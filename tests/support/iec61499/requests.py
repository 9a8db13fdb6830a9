"""Hypothesis strategies of management requests."""

from __future__ import annotations

from hypothesis import strategies as st

from iec61499.management.protocol import (
    ManagedBlock,
    ManagedConnection,
    ManagedType,
    Subject,
    Watch,
)

# what XML 1.0 can carry in an attribute unchanged: no control characters, no surrogates
printable = st.text(st.characters(exclude_categories=["Cs", "Cc", "Cn"]), max_size=20)
names = st.from_regex(r"[A-Za-z_][A-Za-z0-9_.]{0,10}", fullmatch=True)
subjects: st.SearchStrategy[Subject] = st.one_of(
    st.builds(ManagedBlock, names, names),
    st.builds(ManagedConnection, printable, names),
    st.builds(ManagedType, names, printable.map(str.strip)),
    st.builds(Watch, names | st.just("")),
)
