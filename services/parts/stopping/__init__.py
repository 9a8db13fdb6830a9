"""Who asks for a safe stop: the monitor about a failure, the watchdog about a monitor."""
