"""The interface to an AI at a production line: what it can look at, ask, propose and have set up otherwise."""
