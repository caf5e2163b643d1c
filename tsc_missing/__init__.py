"""Traffic signal control that keeps working when sensors do not."""
