"""An arm as a value: a serial chain of n joints, its links, actuators and encoders."""
