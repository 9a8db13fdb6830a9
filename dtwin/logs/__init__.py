"""Logs of runs, own and foreign: collected, kept, read, and checked before anything is made of them."""
