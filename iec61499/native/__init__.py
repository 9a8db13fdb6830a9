"""Resources as machine code: C for a flat network, a compiler for it, and what runs the result in this process."""
