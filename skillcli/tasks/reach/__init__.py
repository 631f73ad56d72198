"""Bring the gripper to a point in space."""
