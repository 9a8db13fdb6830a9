"""A digital twin of a box-sorting arm controlled by IEC 61499 function blocks."""

import os

__version__ = "0.1.0"

# The matrices here are small: threads of linear algebra would only wait for each other. Libraries read this when they
# are loaded, and processes that are started inherit it.
for _library in ("OPENBLAS", "OMP", "MKL"):
    os.environ.setdefault(f"{_library}_NUM_THREADS", "1")
