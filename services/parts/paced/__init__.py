"""The loop of an emulated machine on the bus: samples out, commands in, in every pace."""
