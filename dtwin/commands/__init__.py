"""The subcommands of `dtwin`: one module each, a dataclass of options with `execute() -> exit status`."""
