"""Demand: recorded flows and drawn profiles as trips, and SUMO route files."""
