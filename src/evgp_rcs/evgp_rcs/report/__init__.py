"""The report of a run, as one HTML page: for a jury that knows nothing of software."""
