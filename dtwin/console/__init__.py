"""The operator's seat: what a cell and its twin do, on one page."""
