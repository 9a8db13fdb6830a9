"""Any serial arm in MuJoCo: its model file read by MuJoCo's own compiler, and its emulation."""
