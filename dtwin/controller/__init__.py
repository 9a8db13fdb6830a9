"""The function blocks bound to a plant: in process, in lockstep over TCP, or on a device that is managed."""
