"""The closed loop of blocks and any serial arm in machine code."""
