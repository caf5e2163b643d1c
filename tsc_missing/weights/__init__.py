"""Weights of the diffusion controller that come with the package, a folder a name."""
