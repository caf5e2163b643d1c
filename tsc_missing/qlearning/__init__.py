"""Policies learned by Q-learning in the closed loop: AttendLight, CoLight's kin, and a value."""
