"""What the closed loop costs in time and memory, against the bare simulator and sumo-rl."""
