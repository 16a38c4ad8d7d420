"""Specimens: geometry, contact hypothesis, mesh, and the model to run."""
