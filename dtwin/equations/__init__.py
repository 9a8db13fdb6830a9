"""The equations of motion of a serial chain, told once for n joints."""
