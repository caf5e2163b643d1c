"""Better values of phases from the simulator itself: simulate on with each phase, and learn it."""
