"""Controllers: an observation in, a phase for every intersection out."""
