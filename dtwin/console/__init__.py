"""The operator's console: a web page of one cell, its displays, its commands, and who may give them."""
