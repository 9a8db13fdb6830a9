"""The whole loop once: a fault, its diagnosis, a new model, new settings, and whether the arm tracks as before."""
