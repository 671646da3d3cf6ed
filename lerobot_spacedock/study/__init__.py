"""Sweeps: demonstrations, stock ACT, held-out episodes, over a grid of settings; see ``docs/results.md``."""
