"""How well faults are found: a failing motor, many faults, slow sampling, safe stops."""
