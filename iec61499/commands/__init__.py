"""The subcommands of `fb`."""
