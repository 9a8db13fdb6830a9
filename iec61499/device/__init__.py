"""The embedded runtime as a device that management can build on."""
