"""Campaigns: many independent tasks, done by processes of this machine or by the workers of a Dask cluster."""
