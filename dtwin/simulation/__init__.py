"""The third module of the twin: try settings on the twin, choose the best, upload them, watch them, take them back.

`whatif` closes the loop of the analytic twin and the real function blocks for one motion, `optimise` searches
settings, `checks` refuses bad ones, `upload` applies them to a running controller between two ticks.
"""
