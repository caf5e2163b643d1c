"""Imputers: stages that fill the holes of observations."""
