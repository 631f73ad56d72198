"""Grasp a block, carry it, and put it down."""
