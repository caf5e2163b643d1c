"""Sensors: which of them report, and what an observation is."""
