"""The analytic twin: kinematics, dynamics, rollouts and the regressor, independent of the emulation.

Import from the modules: nothing is re-exported here, so that the kinematics load without the compiler.
"""
