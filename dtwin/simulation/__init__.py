"""The simulation module of the twin: try, choose, upload, watch and roll back settings of the controller.

`whatif` simulates one motion in closed loop with the analytic twin and the real function blocks, `optimise` searches
settings, `checks` refuses bad ones, `upload` applies them to a running controller between two ticks, and `trial`
judges them afterwards.
"""
