"""Monitoring of any serial arm: its own log from a healthy beginning on, or any log beside an identified arm."""
