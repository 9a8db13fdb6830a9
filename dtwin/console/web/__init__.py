"""The web server of a console."""
