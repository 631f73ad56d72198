"""Vectorised environments: many simulations side by side, one call for all."""
