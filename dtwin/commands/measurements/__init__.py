"""Logs of other programs and other arms."""
