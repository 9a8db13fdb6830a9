"""How well a position-controlled arm does what it is told: from commands and positions alone."""
