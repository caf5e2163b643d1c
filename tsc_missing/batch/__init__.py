"""Batches: suites of runs, worker processes that run them, and the table of their results."""
