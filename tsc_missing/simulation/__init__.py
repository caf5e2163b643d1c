"""The simulator: process, detectors, signals and outputs."""
