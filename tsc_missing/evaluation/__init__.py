"""Runs: scenarios, the closed loop, result fields, run folders."""
