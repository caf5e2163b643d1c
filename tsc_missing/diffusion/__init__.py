"""DiffLight: one conditional diffusion model that fills in what sensors miss, and plans.

Pure torch on arrays; knows no simulator. Shapes throughout: B windows (N intersections when
deciding), T = C + H trajectory steps, L = 12 slots, F = 2 features, P phases.
"""
