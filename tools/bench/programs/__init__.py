"""The programs that are measured, or that prepare a measurement; each runs as its own process."""
