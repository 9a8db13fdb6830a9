"""Pictures of a run in the Rerun viewer; no other part of the project uses Rerun.

Nothing here runs inside the tick: a log becomes columns of a recording on a time line in plant time.
"""

from dtwin.view.live import LiveView
from dtwin.view.monitoring import Predictions
from dtwin.view.viewer import Ports, Viewer, ViewerProcess, free_ports
from dtwin.view.write import write_recording

__all__ = [
    "LiveView",
    "Ports",
    "Predictions",
    "Viewer",
    "ViewerProcess",
    "free_ports",
    "write_recording",
]
