"""The thesis's evaluation in one go: every test measured again, drawn, and held against what the thesis reports."""
