"""Pictures of a run in the Rerun viewer; no other part of the project uses Rerun.

Nothing here runs inside the tick: a log becomes columns of a recording on a time line in plant time. Import from the
modules: nothing is re-exported here, so that reading options does not load Rerun.
"""
