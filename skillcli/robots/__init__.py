"""Robots: their files, what is read from MJCF, servos, and the arm that skills are trained on."""
