"""The console of a production line: what it is told of zones and stations, its commands, and a desk for each zone."""
